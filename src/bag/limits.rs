//! How much a log may hold. The only place that says so.

use crate::log_file::Size;
pub(super) use sidehill_recording::framing::RECORD_MAX;

/// What every bag may hold when decompressed, bytes.
const BAG_LEAST: u64 = 64_000_000;
/// How many times larger than its files a bag may be when decompressed; drives compress by 2 to 20.
const BAG_RATIO: u64 = 50;

/// Bytes that a file of a bag may still yield.
#[derive(Debug, Clone, Copy)]
pub(super) struct Budget {
    left: u64,
    whole: u64,
}

impl Budget {
    /// Returns the budget of a file of `size` bytes: `given` by the user, or the default.
    pub(super) fn of(size: u64, given: Option<u64>) -> Self {
        let whole = given.unwrap_or_else(|| BAG_LEAST.max(size.saturating_mul(BAG_RATIO)));
        Self { left: whole, whole }
    }

    /// Returns the largest size that a record may have now, and the reason for it.
    pub(super) fn record_max(&self) -> (u64, String) {
        if self.left < RECORD_MAX {
            (self.left, self.exceeded())
        } else {
            let size = Size(RECORD_MAX);
            (RECORD_MAX, format!("a record is larger than {size}"))
        }
    }

    /// Takes bytes that were read.
    ///
    /// # Errors
    /// The limit, where it is exceeded.
    pub(super) fn take(&mut self, bytes: u64) -> Result<(), String> {
        match self.left.checked_sub(bytes) {
            Some(left) => {
                self.left = left;
                Ok(())
            }
            None => Err(self.exceeded()),
        }
    }

    /// Returns how many bytes are left.
    pub(super) fn left(&self) -> u64 {
        self.left
    }

    pub(super) fn exceeded(&self) -> String {
        format!(
            "it holds more than {} when decompressed; if it is sound, --max-bytes allows more",
            Size(self.whole)
        )
    }
}
