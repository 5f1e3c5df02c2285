//! Where a replay can begin.

use anyhow::{Result, bail};
use serde::Serialize;
use sidehill_recording::{ControllerCycle, Recording};

/// Time before arming that must be recorded, s: the controller uses its commands of the last second.
const BEFORE_S: f64 = 1.0;

/// The first compared cycle. Cycles before it are repeated, but start from an unknown state.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub(super) struct Begin {
    /// Cycles before it.
    #[serde(skip)]
    pub(super) place: usize,
    /// Number of the cycle.
    pub(super) cycle: u64,
    /// Its time, s.
    pub(super) time_s: f64,
    /// Serial number of the path that was followed when the recording begins.
    #[serde(skip)]
    pub(super) earlier_path: Option<u64>,
    /// How far the vehicle had come on that path, m.
    pub(super) from_m: Option<f64>,
}

impl Begin {
    /// Returns the start of a recording, or, if its first files were deleted, the first arming after them, where the
    /// controller is reset.
    ///
    /// # Errors
    /// A recording with neither.
    pub(super) fn of(recording: &Recording) -> Result<Self> {
        let cycles = &recording.cycles;
        if cycles.first().is_some_and(|first| first.index == 0) {
            return Ok(Self::default());
        }
        let begins = cycles.windows(2).enumerate().find_map(|(i, pair)| {
            let place = i + 1;
            let arms = !pair[0].engaged && pair[1].engaged;
            let whole = pair[1].index - cycles[0].index == place as u64;
            let known = pair[1].time_s - cycles[0].time_s >= BEFORE_S;
            if !(arms && whole && known) {
                return None;
            }
            let given = |cycle: &ControllerCycle| cycle.path != 0;
            let earlier_path = if cycles[..=place].iter().any(given) {
                None
            } else {
                let later = |serial| serial != 0 && cycles.iter().any(|cycle| cycle.path == serial);
                let serials = recording.paths.keys().copied();
                Some(serials.filter(|serial| !later(*serial)).max()?)
            };
            let from_m = earlier_path.map(|_| pair[0].arc_length_m);
            Some(Self {
                place,
                cycle: pair[1].index,
                time_s: pair[1].time_s,
                earlier_path,
                from_m: from_m.filter(|from_m| from_m.is_finite()),
            })
        });
        match begins {
            Some(begin) => Ok(begin),
            None => bail!(
                "its first files were deleted (record.keep), and no arming after its first second is in those that \
                 are left, at which the controller began from nothing; it can be looked at with --live"
            ),
        }
    }
}
