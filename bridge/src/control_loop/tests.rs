//! The loop over drives that follow at once: what it sends, when it ends and what it says of that.

use super::channel::command_channel;
use super::record::{LoopRecord, RecordSource, ring};
use super::runner::ControllerRunner;
use super::*;
use crate::drives::{
    Clock, DriveCommand, DriveFeedback, DriveMode, ExternalClock, LinkState, Port, PortInputs,
    SendError,
};
use crate::safety::{Geofence, OperatorRequests, Reason, SafetyConfig, SafetyState, StopCause};
use sidehill_controller::controller::{Decision, Status};
use sidehill_plant::sample::{Sample, Stamped};
use sidehill_plant::speeds::MotorSpeeds;
use std::cell::RefCell;
use std::rc::Rc;
use std::sync::atomic::Ordering;
use std::time::Duration;

const PERIOD_S: f64 = 0.05;
const SPEEDS: MotorSpeeds = MotorSpeeds {
    traction_m_s: 0.5,
    steer_m_s: 0.1,
};
const IDLE: OperatorRequests = OperatorRequests {
    arm: false,
    stop: None,
    halt: None,
};
const ARM: OperatorRequests = OperatorRequests { arm: true, ..IDLE };

/// What a loop runs with; times are those of its clock, s.
struct Setup {
    clock: Clock,
    safety: SafetyConfig,
    link: fn(f64) -> LinkState,
    /// Whether nothing can be sent.
    blocked: fn(f64) -> bool,
    /// What the controller says.
    status: fn(f64) -> Status,
    /// Called in each cycle, to raise flags.
    signal: Box<dyn FnMut(f64)>,
}

impl Default for Setup {
    fn default() -> Self {
        Self {
            clock: Clock::Virtual { now_s: 0.0 },
            safety: SafetyConfig::default(),
            link: |_| LinkState::Active,
            blocked: |_| false,
            status: |_| Status::Tracking,
            signal: Box::new(|_| {}),
        }
    }
}

/// Commands with their instants, s.
type Sent = Rc<RefCell<Vec<(f64, DriveCommand)>>>;
/// Whether the controller was engaged, and how long it was waited for.
type Asked = Rc<RefCell<Vec<(bool, Option<Duration>)>>>;

/// Drives that follow at once and report 0.03 s late.
struct Vehicle {
    sent: Sent,
    link: fn(f64) -> LinkState,
    blocked: fn(f64) -> bool,
}

impl Port for Vehicle {
    fn receive(&mut self, now_s: f64) -> PortInputs {
        let sent = self.sent.borrow();
        let command = sent
            .last()
            .map_or(DriveCommand::OFF, |(_, command)| *command);
        PortInputs {
            sample: Sample {
                time_s: now_s,
                tread_speeds: None,
                attitude: None,
                yaw_rate: None,
                pose: None,
            },
            feedback: Some(Stamped {
                time_s: now_s - 0.03,
                value: DriveFeedback {
                    speeds: command.speeds,
                    mode: match command.enable {
                        true => DriveMode::Enabled,
                        false => DriveMode::Disabled,
                    },
                },
            }),
            forwarded: None,
            link: (self.link)(now_s),
            refused: 7,
        }
    }

    fn send(&mut self, now_s: f64, command: &DriveCommand) -> Result<(), SendError> {
        if (self.blocked)(now_s) {
            return Err(SendError::QueueFull);
        }
        self.sent.borrow_mut().push((now_s, *command));
        Ok(())
    }
}

/// Wants constant speeds.
struct Pilot {
    status: fn(f64) -> Status,
    signal: Box<dyn FnMut(f64)>,
    asked: Asked,
}

impl ControllerRunner for Pilot {
    fn decide(
        &mut self,
        sample: &Sample,
        engaged: bool,
        patience: Option<Duration>,
    ) -> Option<Decision> {
        self.asked.borrow_mut().push((engaged, patience));
        assert!(self.asked.borrow().len() < 1000, "the run does not end");
        (self.signal)(sample.time_s);
        Some(Decision::of_command(
            sample.time_s,
            SPEEDS,
            (self.status)(sample.time_s),
        ))
    }
}

/// A loop with what it sent, what its controller was asked, and what it recorded.
struct Bench {
    control: ControlLoop<Vehicle, Pilot>,
    sent: Sent,
    asked: Asked,
    records: RecordSource<LoopRecord>,
}

impl Bench {
    fn new(setup: Setup) -> Self {
        let (sent, asked) = (Sent::default(), Asked::default());
        let vehicle = Vehicle {
            sent: Rc::clone(&sent),
            link: setup.link,
            blocked: setup.blocked,
        };
        let pilot = Pilot {
            status: setup.status,
            signal: setup.signal,
            asked: Rc::clone(&asked),
        };
        let (sink, records) = ring(4096);
        let (cycle, safety) = (CycleConfig::default(), setup.safety);
        Self {
            control: ControlLoop::new(cycle, safety, setup.clock, vehicle, pilot, sink).unwrap(),
            sent,
            asked,
            records,
        }
    }

    /// Arms, and runs cycles until 1 s.
    fn driving() -> Self {
        let mut bench = Self::new(Setup::default());
        for cycle in 0..20 {
            bench.control.step(if cycle > 1 { ARM } else { IDLE });
        }
        assert_eq!(bench.control.state(), SafetyState::Driving);
        bench
    }

    fn last_sent(&self) -> DriveCommand {
        self.sent.borrow().last().unwrap().1
    }

    /// Returns the times at which the vehicle was commanded to move.
    fn moving_s(&self) -> Vec<f64> {
        let sent = self.sent.borrow();
        let moving = sent
            .iter()
            .filter(|(_, command)| command.speeds != MotorSpeeds::STOP);
        moving.map(|(time_s, _)| *time_s).collect()
    }
}

/// Arms at the start, and ends at 4 s.
const OPTIONS: RunOptions = RunOptions {
    arm: true,
    duration_s: Some(4.0),
};

/// Checks that a run has ended by switching off, and that nothing moved after `until_s`.
fn assert_off(bench: &Bench, until_s: f64, cause: Option<StopCause>) {
    let sent = bench.sent.borrow();
    let last = &sent[sent.len() - 5..];
    assert!(
        last.iter()
            .all(|(_, command)| *command == DriveCommand::OFF)
    );
    let moved_s = bench.moving_s().last().copied().unwrap_or(0.0);
    assert!(moved_s < until_s, "{moved_s}");
    if let Some(cause) = cause {
        assert_eq!(bench.control.stopped_by(), Some(Reason::Requested(cause)));
    }
}

#[test]
fn a_run_ends_where_its_course_does() {
    let finishes = || Setup {
        status: |time_s| match time_s < 2.0 {
            true => Status::Tracking,
            false => Status::Finished,
        },
        ..Setup::default()
    };
    let mut bench = Bench::new(finishes());
    let ending = bench.control.run(&OPTIONS, &Signals::default(), None);
    assert_eq!(ending, RunEnding::Finished);
    // The ramp takes 0.25 s.
    let ended_s = bench.sent.borrow().last().unwrap().0;
    assert!((2.2..2.7).contains(&ended_s), "{ended_s}");
    assert_off(&bench, 2.3, None);
    assert!(bench.moving_s().last() > Some(&2.1));
    // The end of a path that a client gave does not end the program.
    let mut bench = Bench::new(finishes());
    let (_client, loop_end, _controller) = command_channel(1);
    let ending = bench
        .control
        .run(&OPTIONS, &Signals::default(), Some(loop_end));
    assert_eq!(ending, RunEnding::TimeOverStopped);
}

#[test]
fn a_run_whose_time_is_over_halts_and_says_whether_it_was_driving() {
    for (arm, ending) in [
        (true, RunEnding::TimeOver),
        (false, RunEnding::TimeOverStopped),
    ] {
        let mut bench = Bench::new(Setup::default());
        let options = RunOptions { arm, ..OPTIONS };
        assert_eq!(
            bench.control.run(&options, &Signals::default(), None),
            ending
        );
        assert_off(&bench, 4.04, arm.then_some(StopCause::TimeOver));
        assert_eq!(bench.moving_s().is_empty(), !arm);
        // The cycle at 4 s, and five that switch off.
        let ended_s = bench.sent.borrow().last().unwrap().0;
        assert!((ended_s - 4.25).abs() < 0.051, "{ended_s}");
    }
}

#[test]
fn a_signal_or_a_suspension_ends_a_run_in_its_cycle() {
    let ended = |resumed: bool, channel: bool| {
        let signals = Signals::default();
        let flags = signals.clone();
        let mut bench = Bench::new(Setup {
            signal: Box::new(move |time_s| {
                let flag = if resumed { &flags.resumed } else { &flags.end };
                flag.store(time_s > 1.99, Ordering::Relaxed);
            }),
            ..Setup::default()
        });
        let (_client, loop_end, _controller) = command_channel(1);
        let loop_end = channel.then_some(loop_end);
        let ending = bench.control.run(&OPTIONS, &signals, loop_end);
        let (until_s, cause) = match ending {
            RunEnding::TimeOver => (4.04, StopCause::TimeOver),
            RunEnding::Suspended => (2.04, StopCause::Suspended),
            _ => (2.04, StopCause::ProgramEnds),
        };
        assert_off(&bench, until_s, Some(cause));
        ending
    };
    assert_eq!(ended(false, false), RunEnding::Interrupted);
    assert_eq!(ended(false, true), RunEnding::ShutDown);
    assert_eq!(ended(true, true), RunEnding::Suspended);
    // Only the middleware does not survive it.
    assert_eq!(ended(true, false), RunEnding::TimeOver);
}

#[test]
fn a_signal_stops_on_the_ramp_and_another_arms_again() {
    let signals = Signals::default();
    let flags = signals.clone();
    let mut cycle = 0;
    let mut bench = Bench::new(Setup {
        signal: Box::new(move |_| {
            cycle += 1;
            match cycle {
                30 => flags.stop.store(true, Ordering::Relaxed),
                50 => flags.arm.store(true, Ordering::Relaxed),
                _ => {}
            }
        }),
        ..Setup::default()
    });
    let ending = bench.control.run(&OPTIONS, &signals, None);
    assert_eq!(ending, RunEnding::TimeOver);
    let mut said = Vec::new();
    while let Some(record) = bench.records.pop() {
        if let LoopRecord::Transition(transition) = record {
            said.push((transition.to, transition.reason));
        }
    }
    let operator = (
        SafetyState::Stopping,
        Reason::Requested(StopCause::Operator),
    );
    assert_eq!(said.iter().filter(|said| **said == operator).count(), 1);
    let armed = (SafetyState::Zeroing, Reason::Armed);
    assert_eq!(said.iter().filter(|said| **said == armed).count(), 2);
    let stands = |time_s: f64| {
        bench
            .moving_s()
            .iter()
            .all(|moving_s| (moving_s - time_s).abs() > 0.04)
    };
    assert!(!stands(1.4) && stands(2.2) && !stands(3.0));
}

#[test]
fn a_run_waits_for_a_link_that_carries_before_it_arms() {
    let mut bench = Bench::new(Setup {
        link: |time_s| match time_s < 2.0 {
            true => LinkState::Down,
            false => LinkState::Active,
        },
        ..Setup::default()
    });
    let ending = bench.control.run(&OPTIONS, &Signals::default(), None);
    assert_eq!(ending, RunEnding::TimeOver);
    let first_s = bench.moving_s()[0];
    assert!((2.2..2.5).contains(&first_s), "{first_s}");
}

#[test]
fn a_run_does_not_arm_on_feedback_that_is_too_old_for_its_settings() {
    let mut bench = Bench::new(Setup {
        safety: SafetyConfig {
            feedback_timeout_s: 0.02,
            ..SafetyConfig::default()
        },
        ..Setup::default()
    });
    let ending = bench.control.run(&OPTIONS, &Signals::default(), None);
    assert_eq!(ending, RunEnding::TimeOverStopped);
    // A handshake would have ended with a reason.
    assert_eq!(bench.control.stopped_by(), None);
}

#[test]
fn a_loop_that_cannot_send_stops_and_counts_what_was_not_sent() {
    let mut bench = Bench::new(Setup {
        // One cycle at 2 s is no outage.
        blocked: |time_s| (1.99..2.01).contains(&time_s) || (2.99..3.21).contains(&time_s),
        ..Setup::default()
    });
    let mut unsent = 0;
    for cycle in 0..80 {
        let row = bench.control.step(if cycle > 1 { ARM } else { IDLE });
        unsent += u64::from(!row.sent);
        if row.time_s < 3.13 && cycle > 10 {
            assert_eq!(row.state, SafetyState::Driving, "{}", row.time_s);
        }
    }
    assert_eq!((unsent, bench.control.timing().unsent), (6, 6));
    assert_eq!(bench.control.state(), SafetyState::Latched);
    let stopped_by = bench.control.stopped_by();
    assert!(matches!(stopped_by, Some(Reason::TransmitTimeout { .. })));
    // Each outage is told once, when it begins.
    let mut told = Vec::new();
    while let Some(record) = bench.records.pop() {
        if let LoopRecord::Unsent { time_s, .. } = record {
            told.push((time_s / PERIOD_S).round());
        }
    }
    assert_eq!(told, [40.0, 60.0]);
}

#[test]
fn the_controller_is_engaged_while_the_vehicle_drives_and_waited_for_in_real_time_alone() {
    let bench = Bench::driving();
    let asked = bench.asked.borrow();
    let first = asked.iter().position(|(engaged, _)| *engaged).unwrap();
    // Armed in the third cycle, 0.2 s of zeros, enabled, driving, and told in the cycle after that.
    assert_eq!(first, 8);
    assert!(asked[first..].iter().all(|asked| *asked == (true, None)));
    let clock = ExternalClock::default();
    clock.set(1.0);
    let mut bench = Bench::new(Setup {
        clock: Clock::External(clock),
        ..Setup::default()
    });
    bench.control.step(IDLE);
    let waits = Duration::from_secs_f64(CycleConfig::default().decision_time_s);
    assert_eq!(*bench.asked.borrow(), [(false, Some(waits))]);
}

#[test]
fn a_vehicle_stands_where_its_clock_does_and_drives_on_with_it() {
    let clock = ExternalClock::default();
    let mut bench = Bench::new(Setup {
        clock: Clock::External(clock.clone()),
        ..Setup::default()
    });
    let due_s = |cycle: u32| 1.0 + CycleConfig::default().period_s * f64::from(cycle);
    for cycle in 0..20 {
        clock.set(due_s(cycle));
        assert!(!bench.control.clock_stands());
        bench.control.step(if cycle == 2 { ARM } else { IDLE });
    }
    let newest = || bench.sent.borrow().last().unwrap().1;
    let driving = newest();
    assert_eq!(bench.control.state(), SafetyState::Driving);
    assert!(driving.enable && driving.speeds != MotorSpeeds::STOP);
    // It is slow, and then stands.
    for early_s in [0.02, 0.01] {
        clock.set(due_s(20) - early_s);
        assert!(bench.control.clock_stands());
        assert_eq!(newest(), driving);
    }
    assert!(bench.control.clock_stands());
    let standing = DriveCommand {
        speeds: MotorSpeeds::STOP,
        ..driving
    };
    assert_eq!(newest(), standing);
    clock.set(due_s(20));
    assert!(!bench.control.clock_stands());
    bench.control.step(IDLE);
    assert_eq!(newest(), driving);
    assert_eq!(bench.control.state(), SafetyState::Driving);
}

#[test]
fn the_reason_of_a_stop_is_what_began_it() {
    let mut bench = Bench::driving();
    let stop = OperatorRequests {
        stop: Some(StopCause::Operator),
        ..IDLE
    };
    bench.control.step(stop);
    for _ in 0..10 {
        bench.control.step(IDLE);
    }
    assert_eq!(bench.control.state(), SafetyState::Latched);
    let operator = Some(Reason::Requested(StopCause::Operator));
    assert_eq!(bench.control.stopped_by(), operator);
    // Arming again is no stop, a halt of the handshake is.
    bench.control.step(ARM);
    assert_eq!(bench.control.stopped_by(), operator);
    let halt = OperatorRequests {
        halt: Some(StopCause::EmergencyStop),
        ..IDLE
    };
    bench.control.step(halt);
    let pressed = Some(Reason::Requested(StopCause::EmergencyStop));
    assert_eq!(bench.control.stopped_by(), pressed);
}

#[test]
fn a_vehicle_without_an_estimate_is_not_held_back_by_its_geofence() {
    // The handshake goes on until the controller knows where it is.
    let corners = vec![[1.0, 1.0], [2.0, 1.0], [2.0, 2.0]];
    let fence = Geofence::try_from(corners).unwrap();
    let mut bench = Bench::new(Setup::default());
    bench.control = bench.control.within(Some(fence));
    for cycle in 0..20 {
        bench.control.step(if cycle > 1 { ARM } else { IDLE });
    }
    assert_eq!(bench.control.state(), SafetyState::Driving);
}

#[test]
fn cycles_whose_time_passed_in_a_suspension_are_skipped() {
    let mut bench = Bench::driving();
    bench.control.suspend(0.98);
    // It was due at 1 s, 0.05 s after the last.
    let row = bench.control.step(ARM);
    assert!((row.lateness_s - 0.93).abs() < 1e-9, "{row:?}");
    assert_eq!(row.skipped, 18);
    let row = bench.control.step(ARM);
    assert!(row.lateness_s.abs() < 1e-9, "{row:?}");
}

#[test]
fn a_row_says_what_was_commanded_and_fed_back() {
    let mut bench = Bench::driving();
    let row = bench.control.step(ARM);
    assert_eq!((row.traction_m_s, row.steer_m_s), (0.5, 0.1));
    assert_eq!(
        (row.feedback_traction_m_s, row.feedback_steer_m_s),
        (0.5, 0.1)
    );
    assert!((row.feedback_age_s - 0.03).abs() < 1e-9);
    assert!((row.slack_s - PERIOD_S).abs() < 1e-9);
    assert!(row.enable && row.sent && row.state == SafetyState::Driving);
    assert_eq!(
        (row.bus, row.refused, row.skipped),
        (LinkState::Active, 7, 0)
    );
}

#[test]
fn a_loop_that_is_dropped_switches_off_three_times() {
    let bench = Bench::driving();
    assert!(bench.last_sent().enable);
    let Bench { control, sent, .. } = bench;
    let before = sent.borrow().len();
    drop(control);
    let sent = sent.borrow();
    assert_eq!(sent.len(), before + 3);
    assert!(
        sent[before..]
            .iter()
            .all(|(_, command)| *command == DriveCommand::OFF)
    );
}
