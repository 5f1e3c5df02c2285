use super::vocabulary::Reason;

/// How a fault or a request ends the drive.
pub(super) enum Alarm {
    /// On the ramp: the drives can be expected to follow.
    Ramp(Reason),
    /// Zero speed and disable at once.
    Cut(Reason),
}

impl Alarm {
    pub(super) fn reason(self) -> Reason {
        match self {
            Self::Ramp(reason) | Self::Cut(reason) => reason,
        }
    }
}
