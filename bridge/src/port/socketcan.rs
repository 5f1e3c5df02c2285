use super::{Port, Reading, newer};
use crate::bus::{Heard, Listener, SendFault, Sender};
use crate::can::cia402::Master;
use crate::can::controller_side::{CommandWriter, MotorOrder, Readings, VehicleReader};
use crate::can::frame::Frame;
use crate::can::layout::{Layout, Profile};
use crate::clock::Epoch;
use crate::motors::MeasuredMotorSpeeds;
use crate::record::{Record, RecordSink};
use crate::safety::{BusState, DriveFeedback, Order};
use sidehill_plant::sample::{Sample, Stamped};
use sidehill_plant::vehicle::SpeedCorrection;
use std::sync::Arc;
use thread_priority::ThreadId;
use triple_buffer::{Output, triple_buffer};

/// What the listener leaves for the cycle: always the newest, never a queue.
#[derive(Debug, Clone, Copy, Default)]
struct Snapshot {
    readings: Readings,
    bus: BusState,
}

/// Events of both drives that one cycle can have.
const EVENTS_MAX: usize = 8;

/// What tells the drives, as their profile has it.
enum Writer {
    Values(CommandWriter),
    Cia402(Master),
}

/// A vehicle behind a SocketCAN interface.
pub struct CanPort {
    layout: Arc<Layout>,
    writer: Writer,
    sender: Sender,
    newest: Output<Snapshot>,
    /// What was received for this cycle.
    readings: Readings,
    correction: SpeedCorrection,
    /// Instants of the tread speeds, attitude and pose delivered last, s.
    delivered_s: [f64; 3],
    records: RecordSink,
    listener: Listener,
}

impl CanPort {
    /// Returns a port that listens from now on; `heard_records` takes what comes, `sent_records`
    /// what goes.
    ///
    /// # Errors
    /// The system's, where it has no thread left. An interface that does not exist is no error: the
    /// bus is then absent.
    pub fn new(
        interface: &str,
        layout: Arc<Layout>,
        correction: SpeedCorrection,
        epoch: Epoch,
        mut heard_records: RecordSink,
        sent_records: RecordSink,
    ) -> Result<Self, std::io::Error> {
        let (mut slot, newest) = triple_buffer(&Snapshot {
            readings: Readings::default(),
            bus: BusState::Absent,
        });
        let wanted = layout.heard_ids();
        let mut reader = VehicleReader::new(Arc::clone(&layout));
        let mut bus = BusState::Absent;
        let listener = Listener::start(interface, &wanted, epoch, move |heard| {
            match heard {
                Heard::Frame { time_s, frame } => {
                    heard_records.push(Record::Frame {
                        time_s,
                        sent: false,
                        frame,
                    });
                    if let Err(fault) = reader.take(&frame, time_s) {
                        heard_records.push(Record::Refused {
                            time_s,
                            frame,
                            fault,
                        });
                    }
                }
                Heard::Bus { time_s, state } => {
                    bus = state;
                    heard_records.push(Record::Bus { time_s, state });
                }
                Heard::Restart {
                    time_s,
                    attempt,
                    answer,
                } => heard_records.push(Record::Restart {
                    time_s,
                    attempt,
                    answer,
                }),
            }
            slot.write(Snapshot {
                readings: *reader.readings(),
                bus,
            });
        })?;
        let writer = match &layout.profile {
            Profile::Values(enable) => {
                Writer::Values(CommandWriter::new(Arc::clone(&layout), *enable))
            }
            Profile::Cia402(cia402) => {
                Writer::Cia402(Master::new(Arc::clone(&layout), cia402.clone()))
            }
        };
        Ok(Self {
            layout,
            writer,
            sender: Sender::start(interface)?,
            newest,
            readings: Readings::default(),
            correction,
            delivered_s: [f64::NEG_INFINITY; 3],
            records: sent_records,
            listener,
        })
    }

    /// Returns the system's name of the thread that listens.
    pub fn listener_id(&self) -> Option<ThreadId> {
        self.listener.thread_id()
    }
}

impl Port for CanPort {
    fn receive(&mut self, now_s: f64) -> Reading {
        let Snapshot { readings, bus } = *self.newest.read();
        self.readings = readings;
        let report = |drive: usize| match &self.writer {
            Writer::Values(_) => readings.drives[drive],
            Writer::Cia402(master) => master.report(drive, &readings),
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
        let [treads_s, attitude_s, pose_s] = &mut self.delivered_s;
        Reading {
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
                pose: newer(readings.pose, pose_s),
            },
            feedback: motors.map(|motors| Stamped {
                time_s: motors.time_s,
                value: DriveFeedback {
                    speeds: motors.value.0.effective(&self.correction),
                    mode: motors.value.1,
                },
            }),
            bus,
            refused: readings.refused,
        }
    }

    fn send(&mut self, now_s: f64, order: &Order) -> Result<(), SendFault> {
        let motor_order = MotorOrder {
            motors: MeasuredMotorSpeeds::reaching(order.speeds, &self.correction),
            enable: order.enable,
        };
        let (sender, records) = (&mut self.sender, &mut self.records);
        // The records of frames and of events go the same way, one after the other.
        let mut events = [None; EVENTS_MAX];
        let send = |frame: &Frame| {
            sender.send(frame)?;
            records.push(Record::Frame {
                time_s: now_s,
                sent: true,
                frame: *frame,
            });
            Ok(())
        };
        let sent = match &mut self.writer {
            Writer::Values(writer) => writer.write(&motor_order, send),
            Writer::Cia402(master) => {
                let tell = |node, event| {
                    if let Some(slot) = events.iter_mut().find(|slot| slot.is_none()) {
                        *slot = Some((node, event));
                    }
                };
                let reset = order.fault_reset;
                master.write(now_s, &motor_order, reset, &self.readings, tell, send)
            }
        };
        for (node, event) in events.into_iter().flatten() {
            self.records.push(Record::Drive {
                time_s: now_s,
                node,
                event,
            });
        }
        sent
    }
}
