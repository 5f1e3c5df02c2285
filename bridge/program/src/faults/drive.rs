//! One drive through its faults.

use super::kind::{Fault, FaultKind};
use super::port::FaultyPort;
use anyhow::{Context, Result};
use serde::Serialize;
use sidehill::config::{ConfigFile, RunConfig};
use sidehill_bridge::control_loop::ControlLoop;
use sidehill_bridge::control_loop::record::{CycleRow, LogEntry, LoopRecord, Record, ring};
use sidehill_bridge::control_loop::runner::InlineRunner;
use sidehill_bridge::drives::Clock;
use sidehill_bridge::safety::{OperatorRequests, SafetyState};
use sidehill_controller::path::{Point2, Window};

/// Time that is watched after the last fault, s.
const AFTER_S: f64 = 4.0;
/// Speed below which the vehicle stands, m/s, and time for which it may move faster after it has stood, s.
const STANDS_M_S: f64 = 0.02;
const MOVES_S: f64 = 0.2;
/// Distance of the true vehicle from its path that is unsafe, m.
const OFF_PATH_M: f64 = 1.0;
/// Time from the end of driving to standstill beyond that of the ramp, s: the timeout of the drives and their lag.
const STOP_BEYOND_RAMP_S: f64 = 0.5;

/// How a drive ended, and what is unsafe of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct FaultOutcome {
    pub(super) run: u64,
    pub(super) faults: Vec<Fault>,
    /// Why it stopped; none of a vehicle that drove on.
    pub(super) reason: Option<String>,
    /// Time and way from the begin of the first fault to standstill, s and m.
    pub(super) stop_time_s: Option<f64>,
    pub(super) stop_way_m: Option<f64>,
    /// Largest distance of the true vehicle from the path, m.
    pub(super) off_path_m: f64,
    /// What was unsafe.
    pub(super) unsafe_end: Option<&'static str>,
}

/// The configuration of all runs.
pub(super) struct FaultyRover {
    pub(super) file: ConfigFile,
    pub(super) config: RunConfig,
}

/// What a run leaves besides its outcome.
#[derive(Default)]
pub(super) struct Traces {
    pub(super) events: Vec<String>,
    pub(super) cycles: Vec<CycleRow>,
}

impl FaultyRover {
    /// Drives through faults, and leaves events and cycles where they are wanted.
    pub(super) fn drive(
        &self,
        run: u64,
        faults: &[Fault],
        mut traces: Option<&mut Traces>,
    ) -> Result<FaultOutcome> {
        let vehicle = self.config.load_vehicle(&self.file)?;
        let controller = self.config.controller(&self.file, &vehicle)?;
        let path = controller
            .reference()
            .and_then(|reference| reference.path())
            .context("faults need a course with a path")?
            .clone();
        let rover = self.config.simulated_port(&self.file)?;
        let safety = self.config.safety;
        let port = FaultyPort::new(rover, faults.to_vec(), safety.speed_max_m_s);
        let (records, mut log) = ring::<LoopRecord>(64);
        let clock = Clock::Virtual { now_s: 0.0 };
        let cycle = self.config.cycle;
        let runner = InlineRunner::new(controller);
        let mut control_loop = ControlLoop::new(cycle, safety, clock, port, runner, records)?
            .within(self.config.geofence.clone());

        let first_s = faults
            .iter()
            .map(|fault| fault.from_s)
            .fold(f64::INFINITY, f64::min);
        let last_s = faults
            .iter()
            .map(|fault| fault.from_s + fault.for_s)
            .fold(0.0, f64::max);
        let ramp_s = safety.speed_max_m_s / safety.deceleration_m_s2;
        let mut outcome = FaultOutcome {
            run,
            faults: faults.to_vec(),
            reason: None,
            stop_time_s: None,
            stop_way_m: None,
            off_path_m: 0.0,
            unsafe_end: None,
        };
        let (mut along_m, mut way_m, mut moving_s) = (0.0, 0.0, 0.0);
        let mut before = *control_loop.port().state();
        let mut suspended = false;
        let mut ended_s = None;
        for tick in 0.. {
            let arm = tick > 0;
            let row = control_loop.step(OperatorRequests {
                arm,
                ..OperatorRequests::default()
            });
            while let Some(record) = log.pop() {
                let entry = record.entry();
                if let Some(traces) = traces.as_deref_mut() {
                    match entry {
                        LogEntry::Event {
                            event,
                            transition,
                            reason,
                            ..
                        } => {
                            let to = transition.map_or(String::new(), |transition| {
                                format!(" {:?}", transition.to)
                            });
                            let line = format!("{:8.2} s  {event}{to}: {reason}", record.time_s());
                            traces.events.push(line);
                        }
                        LogEntry::Cycle(row) => traces.cycles.push(row),
                        LogEntry::Message(_) => {}
                    }
                }
            }
            let state = *control_loop.port().state();
            let Some(driving_s) = control_loop.port().driving_s() else {
                if row.time_s > 10.0 {
                    outcome.reason = Some("the drives were not armed".to_owned());
                    break;
                }
                continue;
            };
            let since_s = row.time_s - driving_s;
            let elapsed_s = state.time_s - before.time_s;
            let (pose, was) = (state.pose, before.pose);
            let step_m = (pose.x_m - was.x_m).hypot(pose.y_m - was.y_m);
            let motors = state.motors;
            let speed_m_s = motors.traction_m_s.abs().max(motors.steer_m_s.abs());
            before = state;
            let place = Point2 {
                x_m: pose.x_m,
                y_m: pose.y_m,
            };
            let window = Window {
                behind_m: 0.5,
                ahead_m: 1.5,
            };
            let nearest = path.nearest_within(&place, along_m, &window);
            along_m = nearest.point.arc_length_m;
            outcome.off_path_m = outcome.off_path_m.max(nearest.cross_track_m.abs());
            if since_s >= first_s && outcome.stop_time_s.is_none() {
                way_m += step_m;
            }
            let stopping = matches!(row.state, SafetyState::Stopping | SafetyState::Latched);
            if stopping && ended_s.is_none() {
                ended_s = Some(row.time_s);
                outcome.reason = control_loop.stopped_by().map(|reason| reason.to_string());
            }
            let stands = speed_m_s <= STANDS_M_S;
            let stopped = row.state == SafetyState::Latched;
            if stopped && stands && outcome.stop_time_s.is_none() {
                outcome.stop_time_s = Some(since_s - first_s);
                outcome.stop_way_m = Some(way_m);
            }
            moving_s = match outcome.stop_time_s.is_some() && !stands {
                true => moving_s + elapsed_s,
                false => 0.0,
            };
            let late = ended_s.is_some_and(|ended_s| {
                outcome.stop_time_s.is_none() && row.time_s > ended_s + ramp_s + STOP_BEYOND_RAMP_S
            });
            let found = match () {
                () if late => Some("it does not stand in time after its stop"),
                () if moving_s > MOVES_S => Some("it moves again without an arming"),
                () if nearest.cross_track_m.abs() > OFF_PATH_M => Some("it is far from its path"),
                () if !row.traction_m_s.is_finite()
                    || row.traction_m_s.abs() > safety.speed_max_m_s =>
                {
                    Some("a command is beyond its limit")
                }
                () => None,
            };
            outcome.unsafe_end = outcome.unsafe_end.or(found);
            let suspends = |fault: &&Fault| fault.kind == FaultKind::Suspended;
            if !suspended
                && let Some(fault) = faults.iter().find(suspends)
                && since_s >= fault.from_s
            {
                suspended = true;
                control_loop.suspend(fault.for_s);
            }
            if since_s > last_s + AFTER_S {
                break;
            }
        }
        Ok(outcome)
    }
}
