//! What the drives make of their commands: how late, how weak and how wrong they may be.

use super::*;

/// Lets drives make `made` of their command of the cycle before, for some cycles at a command; returns
/// the state.
fn drives(
    bench: &mut Bench,
    command: MotorSpeeds,
    cycles: u32,
    made: impl Fn(MotorSpeeds) -> MotorSpeeds,
) -> SafetyState {
    for _ in 0..cycles {
        let made = made(bench.command.speeds);
        bench.step(command, |inputs| {
            if let Some(feedback) = &mut inputs.feedback {
                feedback.value.speeds = made;
            }
        });
    }
    bench.safety.state()
}

#[test]
fn drives_may_take_their_response_time() {
    // Of 0.5 s.
    for (late, state) in [(9, SafetyState::Driving), (14, SafetyState::Latched)] {
        let mut bench = Bench::driving(speeds(0.0, 0.0));
        for command in [speeds(0.6, -0.2), speeds(-0.4, 0.6), speeds(0.5, 0.1)] {
            let before = bench.command.speeds;
            drives(&mut bench, command, late, |_| before);
            drives(&mut bench, command, 12, |command| command);
        }
        assert_eq!(bench.safety.state(), state, "{late} cycles late");
    }
}

#[test]
fn a_weak_motor_is_put_up_with_for_a_while_whichever_way_it_turns() {
    for command in [speeds(0.8, 0.0), speeds(-0.8, 0.0), speeds(0.0, -0.8)] {
        let state = |cycles: u32, share: f64| {
            let mut bench = Bench::driving(speeds(0.0, 0.0));
            drives(&mut bench, command, cycles, |command| {
                speeds(share * command.traction_m_s, share * command.steer_m_s)
            })
        };
        assert_eq!(state(36, 0.4), SafetyState::Driving, "{command:?}");
        assert_eq!(state(60, 0.4), SafetyState::Latched, "{command:?}");
        for share in [0.2, -0.4, 1.2] {
            assert_eq!(state(36, share), SafetyState::Latched, "{command:?}");
        }
    }
}

#[test]
fn each_motor_is_judged_by_its_own_command() {
    for wrong in [
        speeds(0.3, 0.0),
        speeds(-0.3, 0.0),
        speeds(0.0, 0.3),
        speeds(0.0, -0.3),
    ] {
        let mut bench = Bench::driving(speeds(0.0, 0.0));
        drives(&mut bench, speeds(0.0, 0.0), 12, |_| wrong);
        let found = bench.events.iter().find_map(|event| match event.reason {
            Reason::Implausible {
                traction_m_s,
                steer_m_s,
                ..
            } => Some((traction_m_s, steer_m_s)),
            _ => None,
        });
        let expected = (wrong.traction_m_s.abs(), wrong.steer_m_s.abs());
        assert_eq!(found, Some(expected), "{wrong:?}");
    }
}

#[test]
fn feedback_that_is_not_a_number_stops_as_soon_as_one_that_is_far_off() {
    let mut bench = Bench::driving(speeds(0.5, 0.0));
    drives(&mut bench, speeds(0.5, 0.0), 2, |_| speeds(0.5, f64::NAN));
    assert_eq!(bench.safety.state(), SafetyState::Stopping);
    assert!(matches!(bench.last().reason, Reason::Implausible { .. }));
}

#[test]
fn what_was_commanded_before_a_drive_excuses_nothing_in_it() {
    let mut bench = Bench::driving(speeds(0.8, 0.0));
    bench.step(speeds(0.8, 0.0), |inputs| {
        inputs.requests.halt = Some(StopCause::EmergencyStop)
    });
    bench.inputs.requests.halt = None;
    bench.begin();
    // It drove at 0.8 m/s 0.4 s ago.
    let state = drives(&mut bench, MotorSpeeds::STOP, 3, |_| speeds(0.8, 0.0));
    assert_eq!(state, SafetyState::Latched);
}

/// Drives at a command behind a node that forwards `forwarded`, stamped `age_s` ago; returns the state.
fn behind_a_node(
    command: MotorSpeeds,
    cycles: u32,
    age_s: f64,
    forwarded: impl Fn(MotorSpeeds) -> MotorSpeeds,
    made: impl Fn(MotorSpeeds) -> MotorSpeeds,
) -> SafetyState {
    let mut bench = Bench::driving(speeds(0.0, 0.0));
    for _ in 0..cycles {
        let before = bench.command.speeds;
        bench.step(command, |inputs| {
            inputs.forwarded = Some(Stamped {
                time_s: inputs.time_s - age_s,
                value: forwarded(before),
            });
            if let Some(feedback) = &mut inputs.feedback {
                feedback.value.speeds = made(before);
            }
        });
    }
    bench.safety.state()
}

#[test]
fn a_node_that_has_fallen_silent_excuses_nothing() {
    let third = |command: MotorSpeeds| speeds(0.3 * command.traction_m_s, 0.0);
    let state = |age_s| behind_a_node(speeds(0.8, 0.0), 60, age_s, third, third);
    assert_eq!(state(0.4), SafetyState::Driving);
    assert_eq!(state(0.7), SafetyState::Latched);
}

#[test]
fn a_node_that_forwards_no_number_is_ignored() {
    let follows = |command: MotorSpeeds| command;
    let state = behind_a_node(
        speeds(0.8, 0.0),
        60,
        0.0,
        |_| speeds(f64::NAN, 0.0),
        follows,
    );
    assert_eq!(state, SafetyState::Driving);
}

#[test]
fn drives_may_respond_late_to_what_a_node_forwards_late() {
    let mut bench = Bench::driving(speeds(0.0, 0.0));
    let mut commands = vec![MotorSpeeds::STOP; 16];
    for cycle in 0..200 {
        let command = match cycle / 20 % 2 {
            0 => speeds(0.6, -0.1),
            _ => speeds(-0.5, 0.2),
        };
        // Each by 0.4 s.
        let (forwarded, made) = (commands[cycle + 8], commands[cycle]);
        bench.step(command, |inputs| {
            let time_s = inputs.time_s;
            inputs.forwarded = Some(Stamped {
                time_s,
                value: forwarded,
            });
            if let Some(feedback) = &mut inputs.feedback {
                feedback.value.speeds = made;
            }
        });
        commands.push(bench.command.speeds);
    }
    assert_eq!(bench.safety.state(), SafetyState::Driving);
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
