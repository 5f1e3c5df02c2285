use super::bus_monitor::{BusEvent, BusMonitor};
use super::inputs::{Arrivals, CanInputs};
use super::record::CanRecord;
use super::sender::{FOREIGN_S, Sender};
use sidehill_bridge::control_loop::record::RecordSink;
use sidehill_bridge::drives::Epoch;
use sidehill_bridge::drives::MotorCommand;
use sidehill_bridge::drives::{DriveCommand, DriveFeedback, DriveMode, LinkState};
use sidehill_bridge::drives::{Port, PortInputs, SendError, newer};
use sidehill_bridge::system::ThreadId;
use sidehill_can::canopen::Master;
use sidehill_can::controller_side::{CommandWriter, Readings, VehicleReader};
use sidehill_can::frame::Frame;
use sidehill_can::frozen::FrozenWatch;
use sidehill_can::layout::{Layout, Profile};
use sidehill_can::message::MessageCodec;
use sidehill_plant::sample::{Sample, Stamped};
use sidehill_plant::vehicle::SpeedCorrection;
use std::sync::Arc;
use triple_buffer::{Input, Output, triple_buffer};

/// What the bus monitor passes to the loop: always the newest, never a queue.
#[derive(Debug, Clone, Copy, Default)]
struct Snapshot {
    readings: Readings,
    bus: LinkState,
}

/// Largest number of drive events in one cycle.
const EVENTS_MAX: usize = 24;

/// Writes commands for the profile of the drives.
enum Writer {
    Values(CommandWriter),
    Cia402(Box<Master>),
}

/// A vehicle behind a SocketCAN interface.
pub struct CanPort {
    layout: Arc<Layout>,
    writer: Writer,
    sender: Sender,
    newest: Output<Snapshot>,
    /// Inputs of this cycle.
    readings: Readings,
    correction: SpeedCorrection,
    /// Instants of the tread speeds, attitude and pose delivered last, s.
    delivered_s: [f64; 4],
    watches: [FrozenWatch; 2],
    frozen: [bool; 2],
    /// The newest frame with an identifier of this program that another node has sent.
    foreign: Option<Stamped<Frame>>,
    told_foreign: Input<Option<Stamped<Frame>>>,
    records: RecordSink<CanRecord>,
    /// Until it is handed out.
    inputs: Option<CanInputs>,
    listener: BusMonitor,
}

impl CanPort {
    /// Returns a port that receives from now on. `received_records` and `sent_records` take the frames
    /// and events of either direction.
    ///
    /// # Errors
    /// The system's, if it cannot start a thread. An interface that does not exist is not an error: the
    /// bus is then absent.
    pub fn new(
        interface: &str,
        layout: Arc<Layout>,
        correction: SpeedCorrection,
        epoch: Epoch,
        mut received_records: RecordSink<CanRecord>,
        sent_records: RecordSink<CanRecord>,
    ) -> Result<Self, std::io::Error> {
        let (mut slot, newest) = triple_buffer(&Snapshot {
            readings: Readings::default(),
            bus: LinkState::Absent,
        });
        let mut arrivals = Arrivals::default();
        let (mut arrived, arrivals_seen) = triple_buffer(&arrivals);
        let (told_foreign, foreign_seen) = triple_buffer(&None);
        let inputs = CanInputs::new(interface, Arc::clone(&layout), arrivals_seen, foreign_seen);
        let from_vehicle: Vec<_> = layout.from_vehicle().map(MessageCodec::id).collect();
        let wanted = layout.received_ids();
        let mut reader = VehicleReader::new(Arc::clone(&layout));
        let mut bus = LinkState::Absent;
        let listener = BusMonitor::start(interface, &wanted, epoch, move |event| {
            match event {
                BusEvent::Frame { time_s, frame } => {
                    received_records.push(CanRecord::Frame { time_s, frame });
                    let taken = reader.take(&frame, time_s);
                    if let Some(index) = from_vehicle.iter().position(|id| *id == frame.id) {
                        arrivals.messages[index] = Some((time_s, taken.err()));
                    }
                    if let Err(fault) = taken {
                        received_records.push(CanRecord::Refused {
                            time_s,
                            frame,
                            fault,
                        });
                    }
                }
                BusEvent::Bus { time_s, state } => {
                    bus = state;
                    received_records.push(CanRecord::Bus { time_s, state });
                }
                BusEvent::Restart {
                    time_s,
                    attempt,
                    answer,
                } => received_records.push(CanRecord::Restart {
                    time_s,
                    attempt,
                    answer,
                }),
            }
            slot.write(Snapshot {
                readings: *reader.readings(),
                bus,
            });
            arrivals.bus = bus;
            arrivals.has_pose = reader.readings().pose.is_some();
            arrivals.nodes = reader.readings().nodes.map(|node| node.nmt);
            arrived.write(arrivals);
        })?;
        let writer = match &layout.profile {
            Profile::Values(enable) => {
                Writer::Values(CommandWriter::new(Arc::clone(&layout), *enable))
            }
            Profile::Cia402(cia402) => {
                Writer::Cia402(Box::new(Master::new(Arc::clone(&layout), cia402.clone())))
            }
        };
        let sender = Sender::start(interface, &layout.own_ids())?;
        Ok(Self {
            layout,
            writer,
            sender,
            newest,
            readings: Readings::default(),
            correction,
            delivered_s: [f64::NEG_INFINITY; 4],
            watches: Default::default(),
            frozen: [false; 2],
            foreign: None,
            told_foreign,
            records: sent_records,
            inputs: Some(inputs),
            listener,
        })
    }
}

impl CanPort {
    /// Returns what is known of the messages that the port waits for; once.
    pub fn take_inputs(&mut self) -> Option<CanInputs> {
        self.inputs.take()
    }

    /// Returns whether another node has sent with this program's identifiers lately.
    fn hears_foreign(&mut self, now_s: f64) -> bool {
        let lately = |foreign: &Stamped<Frame>| now_s - foreign.time_s <= FOREIGN_S;
        let heard_before = self.foreign.as_ref().is_some_and(lately);
        let Some(frame) = self.sender.foreign() else {
            return heard_before;
        };
        let time_s = now_s;
        if !heard_before {
            self.records.push(CanRecord::Foreign { time_s, frame });
        }
        self.foreign = Some(Stamped {
            time_s,
            value: frame,
        });
        self.told_foreign.write(self.foreign);
        true
    }
}

impl Port for CanPort {
    fn helper_threads(&self) -> Vec<ThreadId> {
        self.listener.thread_id().into_iter().collect()
    }

    fn receive(&mut self, now_s: f64) -> PortInputs {
        let Snapshot { readings, bus } = *self.newest.read();
        let before = self.readings.modes;
        self.readings = readings;
        let link = match self.hears_foreign(now_s) {
            true if bus.carries() => LinkState::Foreign,
            _ => bus,
        };
        let report = |drive: usize| {
            let mut report = match &self.writer {
                Writer::Values(_) => readings.drives[drive],
                Writer::Cia402(master) => master.report(drive, &readings),
            }?;
            let since = readings.modes[drive].worst_since(&before[drive]);
            report.value.mode = report.value.mode.worse(since);
            if self.frozen[drive] {
                report.value.mode = report.value.mode.worse(DriveMode::Frozen);
            }
            Some(report)
        };
        let motors = report(0).zip(report(1)).map(|(first, second)| {
            let speeds = [first.value.speed_m_s, second.value.speed_m_s];
            Stamped {
                time_s: first.time_s.min(second.time_s),
                value: (
                    self.layout.motors(speeds),
                    first.value.mode.worse(second.value.mode),
                ),
            }
        });
        let [treads_s, attitude_s, yaw_rate_s, pose_s] = &mut self.delivered_s;
        PortInputs {
            sample: Sample {
                time_s: now_s,
                tread_speeds: newer(
                    motors.map(|motors| Stamped {
                        time_s: motors.time_s,
                        value: motors.value.0.into(),
                    }),
                    treads_s,
                ),
                attitude: newer(readings.attitude, attitude_s),
                yaw_rate: newer(readings.yaw_rate, yaw_rate_s),
                pose: newer(readings.pose, pose_s),
            },
            feedback: motors.map(|motors| Stamped {
                time_s: motors.time_s,
                value: DriveFeedback {
                    speeds: motors.value.0.effective(&self.correction),
                    mode: motors.value.1,
                },
            }),
            forwarded: None,
            link,
            refused: readings.refused,
        }
    }

    fn send(&mut self, now_s: f64, command: &DriveCommand) -> Result<(), SendError> {
        let motors = MotorCommand::reaching(command, &self.correction);
        for (i, watch) in self.watches.iter_mut().enumerate() {
            let report = self.readings.drives[i].filter(|_| motors.enable);
            self.frozen[i] = report.is_some_and(|report| {
                let command_m_s = self.layout.drives[i].role.speed_m_s(&motors.speeds);
                watch.is_frozen(now_s, command_m_s, report.value.speed_m_s)
            });
        }
        let (sender, records) = (&mut self.sender, &mut self.records);
        // Frames and events share one sink: events follow after the frames.
        let mut events = [None; EVENTS_MAX];
        let send = |frame: &Frame| {
            sender.send(frame)?;
            records.push(CanRecord::Frame {
                time_s: now_s,
                frame: *frame,
            });
            Ok(())
        };
        let sent = match &mut self.writer {
            Writer::Values(writer) => writer.write(&motors, send),
            Writer::Cia402(master) => {
                let report = |node, event| {
                    if let Some(slot) = events.iter_mut().find(|slot| slot.is_none()) {
                        *slot = Some((node, event));
                    }
                };
                let reset = command.fault_reset;
                master.write(now_s, &motors, reset, &self.readings, report, send)
            }
        };
        for (node, event) in events.into_iter().flatten() {
            self.records.push(CanRecord::Drive {
                time_s: now_s,
                node,
                event,
            });
        }
        sent
    }
}
