//! Whatever is inputs.

use super::*;
use proptest::prelude::*;

fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![
        -1.5..1.5f64,
        Just(f64::NAN),
        Just(f64::INFINITY),
        Just(-0.0)
    ]
}

fn any_observation() -> impl Strategy<Value = SafetyInputs> {
    let mode = prop_oneof![
        6 => Just(DriveMode::Enabled),
        6 => Just(DriveMode::Disabled),
        1 => Just(DriveMode::EmergencyStop),
        1 => Just(DriveMode::Fault),
        1 => Just(DriveMode::NotOperational),
        1 => Just(DriveMode::OtherMode),
        1 => Just(DriveMode::Frozen),
    ];
    let bus = prop_oneof![
        8 => Just(LinkState::Active),
        1 => Just(LinkState::Passive),
        1 => Just(LinkState::BusOff),
        1 => Just(LinkState::Foreign),
    ];
    let operator = (
        any::<bool>(),
        prop::bool::weighted(0.05),
        prop::bool::weighted(0.05),
    )
        .prop_map(|(arm, stop, halt)| OperatorRequests {
            arm,
            stop: stop.then_some(StopCause::Operator),
            halt: halt.then_some(StopCause::ProgramEnds),
        });
    (
        prop_oneof![20 => 0.0..0.1f64, 1 => -1.0..2.0f64, 1 => Just(f64::NAN)],
        (any_number(), any_number(), -0.05..0.2f64),
        (any_number(), any_number(), 0.0..0.25f64, mode),
        bus,
        prop::option::weighted(0.1, 0.0..0.3f64),
        operator,
    )
        .prop_map(
            |(dt, (traction, steer, age), (a, b, old, mode), bus, unsent, operator)| {
                // Times are made absolute by the test.
                SafetyInputs {
                    time_s: dt,
                    controller: Some(ControllerOutput {
                        time_s: age,
                        command: speeds(traction, steer),
                        state: ControllerState::Driving,
                    }),
                    feedback: Some(Stamped {
                        time_s: old,
                        value: DriveFeedback {
                            speeds: speeds(a, b),
                            mode,
                        },
                    }),
                    forwarded: None,
                    link: bus,
                    unsent_since_s: unsent,
                    requests: operator,
                    leaves_geofence: false,
                }
            },
        )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    /// Whatever comes: orders are finite and bounded, only Driving and Stopping move anything, speed
    /// never grows while stopping, Latched is left only by arming, and every change is an event.
    #[test]
    fn whatever_is_seen_the_order_is_safe(observations in prop::collection::vec(any_observation(), 1..200)) {
        let mut safety = Safety::new(SafetyConfig::default()).unwrap();
        let (mut now_s, mut before, mut armed_before) = (0.0, DriveCommand::OFF, true);
        for mut inputs in observations {
            let dt = inputs.time_s;
            let time_s = now_s + dt;
            inputs.time_s = time_s;
            if let Some(output) = &mut inputs.controller { output.time_s = time_s - output.time_s; }
            if let Some(feedback) = &mut inputs.feedback { feedback.time_s = time_s - feedback.time_s; }
            if let Some(since) = &mut inputs.unsent_since_s { *since = time_s - *since; }
            let from = safety.state();
            let (order, event) = safety.step(&inputs);
            let state = safety.state();
            prop_assert_eq!(event.is_some(), state != from);
            prop_assert!(order.speeds.is_finite());
            prop_assert!(order.speeds.traction_m_s.abs() <= 1.0 && order.speeds.steer_m_s.abs() <= 1.0);
            if !matches!(state, SafetyState::Driving | SafetyState::Stopping) {
                prop_assert_eq!(order.speeds, MotorSpeeds::STOP);
            }
            prop_assert_eq!(order.enable, matches!(state, SafetyState::Enabling | SafetyState::Driving | SafetyState::Stopping));
            prop_assert_eq!(order.fault_reset, state == SafetyState::Zeroing);
            if state == SafetyState::Stopping {
                let elapsed = if dt >= 0.0 { dt } else { 0.0 };
                let bound = (before.speeds.traction_m_s.abs() - 2.0 * elapsed).max(0.0);
                prop_assert!(order.speeds.traction_m_s.abs() <= bound + 1e-9);
            }
            if matches!(from, SafetyState::Latched | SafetyState::Disarmed) && state != from {
                prop_assert!(state == SafetyState::Zeroing && inputs.requests.arm && !armed_before);
            }
            if inputs.requests.halt.is_some() || inputs.feedback.is_some_and(|f| f.value.mode == DriveMode::EmergencyStop) {
                prop_assert_eq!(order.speeds, MotorSpeeds::STOP);
            }
            armed_before = inputs.requests.arm;
            before = order;
            if time_s.is_finite() { now_s = time_s; }
        }
    }
}
