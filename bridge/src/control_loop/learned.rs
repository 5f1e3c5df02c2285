//! What was learned, on its way from the controller's thread to one that writes it.

use sidehill_controller::controller::Controller;
use sidehill_controller::memory::Learned;

/// Where the controller's thread leaves what was learned, without waiting or allocating: it fills what the
/// other end has emptied.
pub struct LearnedOutlet {
    spare: rtrb::Consumer<Learned>,
    filled: rtrb::Producer<Learned>,
    room: Option<Learned>,
    every_s: f64,
    next_s: Option<f64>,
    due: bool,
}

/// Where what was learned is taken from.
pub struct LearnedInlet {
    spare: rtrb::Producer<Learned>,
    filled: rtrb::Consumer<Learned>,
}

/// Returns both ends for what `controller` learns, which is left every `every_s` of driving and when the
/// vehicle is disarmed.
pub fn learned_channel(controller: &Controller, every_s: f64) -> (LearnedOutlet, LearnedInlet) {
    let (mut empty, spare) = rtrb::RingBuffer::new(1);
    let (filled, full) = rtrb::RingBuffer::new(1);
    if let Some(room) = controller.room_for_learned() {
        // There is room for it in the new ring.
        let _ = empty.push(room);
    }
    (
        LearnedOutlet {
            spare,
            filled,
            room: None,
            every_s,
            next_s: None,
            due: false,
        },
        LearnedInlet {
            spare: empty,
            filled: full,
        },
    )
}

impl LearnedOutlet {
    /// Lets what was learned be left at the next opportunity: the vehicle is disarmed.
    pub(super) fn disarmed(&mut self) {
        self.due = true;
        self.next_s = None;
    }

    /// Leaves what was learned, where it is time for it and the other end is ready.
    pub(super) fn serve(&mut self, time_s: f64, engaged: bool, controller: &Controller) {
        if engaged {
            let next_s = *self.next_s.get_or_insert(time_s + self.every_s);
            self.due |= time_s >= next_s;
        }
        if !self.due {
            return;
        }
        let room = self.room.take().or_else(|| self.spare.pop().ok());
        let Some(mut learned) = room else { return };
        if controller.learned_into(&mut learned) {
            // Only one is under way at a time, so there is room in the ring.
            let _ = self.filled.push(learned);
        } else {
            self.room = Some(learned);
        }
        self.due = false;
        self.next_s = None;
    }
}

impl LearnedInlet {
    /// Returns whether the other end is gone; what it left before can still be taken.
    pub fn is_abandoned(&self) -> bool {
        self.filled.is_abandoned()
    }

    /// Lets `write` have what was left, and makes room for the next; returns whether there was any.
    pub fn take(&mut self, write: impl FnOnce(&Learned)) -> bool {
        let Ok(learned) = self.filled.pop() else {
            return false;
        };
        write(&learned);
        // Only one is under way at a time.
        let _ = self.spare.push(learned);
        true
    }
}
