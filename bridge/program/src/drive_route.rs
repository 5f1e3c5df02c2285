//! `sidehill drive-route`: a stored route, lane by lane, as goals of a controller server that runs.
//!
//! A goal that ends before its end is a pause: what was left of it is sent again once the operator says so.

use crate::interrupts::Interrupts;
use crate::ros2::environment;
use anyhow::{Context, Result, bail, ensure};
use sidehill::config::{ConfigFile, RunConfig};
use sidehill::console;
use sidehill::drive::DriveRouteArgs;
use sidehill::exit::Exit;
use sidehill_bridge::ros2::arguments::RosArguments;
use sidehill_bridge::ros2::conversions::to_pose;
use sidehill_bridge::ros2::convert::world_from_base_link;
use sidehill_bridge::ros2::message::{self, PoseStamped};
use sidehill_controller::path::{Aside, Direction, Path};
use sidehill_plant::bounds::Bounds;
use sidehill_plant::frames::{Attitude, PlanarPose, Pose};
use sidehill_ros2::client::{FollowPathClient, GoalEvent};
use sidehill_ros2::server::requested_path::RequestedPath;
use signal_hook::consts::{SIGUSR1, SIGUSR2};
use signal_hook::flag::register;
use std::f64::consts::PI;
use std::io::BufRead;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Interval at which messages are polled.
const PERIOD: Duration = Duration::from_millis(10);
/// Longest wait for the server: discovery without multicast takes 7 s.
const WAIT: Duration = Duration::from_secs(15);
/// Longest wait for the end of a goal that was cancelled: a vehicle stops within that.
const END: Duration = Duration::from_secs(5);
/// A route whose ends are closer than this is a loop, m.
const LOOP_M: f64 = 1.0;
/// Way before the place of a pause at which the rest begins, m: the vehicle joins at the nearest pose.
const BEFORE_M: f64 = 0.5;
/// Largest number of lanes, and of passes.
const LANES_MAX: f64 = 1000.0;

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
    let legs = legs(args, curve, ros2.tolerances.goal_xy_m)?;
    let arguments = RosArguments::parse(ros)?;
    let operator = Operator::watch()?;
    let action = &ros2.follow_path;
    let client = FollowPathClient::start("route_client", action, &arguments, &environment()?)?;
    let mut driver = Driver {
        client,
        operator,
        frame: ros2.frames.odometry,
    };
    driver.find_server(&action.action)?;
    for leg in &legs {
        if !driver.drive(leg)? {
            return Ok(Exit::Not.into());
        }
    }
    console::line(format_args!("the route is driven"));
    Ok(ExitCode::SUCCESS)
}

/// A stretch that is driven as a goal.
struct RouteLeg {
    name: String,
    poses: Vec<PlanarPose>,
}

impl RouteLeg {
    fn length_m(&self) -> f64 {
        let steps = self.poses.windows(2);
        steps.map(|pair| apart_m(&pair[0], &pair[1])).sum()
    }

    /// Returns the poses from a little before the place on at which so much is left.
    fn rest(&self, left_m: f64) -> &[PlanarPose] {
        let mut behind_m = 0.0;
        let mut from = self.poses.len() - 1;
        while from > 0 && behind_m < left_m + BEFORE_M {
            from -= 1;
            behind_m += apart_m(&self.poses[from], &self.poses[from + 1]);
        }
        &self.poses[from..]
    }
}

fn apart_m(a: &PlanarPose, b: &PlanarPose) -> f64 {
    (b.x_m - a.x_m).hypot(b.y_m - a.y_m)
}

/// Returns lanes beside a curve and the ways from one to the next, in the order in which they are driven.
fn legs(args: &DriveRouteArgs, curve: &Path, goal_xy_m: f64) -> Result<Vec<RouteLeg>> {
    let count = Bounds::new(1.0, LANES_MAX, "");
    count.check("--lanes", f64::from(args.lanes))?;
    count.check("--passes", f64::from(args.passes))?;
    let lane_m = match args.lane_m {
        Some(lane_m) => Bounds::new(-100.0, 100.0, "m").check("--lane-m", lane_m)?,
        None if args.lanes == 1 => 0.0,
        None => bail!("--lanes: the distance from lane to lane is missing, as --lane-m 0.8"),
    };
    let ends_m = apart_m(&curve.at(0.0).pose(), &curve.at(curve.length_m()).pose());
    let is_loop = ends_m < LOOP_M;
    let lanes = (0..args.lanes).map(|lane| {
        let left_m = f64::from(lane) * lane_m;
        if left_m == 0.0 {
            return Ok(RequestedPath::from_curve("", curve).poses);
        }
        let aside = Aside {
            left_m,
            ..Aside::NONE
        };
        let moved = curve.moved_aside(|_| aside).with_context(|| {
            format!("--lane-m: lane {} is beyond the centre of a bend", lane + 1)
        })?;
        Ok(RequestedPath::from_curve("", &moved.path).poses)
    });
    let lanes: Vec<Vec<PlanarPose>> = lanes.collect::<Result<_>>()?;
    let mut legs: Vec<RouteLeg> = Vec::new();
    for pass in 0..args.passes {
        for index in 0..args.lanes {
            // Back the way it came.
            let lane = match pass % 2 {
                0 => index,
                _ => args.lanes - 1 - index,
            };
            let mut poses = lanes[lane as usize].clone();
            if !is_loop && (pass * args.lanes + index) % 2 == 1 {
                poses.reverse();
                poses.iter_mut().for_each(|pose| pose.yaw_rad += PI);
            }
            if let (Some(from), Some(to)) =
                (legs.last().and_then(|leg| leg.poses.last()), poses.first())
                && apart_m(from, to) > goal_xy_m
            {
                let across = across(from, to);
                legs.push(RouteLeg {
                    name: format!("way to lane {}", lane + 1),
                    poses: across,
                });
            }
            let mut name = format!("lane {} of {}", lane + 1, args.lanes);
            if args.passes > 1 {
                name += &format!(", pass {} of {}", pass + 1, args.passes);
            }
            legs.push(RouteLeg { name, poses });
        }
    }
    Ok(legs)
}

/// Returns poses straight from one place to another.
fn across(from: &PlanarPose, to: &PlanarPose) -> Vec<PlanarPose> {
    let steps = (apart_m(from, to) / 0.1).ceil().max(1.0) as usize;
    let yaw_rad = (from.x_m - to.x_m).atan2(to.y_m - from.y_m);
    (0..=steps)
        .map(|step| step as f64 / steps as f64)
        .map(|share| PlanarPose {
            x_m: from.x_m + share * (to.x_m - from.x_m),
            y_m: from.y_m + share * (to.y_m - from.y_m),
            yaw_rad,
        })
        .collect()
}

/// What the operator wants: by signals, or by Enter.
struct Operator {
    interrupts: Interrupts,
    go_on: Arc<AtomicBool>,
    pause: Arc<AtomicBool>,
    toggle: Arc<AtomicBool>,
}

impl Operator {
    fn watch() -> Result<Self> {
        let interrupts = Interrupts::watch()?;
        let (go_on, pause, toggle) =
            <(Arc<AtomicBool>, Arc<AtomicBool>, Arc<AtomicBool>)>::default();
        register(SIGUSR1, Arc::clone(&go_on))?;
        register(SIGUSR2, Arc::clone(&pause))?;
        let pressed = Arc::clone(&toggle);
        // Ends with the program.
        std::thread::spawn(move || {
            for _ in std::io::stdin().lock().lines().map_while(Result::ok) {
                pressed.store(true, Ordering::Relaxed);
            }
        });
        Ok(Self {
            interrupts,
            go_on,
            pause,
            toggle,
        })
    }

    fn pauses(&self) -> bool {
        self.go_on.store(false, Ordering::Relaxed);
        let signalled = self.pause.swap(false, Ordering::Relaxed);
        self.toggle.swap(false, Ordering::Relaxed) || signalled
    }

    fn goes_on(&self) -> bool {
        self.pause.store(false, Ordering::Relaxed);
        let signalled = self.go_on.swap(false, Ordering::Relaxed);
        self.toggle.swap(false, Ordering::Relaxed) || signalled
    }
}

struct Driver {
    client: FollowPathClient,
    operator: Operator,
    frame: String,
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

    /// Drives a leg, with its pauses; returns whether it was driven to its end.
    fn drive(&mut self, leg: &RouteLeg) -> Result<bool> {
        let mut left_m = leg.length_m();
        console::line(format_args!("{}: {left_m:.1} m", leg.name));
        loop {
            self.client.send(self.message(leg.rest(left_m)));
            let Some(reason) = self.follow(&mut left_m) else {
                return Ok(true);
            };
            let name = &leg.name;
            if self.operator.interrupts.ended() {
                console::complain(format_args!("ended {left_m:.1} m before the end of {name}"));
                return Ok(false);
            }
            console::complain(format_args!(
                "paused {left_m:.1} m before the end of {name}: {reason}; Enter or SIGUSR1 goes on, Ctrl-C ends"
            ));
            while !self.operator.goes_on() {
                if self.operator.interrupts.ended() {
                    console::complain(format_args!("ended {left_m:.1} m before the end of {name}"));
                    return Ok(false);
                }
                std::thread::sleep(PERIOD);
            }
            console::line(format_args!("{name}: goes on, {left_m:.1} m are left"));
        }
    }

    /// Follows a goal to its end; returns why it ended early.
    fn follow(&mut self, left_m: &mut f64) -> Option<String> {
        let mut cancelled: Option<Instant> = None;
        loop {
            match self.client.poll() {
                Some(GoalEvent::Left(metres)) => *left_m = left_m.min(metres),
                Some(GoalEvent::Succeeded) => return None,
                Some(GoalEvent::Rejected) => {
                    return Some("the server rejects the goal; its log says why".to_owned());
                }
                Some(GoalEvent::Ended(_)) if cancelled.is_some() => {
                    return Some("the operator has asked for it".to_owned());
                }
                Some(GoalEvent::Ended(reason)) => return Some(reason),
                None => {}
            }
            match cancelled {
                None if self.operator.pauses() || self.operator.interrupts.ended() => {
                    self.client.cancel();
                    cancelled = Some(Instant::now());
                }
                Some(since) if since.elapsed() > END => {
                    return Some("the server does not answer".to_owned());
                }
                _ => {}
            }
            std::thread::sleep(PERIOD);
        }
    }

    fn message(&self, poses: &[PlanarPose]) -> message::Path {
        let mut path = message::Path::default();
        path.header.frame_id = self.frame.clone();
        path.poses = poses
            .iter()
            .map(|pose| {
                let pose = Pose {
                    x_m: pose.x_m,
                    y_m: pose.y_m,
                    z_m: 0.0,
                    yaw_rad: pose.yaw_rad,
                };
                PoseStamped {
                    header: path.header.clone(),
                    pose: to_pose(&world_from_base_link(&pose, &Attitude::LEVEL)),
                }
            })
            .collect();
        path
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sidehill_controller::path::{Point2, RawPoint, Smoothing, smooth};

    fn curve(points: &[(f64, f64)]) -> Path {
        let points: Vec<RawPoint> = points
            .iter()
            .map(|&(x_m, y_m)| RawPoint {
                position: Point2 { x_m, y_m },
                elevation_m: None,
                direction: None,
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
        }
    }

    /// Ends of the legs, (x, y) of the first and of the last pose.
    fn ends(legs: &[RouteLeg]) -> Vec<[(f64, f64); 2]> {
        let place = |pose: &PlanarPose| {
            let centimetres = |value: f64| (100.0 * value).round() / 100.0 + 0.0;
            (centimetres(pose.x_m), centimetres(pose.y_m))
        };
        let both = |leg: &RouteLeg| [place(&leg.poses[0]), place(leg.poses.last().unwrap())];
        legs.iter().map(both).collect()
    }

    #[test]
    fn lanes_lie_beside_each_other_and_are_driven_to_and_fro() {
        // Along Y_g: left is towards -X_g.
        let straight = curve(&[(0.0, 0.0), (0.0, 10.0)]);
        let found = legs(&arguments(3, Some(0.8), 1), &straight, 0.25).unwrap();
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
            let (a, b) = (&leg.poses[0], &leg.poses[1]);
            let (sin, cos) = a.yaw_rad.sin_cos();
            let along = -sin * (b.x_m - a.x_m) + cos * (b.y_m - a.y_m);
            assert!((along - apart_m(a, b)).abs() < 1e-9, "{}", leg.name);
        }
        // Two passes end where they began; lanes closer than the goal's tolerance need no way between them.
        let found = legs(&arguments(1, None, 2), &straight, 0.25).unwrap();
        assert_eq!(
            ends(&found),
            [[(0.0, 0.0), (0.0, 10.0)], [(0.0, 10.0), (0.0, 0.0)]]
        );
        assert!(legs(&arguments(2, None, 1), &straight, 0.25).is_err());
        assert!(legs(&arguments(0, None, 1), &straight, 0.25).is_err());
    }

    #[test]
    fn lanes_of_a_loop_are_driven_the_same_way_round() {
        let round = |i: u32| {
            let angle = std::f64::consts::TAU * f64::from(i) / 60.0;
            (5.0 * angle.cos(), 5.0 * angle.sin())
        };
        let points: Vec<(f64, f64)> = (0..=60).map(round).collect();
        let found = legs(&arguments(2, Some(0.8), 1), &curve(&points), 0.25).unwrap();
        let lanes = [&found[0], &found[2]];
        // Counter-clockwise: the second lane is inside.
        let lengths = lanes.map(|leg| leg.length_m() / std::f64::consts::TAU);
        assert!(
            (lengths[0] - 5.0).abs() < 0.02 && (lengths[1] - 4.2).abs() < 0.02,
            "{lengths:?}"
        );
        assert!(lanes.iter().all(|leg| leg.poses[5].y_m > 0.0));
        // No lane fits beyond the centre.
        assert!(legs(&arguments(2, Some(6.0), 1), &curve(&points), 0.25).is_err());
    }

    #[test]
    fn what_is_left_begins_a_little_before_the_pause() {
        let straight = curve(&[(0.0, 0.0), (0.0, 10.0)]);
        let [leg] = &legs(&arguments(1, None, 1), &straight, 0.25).unwrap()[..] else {
            panic!("one lane");
        };
        let rest = leg.rest(4.0);
        assert!((rest[0].y_m - 5.5).abs() < 0.11, "{}", rest[0].y_m);
        assert_eq!(leg.rest(leg.length_m()).len(), leg.poses.len());
        assert!(leg.rest(0.0).len() >= 2);
    }
}
