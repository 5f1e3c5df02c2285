use sidehill_plant::speeds::MotorSpeeds;

/// The commands of the last second at up to 100 Hz, without allocation.
#[derive(Debug, Clone)]
pub(super) struct RecentCommands {
    entries: [(f64, MotorSpeeds); Self::LENGTH],
    next: usize,
}

impl RecentCommands {
    const LENGTH: usize = 128;

    pub(super) fn new() -> Self {
        Self {
            entries: [(f64::NEG_INFINITY, MotorSpeeds::STOP); Self::LENGTH],
            next: 0,
        }
    }

    pub(super) fn clear(&mut self) {
        *self = Self::new();
    }

    pub(super) fn push(&mut self, time_s: f64, speeds: MotorSpeeds) {
        self.entries[self.next] = (time_s, speeds);
        self.next = (self.next + 1) % Self::LENGTH;
    }

    /// Returns the least and greatest traction and steer since an instant, with the command that was
    /// active then.
    pub(super) fn range(&self, since_s: f64) -> [[f64; 2]; 2] {
        let mut range = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for i in 1..=Self::LENGTH {
            let (time_s, speeds) = self.entries[(self.next + Self::LENGTH - i) % Self::LENGTH];
            for (range, value) in range
                .iter_mut()
                .zip([speeds.traction_m_s, speeds.steer_m_s])
            {
                *range = [range[0].min(value), range[1].max(value)];
            }
            if time_s < since_s {
                break;
            }
        }
        range
    }
}
