use super::*;
use crate::node::goals::GoalEnd;
use crate::server::goal_context::GoalContext;
use crate::server::test_data::{decision, j8, route_settings};
use nalgebra::{Isometry3, Translation3, UnitQuaternion};
use sidehill_bridge::ros2::settings::server::Tolerances;
use sidehill_bridge::ros2::transforms::Transforms;
use sidehill_bridge::safety::{Reason, SafetyState};
use sidehill_controller::controller::{Status, StopReason};
use sidehill_controller::mpc::QpFailure;
use sidehill_controller::reference::Progress;
use sidehill_controller::trajectory::Trajectory;
use sidehill_plant::frames::{Attitude, PlanarPose, wrap_angle};
use std::f64::consts::FRAC_PI_2;
use std::time::Duration;

mod ends;
mod obstacle_runs;
mod obstacles;
mod passing;
mod paths;
mod program;
mod several_posts;

/// Heading along x.
const ALONG_X: f64 = -FRAC_PI_2;
const CLIENT: ClientId = ClientId::of_participant([7; 8]);

/// A vehicle as a session sees it: the state of its safety, and a controller that tracks what it is given.
struct World {
    handler: GoalHandler,
    transforms: Transforms,
    now_s: f64,
    state: SafetyState,
    armed: u64,
    stopped_by: Option<Reason>,
    status: Status,
    has_progress: bool,
    reference: u64,
    trajectory: Option<Trajectory>,
    x_m: f64,
    yaw_rad: f64,
    attitude: Attitude,
    emergency_stop: Option<StopCause>,
    estop_unknown: bool,
    estop_incompatible: Option<&'static str>,
    clock_jumped: bool,
    finished: Vec<(PathSource, GoalEnd, Outcome)>,
    arm: u64,
    stop: Option<StopCause>,
    /// The check for obstacles, where it is on.
    obstacles: Option<obstacles::Costmaps>,
    warnings: Vec<String>,
}

impl World {
    fn new() -> Self {
        Self::with(PivotSettings::default())
    }

    fn with(pivots: PivotSettings) -> Self {
        let mut transforms = Transforms::default();
        transforms.take("map", "odom", (0.0, 0.0), Isometry3::identity(), true);
        Self {
            handler: GoalHandler::new(route_settings(), pivots, "odom", &j8()),
            transforms,
            now_s: 1.0,
            state: SafetyState::Disarmed,
            armed: 0,
            stopped_by: None,
            status: Status::Tracking,
            has_progress: false,
            reference: 0,
            trajectory: None,
            x_m: 0.0,
            yaw_rad: ALONG_X,
            attitude: Attitude::LEVEL,
            emergency_stop: None,
            estop_unknown: false,
            estop_incompatible: None,
            clock_jumped: false,
            finished: Vec::new(),
            arm: 0,
            stop: None,
            obstacles: None,
            warnings: Vec::new(),
        }
    }

    /// The session's step, and what it requests.
    fn look(&mut self) {
        let mut decision = decision(self.now_s, self.x_m, self.yaw_rad);
        (decision.status, decision.reference) = (self.status, self.reference);
        if let Some(estimate) = &mut decision.estimate {
            estimate.attitude = self.attitude;
        }
        decision.progress =
            self.trajectory
                .as_ref()
                .filter(|_| self.has_progress)
                .map(|trajectory| Progress {
                    point: trajectory.at(0.0),
                    arc_length_m: self.x_m + self.handler.settings.route.tracked_point.forward_m,
                    cross_track_m: 0.0,
                    ended: false,
                });
        let tolerances = Tolerances::default();
        self.handler.step(&GoalContext {
            now_s: self.now_s,
            cycle_s: self.now_s,
            state: self.state,
            armed: self.armed,
            stopped_by: self.stopped_by,
            decision: Some(&decision),
            plan: &[],
            obstacles: self
                .obstacles
                .as_ref()
                .map(|obstacles| obstacles.context(self.now_s, &self.transforms)),
            transforms: &self.transforms,
            tolerances: &tolerances,
            emergency_stop: self.emergency_stop,
            estop_unknown: self.estop_unknown,
            estop_unknown_driving: self.estop_unknown,
            estop_incompatible: self.estop_incompatible,
            clock_jumped: self.clock_jumped,
        });
        for request in self.handler.take_requests() {
            match request {
                Request::Arm(number) => self.arm = number,
                Request::Stop(cause) => self.stop = cause,
                Request::Warn(message) => self.warnings.push(message),
                Request::Finish {
                    client,
                    end,
                    outcome,
                } => self.finished.push((client, end, outcome)),
                Request::Follow(None) => (self.reference, self.trajectory) = (0, None),
                Request::Follow(Some(path)) => {
                    self.reference = path.number;
                    self.trajectory = Some(path.trajectory);
                }
            }
        }
    }

    /// A cycle of the safety as far as it matters here, and the session's step after it.
    fn cycle(&mut self) {
        self.now_s += 0.05;
        let off = matches!(self.state, SafetyState::Disarmed | SafetyState::Latched);
        let free = self.emergency_stop.or(self.stop).is_none();
        self.state = match (self.state, self.emergency_stop, self.stop) {
            (_, Some(cause), _) if !off => {
                self.stopped_by = Some(Reason::Requested(cause));
                SafetyState::Latched
            }
            _ if off && self.arm > self.armed && free => {
                self.armed = self.arm;
                SafetyState::Zeroing
            }
            (SafetyState::Zeroing, ..) => SafetyState::Enabling,
            (SafetyState::Enabling, ..) => SafetyState::Driving,
            (SafetyState::Driving, _, Some(cause)) => {
                self.stopped_by = Some(Reason::Requested(cause));
                SafetyState::Stopping
            }
            (SafetyState::Stopping, ..) => SafetyState::Latched,
            (state, ..) => state,
        };
        self.look();
    }

    fn cycles(&mut self, count: u32) {
        for _ in 0..count {
            self.cycle();
        }
    }

    /// Begins a path for a client of its own, and returns the client.
    fn begin(&mut self, path: RequestedPath) -> PathSource {
        let client = PathSource::Goal {
            id: GoalId::new_random(),
            client: CLIENT,
        };
        self.handler.begin(client, Ok(path), self.now_s);
        client
    }

    /// Waits until the route is built and the controller has it; simulated time stands.
    fn build(&mut self) {
        let before = self.reference;
        for _ in 0..5000 {
            self.look();
            if self.reference != before {
                return;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        panic!("no route");
    }

    /// Follows a path of 10 m along x.
    fn follow(&mut self) -> PathSource {
        let client = self.begin(path());
        self.build();
        client
    }

    fn driving(&mut self) -> PathSource {
        let client = self.follow();
        self.cycles(10);
        assert_eq!(self.state, SafetyState::Driving);
        client
    }

    /// Ends a pivot: the vehicle has its heading.
    fn end_pivot(&mut self) {
        let pivot = self.trajectory.as_ref().unwrap();
        assert_eq!(pivot.length_m(), 0.0, "a pivot");
        self.yaw_rad = pivot.at(1e3).heading_rad;
        self.end_by(Reason::Finished);
        self.cycle();
    }

    /// The safety ends the drive.
    fn end_by(&mut self, reason: Reason) {
        self.state = SafetyState::Latched;
        self.stopped_by = Some(reason);
    }

    fn finish(&mut self) {
        self.end_by(Reason::Finished);
        self.cycles(3);
    }

    fn cancel(&mut self, client: PathSource) {
        let PathSource::Goal { id, .. } = client else {
            panic!("no goal");
        };
        self.handler.cancel(id, self.now_s);
    }

    #[track_caller]
    fn assert_finished(&self, client: PathSource, end: GoalEnd, code: u16) {
        let finished: Vec<_> = self
            .finished
            .iter()
            .filter(|(who, ..)| *who == client)
            .collect();
        assert_eq!(finished.len(), 1, "{finished:?}");
        let (_, found, outcome) = finished[0];
        assert_eq!((*found, outcome.code), (end, code), "{outcome:?}");
        assert_eq!(outcome.message.is_empty(), end == GoalEnd::Succeeded);
    }
}

/// 10 m along x in the map.
fn path() -> RequestedPath {
    let poses = (0..=100).map(|i| PlanarPose {
        x_m: 0.1 * f64::from(i),
        y_m: 0.0,
        yaw_rad: ALONG_X,
    });
    RequestedPath {
        frame: "map".to_owned(),
        poses: poses.collect(),
        ..RequestedPath::default()
    }
}

/// The same with another heading at its end.
fn path_to(yaw_rad: f64) -> RequestedPath {
    let mut path = path();
    path.poses.last_mut().unwrap().yaw_rad = yaw_rad;
    path
}
