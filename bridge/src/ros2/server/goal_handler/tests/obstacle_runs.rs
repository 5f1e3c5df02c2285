//! Random obstacles in closed loop: goal handler, controller, safety and a simulated vehicle in virtual time.
//! Only the middleware is missing: costmaps are handed over as they would be received.

use super::obstacles::Costmaps;
use super::*;
use crate::control_loop::channel::{CommandClient, LoopEnd, command_channel};
use crate::control_loop::record::{LoopRecord, RecordSource, ring};
use crate::control_loop::runner::InlineRunner;
use crate::control_loop::{ControlLoop, CycleConfig};
use crate::drives::Clock;
use crate::ros2::server::obstacles::config::CostmapConfig;
use crate::rover::{DriveConfig, SimulatedPort};
use crate::safety::{OperatorRequests, SafetyConfig};
use sidehill_controller::config::{ControllerConfig, ControllerKind};
use sidehill_controller::controller::Controller;
use sidehill_controller::speed_profile::SpeedConfig;
use sidehill_plant::contact::{ContactModel, ContactVehicle};
use sidehill_plant::motion::{IcrMotion, MotionModel};
use sidehill_plant::simulation::{Simulation, SimulationSetup};
use sidehill_plant::speeds::EncoderScale;
use sidehill_plant::terrain::{PlaneTerrain, Terrain};

const NOTHING: OperatorRequests = OperatorRequests {
    arm: false,
    stop: None,
    halt: None,
};
const PERIOD_S: f64 = 0.05;
/// Between two costmaps, and from what they show until they are there, s.
const COSTMAP_PERIOD_S: f64 = 0.2;
const COSTMAP_LATENCY_S: f64 = 0.1;

/// Uniform numbers from 0 to 1 (SplitMix64).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }
}

/// A post that stands from one instant to another.
struct Post {
    x_m: f64,
    y_m: f64,
    radius_m: f64,
    /// Where the vehicle is along the path when it appears, m, and how long it stays, s.
    appears_m: f64,
    stays_s: f64,
    since_s: Option<f64>,
}

impl Post {
    fn stands(&self, now_s: f64) -> bool {
        self.since_s
            .is_some_and(|since_s| (since_s..since_s + self.stays_s).contains(&now_s))
    }

    /// Distance from the base rectangle of the J8 at its true pose, m; negative inside.
    fn gap_m(&self, pose: &PlanarPose) -> f64 {
        let (sin, cos) = pose.yaw_rad.sin_cos();
        let (x, y) = (self.x_m - pose.x_m, self.y_m - pose.y_m);
        let beside = (x * cos + y * sin).abs() - j8().base_half_width_m;
        let ahead = (-x * sin + y * cos).abs() - j8().base_half_length_m;
        let outside = beside.max(0.0).hypot(ahead.max(0.0));
        let inside = beside.max(ahead).min(0.0);
        outside + inside - self.radius_m
    }
}

/// The whole program but for the middleware.
struct Loop {
    control: ControlLoop<SimulatedPort, InlineRunner>,
    _log: RecordSource<LoopRecord>,
    client: CommandClient,
    loop_end: LoopEnd,
    handler: GoalHandler,
    transforms: Transforms,
    obstacles: Option<Costmaps>,
    finished: Option<(GoalEnd, Outcome)>,
    warnings: Vec<String>,
}

impl Loop {
    fn new(slope_deg: f64, uphill_deg: f64, speed_m_s: f64, contact: bool) -> Self {
        let vehicle = j8();
        let (motion, encoder_scale): (Box<dyn MotionModel + Send>, _) = if contact {
            let file = include_str!("../../../../../../config/vehicles/j8_contact.yaml");
            let wheels: ContactVehicle = serde_yaml::from_str(file).unwrap();
            (
                Box::new(ContactModel::new(wheels)),
                EncoderScale {
                    left: 1.0,
                    right: 1.0,
                },
            )
        } else {
            let icr = IcrMotion {
                vehicle: vehicle.clone(),
                inclined: true,
            };
            (Box::new(icr), vehicle.encoder_scale)
        };
        let simulation = Simulation::new(SimulationSetup {
            terrain: Terrain::Plane(PlaneTerrain::new(slope_deg, uphill_deg).unwrap()),
            motion,
            drive_train: serde_yaml::from_str(
                "{traction: {acceleration_max_m_s2: 2, deceleration_max_m_s2: 2}, steer: {acceleration_max_m_s2: 2, deceleration_max_m_s2: 2}}",
            )
            .unwrap(),
            sensors: Default::default(),
            encoder_scale,
            start: PlanarPose { yaw_rad: ALONG_X, ..PlanarPose::default() },
            dt_s: 0.005,
            seed: 1,
        })
        .unwrap();
        let config = ControllerConfig {
            period_s: PERIOD_S,
            ..ControllerConfig::default()
        };
        let limits = SpeedConfig {
            speed_m_s,
            ..SpeedConfig::default()
        }
        .limits(&config.limits, &vehicle);
        let (client, loop_end, controller_end) = command_channel(config.stages);
        let controller = Controller::new(ControllerKind::IcrikMpc, config, &vehicle).unwrap();
        let (records, log) = ring(64);
        let control = ControlLoop::new(
            CycleConfig {
                period_s: PERIOD_S,
                ..CycleConfig::default()
            },
            SafetyConfig::default(),
            Clock::Virtual { now_s: 0.0 },
            SimulatedPort::new(simulation, 0.005, encoder_scale, DriveConfig::default()).unwrap(),
            InlineRunner::with_channel(controller, Some(controller_end), None),
            records,
        )
        .unwrap();
        let mut transforms = Transforms::default();
        transforms.take("map", "odom", 0.0, Isometry3::identity(), true);
        let route = RouteSettings {
            limits,
            ..route_settings()
        };
        Self {
            control,
            _log: log,
            client,
            loop_end,
            handler: GoalHandler::new(route, PivotSettings::default(), "odom", &vehicle),
            transforms,
            obstacles: None,
            finished: None,
            warnings: Vec::new(),
        }
    }

    /// A cycle, and the session's step after it.
    fn step(&mut self) -> f64 {
        let row = self.control.step_with(NOTHING, Some(&mut self.loop_end));
        let now_s = row.time_s;
        self.look(now_s);
        now_s
    }

    /// The session's step; returns whether it has handed over a path.
    fn look(&mut self, now_s: f64) -> bool {
        let status = self.client.loop_status().unwrap();
        let controller = self.client.controller_status().clone();
        let obstacles = self.obstacles.as_ref();
        self.handler.step(&GoalContext {
            now_s,
            cycle_s: status.row.time_s,
            state: status.row.state,
            armed: status.armed,
            stopped_by: status.stopped_by,
            decision: controller.decision.as_ref(),
            plan: &controller.plan,
            obstacles: obstacles.map(|obstacles| obstacles.context(now_s, &self.transforms)),
            transforms: &self.transforms,
            tolerances: &Tolerances::default(),
            emergency_stop: None,
            estop_unknown: false,
            estop_unknown_driving: false,
            clock_jumped: false,
        });
        let mut handed_over = false;
        for request in self.handler.take_requests() {
            match request {
                Request::Arm(number) => self.client.arm(number),
                Request::Stop(cause) => self.client.stop(cause),
                Request::Warn(message) => self.warnings.push(message),
                Request::Finish { end, outcome, .. } => self.finished = Some((end, outcome)),
                Request::Follow(path) => {
                    handed_over = true;
                    self.client.set_path(path);
                }
            }
        }
        handed_over
    }

    /// Gives the goal, and waits in real time until its route is built.
    fn begin(&mut self, path: RequestedPath) {
        let mut now_s = 0.0;
        for _ in 0..5 {
            now_s = self.step();
        }
        self.handler.begin(Client::Topic, Ok(path), now_s);
        for _ in 0..5000 {
            if self.look(now_s) {
                return;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        panic!("no route");
    }

    fn pose(&self) -> PlanarPose {
        self.control.port().state().pose.planar()
    }
}

/// An arc of 12 m that begins along x.
fn arc(curvature_per_m: f64) -> RequestedPath {
    let mut poses = vec![PlanarPose {
        yaw_rad: ALONG_X,
        ..PlanarPose::default()
    }];
    for _ in 0..120 {
        let last = poses[poses.len() - 1];
        let yaw_rad = last.yaw_rad + 0.1 * curvature_per_m;
        poses.push(PlanarPose {
            x_m: last.x_m - 0.1 * yaw_rad.sin(),
            y_m: last.y_m + 0.1 * yaw_rad.cos(),
            yaw_rad,
        });
    }
    RequestedPath {
        frame: "map".to_owned(),
        poses,
    }
}

/// What one run came to.
#[derive(Debug)]
struct Run {
    least_gap_m: f64,
    stops: usize,
    end: Option<(GoalEnd, Outcome)>,
}

/// Drives a goal among posts. Each appears at least 1.5 m ahead of the front of the vehicle, which is more
/// than it needs for a stop, and some leave again.
fn run(seed: u64) -> Run {
    let mut random = Random(seed);
    let curvature_per_m = random.within(-0.25, 0.25);
    let path = arc(curvature_per_m);
    let speed_m_s = random.within(0.3, 0.8);
    let (slope_deg, uphill_deg) = (random.within(0.0, 15.0), random.within(-180.0, 180.0));
    let mut posts: Vec<Post> = (0..1 + (3.0 * random.next()) as usize)
        .map(|_| {
            let index = random.within(35.0, 115.0) as usize;
            let at = path.poses[index];
            let aside_m = random.within(-1.5, 1.5);
            let leaves = random.next() < 0.6;
            Post {
                x_m: at.x_m + aside_m * at.yaw_rad.cos(),
                y_m: at.y_m + aside_m * at.yaw_rad.sin(),
                radius_m: random.within(0.05, 0.3),
                appears_m: random.within(0.0, 0.1 * index as f64 - 2.86).max(0.0),
                stays_s: if leaves {
                    random.within(3.0, 20.0)
                } else {
                    f64::INFINITY
                },
                since_s: None,
            }
        })
        .collect();
    let mut drive = Loop::new(slope_deg, uphill_deg, speed_m_s, seed.is_multiple_of(2));
    drive.obstacles = Some(Costmaps::new(CostmapConfig::default()));
    let mut seen: Vec<(f64, [f64; 2], Vec<[f64; 3]>)> = Vec::new();
    let (mut sensed_s, mut way_m) = (f64::NEG_INFINITY, 0.0);
    let mut least_gap_m = f64::INFINITY;
    drive.begin(path);
    let mut last = drive.pose();
    while drive.finished.is_none() {
        let now_s = drive.step();
        assert!(now_s < 120.0, "seed {seed}: no end");
        let pose = drive.pose();
        let moved_m = (pose.x_m - last.x_m).hypot(pose.y_m - last.y_m);
        (way_m, last) = (way_m + moved_m, pose);
        for post in &mut posts {
            if post.since_s.is_none() && way_m >= post.appears_m {
                post.since_s = Some(now_s);
            }
        }
        let standing = posts.iter().filter(|post| post.stands(now_s));
        let gaps = standing.clone().map(|post| post.gap_m(&pose));
        least_gap_m = gaps.fold(least_gap_m, f64::min);
        if now_s >= sensed_s + COSTMAP_PERIOD_S {
            sensed_s = now_s;
            let discs = standing.map(|post| [post.x_m, post.y_m, post.radius_m]);
            seen.push((now_s, [pose.x_m, pose.y_m], discs.collect()));
        }
        let arrived = seen
            .iter()
            .position(|(at_s, ..)| now_s < at_s + COSTMAP_LATENCY_S);
        for (at_s, centre, discs) in seen.drain(..arrived.unwrap_or(seen.len())) {
            // A cell is lethal where the disc reaches its centre, as for a sensor that hits it.
            let lethal = |x: f64, y: f64| {
                discs
                    .iter()
                    .any(|[at_x, at_y, radius]| (x - at_x).hypot(y - at_y) <= *radius)
            };
            if let Some(costmaps) = &mut drive.obstacles {
                costmaps.publish(centre, at_s, lethal);
            }
        }
    }
    Run {
        least_gap_m,
        stops: drive
            .warnings
            .iter()
            .filter(|warning| warning.contains("obstacle"))
            .count(),
        end: drive.finished,
    }
}

fn drive_among_posts(seeds: std::ops::Range<u64>) {
    let (mut waited, mut reached, mut gave_up, mut least_gap_m) = (0, 0, 0, f64::INFINITY);
    for seed in seeds {
        let run = run(seed);
        assert!(run.least_gap_m > 0.0, "seed {seed}: {run:?}");
        least_gap_m = least_gap_m.min(run.least_gap_m);
        match &run.end {
            Some((GoalEnd::Succeeded, _)) if run.stops > 0 => waited += 1,
            Some((GoalEnd::Succeeded, _)) => reached += 1,
            Some((_, outcome)) if outcome.code == code::PATIENCE_EXCEEDED => gave_up += 1,
            end => panic!("seed {seed}: {end:?}"),
        }
    }
    println!(
        "{reached} reached, {waited} after a wait, {gave_up} aborted, least gap {least_gap_m:.3} m"
    );
    assert!(reached > 0 && waited > 0 && gave_up > 0);
}

#[test]
fn the_footprint_stays_clear_of_random_obstacles() {
    drive_among_posts(0..8);
}

/// `cargo test -p sidehill-bridge --lib two_hundred -- --ignored --nocapture`.
#[test]
#[ignore = "takes minutes: eight of them are always run"]
fn the_footprint_stays_clear_in_two_hundred_random_runs() {
    drive_among_posts(1000..1200);
}
