//! Goal handler, controller, safety and a simulated vehicle in virtual time: the program without the middleware.

use super::obstacles::Costmaps;
use super::*;
use sidehill_bridge::control_loop::channel::{CommandClient, LoopEnd, command_channel};
use sidehill_bridge::control_loop::record::{LoopRecord, RecordSource, ring};
use sidehill_bridge::control_loop::runner::InlineRunner;
use sidehill_bridge::control_loop::{ControlLoop, CycleConfig};
use sidehill_bridge::drives::Clock;
use sidehill_bridge::rover::{DriveConfig, SimulatedPort};
use sidehill_bridge::safety::{OperatorRequests, SafetyConfig};
use sidehill_controller::config::{ControllerConfig, ControllerKind};
use sidehill_controller::controller::Controller;
use sidehill_controller::speed_profile::SpeedConfig;
use sidehill_plant::contact::{ContactModel, ContactVehicle};
use sidehill_plant::frames::BodyVelocity;
use sidehill_plant::motion::{GroundState, Motion, MotionError, MotionModel};
use sidehill_plant::simulation::{Simulation, SimulationSetup};
use sidehill_plant::speeds::{EncoderScale, TreadSpeeds};
use sidehill_plant::terrain::{PlaneTerrain, Terrain};
use sidehill_plant::vehicle::IcrMotion;

const NOTHING: OperatorRequests = OperatorRequests {
    arm: false,
    stop: None,
    halt: None,
};
const PERIOD_S: f64 = 0.05;

/// Ground that moves a vehicle sideways without any slope, unknown to the controller.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Slippery {
    /// Where along X_g it begins and ends, m.
    pub(super) from_m: f64,
    pub(super) to_m: f64,
    /// Speed to the right, as a share of the speed forward.
    pub(super) right_share: f64,
}

/// Motion on such ground.
#[derive(Clone)]
struct Sliding {
    motion: Box<dyn Motion>,
    ground: Slippery,
}

impl MotionModel for Sliding {
    fn body_velocity(
        &mut self,
        at: &GroundState,
        treads: TreadSpeeds,
        dt_s: f64,
    ) -> Result<BodyVelocity, MotionError> {
        let mut velocity = self.motion.body_velocity(at, treads, dt_s)?;
        if (self.ground.from_m..self.ground.to_m).contains(&at.position.x_m) {
            velocity.right_m_s += self.ground.right_share * velocity.forward_m_s.abs();
        }
        Ok(velocity)
    }
}

/// The whole program but for the middleware.
pub(super) struct Loop {
    control: ControlLoop<SimulatedPort, InlineRunner>,
    _log: RecordSource<LoopRecord>,
    client: CommandClient,
    loop_end: LoopEnd,
    handler: GoalHandler,
    transforms: Transforms,
    pub(super) obstacles: Option<Costmaps>,
    pub(super) finished: Option<(GoalEnd, Outcome)>,
    pub(super) warnings: Vec<String>,
}

impl Loop {
    pub(super) fn new(
        (slope_deg, uphill_deg): (f64, f64),
        speed_m_s: f64,
        contact: bool,
        slippery: Option<Slippery>,
    ) -> Self {
        let vehicle = j8();
        let (motion, encoder_scale): (Box<dyn Motion>, _) = if contact {
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
        let motion = match slippery {
            Some(ground) => Box::new(Sliding { motion, ground }),
            None => motion,
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
        transforms.take("map", "odom", (0.0, 0.0), Isometry3::identity(), true);
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
    pub(super) fn step(&mut self) -> f64 {
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
            plan: &controller.view.plan,
            obstacles: obstacles.map(|obstacles| obstacles.context(now_s, &self.transforms)),
            transforms: &self.transforms,
            tolerances: &Tolerances::default(),
            emergency_stop: None,
            estop_unknown: false,
            estop_unknown_driving: false,
            estop_incompatible: None,
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
    pub(super) fn begin(&mut self, path: RequestedPath) {
        let mut now_s = 0.0;
        for _ in 0..5 {
            now_s = self.step();
        }
        self.handler.begin(PathSource::None, Ok(path), now_s);
        for _ in 0..5000 {
            if self.look(now_s) {
                return;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        panic!("no route");
    }

    pub(super) fn pose(&self) -> PlanarPose {
        self.control.port().state().pose.planar()
    }
}
