//! A controller and the simulated J8 on a slope, in one loop; every command is checked.

use sidehill_controller::config::{ControllerConfig, ControllerKind};
use sidehill_controller::controller::{Controller, Decision, Status};
use sidehill_controller::course::Course;
use sidehill_controller::reference::Reference;
use sidehill_controller::speed_profile::SpeedLimits;
use sidehill_controller::trajectory::Trajectory;
use sidehill_plant::contact::CentreOfMass;
use sidehill_plant::drive_train::DriveTrainConfig;
use sidehill_plant::frames::PlanarPose;
use sidehill_plant::sample::Sample;
use sidehill_plant::sensors::SensorsConfig;
use sidehill_plant::simulation::{Simulation, SimulationSetup};
use sidehill_plant::speeds::MotorSpeeds;
use sidehill_plant::terrain::{PlaneTerrain, Terrain};
use sidehill_plant::vehicle::IcrMotion;
use sidehill_plant::vehicle::Vehicle;
use std::time::Instant;

pub const CIRCLE: &str = "{shape: circle, radius_m: 4, speed_m_s: 0.4}";

/// A law that predicts, and one that does not.
pub const KINDS: [ControllerKind; 2] = [ControllerKind::IcrikMpc, ControllerKind::PurePursuit];

/// Cycles until a command of 0.4 m/s is 0 at 2 m/s^2, and one for rounding.
pub const STOPPING_CYCLES: u32 = 5;

pub fn plane(slope_deg: f64) -> Terrain {
    Terrain::Plane(PlaneTerrain::new(slope_deg, 0.0).unwrap())
}

/// How fast the J8 is asked to be.
pub const LIMITS: SpeedLimits = SpeedLimits {
    speed_max_m_s: 0.8,
    traction_max_m_s: 1.0,
    steer_max_m_s: 1.0,
    tread_max_m_s: f64::INFINITY,
    acceleration_m_s2: 0.5,
    deceleration_m_s2: 0.5,
    steer_acceleration_m_s2: 1.0,
    lateral_acceleration_m_s2: f64::INFINITY,
    track_width_m: 2.05,
};

pub fn course(yaml: &str) -> Trajectory {
    let course: Course = serde_yaml::from_str(yaml).unwrap();
    course.trajectory(&LIMITS).unwrap()
}

/// What a rig is made of; `Setup::new` gives perfect sensors and the vehicle on its reference.
pub struct Setup {
    pub kind: ControllerKind,
    pub config: ControllerConfig,
    pub trajectory: Trajectory,
    pub laps: u32,
    pub terrain: Terrain,
    pub map: Option<Terrain>,
    pub start: PlanarPose,
    pub sensors: SensorsConfig,
    pub drive_train: DriveTrainConfig,
    pub steps_per_cycle: u32,
}

impl Setup {
    pub fn new(trajectory: Trajectory) -> Self {
        let start = trajectory.at(0.0);
        Self {
            kind: ControllerKind::IcrikMpc,
            config: ControllerConfig::default(),
            laps: 1,
            terrain: plane(10.0),
            map: None,
            start: start.pose(),
            sensors: SensorsConfig::default(),
            drive_train: DriveTrainConfig::default(),
            steps_per_cycle: 10,
            trajectory,
        }
    }

    pub fn build(self) -> Rig {
        let mut vehicle = Vehicle::j8();
        vehicle.centre_of_mass = Some(CentreOfMass {
            right_m: 0.0,
            forward_m: 0.0,
            height_m: 0.6,
        });
        let simulation = Simulation::new(SimulationSetup {
            terrain: self.terrain,
            motion: Box::new(IcrMotion {
                vehicle: vehicle.clone(),
                inclined: true,
            }),
            drive_train: self.drive_train,
            sensors: self.sensors,
            encoder_scale: vehicle.encoder_scale,
            start: self.start,
            dt_s: self.config.period_s / f64::from(self.steps_per_cycle),
            seed: 7,
        })
        .unwrap();
        let mut controller = Controller::new(self.kind, self.config, &vehicle).unwrap();
        if let Some(map) = self.map {
            controller = controller.with_terrain(map);
        }
        controller.follow(Reference::new(self.trajectory).for_laps(self.laps));
        Rig {
            simulation,
            controller,
            command: MotorSpeeds::STOP,
            steps_per_cycle: self.steps_per_cycle,
        }
    }
}

#[derive(Clone)]
pub struct Rig {
    pub simulation: Simulation,
    pub controller: Controller,
    pub command: MotorSpeeds,
    steps_per_cycle: u32,
}

impl Rig {
    /// Follows another trajectory along its path, under a number, from an arc length on.
    pub fn follow(&mut self, number: u64, trajectory: Trajectory, from_m: f64) {
        let reference = Reference::new(trajectory);
        self.controller
            .follow(reference.starting_at(from_m).numbered(number));
    }

    /// One cycle with the sensors as they are.
    pub fn cycle(&mut self) -> Decision {
        self.cycle_with(None, |_| ())
    }

    /// One cycle whose sample is `disturb`ed and whose solve ends at `deadline`.
    pub fn cycle_with(
        &mut self,
        deadline: Option<Instant>,
        disturb: impl FnOnce(&mut Sample),
    ) -> Decision {
        let mut sample = self.simulation.sample();
        disturb(&mut sample);
        let decision = self.controller.step(&sample, deadline);
        self.check(decision.command_effective);
        self.command = decision.command_effective;
        self.simulation
            .set_command(decision.command_effective)
            .unwrap();
        for _ in 0..self.steps_per_cycle {
            self.simulation.step().unwrap();
        }
        decision
    }

    /// Cycles until the vehicle stands for good, at most `limit`; returns the last decision.
    pub fn until_standing(&mut self, limit: u32) -> (u32, Decision) {
        for count in 1..=limit {
            let decision = self.cycle();
            if decision.command_effective == MotorSpeeds::STOP {
                return (count, decision);
            }
        }
        panic!("still moving after {limit} cycles: {:?}", self.command);
    }

    /// Asserts that a command is within bounds and rates; the default limits' rates are the same
    /// towards standstill and away from it.
    fn check(&self, command: MotorSpeeds) {
        let config = self.controller.config();
        let (traction, steer) = (&config.limits.traction, &config.limits.steer);
        assert!(command.is_finite(), "{command:?}");
        assert!(command.traction_m_s.abs() <= traction.speed_m_s + 1e-12);
        assert!(command.steer_m_s.abs() <= steer.speed_m_s + 1e-12);
        let tread_m_s = command.traction_m_s.abs() + command.steer_m_s.abs();
        assert!(
            tread_m_s <= config.limits.tread_speed_m_s + 1e-12,
            "{command:?}"
        );
        let before = self.command;
        for (limits, from, to) in [
            (traction, before.traction_m_s, command.traction_m_s),
            (steer, before.steer_m_s, command.steer_m_s),
        ] {
            assert_eq!(limits.acceleration_m_s2, limits.deceleration_m_s2);
            let change = limits.acceleration_m_s2 * config.period_s;
            assert!(
                (to - from).abs() <= change + 1e-12,
                "{before:?} {command:?}"
            );
        }
    }
}

/// A vehicle under way.
pub fn driving(kind: ControllerKind) -> Rig {
    let mut rig = Setup {
        kind,
        ..Setup::new(course(CIRCLE))
    }
    .build();
    for _ in 0..40 {
        assert_eq!(rig.cycle().status, Status::Tracking);
    }
    assert!(rig.command.traction_m_s > 0.3);
    rig
}
