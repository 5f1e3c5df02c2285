//! A virtual rover whose sensors, drives and link fail as drawn.

use super::kind::{Fault, FaultKind};
use sidehill_bridge::drives::{
    DriveCommand, DriveFeedback, DriveMode, LinkState, Port, PortInputs, SendError,
};
use sidehill_bridge::rover::SimulatedPort;
use sidehill_plant::frames::Pose;
use sidehill_plant::sample::Stamped;
use sidehill_plant::simulation::TrueState;
use std::collections::VecDeque;

/// How late poses are that are late, s.
const LATE_S: f64 = 0.6;

/// The rover behind its faults.
pub(super) struct FaultyPort {
    rover: SimulatedPort,
    faults: Vec<Fault>,
    /// Since when the drives are on, s.
    driving_s: Option<f64>,
    /// Last values from before a fault that repeats them, and poses on their way.
    held: PortInputs,
    waiting: VecDeque<Stamped<Pose>>,
    last_pose: Option<Stamped<Pose>>,
    last_sent: DriveCommand,
    sent: u64,
    /// Largest speed of the motors, m/s.
    speed_max_m_s: f64,
}

impl FaultyPort {
    pub(super) fn new(mut rover: SimulatedPort, faults: Vec<Fault>, speed_max_m_s: f64) -> Self {
        let held = rover.receive(0.0);
        Self {
            rover,
            faults,
            driving_s: None,
            held,
            waiting: VecDeque::new(),
            last_pose: None,
            last_sent: DriveCommand::OFF,
            sent: 0,
            speed_max_m_s,
        }
    }

    /// Returns the true state.
    pub(super) fn state(&self) -> &TrueState {
        self.rover.state()
    }

    /// Returns since when the vehicle drives, s.
    pub(super) fn driving_s(&self) -> Option<f64> {
        self.driving_s
    }

    fn active(&self, now_s: f64) -> impl Iterator<Item = Fault> + use<> {
        let since_s = self.driving_s.map(|driving_s| now_s - driving_s);
        let faults = self.faults.clone();
        faults
            .into_iter()
            .filter(move |fault| since_s.is_some_and(|since_s| fault.is_at(since_s)))
    }

    /// Changes what is received by one fault.
    fn spoil(&mut self, now_s: f64, fault: &Fault, inputs: &mut PortInputs) {
        let since_s = self
            .driving_s
            .map_or(0.0, |driving_s| now_s - driving_s - fault.from_s);
        let sample = &mut inputs.sample;
        match fault.kind {
            FaultKind::PoseSilent => sample.pose = None,
            FaultKind::PoseFrozen => {
                if let (Some(pose), Some(held)) = (&mut sample.pose, self.held.sample.pose) {
                    pose.value = held.value;
                }
            }
            FaultKind::PoseOffset => shift(&mut sample.pose, 0.5),
            FaultKind::PoseDrift => shift(&mut sample.pose, 0.2 * since_s),
            FaultKind::PoseLate => {
                self.waiting.extend(sample.pose.take());
                let is_due = |pose: &Stamped<Pose>| now_s - pose.time_s >= LATE_S;
                while self.waiting.front().is_some_and(is_due) {
                    sample.pose = self.waiting.pop_front();
                }
            }
            FaultKind::PoseOutOfOrder => {
                let before = self.last_pose;
                self.last_pose = sample.pose.or(before);
                if self.sent.is_multiple_of(2) && sample.pose.is_some() {
                    sample.pose = before;
                }
            }
            FaultKind::PoseNan => {
                if let Some(pose) = &mut sample.pose {
                    pose.value.x_m = f64::NAN;
                }
            }
            FaultKind::PoseAhead => {
                if let Some(pose) = &mut sample.pose {
                    pose.time_s += 0.4;
                }
            }
            FaultKind::HeadingOffset => {
                if let Some(pose) = &mut sample.pose {
                    pose.value.yaw_rad += 10_f64.to_radians();
                }
            }
            FaultKind::AttitudeSilent => sample.attitude = None,
            FaultKind::AttitudeOffset => {
                if let Some(attitude) = &mut sample.attitude {
                    attitude.value.roll_rad += 5_f64.to_radians();
                }
            }
            FaultKind::AttitudeNan => {
                if let Some(attitude) = &mut sample.attitude {
                    attitude.value.roll_rad = f64::NAN;
                }
            }
            FaultKind::GyroscopeSilent => sample.yaw_rate = None,
            FaultKind::GyroscopeOffset => {
                if let Some(yaw_rate) = &mut sample.yaw_rate {
                    yaw_rate.value += 0.2;
                }
            }
            FaultKind::SpeedsSilent => sample.tread_speeds = None,
            FaultKind::SpeedsFrozen => {
                if let (Some(speeds), Some(held)) =
                    (&mut sample.tread_speeds, self.held.sample.tread_speeds)
                {
                    speeds.value = held.value;
                }
            }
            FaultKind::SpeedsNan => {
                if let Some(speeds) = &mut sample.tread_speeds {
                    speeds.value.left_m_s = f64::NAN;
                }
            }
            FaultKind::AllSilent => self.hear_nothing(inputs),
            FaultKind::FeedbackSilent => inputs.feedback = self.held.feedback,
            FaultKind::FeedbackFrozen => {
                if let (Some(feedback), Some(held)) = (&mut inputs.feedback, self.held.feedback) {
                    feedback.value.speeds = held.value.speeds;
                }
            }
            FaultKind::FeedbackMirrored => report(inputs, |feedback| {
                feedback.speeds.traction_m_s *= -1.0;
                feedback.speeds.steer_m_s *= -1.0;
            }),
            FaultKind::FeedbackNan => {
                report(inputs, |feedback| feedback.speeds.traction_m_s = f64::NAN);
            }
            FaultKind::FeedbackAhead => {
                if let Some(feedback) = &mut inputs.feedback {
                    feedback.time_s += 1.0;
                }
            }
            FaultKind::DriveFault => report(inputs, |feedback| feedback.mode = DriveMode::Fault),
            FaultKind::EmergencyStop => {
                report(inputs, |feedback| feedback.mode = DriveMode::EmergencyStop);
            }
            FaultKind::OtherMode => report(inputs, |feedback| feedback.mode = DriveMode::OtherMode),
            FaultKind::LinkDown => {
                self.hear_nothing(inputs);
                inputs.link = LinkState::Down;
            }
            FaultKind::BusOff => {
                self.hear_nothing(inputs);
                inputs.link = LinkState::BusOff;
            }
            FaultKind::Foreign => inputs.link = LinkState::Foreign,
            FaultKind::DriveReboots
            | FaultKind::MotorsStuck
            | FaultKind::MotorsBlocked
            | FaultKind::MotorsReversed
            | FaultKind::MotorsWeak
            | FaultKind::RunsAway
            | FaultKind::CommandsLost
            | FaultKind::SendFails
            | FaultKind::Suspended => {}
        }
    }

    fn hear_nothing(&self, inputs: &mut PortInputs) {
        inputs.feedback = self.held.feedback;
        inputs.sample.tread_speeds = None;
        inputs.sample.attitude = None;
        inputs.sample.yaw_rate = None;
        inputs.sample.pose = None;
    }
}

fn shift(pose: &mut Option<Stamped<Pose>>, right_m: f64) {
    if let Some(pose) = pose {
        let (sin, cos) = pose.value.yaw_rad.sin_cos();
        pose.value.x_m += right_m * cos;
        pose.value.y_m += right_m * sin;
    }
}

fn report(inputs: &mut PortInputs, change: impl FnOnce(&mut DriveFeedback)) {
    if let Some(feedback) = &mut inputs.feedback {
        change(&mut feedback.value);
    }
}

impl Port for FaultyPort {
    fn receive(&mut self, now_s: f64) -> PortInputs {
        let mut inputs = self.rover.receive(now_s);
        let enabled = inputs
            .feedback
            .is_some_and(|feedback| feedback.value.mode == DriveMode::Enabled);
        if enabled {
            self.driving_s.get_or_insert(now_s);
        }
        let active: Vec<Fault> = self.active(now_s).collect();
        if active.is_empty() {
            self.held = inputs;
        }
        for fault in &active {
            self.spoil(now_s, fault, &mut inputs);
        }
        inputs
    }

    fn send(&mut self, now_s: f64, command: &DriveCommand) -> Result<(), SendError> {
        self.sent += 1;
        let mut arriving = *command;
        for fault in self.active(now_s) {
            let speeds = &mut arriving.speeds;
            match fault.kind {
                FaultKind::LinkDown => return Err(SendError::Down),
                FaultKind::BusOff | FaultKind::SendFails => return Err(SendError::QueueFull),
                FaultKind::CommandsLost if self.sent.is_multiple_of(2) => return Ok(()),
                // They switch off, whatever they are told.
                FaultKind::DriveReboots | FaultKind::DriveFault | FaultKind::EmergencyStop => {
                    arriving = DriveCommand::OFF;
                }
                FaultKind::MotorsStuck | FaultKind::OtherMode => *speeds = self.last_sent.speeds,
                FaultKind::MotorsBlocked => {
                    (speeds.traction_m_s, speeds.steer_m_s) = (0.0, 0.0);
                }
                FaultKind::MotorsReversed => {
                    (speeds.traction_m_s, speeds.steer_m_s) =
                        (-speeds.traction_m_s, -speeds.steer_m_s);
                }
                FaultKind::MotorsWeak => {
                    (speeds.traction_m_s, speeds.steer_m_s) =
                        (0.5 * speeds.traction_m_s, 0.5 * speeds.steer_m_s);
                }
                FaultKind::RunsAway => speeds.traction_m_s = 0.5 * self.speed_max_m_s,
                _ => {}
            }
        }
        if !arriving.enable {
            arriving = DriveCommand::OFF;
        }
        self.last_sent = arriving;
        self.rover.send(now_s, &arriving)
    }
}
