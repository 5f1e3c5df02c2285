//! What the server watches: the peers on the graph, and the clock.

use super::ControllerServer;
use ros2_client::dds::rustdds::{DomainParticipantStatusEvent as Event, StatusEvented};
use sidehill_controller::controller::Decision;
use std::sync::atomic::Ordering;
use std::time::Instant;

/// Number of poses in a row that are left out from which it is said: single outliers are usual.
const POSES_LEFT_OUT: u32 = 3;

impl ControllerServer {
    /// Takes discovery events: publishers of the emergency stop, readers of replies, and peers that left.
    pub(super) fn discover_peers(&mut self) {
        while let Some(event) = self.discovery.try_recv_status() {
            let inputs = &self.links.inputs;
            inputs.graph().discovered(&event);
            match &event {
                Event::WriterDetected { writer }
                    if writer.topic_name == self.emergency_stop_topic =>
                {
                    let publisher = writer.guid.into();
                    let mut publishers = inputs.estop_publishers();
                    publishers.publisher_discovered(publisher, Instant::now());
                }
                Event::WriterLost { guid, .. } => {
                    inputs.estop_publishers().publisher_lost((*guid).into());
                }
                Event::ParticipantLost { id, .. } => {
                    let mut participant = [0; 16];
                    participant[..12].copy_from_slice(id.as_ref());
                    inputs.estop_publishers().publisher_lost(participant.into());
                }
                _ => {}
            }
            if let Some(left) = self.peers.take(event) {
                let topic = &self.result_topic;
                self.handler
                    .clients_left(|client| client.has_left(&left, topic));
            }
        }
    }

    /// Says when poses contradict dead reckoning, and when they are used again.
    pub(super) fn watch_poses(&mut self, decision: Option<&Decision>) {
        let Some(estimate) = decision.and_then(|decision| decision.estimate.as_ref()) else {
            return;
        };
        let message = match (self.poses_left_out, estimate.poses_gated) {
            (false, POSES_LEFT_OUT..) => {
                "poses jump or contradict dead reckoning and are left out, until those that agree with each other are \
                 believed"
            }
            (true, 0) => "poses are used again",
            _ => return,
        };
        self.poses_left_out = !self.poses_left_out;
        self.links.inputs.note("poses", message.to_owned());
    }

    /// Returns whether the clock has jumped, that of `/clock` or the system's.
    pub(super) fn detect_clock_jump(&mut self) -> bool {
        let inputs = &self.links.inputs;
        let jumps = inputs.clock_jumps.load(Ordering::Relaxed);
        let jumped = jumps != self.clock_jumps;
        self.clock_jumps = jumps;
        if jumped {
            self.feedback_s = f64::NEG_INFINITY;
        }
        jumped
    }
}
