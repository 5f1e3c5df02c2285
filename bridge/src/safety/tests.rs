mod any;
mod faults;
mod model;
mod response;

use super::*;
use crate::drives::LinkState;
use sidehill_controller::controller::StopReason;
use sidehill_plant::sample::Stamped;

const PERIOD_S: f64 = 0.05;

/// A drive that follows at once, and a controller that wants what it is told.
struct Bench {
    safety: Safety,
    inputs: SafetyInputs,
    steps: u32,
    events: Vec<Transition>,
    command: DriveCommand,
}

impl Bench {
    fn new() -> Self {
        Self {
            safety: Safety::new(SafetyConfig::default()).unwrap(),
            inputs: SafetyInputs {
                time_s: 0.0,
                controller: None,
                feedback: None,
                forwarded: None,
                link: LinkState::Active,
                unsent_since_s: None,
                requests: OperatorRequests::default(),
                leaves_geofence: false,
            },
            steps: 0,
            events: Vec::new(),
            command: DriveCommand::OFF,
        }
    }

    /// One healthy cycle, in which `change` may break something.
    fn step(
        &mut self,
        command: MotorSpeeds,
        change: impl FnOnce(&mut SafetyInputs),
    ) -> DriveCommand {
        self.steps += 1;
        let time_s = f64::from(self.steps) * PERIOD_S;
        self.inputs.time_s = time_s;
        self.inputs.controller = Some(ControllerOutput {
            time_s,
            command,
            state: ControllerState::Driving,
        });
        self.inputs.feedback = Some(Stamped {
            time_s,
            value: DriveFeedback {
                speeds: self.command.speeds,
                mode: if self.command.enable {
                    DriveMode::Enabled
                } else {
                    DriveMode::Disabled
                },
            },
        });
        change(&mut self.inputs);
        let (order, event) = self.safety.step(&self.inputs);
        self.command = order;
        self.events.extend(event);
        order
    }

    fn arm(&mut self) {
        self.step(MotorSpeeds::STOP, |inputs| inputs.requests.arm = false);
        self.step(MotorSpeeds::STOP, |inputs| inputs.requests.arm = true);
    }

    /// Arms, and goes on until the safety drives.
    fn begin(&mut self) {
        self.arm();
        for _ in 0..20 {
            if self.safety.state() == SafetyState::Driving {
                return;
            }
            self.step(MotorSpeeds::STOP, |_| {});
        }
        panic!("it does not drive: {:?}", self.events);
    }

    /// A bench that drives at a command.
    fn driving(command: MotorSpeeds) -> Self {
        let mut bench = Self::new();
        bench.arm();
        for _ in 0..20 {
            bench.step(command, |_| {});
        }
        assert_eq!(bench.safety.state(), SafetyState::Driving);
        assert_eq!(bench.command.speeds, command);
        bench
    }

    fn last(&self) -> Transition {
        *self.events.last().unwrap()
    }
}

fn speeds(traction_m_s: f64, steer_m_s: f64) -> MotorSpeeds {
    MotorSpeeds {
        traction_m_s,
        steer_m_s,
    }
}

fn set_command_time(inputs: &mut SafetyInputs, time_s: f64) {
    inputs.controller.as_mut().unwrap().time_s = time_s;
}

#[test]
fn nothing_moves_before_zeros_standstill_and_the_drives_answer() {
    let mut bench = Bench::new();
    for _ in 0..40 {
        assert_eq!(bench.step(speeds(1.0, 0.5), |_| {}), DriveCommand::OFF);
    }
    bench.arm();
    let mut orders = Vec::new();
    for _ in 0..20 {
        orders.push(bench.step(speeds(0.5, 0.1), |_| {}));
    }
    let on = orders.iter().position(|order| order.enable).unwrap();
    let moved = orders
        .iter()
        .position(|order| order.speeds != MotorSpeeds::STOP)
        .unwrap();
    assert!(on >= 3 && moved > on, "{orders:?}");
    let states: Vec<SafetyState> = bench.events.iter().map(|event| event.to).collect();
    assert_eq!(
        states,
        [
            SafetyState::Zeroing,
            SafetyState::Enabling,
            SafetyState::Driving
        ]
    );
}

#[test]
fn a_switch_that_stands_on_arm_does_not_arm() {
    let mut bench = Bench::new();
    for _ in 0..100 {
        bench.step(speeds(0.5, 0.0), |inputs| inputs.requests.arm = true);
    }
    assert_eq!(bench.safety.state(), SafetyState::Disarmed);
}

#[test]
fn a_drive_that_never_answers_or_never_stands_ends_the_handshake() {
    let mut bench = Bench::new();
    bench.arm();
    for _ in 0..60 {
        bench.step(speeds(0.5, 0.0), |inputs| {
            if let Some(feedback) = &mut inputs.feedback {
                feedback.value.mode = DriveMode::Disabled;
            }
        });
    }
    assert!(matches!(bench.last().reason, Reason::Handshake { .. }));
    assert_eq!(bench.safety.state(), SafetyState::Latched);
    let mut bench = Bench::new();
    bench.arm();
    for _ in 0..60 {
        let order = bench.step(speeds(0.5, 0.0), |inputs| {
            if let Some(feedback) = &mut inputs.feedback {
                feedback.value.speeds.steer_m_s = 0.05;
            }
        });
        assert!(!order.enable);
    }
    assert!(matches!(bench.last().reason, Reason::Handshake { .. }));
}

#[test]
fn drives_have_the_time_of_the_handshake_after_the_zeros() {
    // 0.2 s of zeros and 1 s of handshake.
    for (stands_after_s, arms) in [(1.1, true), (1.3, false)] {
        let mut bench = Bench::new();
        bench.arm();
        let armed_s = bench.inputs.time_s;
        for _ in 0..40 {
            bench.step(speeds(0.5, 0.0), |inputs| {
                if let Some(feedback) = &mut inputs.feedback
                    && inputs.time_s - armed_s < stands_after_s
                {
                    feedback.value.speeds.traction_m_s = -0.05;
                }
            });
        }
        let driving = bench.safety.state() == SafetyState::Driving;
        assert_eq!(driving, arms, "{:?}", bench.events);
    }
}

#[test]
fn drives_have_the_time_of_the_handshake_to_be_on() {
    for (on_after_s, drives) in [(0.9, true), (1.2, false)] {
        let mut bench = Bench::new();
        bench.arm();
        let mut told_s = f64::INFINITY;
        for _ in 0..40 {
            let order = bench.step(speeds(0.5, 0.0), |inputs| {
                if let Some(feedback) = &mut inputs.feedback
                    && inputs.time_s - told_s < on_after_s
                {
                    feedback.value.mode = DriveMode::Disabled;
                }
            });
            if order.enable {
                told_s = told_s.min(bench.inputs.time_s);
            }
        }
        let driving = bench.safety.state() == SafetyState::Driving;
        assert_eq!(driving, drives, "{:?}", bench.events);
    }
}

#[test]
fn drives_may_be_set_up_while_zeros_are_sent() {
    for mode in [
        DriveMode::Fault,
        DriveMode::NotOperational,
        DriveMode::OtherMode,
    ] {
        let mut bench = Bench::new();
        bench.arm();
        for cycle in 0..40 {
            let order = bench.step(speeds(0.5, 0.0), |inputs| {
                if let Some(feedback) = &mut inputs.feedback
                    && cycle < 10
                {
                    feedback.value.mode = mode;
                }
            });
            assert!(cycle >= 10 || !order.enable, "{mode:?}");
        }
        assert_eq!(bench.safety.state(), SafetyState::Driving, "{mode:?}");
    }
}

#[test]
fn a_fault_may_be_forgotten_only_after_arming() {
    let fault = |inputs: &mut SafetyInputs| {
        if let Some(feedback) = &mut inputs.feedback {
            feedback.value.mode = DriveMode::Fault;
        }
    };
    let mut bench = Bench::driving(speeds(0.5, 0.0));
    for _ in 0..100 {
        assert_eq!(bench.step(speeds(0.5, 0.0), fault), DriveCommand::OFF);
    }
    assert_eq!(bench.last().reason, Reason::DriveFault);
    bench.arm();
    let order = bench.step(speeds(0.5, 0.0), fault);
    assert!(order.fault_reset && !order.enable && order.speeds == MotorSpeeds::STOP);
    for _ in 0..20 {
        bench.step(speeds(0.5, 0.0), |_| {});
    }
    assert_eq!(bench.safety.state(), SafetyState::Driving);
    assert!(!bench.command.fault_reset);
    // One that lasts ends the handshake.
    bench.step(speeds(0.5, 0.0), fault);
    bench.arm();
    for _ in 0..40 {
        bench.step(speeds(0.5, 0.0), fault);
    }
    assert!(matches!(
        bench.last().reason,
        Reason::Handshake {
            mode: DriveMode::Fault,
            ..
        }
    ));
    assert_eq!(bench.command, DriveCommand::OFF);
}

#[test]
fn an_intent_from_before_the_drive_is_not_driven_on() {
    let mut bench = Bench::new();
    bench.arm();
    for _ in 0..40 {
        let order = bench.step(speeds(0.5, 0.0), |inputs| set_command_time(inputs, 0.1));
        assert_eq!(order.speeds, MotorSpeeds::STOP);
    }
    assert!(
        bench
            .events
            .iter()
            .any(|event| matches!(event.reason, Reason::CommandTimeout { .. }))
    );
}

#[test]
fn an_intent_from_the_cycle_in_which_the_drive_began_is_not_driven_on() {
    // The controller did not know yet that it drives.
    let mut bench = Bench::new();
    bench.begin();
    let start_s = bench.inputs.time_s;
    let order = bench.step(speeds(0.5, 0.0), |s| set_command_time(s, start_s));
    assert_eq!(order.speeds, MotorSpeeds::STOP);
    let order = bench.step(speeds(0.5, 0.0), |_| {});
    assert_eq!(order.speeds, speeds(0.5, 0.0));
}

#[test]
fn a_first_plan_may_take_long_while_the_vehicle_stands() {
    let mut bench = Bench::new();
    bench.begin();
    let start_s = f64::from(bench.steps) * PERIOD_S;
    // An answer that is too old when it comes is not driven on, nor an alarm yet.
    for i in 0..10 {
        let order = bench.step(speeds(0.5, 0.0), |s| match i {
            0..4 => s.controller = None,
            _ => set_command_time(s, start_s + 0.05),
        });
        assert!(
            order.enable && order.speeds == MotorSpeeds::STOP,
            "{:?}",
            bench.events
        );
    }
    assert_eq!(
        bench.step(speeds(0.5, 0.0), |_| {}).speeds,
        speeds(0.5, 0.0)
    );
    // From here on the same age stops.
    for _ in 0..20 {
        bench.step(speeds(0.5, 0.0), |s| set_command_time(s, start_s + 0.6));
    }
    assert!(
        bench
            .events
            .iter()
            .any(|event| matches!(event.reason, Reason::CommandTimeout { .. }))
    );
    assert_eq!(bench.safety.state(), SafetyState::Latched);
}

#[test]
fn a_first_plan_that_comes_late_leaves_the_second_its_time() {
    let mut bench = Bench::new();
    bench.begin();
    let start_s = f64::from(bench.steps) * PERIOD_S;
    // The first decision reaches the loop 0.09 s after its sample, and the second takes three cycles.
    for decided_s in [0.05, 0.05, 0.05, 0.2] {
        let order = bench.step(speeds(0.5, 0.0), |s| {
            s.time_s += 0.09;
            if let Some(feedback) = &mut s.feedback {
                feedback.time_s = s.time_s;
            }
            set_command_time(s, start_s + decided_s);
        });
        assert_eq!(order.speeds, MotorSpeeds::STOP);
        assert_eq!(bench.safety.state(), SafetyState::Driving, "{decided_s}");
    }
    // The machine has caught up.
    bench.steps += 2;
    let order = bench.step(speeds(0.5, 0.0), |_| {});
    assert_eq!(order.speeds, speeds(0.5, 0.0));
}

#[test]
fn a_stop_brakes_each_motor_at_the_deceleration() {
    let mut bench = Bench::driving(speeds(-0.65, 0.3));
    for cycle in 1..=7 {
        let order = bench.step(speeds(-0.65, 0.3), |inputs| {
            inputs.requests.stop = Some(StopCause::Operator)
        });
        // 2 m/s^2 in cycles of 0.05 s.
        let fallen_m_s = 0.1 * f64::from(cycle);
        let left = [0.65, 0.3].map(|speed_m_s| (speed_m_s - fallen_m_s).max(0.0));
        let speeds = order.speeds;
        assert!((speeds.traction_m_s + left[0]).abs() < 1e-9, "{order:?}");
        assert!((speeds.steer_m_s - left[1]).abs() < 1e-9, "{order:?}");
        assert!(order.enable);
    }
    bench.step(MotorSpeeds::STOP, |_| {});
    assert_eq!(bench.command, DriveCommand::OFF);
}

#[test]
fn a_ramp_catches_up_after_a_late_cycle() {
    let mut bench = Bench::driving(speeds(0.8, 0.0));
    bench.step(speeds(0.8, 0.0), |inputs| {
        inputs.requests.stop = Some(StopCause::Operator)
    });
    bench.steps += 5;
    let order = bench.step(speeds(0.8, 0.0), |_| {});
    // 0.3 s and the first cycle's 0.05 s at 2 m/s^2.
    assert!(order.speeds.traction_m_s <= 0.1 + 1e-9, "{order:?}");
}

#[test]
fn every_reason_has_a_name_and_warns_where_it_is_a_fault() {
    let why = StopReason::NoPath;
    for (reason, name, is_fault) in [
        (Reason::Armed, "armed", false),
        (Reason::Standing, "standing", false),
        (Reason::Enabled, "enabled", false),
        (Reason::RampEnded, "ramp_ended", false),
        (Reason::Finished, "finished", false),
        (Reason::Requested(StopCause::Operator), "operator", false),
        (Reason::Requested(StopCause::Obstacle), "obstacle", false),
        (Reason::Requested(StopCause::Suspended), "suspended", true),
        (Reason::ControllerStopped { why }, "no_path", true),
        (Reason::DriveOff, "drive_off", true),
        (Reason::Geofence, "geofence", true),
    ] {
        assert_eq!((reason.cause(), reason.is_fault()), (name, is_fault));
        assert!(Reason::causes().any(|cause| cause == name), "{name}");
    }
}

#[test]
fn settings_out_of_range_are_named() {
    let error = Safety::new(SafetyConfig {
        deceleration_m_s2: 0.0,
        ..SafetyConfig::default()
    })
    .unwrap_err();
    assert_eq!(error.key, "safety.deceleration_m_s2");
}
