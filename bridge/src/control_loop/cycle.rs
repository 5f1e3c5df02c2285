use super::config::CycleConfig;
use super::record::{CycleRow, LoopRecord, RecordSink, differs};
use super::runner::{ControllerRunner, controller_output};
use super::timing::{CycleTime, LoopTiming, Schedule};
use crate::drives::{Clock, DriveCommand, Port, PortInputs, SendError};
use crate::safety::{
    Geofence, OperatorRequests, Reason, Safety, SafetyConfig, SafetyInputs, SafetyState, Transition,
};
use sidehill_controller::controller::{Decision, DriveResponse};
use sidehill_plant::speeds::MotorSpeeds;
use sidehill_plant::vehicle::RangeError;
use std::time::Duration;

/// The loop with its vehicle, its controller and its safety.
///
/// On drop, also after a panic, it sends zero speed and disable.
pub struct ControlLoop<P: Port, R: ControllerRunner> {
    config: CycleConfig,
    clock: Clock,
    schedule: Schedule,
    port: P,
    runner: R,
    safety: Safety,
    geofence: Option<Geofence>,
    records: RecordSink<LoopRecord>,
    /// Instant of the first of the commands that could not be sent in a row, s.
    unsent_since_s: Option<f64>,
    unsent: u64,
    stopped_by: Option<Reason>,
    /// The response of the drives that was recorded last.
    drives: Option<DriveResponse>,
    /// The command of the newest cycle.
    commanded: DriveCommand,
    /// Time at which the clock was found to stand, s.
    stands_at_s: Option<f64>,
}

impl<P: Port, R: ControllerRunner> ControlLoop<P, R> {
    /// Returns a disarmed loop whose times count from its first cycle.
    ///
    /// # Errors
    /// [`RangeError`] for a setting out of range.
    pub fn new(
        config: CycleConfig,
        safety: SafetyConfig,
        clock: Clock,
        port: P,
        runner: R,
        records: RecordSink<LoopRecord>,
    ) -> Result<Self, RangeError> {
        config.validate()?;
        Ok(Self {
            config,
            clock,
            schedule: Schedule::new(config.period_s),
            port,
            runner,
            safety: Safety::new(safety)?,
            geofence: None,
            records,
            unsent_since_s: None,
            unsent: 0,
            stopped_by: None,
            drives: None,
            commanded: DriveCommand::OFF,
            stands_at_s: None,
        })
    }

    /// Keeps the vehicle inside an area.
    #[must_use]
    pub fn within(mut self, geofence: Option<Geofence>) -> Self {
        self.geofence = geofence;
        self
    }

    /// Returns the port.
    pub fn port(&self) -> &P {
        &self.port
    }

    /// Returns the controller's runner.
    pub fn runner_mut(&mut self) -> &mut R {
        &mut self.runner
    }

    /// Returns the state of the safety.
    pub fn state(&self) -> SafetyState {
        self.safety.state()
    }

    /// Returns the limits of the safety.
    pub fn safety_config(&self) -> &SafetyConfig {
        self.safety.config()
    }

    /// Returns why the last drive or handshake ended.
    pub fn stopped_by(&self) -> Option<Reason> {
        self.stopped_by
    }

    /// Returns how well the loop has kept its times.
    pub fn timing(&self) -> LoopTiming {
        self.schedule.timing(self.unsent)
    }

    /// Lets simulated time pass without a cycle, as for a process that is suspended; other clocks go on by themselves.
    pub fn suspend(&mut self, time_s: f64) {
        if let Clock::Virtual { now_s } = &mut self.clock {
            *now_s += time_s;
        }
    }

    /// Waits for the time of the next cycle, and returns whether it has not come: a simulator is paused or slow. Where the
    /// time stays the same, its source may also be lost, so the vehicle is told to stand; nothing else is decided.
    pub(super) fn clock_stands(&mut self) -> bool {
        if !self.schedule.stands(&mut self.clock) {
            self.stands_at_s = None;
            return false;
        }
        let now_s = self.clock.now_s();
        if self.stands_at_s.replace(now_s) == Some(now_s) {
            self.send(&DriveCommand {
                speeds: MotorSpeeds::STOP,
                fault_reset: false,
                ..self.commanded
            });
        }
        true
    }

    /// Waits for the time of the next cycle, runs it, and returns what it did.
    pub fn step(&mut self, requests: OperatorRequests) -> CycleRow {
        // 1. Wait for the absolute time of this cycle.
        let time = self.schedule.wait(&mut self.clock);

        // 2. Receive: the newest of everything.
        let inputs = self.port.receive(time.begin_s);

        // 3. Decide, within the decision time. Simulated time stands still meanwhile.
        let engaged = self.safety.state() == SafetyState::Driving;
        let patience = match self.clock {
            Clock::Real(_) | Clock::External(_) => {
                Some(Duration::from_secs_f64(self.config.decision_time_s))
            }
            Clock::Virtual { .. } => None,
        };
        let decision = self.runner.decide(&inputs.sample, engaged, patience);

        // 4. Check: only the safety decides what is sent.
        let (command, transition) = self.safety.step(&SafetyInputs {
            time_s: time.begin_s,
            controller: decision.as_ref().map(controller_output),
            feedback: inputs.feedback,
            forwarded: inputs.forwarded,
            link: inputs.link,
            unsent_since_s: self.unsent_since_s,
            requests,
            leaves_geofence: self.leaves_geofence(decision.as_ref()),
        });

        // 5. Send at once, or not at all.
        let sent = self.send(&command);
        self.commanded = command;

        // 6. Record, and find the next cycle whose time has not passed.
        if let Some(transition) = transition {
            self.record_transition(transition);
        }
        if let Some(response) = self.runner.drives()
            && differs(self.drives.as_ref(), &response)
        {
            self.drives = Some(response);
            self.records.push(LoopRecord::Drives {
                time_s: time.begin_s,
                response,
            });
        }
        let slack_s = self.schedule.finish(&time, self.clock.now_s());
        let row = CycleRow {
            slack_s,
            state: self.safety.state(),
            sent,
            skipped: self.schedule.skipped(),
            ..row(&time, &inputs, &command, decision.as_ref())
        };
        self.records.push(LoopRecord::Cycle(row));
        row
    }

    fn leaves_geofence(&self, decision: Option<&Decision>) -> bool {
        let estimate = decision.and_then(|decision| decision.estimate.as_ref());
        let (Some(geofence), Some(estimate)) = (&self.geofence, estimate) else {
            return false;
        };
        geofence.is_left_by(estimate, self.safety.config().deceleration_m_s2)
    }

    fn send(&mut self, command: &DriveCommand) -> bool {
        let now_s = self.clock.now_s();
        let Err(error) = self.port.send(now_s, command) else {
            self.unsent_since_s = None;
            return true;
        };
        self.unsent += 1;
        if self.unsent_since_s.is_none() {
            self.unsent_since_s = Some(now_s);
            self.records.push(LoopRecord::Unsent {
                time_s: now_s,
                error,
            });
        }
        false
    }

    pub(super) fn record(&mut self, record: LoopRecord) {
        self.records.push(record);
    }

    fn record_transition(&mut self, transition: Transition) {
        let stops = matches!(transition.to, SafetyState::Stopping | SafetyState::Latched);
        if stops && transition.from != SafetyState::Stopping {
            self.stopped_by = Some(transition.reason);
        }
        self.records.push(LoopRecord::Transition(transition));
    }
}

impl<P: Port, R: ControllerRunner> Drop for ControlLoop<P, R> {
    /// Sends more than once, because a single message may be lost.
    fn drop(&mut self) {
        for _ in 0..3 {
            let now_s = self.clock.now_s();
            let _: Result<(), SendError> = self.port.send(now_s, &DriveCommand::OFF);
        }
    }
}

/// Returns the part of a row that does not depend on how the cycle ended.
fn row(
    time: &CycleTime,
    inputs: &PortInputs,
    command: &DriveCommand,
    decision: Option<&Decision>,
) -> CycleRow {
    let speeds = inputs.feedback.map(|feedback| feedback.value.speeds);
    let age_s = inputs
        .feedback
        .map(|feedback| time.begin_s - feedback.time_s);
    let pose = decision
        .and_then(|decision| decision.estimate)
        .map(|estimate| estimate.pose);
    let progress = decision.and_then(|decision| decision.progress);
    let solve = decision.and_then(|decision| decision.solve);
    CycleRow {
        time_s: time.begin_s,
        lateness_s: time.lateness_s(),
        slack_s: f64::NAN,
        state: SafetyState::Disarmed,
        enable: command.enable,
        traction_m_s: command.speeds.traction_m_s,
        steer_m_s: command.speeds.steer_m_s,
        sent: false,
        feedback_traction_m_s: speeds.map_or(f64::NAN, |speeds| speeds.traction_m_s),
        feedback_steer_m_s: speeds.map_or(f64::NAN, |speeds| speeds.steer_m_s),
        feedback_age_s: age_s.unwrap_or(f64::INFINITY),
        bus: inputs.link,
        x_m: pose.map_or(f64::NAN, |pose| pose.x_m),
        y_m: pose.map_or(f64::NAN, |pose| pose.y_m),
        yaw_rad: pose.map_or(f64::NAN, |pose| pose.yaw_rad),
        cross_track_m: progress.map(|progress| progress.cross_track_m),
        arc_length_m: progress.map(|progress| progress.arc_length_m),
        solve_us: solve.map_or(f64::NAN, |solve| 1e6 * solve.solve_time_s),
        refused: inputs.refused,
        skipped: 0,
    }
}
