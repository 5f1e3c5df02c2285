use super::vocabulary::{DriveCommand, DriveFeedback, LinkState, SendError};
use crate::system::ThreadId;
use sidehill_plant::sample::{Sample, Stamped};
use sidehill_plant::speeds::MotorSpeeds;

/// What a port has received when a cycle begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PortInputs {
    /// Readings for the controller that are new since the cycle before.
    pub sample: Sample,
    /// Newest feedback of both drives, new or not.
    pub feedback: Option<Stamped<DriveFeedback>>,
    /// The newest command that reached the drives, where a node between the loop and them may slow it
    /// down; none without such a node, or if the port does not read it.
    pub forwarded: Option<Stamped<MotorSpeeds>>,
    /// State of the link to the drives.
    pub link: LinkState,
    /// Messages that failed a check, since the start.
    pub refused: u64,
}

/// A vehicle as the control loop sees it: CAN, ROS 2, or a simulation. No call waits.
pub trait Port {
    /// Returns what has been received until `now_s`.
    fn receive(&mut self, now_s: f64) -> PortInputs;

    /// Sends a command to the drives.
    ///
    /// # Errors
    /// Why it was not sent. It is not sent later either.
    fn send(&mut self, now_s: f64, command: &DriveCommand) -> Result<(), SendError>;

    /// Returns the port's own threads whose results the loop needs in time; they get the priority of
    /// helpers.
    fn helper_threads(&self) -> Vec<ThreadId> {
        Vec::new()
    }
}

impl<P: Port + ?Sized> Port for Box<P> {
    fn receive(&mut self, now_s: f64) -> PortInputs {
        (**self).receive(now_s)
    }

    fn send(&mut self, now_s: f64, command: &DriveCommand) -> Result<(), SendError> {
        (**self).send(now_s, command)
    }

    fn helper_threads(&self) -> Vec<ThreadId> {
        (**self).helper_threads()
    }
}

/// Returns a reading that is newer than the one delivered last.
pub fn newer<T>(reading: Option<Stamped<T>>, delivered_s: &mut f64) -> Option<Stamped<T>> {
    let reading = reading.filter(|reading| reading.time_s > *delivered_s)?;
    *delivered_s = reading.time_s;
    Some(reading)
}
