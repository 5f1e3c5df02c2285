use super::vocabulary::{DriveCommand, DriveFeedback, LinkState, SendError};
use sidehill_plant::sample::{Sample, Stamped};

/// What a port has received when a cycle begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PortInputs {
    /// Readings for the controller that are new since the cycle before.
    pub sample: Sample,
    /// Newest feedback of both drives, new or not.
    pub feedback: Option<Stamped<DriveFeedback>>,
    /// State of the link to the drives.
    pub link: LinkState,
    /// Frames that were not believed, since the start.
    pub refused: u64,
}

/// A vehicle as the cycle sees it. Neither call waits.
pub trait Port {
    /// Returns what has been received until `now_s`.
    fn receive(&mut self, now_s: f64) -> PortInputs;

    /// Tells the drives an order.
    ///
    /// # Errors
    /// Why it has not been sent; it is not sent later either.
    fn send(&mut self, now_s: f64, order: &DriveCommand) -> Result<(), SendError>;
}

impl<P: Port + ?Sized> Port for Box<P> {
    fn receive(&mut self, now_s: f64) -> PortInputs {
        (**self).receive(now_s)
    }

    fn send(&mut self, now_s: f64, order: &DriveCommand) -> Result<(), SendError> {
        (**self).send(now_s, order)
    }
}

/// Returns a reading that is newer than the last one delivered.
pub(crate) fn newer<T>(reading: Option<Stamped<T>>, delivered_s: &mut f64) -> Option<Stamped<T>> {
    let reading = reading.filter(|reading| reading.time_s > *delivered_s)?;
    *delivered_s = reading.time_s;
    Some(reading)
}
