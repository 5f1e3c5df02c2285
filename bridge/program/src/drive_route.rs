//! `sidehill drive-route`: a stored route, lane by lane, as goals of a controller server that runs.
//!
//! A goal that ends before its end is a pause: what was left of it is sent again once the operator says so.

mod dug_places;
mod legs;
mod operator;

use crate::interrupts::Interrupts;
use crate::ros2::environment;
use anyhow::{Context, Result, bail, ensure};
use dug_places::DugPlaces;
use legs::{RouteLeg, apart_m, legs};
use operator::Operator;
use sidehill::config::{ConfigFile, RunConfig};
use sidehill::console;
use sidehill::drive::DriveRouteArgs;
use sidehill::exit::Exit;
use sidehill_bridge::ros2::arguments::RosArguments;
use sidehill_bridge::ros2::conversions::{from_pose, stamp, to_pose};
use sidehill_bridge::ros2::convert::world_from_base_link;
use sidehill_bridge::ros2::message::{self, Header, PoseStamped};
use sidehill_bridge::ros2::position::{AnyPosition, PositionTopic};
use sidehill_bridge::ros2::settings::server::Definition;
use sidehill_controller::path::{Direction, PendingActions, Point2, RouteAction};
use sidehill_plant::bounds::Bounds;
use sidehill_plant::frames::{Attitude, Pose};
use sidehill_ros2::client::{FollowPathClient, GoalEvent, GoalFailure};
use sidehill_ros2::positions::PositionNode;
use sidehill_ros2::server::requested_path::RequestedPath;
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// Interval at which messages are polled.
const PERIOD: Duration = Duration::from_millis(10);
/// Longest wait for the server: discovery without multicast takes 7 s.
const WAIT: Duration = Duration::from_secs(15);
/// Longest wait for the end of a goal that was cancelled: a vehicle stops within that.
const END: Duration = Duration::from_secs(5);
/// Way of a retreat, m: shorter ones may count as driven, longer ones are no small correction.
const RETREAT: Bounds = Bounds::new(0.5, 5.0, "m");

/// Drives a route and returns once it is driven, or the operator ends it.
///
/// # Errors
/// A configuration or route that cannot be used, invalid ROS arguments, or a server that is not there.
pub fn run(args: &DriveRouteArgs, ros: &[String]) -> Result<ExitCode> {
    let file = ConfigFile::read(&args.config)?;
    let config: RunConfig = file.parse()?;
    ensure!(
        config.over_ros2(),
        "{}: its paths do not come over ROS 2; `sidehill run` drives its `route`",
        file.name()
    );
    let vehicle = config.load_vehicle(&file)?;
    let ros2 = config.ros2(&file, &vehicle)?;
    let loaded = config.stored_route(&file, &vehicle, &args.route)?;
    for text in std::iter::once(&loaded.note).chain(&loaded.warnings) {
        console::complain(text);
    }
    let curve = loaded.trajectory.path().context("the route has no path")?;
    if curve.at(0.0).direction == Direction::Reverse && !ros2.follow_path.use_orientations {
        bail!(
            "{}: it begins in reverse, which a goal says only with ros2.follow_path.use_orientations: true",
            args.route.display()
        );
    }
    let goal_xy_m = ros2.tolerances.goal_xy_m;
    if let Some(retreat_m) = args.retreat_m {
        RETREAT.check("--retreat-m", retreat_m)?;
        ensure!(
            retreat_m > goal_xy_m,
            "--retreat-m {retreat_m}: a way within ros2.tolerances.goal_xy_m, {goal_xy_m} m, counts as driven"
        );
        ensure!(
            ros2.follow_path.use_orientations,
            "--retreat-m: the vehicle drives back in reverse, which a goal says only with \
             ros2.follow_path.use_orientations: true"
        );
        ensure!(
            ros2.follow_path.definition != Definition::Humble,
            "--retreat-m: a goal of ros2.follow_path.definition: humble does not say that the vehicle makes no progress"
        );
    }
    let limits = config.speed.limits(&config.settings.limits, &vehicle);
    let dug = DugPlaces::new(
        (args.go_round_m, &args.stuck_at),
        (&vehicle, ros2.smoothing.planned(limits.track_width_m)),
        (args.retreat_m, RETREAT),
    )?;
    let mut legs = legs(args, (curve, &loaded.actions), goal_xy_m)?;
    let all_m = legs.last().map_or(0.0, |leg| leg.ends_m);
    let from_m = match args.from_m {
        Some(from_m) => {
            let all_m = (10.0 * all_m).round() / 10.0;
            Bounds::new(0.0, all_m, "m").check("--from-m", from_m)?
        }
        None => 0.0,
    };
    let arguments = RosArguments::parse(ros)?;
    let operator = Operator::watch()?;
    let action = &ros2.follow_path;
    let mut way = None;
    if args.from_m.is_some() {
        legs.retain(|leg| leg.ends_m > from_m || leg.ends_m == all_m);
        let topic = format!("{}/odometry", ros2.node);
        let place = place_of_vehicle(topic, &arguments, &operator.interrupts)?;
        let first = legs.first().context("the route has no lane")?;
        way = first.way_to(from_m, place, (goal_xy_m, action.use_orientations))?;
    }
    let client = FollowPathClient::start("route_client", action, &arguments, &environment()?)?;
    let mut driver = Driver {
        client,
        operator,
        frame: ros2.frames.odometry,
        goal_xy_m,
        retreat_m: args.retreat_m,
        dug,
    };
    driver.find_server(&action.action)?;
    for leg in way.iter().chain(&legs) {
        if !driver.drive(leg, from_m)? {
            return Ok(Exit::Not.into());
        }
    }
    console::line(format_args!("the route is driven"));
    Ok(ExitCode::SUCCESS)
}

/// Returns where the vehicle is by the estimate that the server publishes on a topic, (x, y), m.
fn place_of_vehicle(
    topic: String,
    arguments: &RosArguments,
    interrupts: &Interrupts,
) -> Result<(f64, f64)> {
    let name = topic.clone();
    let topic = PositionTopic::Odometry(topic);
    let mut node = PositionNode::start("route_place", topic, arguments, &environment()?)?;
    let since = Instant::now();
    let mut place = None;
    loop {
        node.step(|message| {
            if let AnyPosition::Odometry(odometry) = message {
                let pose = from_pose(&odometry.pose.pose).map_err(|error| error.to_string())?;
                place = Some((pose.translation.x, pose.translation.y));
            }
            Ok(())
        });
        if let Some(place) = place {
            return Ok(place);
        }
        ensure!(
            since.elapsed() < WAIT && !interrupts.ended(),
            "--from-m: where the vehicle stands is not known: {}",
            node.missing().unwrap_or(name)
        );
        std::thread::sleep(PERIOD);
    }
}

struct Driver {
    client: FollowPathClient,
    operator: Operator,
    frame: String,
    goal_xy_m: f64,
    retreat_m: Option<f64>,
    dug: DugPlaces,
}

impl Driver {
    fn find_server(&mut self, action: &str) -> Result<()> {
        let since = Instant::now();
        while !self.client.has_server() {
            ensure!(
                since.elapsed() < WAIT && !self.operator.interrupts.ended(),
                "no controller server answers on {action}: is `sidehill run` up, with the same ROS_DOMAIN_ID and \
                 RMW_IMPLEMENTATION?"
            );
            std::thread::sleep(PERIOD);
        }
        Ok(())
    }

    /// Drives a leg from a place along all that is driven on, m, with its pauses; returns whether it was driven to its
    /// end.
    fn drive(&mut self, leg: &RouteLeg, from_m: f64) -> Result<bool> {
        let begun_m = (from_m.min(leg.ends_m) - leg.begins_m).max(0.0);
        let mut leg = match self.dug.lead(leg, begun_m) {
            Ok(leg) => leg,
            Err(reason) => return Ok(self.end(leg, leg.length_m() - begun_m, &reason)),
        };
        let mut left_m = leg.length_m() - begun_m;
        let ahead = leg.actions.iter().filter(|action| action.at_m >= begun_m);
        let mut actions = PendingActions::new(ahead.cloned().collect());
        console::line(format_args!("{}: {left_m:.1} m", leg.name));
        loop {
            let length_m = leg.length_m();
            let message = message_of(&self.frame, &leg.path, leg.rest(left_m));
            self.client.send(message);
            let mut joins = true;
            // Wheels that dig may have been taken for progress at first.
            let mut newest_left_m = left_m;
            let ended = self.follow(|client, now_left_m| {
                newest_left_m = now_left_m;
                left_m = left_m.min(now_left_m);
                let come_m = (length_m - now_left_m).max(0.0);
                if std::mem::take(&mut joins) {
                    actions.join(come_m);
                }
                act(client, actions.pass(come_m));
            });
            let Some(GoalFailure { mut reason, stuck }) = ended else {
                act(&self.client, actions.finish());
                return Ok(true);
            };
            if stuck && let Some(retreat_m) = self.retreat_m {
                let is_new = self.dug.mark(leg.point(newest_left_m));
                if self.dug.are_passed() && !is_new {
                    let reason = format!("{reason}; it was stuck there before");
                    return Ok(self.end(&leg, newest_left_m, &reason));
                }
                let come_m = length_m - left_m;
                let (back_m, is_whole) =
                    self.retreat(&leg, newest_left_m, retreat_m, &mut reason)?;
                left_m = newest_left_m + back_m;
                if is_whole && self.dug.are_passed() {
                    leg.actions.retain(|action| action.at_m > come_m);
                    match self.dug.lead(&leg, length_m - left_m) {
                        Ok(round) => {
                            console::complain(format_args!(
                                "{}: {reason}; the vehicle goes round the place",
                                leg.name
                            ));
                            left_m += round.length_m() - length_m;
                            actions = PendingActions::new(round.actions.clone());
                            leg = round;
                            continue;
                        }
                        Err(no_way) => reason += &format!("; {no_way}"),
                    }
                }
            }
            let ended = || self.operator.interrupts.ended();
            if !ended() {
                console::complain(format_args!(
                    "paused {}: {reason}; Enter or SIGUSR1 goes on, Ctrl-C ends",
                    leg.name_place(left_m)
                ));
            }
            while !ended() && !self.operator.goes_on() {
                std::thread::sleep(PERIOD);
            }
            if ended() {
                return Ok(self.end(&leg, left_m, ""));
            }
            console::line(format_args!(
                "{}: goes on, {left_m:.1} m are left",
                leg.name
            ));
        }
    }

    /// Says where a drive has ended early and how it goes on there; returns that it was not driven to its end.
    fn end(&self, leg: &RouteLeg, left_m: f64, reason: &str) -> bool {
        let separator = if reason.is_empty() { "" } else { ": " };
        console::complain(format_args!(
            "ended {}{separator}{reason}; with --from-m {:.1}{} it goes on there",
            leg.name_place(left_m),
            leg.place_m(left_m),
            self.dug.options()
        ));
        false
    }

    /// Drives back along a leg in reverse, from where so much of it is left; returns how far, m, and whether it was all of
    /// it, and adds it to the reason of the pause.
    fn retreat(
        &mut self,
        leg: &RouteLeg,
        left_m: f64,
        retreat_m: f64,
        reason: &mut String,
    ) -> Result<(f64, bool)> {
        let Point2 { x_m, y_m } = leg.point(left_m);
        let to_m = leg.begins_m + (leg.length_m() - left_m - retreat_m).max(0.0);
        let Some(way) = leg.way_to(to_m, (x_m, y_m), (self.goal_xy_m, true))? else {
            return Ok((0.0, false));
        };
        console::complain(format_args!(
            "{} at {:.1} m, x {x_m:.2} m, y {y_m:.2} m: {reason}; the vehicle drives back",
            leg.name,
            leg.place_m(left_m)
        ));
        self.client.send(message_of(&self.frame, &way.path, 0));
        let mut back_left_m = way.length_m();
        let failed = self.follow(|_, now_left_m| back_left_m = now_left_m);
        let is_whole = failed.is_none();
        match failed {
            None => back_left_m = 0.0,
            Some(failure) => *reason += &format!("; then {}", failure.reason),
        }
        let back_m = way.length_m() - back_left_m;
        *reason += &format!("; driven back {back_m:.1} m");
        Ok((back_m, is_whole))
    }

    /// Follows a goal to its end, and passes on what is left of it, m; returns why it ended early.
    fn follow(&mut self, mut left: impl FnMut(&FollowPathClient, f64)) -> Option<GoalFailure> {
        let mut cancelled: Option<Instant> = None;
        loop {
            match self.client.poll() {
                Some(GoalEvent::Left(left_m)) => left(&self.client, left_m),
                Some(GoalEvent::Succeeded) => return None,
                Some(GoalEvent::Rejected) => {
                    let reason = "the server rejects the goal; its log says why";
                    return Some(GoalFailure::new(reason));
                }
                Some(GoalEvent::Ended(_)) if cancelled.is_some() => {
                    return Some(GoalFailure::new("the operator has asked for it"));
                }
                Some(GoalEvent::Ended(failure)) => return Some(failure),
                None => {}
            }
            match cancelled {
                None if self.operator.pauses() || self.operator.interrupts.ended() => {
                    self.client.cancel();
                    cancelled = Some(Instant::now());
                }
                Some(since) if since.elapsed() > END => {
                    return Some(GoalFailure::new("the server does not answer"));
                }
                _ => {}
            }
            std::thread::sleep(PERIOD);
        }
    }
}

/// Returns the poses from an index on, stamped with the times from 0 at which the vehicle may be there at the earliest.
fn message_of(frame: &str, path: &RequestedPath, from: usize) -> message::Path {
    let mut message = message::Path::default();
    message.header.frame_id = frame.to_owned();
    let mut time_s = 0.0;
    for (index, at) in path.poses.iter().enumerate().skip(from) {
        let pose = Pose {
            x_m: at.x_m,
            y_m: at.y_m,
            z_m: 0.0,
            yaw_rad: at.yaw_rad,
        };
        message.poses.push(PoseStamped {
            header: Header {
                stamp: stamp((1e9 * time_s) as i64),
                frame_id: frame.to_owned(),
            },
            pose: to_pose(&world_from_base_link(&pose, &Attitude::LEVEL)),
        });
        if let (Some(speed_m_s), Some(next)) = (path.speed_m_s(index), path.poses.get(index + 1)) {
            time_s += apart_m(at, next) / speed_m_s;
        }
    }
    message
}

/// Says what is to be done where the vehicle is, here and to other programs.
fn act(client: &FollowPathClient, actions: &[RouteAction]) {
    for RouteAction { text, .. } in actions {
        console::line(format_args!("action: {text}"));
        client.publish_action(text);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sidehill_controller::path::{Path, Point2, RawPoint, Smoothing, smooth};
    use sidehill_plant::frames::PlanarPose;

    fn curve(points: &[(f64, f64)]) -> Path {
        let points: Vec<RawPoint> = points
            .iter()
            .map(|&(x_m, y_m)| RawPoint {
                position: Point2 { x_m, y_m },
                ..RawPoint::default()
            })
            .collect();
        smooth(&points, &Smoothing::default()).unwrap().path
    }

    fn arguments(lanes: u32, lane_m: Option<f64>, passes: u32) -> DriveRouteArgs {
        DriveRouteArgs {
            config: "run.yaml".into(),
            route: "lane".into(),
            lanes,
            lane_m,
            passes,
            from_m: None,
            retreat_m: None,
            go_round_m: None,
            stuck_at: Vec::new(),
        }
    }

    /// Ends of the legs, (x, y) of the first and of the last pose.
    fn ends(legs: &[RouteLeg]) -> Vec<[(f64, f64); 2]> {
        let place = |pose: &PlanarPose| {
            let centimetres = |value: f64| (100.0 * value).round() / 100.0 + 0.0;
            (centimetres(pose.x_m), centimetres(pose.y_m))
        };
        let both = |leg: &RouteLeg| {
            let poses = &leg.path.poses;
            [place(&poses[0]), place(poses.last().unwrap())]
        };
        legs.iter().map(both).collect()
    }

    #[test]
    fn lanes_lie_beside_each_other_and_are_driven_to_and_fro() {
        // Along Y_g: left is towards -X_g.
        let straight = curve(&[(0.0, 0.0), (0.0, 10.0)]);
        let found = legs(&arguments(3, Some(0.8), 1), (&straight, &[]), 0.25).unwrap();
        let expected = [
            [(0.0, 0.0), (0.0, 10.0)],
            [(0.0, 10.0), (-0.8, 10.0)],
            [(-0.8, 10.0), (-0.8, 0.0)],
            [(-0.8, 0.0), (-1.6, 0.0)],
            [(-1.6, 0.0), (-1.6, 10.0)],
        ];
        assert_eq!(ends(&found), expected);
        // Poses look where the vehicle drives: forward is (-sin psi, cos psi).
        for leg in &found {
            let (a, b) = (&leg.path.poses[0], &leg.path.poses[1]);
            let (sin, cos) = a.yaw_rad.sin_cos();
            let along = -sin * (b.x_m - a.x_m) + cos * (b.y_m - a.y_m);
            assert!((along - apart_m(a, b)).abs() < 1e-9, "{}", leg.name);
        }
        // Two passes end where they began; lanes closer than the goal's tolerance need no way between them.
        let found = legs(&arguments(1, None, 2), (&straight, &[]), 0.25).unwrap();
        assert_eq!(
            ends(&found),
            [[(0.0, 0.0), (0.0, 10.0)], [(0.0, 10.0), (0.0, 0.0)]]
        );
        assert!(legs(&arguments(2, None, 1), (&straight, &[]), 0.25).is_err());
        assert!(legs(&arguments(0, None, 1), (&straight, &[]), 0.25).is_err());
    }

    #[test]
    fn lanes_of_a_loop_are_driven_the_same_way_round() {
        let round = |i: u32| {
            let angle = std::f64::consts::TAU * f64::from(i) / 60.0;
            (5.0 * angle.cos(), 5.0 * angle.sin())
        };
        let points: Vec<(f64, f64)> = (0..=60).map(round).collect();
        let found = legs(&arguments(2, Some(0.8), 1), (&curve(&points), &[]), 0.25).unwrap();
        let lanes = [&found[0], &found[2]];
        // Counter-clockwise: the second lane is inside.
        let lengths = lanes.map(|leg| leg.length_m() / std::f64::consts::TAU);
        assert!(
            (lengths[0] - 5.0).abs() < 0.02 && (lengths[1] - 4.2).abs() < 0.02,
            "{lengths:?}"
        );
        assert!(lanes.iter().all(|leg| leg.path.poses[5].y_m > 0.0));
        // No lane fits beyond the centre.
        assert!(legs(&arguments(2, Some(6.0), 1), (&curve(&points), &[]), 0.25).is_err());
    }

    #[test]
    fn the_way_to_where_a_drive_begins_follows_its_lane() {
        let straight = curve(&[(0.0, 0.0), (0.0, 10.0)]);
        let lanes = legs(&arguments(2, Some(0.8), 1), (&straight, &[]), 0.25).unwrap();
        let [out, across, back] = &lanes[..] else {
            panic!("two lanes and the way between them");
        };
        assert!((across.ends_m - 10.8).abs() < 0.01 && (back.ends_m - 20.8).abs() < 0.01);
        assert!(
            (back.place_m(4.0) - 16.8).abs() < 0.01 && (back.place_m(3.91) - 16.8).abs() < 0.01
        );
        let way = |leg: &RouteLeg, from_m, place, reverses| {
            let way = leg.way_to(from_m, place, (0.25, reverses)).unwrap()?;
            assert_eq!((way.begins_m, way.place_m(1.0)), (from_m, from_m));
            let [first, last] = ends(std::slice::from_ref(&way))[0];
            Some((first, last, way.path.poses[0].yaw_rad))
        };
        assert_eq!(way(out, 3.0, (0.3, 3.1), false), None);
        // Ahead, and back: turned, or in reverse.
        let (from, to, _) = way(out, 7.0, (0.3, 3.0), false).unwrap();
        assert_eq!((from, to), ((0.0, 3.0), (0.0, 7.0)));
        for reverses in [false, true] {
            let (from, to, yaw_rad) = way(out, 3.0, (0.0, 7.0), reverses).unwrap();
            assert_eq!((from, to), ((0.0, 7.0), (0.0, 3.0)));
            assert_eq!(yaw_rad.cos() > 0.0, reverses);
        }
        // The second lane is driven towards y = 0.
        let (from, to, _) = way(back, 10.8 + 2.0, (-0.8, 3.0), false).unwrap();
        assert!((from.1 - 3.0).abs() < 0.1 && (to.1 - 8.0).abs() < 0.1);
        let error = out.way_to(3.0, (2.0, 3.0), (0.25, false)).err().unwrap();
        assert!(error.to_string().contains("stands 2.0 m from lane 1 of 2"));
    }

    #[test]
    fn what_is_left_begins_a_little_before_the_pause() {
        let straight = curve(&[(0.0, 0.0), (0.0, 10.0)]);
        let [leg] = &legs(&arguments(1, None, 1), (&straight, &[]), 0.25).unwrap()[..] else {
            panic!("one lane");
        };
        let from_m = leg.path.poses[leg.rest(4.0)].y_m;
        assert!((from_m - 5.5).abs() < 0.11, "{from_m}");
        assert_eq!(leg.rest(leg.length_m()), 0);
        assert!(leg.rest(0.0) <= leg.path.poses.len() - 2);
    }

    /// A straight route of 10 m with a slow stretch from 2 m to 5 m and an action at 4 m.
    fn slow_stretch() -> (Path, Vec<RouteAction>) {
        let rows = [(0.0, None), (2.0, Some(0.25)), (5.0, None), (10.0, None)];
        let points = rows.map(|(y_m, speed_m_s)| RawPoint {
            position: Point2 { x_m: 0.0, y_m },
            speed_m_s,
            ..RawPoint::default()
        });
        let action = RouteAction {
            at_m: 4.0,
            text: "probe".to_owned(),
        };
        let path = smooth(&points, &Smoothing::default()).unwrap().path;
        (path, vec![action])
    }

    #[test]
    fn lanes_have_the_speeds_and_actions_at_the_same_places_to_and_fro() {
        let (path, actions) = slow_stretch();
        let found = legs(&arguments(2, Some(0.8), 1), (&path, &actions), 0.25).unwrap();
        let [out, across, back] = &found[..] else {
            panic!("two lanes and the way between them");
        };
        assert!(across.actions.is_empty() && across.path.speeds_m_s.is_empty());
        assert!((out.actions[0].at_m - 4.0).abs() < 0.01);
        assert!((back.actions[0].at_m - 6.0).abs() < 0.01);
        for leg in [out, back] {
            let slow_m: f64 = (0..leg.path.poses.len() - 1)
                .filter(|&index| {
                    let [a, b] = [index, index + 1].map(|index| leg.path.poses[index].y_m);
                    let slow = leg.path.speed_m_s(index) == Some(0.25);
                    let within = (1.99..5.01).contains(&a) && (1.99..5.01).contains(&b);
                    assert_eq!(slow, within, "{}: {a} to {b}", leg.name);
                    slow
                })
                .map(|index| apart_m(&leg.path.poses[index], &leg.path.poses[index + 1]))
                .sum();
            assert!((slow_m - 3.0).abs() < 0.01, "{}: {slow_m}", leg.name);
        }
    }

    #[test]
    fn the_stamps_of_a_goal_say_the_speeds_of_its_stretches() {
        let (path, actions) = slow_stretch();
        let [leg] = &legs(&arguments(1, None, 1), (&path, &actions), 0.25).unwrap()[..] else {
            panic!("one lane");
        };
        let message = message_of("map", &leg.path, 0);
        let read = RequestedPath::from_message(&message).unwrap();
        assert_eq!(read.poses.len(), leg.path.poses.len());
        for (index, pose) in leg.path.poses.iter().enumerate() {
            match (read.speed_m_s(index), leg.path.speed_m_s(index)) {
                (Some(found), Some(expected)) => assert!((found / expected - 1.0).abs() < 1e-6),
                // Between poses at one place no time passes.
                (None, Some(_)) => {
                    assert!(apart_m(pose, &leg.path.poses[index + 1]) < 1e-9);
                }
                (found, expected) => assert_eq!(found, expected, "{}", pose.y_m),
            }
        }
        // What is left begins anew at 0, and without slow stretches there are no stamps.
        let rest = message_of("map", &leg.path, leg.rest(6.5));
        let stamps: Vec<f64> = rest
            .poses
            .iter()
            .map(|p| seconds(&p.header.stamp))
            .collect();
        assert_eq!(stamps[0], 0.0);
        assert!(
            (stamps[stamps.len() - 1] - (5.0 - 3.0) / 0.25).abs() < 0.5,
            "{stamps:?}"
        );
        let rest = message_of("map", &leg.path, leg.rest(3.0));
        assert!(
            rest.poses
                .iter()
                .all(|pose| seconds(&pose.header.stamp) == 0.0)
        );
    }

    fn seconds(stamp: &message::Time) -> f64 {
        f64::from(stamp.sec) + 1e-9 * f64::from(stamp.nanosec)
    }
}
