//! Between the cycle and a vehicle: simulated, or behind a CAN bus.

mod simulated;
mod socketcan;

pub use simulated::SimulatedPort;
pub use socketcan::CanPort;

use crate::bus::SendFault;
use crate::safety::{BusState, DriveFeedback, Order};
use sidehill_plant::sample::{Sample, Stamped};

/// What a port has received when a cycle begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Readings for the controller that are new since the cycle before.
    pub sample: Sample,
    /// Newest feedback of both drives, new or not.
    pub feedback: Option<Stamped<DriveFeedback>>,
    /// State of the bus.
    pub bus: BusState,
    /// Frames that were not believed, since the start.
    pub refused: u64,
}

/// A vehicle as the cycle sees it. Neither call waits.
pub trait Port {
    /// Returns what has been received until `now_s`.
    fn receive(&mut self, now_s: f64) -> Reading;

    /// Tells the drives an order.
    ///
    /// # Errors
    /// Why it has not been sent; it is not sent later either.
    fn send(&mut self, now_s: f64, order: &Order) -> Result<(), SendFault>;
}

impl<P: Port + ?Sized> Port for Box<P> {
    fn receive(&mut self, now_s: f64) -> Reading {
        (**self).receive(now_s)
    }

    fn send(&mut self, now_s: f64, order: &Order) -> Result<(), SendFault> {
        (**self).send(now_s, order)
    }
}

/// Returns a reading that is newer than the last one delivered.
pub(crate) fn newer<T>(reading: Option<Stamped<T>>, delivered_s: &mut f64) -> Option<Stamped<T>> {
    let reading = reading.filter(|reading| reading.time_s > *delivered_s)?;
    *delivered_s = reading.time_s;
    Some(reading)
}
