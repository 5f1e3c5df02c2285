//! A virtual rover behind a CAN bus.

use super::rover::Rover;
use anyhow::Result;
use sidehill::config::{ConfigFile, Prepared, VehicleConfig};
use sidehill_bridge::drives::DriveMode;
use sidehill_bridge::drives::Epoch;
use sidehill_can::frame::Frame;
use sidehill_can::rover::CanRover;
use sidehill_can_port::{BusEvent, BusMonitor, Sender};
use sidehill_plant::simulation::TrueState;
use std::sync::Arc;

/// Capacity for commands that wait for the simulation: two cycles of a dozen messages.
const WAITING_MAX: usize = 64;

pub(super) struct BusRover {
    vehicle: CanRover,
    waiting: rtrb::Consumer<(f64, Frame)>,
    sender: Sender,
    /// Kept for its thread.
    _listener: BusMonitor,
}

impl BusRover {
    pub fn start(
        file: &ConfigFile,
        config: &VehicleConfig,
        world: &Prepared,
        epoch: Epoch,
    ) -> Result<Self> {
        let (interface, layout) = config.bus(file)?;
        let vehicle = config.can_rover(file, world, Arc::new(layout))?;
        let (mut arrived, waiting) = rtrb::RingBuffer::new(WAITING_MAX);
        let listener =
            BusMonitor::start(interface, &vehicle.received_ids(), epoch, move |heard| {
                if let BusEvent::Frame { time_s, frame } = heard {
                    // A full ring loses the frame, as a slow drive would; the counter shows it.
                    let _ = arrived.push((time_s, frame));
                }
            })?;
        Ok(Self {
            vehicle,
            waiting,
            sender: Sender::start(interface, &[])?,
            _listener: listener,
        })
    }
}

impl Rover for BusRover {
    fn advance(&mut self, now_s: f64) -> Result<bool> {
        while let Ok((time_s, frame)) = self.waiting.pop() {
            // Invalid frames are counted and ignored.
            let _ = self.vehicle.take(&frame, time_s);
        }
        self.vehicle.advance(now_s)?;
        let due = now_s >= self.vehicle.next_report_s();
        if due {
            self.vehicle.report(now_s)?;
        }
        let sender = &mut self.sender;
        self.vehicle.flush(now_s, |frame| {
            // The controller detects a lost frame by a gap in the counter, or by silence.
            let _ = sender.send(&frame);
        });
        Ok(due)
    }

    fn state(&self) -> &TrueState {
        self.vehicle.state()
    }

    fn mode(&self) -> DriveMode {
        self.vehicle.mode()
    }
}
