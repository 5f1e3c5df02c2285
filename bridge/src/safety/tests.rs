mod any;
mod faults;
mod model;

use super::*;
use crate::drives::LinkState;
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
fn a_first_plan_may_take_long_while_the_vehicle_stands() {
    let mut bench = Bench::new();
    bench.arm();
    while bench.safety.state() != SafetyState::Driving {
        bench.step(MotorSpeeds::STOP, |_| {});
    }
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
    bench.arm();
    while bench.safety.state() != SafetyState::Driving {
        bench.step(MotorSpeeds::STOP, |_| {});
    }
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
fn settings_out_of_range_are_named() {
    let error = Safety::new(SafetyConfig {
        deceleration_m_s2: 0.0,
        ..SafetyConfig::default()
    })
    .unwrap_err();
    assert_eq!(error.key, "safety.deceleration_m_s2");
}

#[test]
fn a_node_on_the_way_to_the_drives_may_slow_them_down_but_not_speed_them_up() {
    let slow = |factor: f64, heard: bool, cycles: u32| {
        let mut bench = Bench::driving(speeds(0.0, 0.0));
        for _ in 0..cycles {
            let before = bench.command.speeds;
            let made = speeds(factor * before.traction_m_s, factor * before.steer_m_s);
            bench.step(speeds(0.8, 0.0), |inputs| {
                let time_s = inputs.time_s;
                inputs.forwarded = heard.then_some(Stamped {
                    time_s,
                    value: made,
                });
                if let Some(feedback) = &mut inputs.feedback {
                    feedback.value.speeds = made;
                }
            });
        }
        bench.safety.state()
    };
    assert_eq!(slow(0.3, true, 60), SafetyState::Driving);
    // A weak motor is put up with until the controller has learned it, one that hardly turns is not.
    assert_eq!(slow(0.4, false, 36), SafetyState::Driving);
    assert_eq!(slow(0.4, false, 60), SafetyState::Latched, "weak");
    assert_eq!(slow(0.2, false, 36), SafetyState::Latched, "stuck");
    assert_eq!(
        slow(1.5, true, 36),
        SafetyState::Latched,
        "faster than commanded"
    );
}
