//! Turns a motor slowly, in place of a controller: for commissioning.

use super::runner::ControllerRunner;
use sidehill_controller::controller::{Decision, Status};
use sidehill_plant::sample::Sample;
use sidehill_plant::speeds::MotorSpeeds;
use std::time::Duration;

/// Goes to a speed on a ramp while its commands reach the drives, and begins anew where they reach them again.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JogRunner {
    target: MotorSpeeds,
    speeds: MotorSpeeds,
    before_s: f64,
}

impl JogRunner {
    /// Acceleration of each motor, m/s^2: slow enough for a person to let go while a motor is still slow.
    pub const ACCELERATION_M_S2: f64 = 0.05;

    /// Returns a jog that stands.
    pub fn new() -> Self {
        Self {
            target: MotorSpeeds::STOP,
            speeds: MotorSpeeds::STOP,
            before_s: f64::NAN,
        }
    }

    /// Sets the speeds to go to.
    pub fn set(&mut self, target: MotorSpeeds) {
        self.target = target;
    }
}

impl Default for JogRunner {
    fn default() -> Self {
        Self::new()
    }
}

impl ControllerRunner for JogRunner {
    fn decide(
        &mut self,
        sample: &Sample,
        engaged: bool,
        _patience: Option<Duration>,
    ) -> Option<Decision> {
        // The first cycle, and a clock that jumps, begin anew.
        let elapsed_s = sample.time_s - self.before_s;
        self.before_s = sample.time_s;
        let goes_on = engaged && (0.0..1.0).contains(&elapsed_s);
        let step = Self::ACCELERATION_M_S2 * elapsed_s;
        let toward = |speed: f64, target: f64| speed + (target - speed).clamp(-step, step);
        self.speeds = match goes_on {
            true => MotorSpeeds {
                traction_m_s: toward(self.speeds.traction_m_s, self.target.traction_m_s),
                steer_m_s: toward(self.speeds.steer_m_s, self.target.steer_m_s),
            },
            false => MotorSpeeds::STOP,
        };
        Some(Decision::of_command(
            sample.time_s,
            self.speeds,
            Status::Tracking,
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_goes_to_its_speed_on_a_ramp_and_begins_anew_when_engaged_again() {
        let mut jog = JogRunner::new();
        jog.set(MotorSpeeds {
            traction_m_s: 0.05,
            steer_m_s: -0.025,
        });
        let mut cycle = 0;
        let mut run = |engaged: bool, cycles: u32| {
            let mut speeds = MotorSpeeds::STOP;
            for _ in 0..cycles {
                cycle += 1;
                let sample = Sample {
                    time_s: 0.05 * f64::from(cycle),
                    tread_speeds: None,
                    attitude: None,
                    yaw_rate: None,
                    pose: None,
                };
                let decision = jog.decide(&sample, engaged, None).unwrap();
                let step = (decision.command_effective.traction_m_s - speeds.traction_m_s).abs();
                assert!(!engaged || step <= 0.0025 + 1e-12, "{step}");
                speeds = decision.command_effective;
            }
            speeds
        };
        assert_eq!(run(false, 5), MotorSpeeds::STOP);
        let half = run(true, 10);
        assert!((half.traction_m_s - 0.025).abs() < 1e-9 && (half.steer_m_s + 0.025).abs() < 1e-9);
        assert_eq!(run(false, 1), MotorSpeeds::STOP);
        let full = run(true, 30);
        assert!((full.traction_m_s - 0.05).abs() < 1e-9);
    }
}
