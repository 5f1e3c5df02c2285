//! Closes the loop around a plant of your own: a J8 on a slope of 10 deg whose treads lose 3 %.
#![allow(clippy::print_stdout)]

use sidehill_controller::closed_loop::{ClosedLoop, RunEnd};
use sidehill_controller::config::{ControllerConfig, ControllerKind};
use sidehill_controller::controller::Controller;
use sidehill_controller::course::FigureEight;
use sidehill_controller::reference::Reference;
use sidehill_plant::dead_reckoning::{StepMotion, advance};
use sidehill_plant::frames::{Attitude, Pose};
use sidehill_plant::sample::Sample;
use sidehill_plant::simulation::{Plant, TrueState};
use sidehill_plant::speeds::MotorSpeeds;
use sidehill_plant::vehicle::Vehicle;
use std::convert::Infallible;

#[derive(Default)]
struct FrictionRover(TrueState);

impl Plant for FrictionRover {
    type Error = Infallible;

    fn state(&self) -> TrueState {
        self.0
    }

    fn sample(&mut self) -> Sample {
        self.0.sample(&Vehicle::j8().encoder_scale)
    }

    fn step_s(&self) -> f64 {
        0.01
    }

    fn step(&mut self, command_effective: MotorSpeeds) -> Result<TrueState, Infallible> {
        let (dt_s, state) = (self.step_s(), &mut self.0);
        state.motors.traction_m_s = 0.97 * command_effective.traction_m_s;
        state.motors.steer_m_s = 0.97 * command_effective.steer_m_s;
        state.treads = state.motors.into();
        state.attitude = Attitude::from_slope(10_f64.to_radians(), state.pose.yaw_rad);
        let attitude = state.attitude;
        let velocity = Vehicle::j8().body_velocity(attitude, state.treads);
        state.pose = advance(&state.pose, dt_s, |_, _| StepMotion { velocity, attitude });
        state.time_s += dt_s;
        Ok(*state)
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let trajectory = FigureEight::default().trajectory()?;
    let mut rover = FrictionRover::default();
    rover.0.pose = Pose::from(trajectory.at(0.0).pose());
    let config = ControllerConfig::default();
    let mut controller = Controller::new(ControllerKind::IcrikMpc, config, &Vehicle::j8())?;
    controller.follow(Reference::new(trajectory));
    let mut closed_loop = ClosedLoop::new(rover, controller)?;
    let end = closed_loop.run(|_cycle| ())?;
    println!("{end}: {:?}", closed_loop.figures());
    assert!(end == RunEnd::Finished && closed_loop.figures().cross_track_rms_m < 0.02);
    Ok(())
}
