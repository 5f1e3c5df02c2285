//! The cycle: receive, decide, guard, send, record, on absolute times.

use crate::bus::SendFault;
use crate::clock::Clock;
use crate::pilot::{Pilot, intent};
use crate::port::Port;
use crate::record::{CycleRow, Record, RecordSink};
use crate::safety::{Observation, Operator, Order, Reason, Safety, SafetyConfig, State};
use serde::{Deserialize, Serialize};
use sidehill_plant::vehicle::RangeError;
use std::time::Duration;

/// Settings of the cycle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CycleConfig {
    /// Period, s, from 0.01 (100 Hz) to 0.2.
    pub period_s: f64,
    /// Longest wait for the controller in a cycle, s; a later decision counts in the next.
    pub decision_time_s: f64,
}

impl Default for CycleConfig {
    fn default() -> Self {
        Self {
            period_s: 0.05,
            decision_time_s: 0.03,
        }
    }
}

impl CycleConfig {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub fn validate(&self) -> Result<(), RangeError> {
        RangeError::check(
            "cycle.period_s",
            self.period_s,
            0.01,
            0.2,
            "from 0.01 to 0.2 s",
        )?;
        RangeError::check(
            "cycle.decision_time_s",
            self.decision_time_s,
            0.001,
            self.period_s,
            "from 0.001 s to cycle.period_s",
        )?;
        Ok(())
    }
}

/// The cycle with its vehicle, its controller and its safety.
pub struct Cycle<P: Port, Q: Pilot> {
    config: CycleConfig,
    clock: Clock,
    port: P,
    pilot: Q,
    safety: Safety,
    records: RecordSink,
    tick: u64,
    first_s: Option<f64>,
    skipped: u64,
    lateness: Lateness,
    unsent_since_s: Option<f64>,
    unsent: u64,
    stopped_by: Option<Reason>,
}

/// How well the cycle has kept its times.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Timing {
    /// Cycles run.
    pub cycles: u64,
    /// Cycles left out.
    pub skipped: u64,
    /// Cycles whose command could not be sent.
    pub unsent: u64,
    /// Median lateness of the beginnings, s.
    pub lateness_p50_s: f64,
    /// 99 % quantile, s.
    pub lateness_p99_s: f64,
    /// Largest, s.
    pub lateness_max_s: f64,
    /// Least slack at the end of a cycle, s; negative where a cycle ended late.
    pub slack_min_s: f64,
}

impl<P: Port, Q: Pilot> Cycle<P, Q> {
    /// Returns a cycle that begins with its first step, disarmed.
    ///
    /// # Errors
    /// [`RangeError`] for a setting out of range.
    pub fn new(
        config: CycleConfig,
        safety: SafetyConfig,
        clock: Clock,
        port: P,
        pilot: Q,
        records: RecordSink,
    ) -> Result<Self, RangeError> {
        config.validate()?;
        Ok(Self {
            config,
            clock,
            port,
            pilot,
            safety: Safety::new(safety)?,
            records,
            tick: 0,
            first_s: None,
            skipped: 0,
            lateness: Lateness::new(),
            unsent_since_s: None,
            unsent: 0,
            stopped_by: None,
        })
    }

    /// Returns the port.
    pub fn port(&self) -> &P {
        &self.port
    }

    /// Returns the state of the safety.
    pub fn state(&self) -> State {
        self.safety.state()
    }

    /// Returns why the last drive or handshake ended.
    pub fn stopped_by(&self) -> Option<Reason> {
        self.stopped_by
    }

    /// Returns how well the cycle has kept its times.
    pub fn timing(&self) -> Timing {
        Timing {
            cycles: self.lateness.count,
            skipped: self.skipped,
            unsent: self.unsent,
            lateness_p50_s: self.lateness.quantile(0.5),
            lateness_p99_s: self.lateness.quantile(0.99),
            lateness_max_s: self.lateness.max_s,
            slack_min_s: self.lateness.slack_min_s,
        }
    }

    /// Runs one cycle and returns what it did; waits for its time first.
    pub fn step(&mut self, operator: Operator) -> CycleRow {
        // 1. Wait for the absolute time of this cycle.
        let first_s = *self.first_s.get_or_insert_with(|| self.clock.now_s());
        let mut due_s = first_s + self.tick as f64 * self.config.period_s;
        self.clock.wait_until(due_s);
        let begin_s = self.clock.now_s();
        if begin_s + self.config.period_s < due_s {
            // A clock that was put back, or has been waited for in vain, is counted from anew.
            self.first_s = Some(begin_s);
            self.tick = 0;
            due_s = begin_s;
        }

        // 2. Receive: the newest of everything.
        let reading = self.port.receive(begin_s);

        // 3. Decide, within the time there is.
        let engaged = self.safety.state() == State::Driving;
        let patience = match self.clock {
            Clock::Real(_) | Clock::Told(_) => {
                Some(Duration::from_secs_f64(self.config.decision_time_s))
            }
            Clock::Virtual { .. } => None,
        };
        let decision = self.pilot.decide(&reading.sample, engaged, patience);

        // 4. Guard: only the safety says what is sent. Its time is that of the readings.
        let (order, transition) = self.safety.step(&Observation {
            time_s: begin_s,
            intent: decision.as_ref().map(intent),
            feedback: reading.feedback,
            bus: reading.bus,
            unsent_since_s: self.unsent_since_s,
            operator,
        });

        // 5. Send at once, or not at all.
        let sent = self.send(&order);

        // 6. Record, and find the next cycle that is not over yet.
        if let Some(transition) = transition {
            let stops = matches!(transition.to, State::Stopping | State::Latched);
            if stops && transition.from != State::Stopping {
                self.stopped_by = Some(transition.reason);
            }
            self.records.push(Record::Transition(transition));
        }
        let end_s = self.clock.now_s();
        let slack_s = due_s + self.config.period_s - end_s;
        self.lateness.take(begin_s - due_s, slack_s);
        // A cycle that began after its own period does not begin again at once.
        let passed_s = (begin_s - due_s).max(-slack_s);
        let late_periods = (passed_s / self.config.period_s).max(0.0) as u64;
        self.tick += 1 + late_periods;
        self.skipped += late_periods;
        let feedback = reading.feedback.map(|feedback| feedback.value.speeds);
        let estimate = decision.as_ref().and_then(|decision| decision.estimate);
        let pose = estimate.map(|estimate| estimate.pose);
        let row = CycleRow {
            time_s: begin_s,
            lateness_s: begin_s - due_s,
            slack_s,
            state: self.safety.state(),
            enable: order.enable,
            traction_m_s: order.speeds.traction_m_s,
            steer_m_s: order.speeds.steer_m_s,
            sent,
            feedback_traction_m_s: feedback.map_or(f64::NAN, |speeds| speeds.traction_m_s),
            feedback_steer_m_s: feedback.map_or(f64::NAN, |speeds| speeds.steer_m_s),
            feedback_age_s: reading
                .feedback
                .map_or(f64::INFINITY, |feedback| begin_s - feedback.time_s),
            bus: reading.bus,
            x_m: pose.map_or(f64::NAN, |pose| pose.x_m),
            y_m: pose.map_or(f64::NAN, |pose| pose.y_m),
            yaw_rad: pose.map_or(f64::NAN, |pose| pose.yaw_rad),
            cross_track_m: decision
                .as_ref()
                .and_then(|decision| decision.progress)
                .map(|progress| progress.cross_track_m),
            solve_us: decision
                .as_ref()
                .and_then(|decision| decision.solve)
                .map_or(f64::NAN, |solve| 1e6 * solve.solve_time_s),
            refused: reading.refused,
            skipped: self.skipped,
        };
        self.records.push(Record::Cycle(row));
        row
    }

    fn send(&mut self, order: &Order) -> bool {
        let now_s = self.clock.now_s();
        let Err(fault) = self.port.send(now_s, order) else {
            self.unsent_since_s = None;
            return true;
        };
        self.unsent += 1;
        if self.unsent_since_s.is_none() {
            self.unsent_since_s = Some(now_s);
            self.records.push(Record::Unsent {
                time_s: now_s,
                fault,
            });
        }
        false
    }
}

impl<P: Port, Q: Pilot> Drop for Cycle<P, Q> {
    /// The last word to the drives is zero and off, however the cycle ends; a panic comes here too.
    /// Said more than once, since a single frame may be lost.
    fn drop(&mut self) {
        for _ in 0..3 {
            let now_s = self.clock.now_s();
            let _: Result<(), SendFault> = self.port.send(now_s, &Order::OFF);
        }
    }
}

/// Distribution of lateness in steps of 0.1 ms, without allocation in the cycle.
struct Lateness {
    counts: Box<[u32; Self::STEPS]>,
    count: u64,
    max_s: f64,
    slack_min_s: f64,
}

impl Lateness {
    const STEPS: usize = 1000;
    const STEP_S: f64 = 1e-4;

    fn new() -> Self {
        Self {
            counts: Box::new([0; Self::STEPS]),
            count: 0,
            max_s: 0.0,
            slack_min_s: f64::INFINITY,
        }
    }

    fn take(&mut self, lateness_s: f64, slack_s: f64) {
        let step = (lateness_s / Self::STEP_S) as usize;
        self.counts[step.min(Self::STEPS - 1)] += 1;
        self.count += 1;
        self.max_s = self.max_s.max(lateness_s);
        self.slack_min_s = self.slack_min_s.min(slack_s);
    }

    /// Upper end of the step in which the quantile lies.
    fn quantile(&self, q: f64) -> f64 {
        let rank = (q * self.count as f64).ceil() as u64;
        let mut sum = 0;
        for (i, count) in self.counts.iter().enumerate() {
            sum += u64::from(*count);
            if sum >= rank && rank > 0 {
                return ((i + 1) as f64 * Self::STEP_S).min(self.max_s);
            }
        }
        self.max_s
    }
}
