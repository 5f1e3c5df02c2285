//! What every vehicle needs to be driven, over CAN, over ROS 2 or in a simulation.
//!
//! # Data path
//!
//! ```text
//!            receive              decide                  check          send
//! vehicle -> Port -> PortInputs -> ControllerRunner -> Decision -> Safety -> DriveCommand -> Port -> vehicle
//!                        |                                           ^
//!                        +---- drive feedback, state of the link ----+
//! ```
//!
//! [`control_loop::ControlLoop::step`] is this line, once a period. [`drives`] is the vocabulary of
//! both ends: `CanPort` of the crate `sidehill-can-port`, `Ros2Port` of `sidehill-ros2` and
//! [`rover::SimulatedPort`] implement [`drives::Port`], and neither the loop nor the safety knows which of them it has. A CAN fault reaches
//! the safety as [`drives::LinkState`], as [`drives::SendError`], or as feedback that grows old, and
//! becomes a stop in [`safety::Safety::step`].
//!
//! # Threads
//!
//! | thread | priority | may wait for |
//! |---|---|---|
//! | `cycle`: the control loop | `realtime.fifo_priority` | the time of its next cycle; the controller, for `cycle.decision_time_s` at most |
//! | `controller` | `realtime.helper_fifo_priority` | the next cycle; a solve ends at its deadline |
//! | `can-listener` | `realtime.helper_fifo_priority` | a frame, for 20 ms at most |
//! | `can-opener` | normal | the kernel, which may block while an interface disappears |
//! | `ros2 inputs`, `ros2 commands` | `realtime.helper_fifo_priority` | a message or a command, for 50 ms at most; the middleware |
//! | the middleware's own, with `port: ros2` | `realtime.helper_fifo_priority` | the network |
//! | `ros2 server`, `ros2 path` | normal | the middleware |
//! | the caller's | normal | files and standard output |
//!
//! Threads exchange values through triple buffers, rings and atomics: none holds a lock that the loop
//! needs. The exception is simulated time, where the loop waits for the clock of the simulator.
//!
//! # States
//!
//! ```text
//!                +--------------------- operator arms ---------------------+
//!                v                                                         |
//! Disarmed -> Zeroing -> Enabling -> Driving -> Stopping ---ramp ended---> Latched
//!                |           |          |           |                        ^
//!                +-----------+----------+-----------+---- fault or halt -----+
//! ```
//!
//! See [`safety`]. Nothing re-arms by itself; over ROS 2 an accepted goal also acts as the operator,
//! even when it resumes after an obstacle.
//!
//! # Example
//!
//! An operator arms, the drives follow, and after 1 s their feedback is lost. The safety state machine
//! ramps to zero and latches.
//!
//! ```
//! use sidehill_bridge::drives::{DriveCommand, DriveFeedback, DriveMode, LinkState};
//! use sidehill_bridge::safety::*;
//! use sidehill_plant::{sample::Stamped, speeds::MotorSpeeds};
//!
//! let mut safety = Safety::new(SafetyConfig::default())?;
//! let (mut sent, mut feedback, mut history) = (DriveCommand::OFF, None, Vec::new());
//! for cycle in 0..60 {
//!     let time_s = f64::from(cycle) * 0.05;
//!     if time_s < 1.0 {
//!         let mode = if sent.enable { DriveMode::Enabled } else { DriveMode::Disabled };
//!         feedback = Some(Stamped { time_s, value: DriveFeedback { speeds: sent.speeds, mode } });
//!     }
//!     let command = MotorSpeeds { traction_m_s: 0.5, steer_m_s: 0.0 };
//!     let controller = Some(ControllerOutput { time_s, command, state: ControllerState::Driving });
//!     let requests = OperatorRequests { arm: cycle > 0, ..Default::default() };
//!     let link = LinkState::Active;
//!     let (forwarded, unsent_since_s) = (None, None);
//!     let transition;
//!     (sent, transition) = safety.step(&SafetyInputs {
//!         time_s, controller, feedback, forwarded, link, unsent_since_s, requests, leaves_geofence: false,
//!     });
//!     history.extend(transition.map(|change| (change.to, change.reason)));
//! }
//! assert_eq!(sent, DriveCommand::OFF);
//! assert!(matches!(history[3], (SafetyState::Stopping, Reason::FeedbackTimeout { .. })));
//! assert_eq!(history[4], (SafetyState::Latched, Reason::RampEnded));
//! # Ok::<(), sidehill_plant::vehicle::RangeError>(())
//! ```

pub mod control_loop;
pub mod drives;
pub mod ros2;
pub mod rover;
pub mod safety;
pub mod system;
