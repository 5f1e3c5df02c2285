//! The range a parameter may lie in: one value for the check and for the text of its error.

/// A closed range of finite numbers with its unit.
///
/// ```
/// use sidehill_plant::bounds::Bounds;
///
/// let period = Bounds::new(0.005, 1.0, "s");
/// assert_eq!(period.check("period_s", 0.05), Ok(0.05));
/// assert_eq!(
///     period.check("period_s", 2.0).unwrap_err().to_string(),
///     "period_s: 2 is out of range, must be from 0.005 to 1 s"
/// );
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Smallest value allowed.
    pub low: f64,
    /// Largest value allowed; may be infinite, a value may not.
    pub high: f64,
    /// Unit of both; empty for a plain number.
    pub unit: &'static str,
    /// What a bound depends on, for the reader of the error; empty for nothing.
    pub note: &'static str,
}

impl Bounds {
    /// Returns the range from `low` to `high`, both included.
    pub const fn new(low: f64, high: f64, unit: &'static str) -> Self {
        Self {
            low,
            high,
            unit,
            note: "",
        }
    }

    /// Returns the range of all positive finite numbers.
    pub const fn positive(unit: &'static str) -> Self {
        Self::new(f64::MIN_POSITIVE, f64::INFINITY, unit)
    }

    /// Returns the same range with a note on what its bounds depend on.
    pub const fn with_note(self, note: &'static str) -> Self {
        Self { note, ..self }
    }

    /// Returns `value` if it is finite and within the range.
    ///
    /// # Errors
    /// [`RangeError`] with `key`, the value and this range.
    pub fn check(&self, key: &'static str, value: f64) -> Result<f64, RangeError> {
        if value.is_finite() && (self.low..=self.high).contains(&value) {
            Ok(value)
        } else {
            Err(RangeError {
                key,
                value,
                bounds: *self,
            })
        }
    }
}

impl std::fmt::Display for Bounds {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.low == f64::MIN_POSITIVE {
            out.write_str("above 0")?;
        } else if self.high == f64::INFINITY {
            write!(out, "at least {}", Number(self.low))?;
        } else {
            write!(out, "from {} to {}", Number(self.low), Number(self.high))?;
        }
        if !self.unit.is_empty() {
            write!(out, " {}", self.unit)?;
        }
        if !self.note.is_empty() {
            write!(out, " ({})", self.note)?;
        }
        Ok(())
    }
}

/// A number that prints in few digits where it is very large or small.
struct Number(f64);

impl std::fmt::Display for Number {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let size = self.0.abs();
        if size == 0.0 || (1e-4..1e6).contains(&size) {
            write!(out, "{}", self.0)
        } else {
            write!(out, "{:e}", self.0)
        }
    }
}

/// A parameter that is outside its range.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("{key}: {value} is out of range, must be {bounds}")]
pub struct RangeError {
    /// Key as the configuration file spells it.
    pub key: &'static str,
    /// The value found.
    pub value: f64,
    /// The values allowed.
    pub bounds: Bounds,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_checked_is_what_is_printed() {
        for (bounds, text) in [
            (Bounds::new(-50.0, 50.0, "m/s"), "from -50 to 50 m/s"),
            (Bounds::new(0.0, 1e12, ""), "from 0 to 1e12"),
            (Bounds::new(1e-4, 1.0, "m"), "from 0.0001 to 1 m"),
            (Bounds::new(1e-5, 1.0, "s"), "from 1e-5 to 1 s"),
            (Bounds::positive("m"), "above 0 m"),
            (Bounds::new(0.05, f64::INFINITY, "s"), "at least 0.05 s"),
            (
                Bounds::new(0.05, 2.0, "s").with_note("at least period_s"),
                "from 0.05 to 2 s (at least period_s)",
            ),
        ] {
            assert_eq!(bounds.to_string(), text);
            assert!(bounds.check("key", bounds.low).is_ok(), "{text}");
            assert!(bounds.check("key", f64::NAN).is_err(), "{text}");
            assert!(bounds.check("key", f64::INFINITY).is_err(), "{text}");
            let below = bounds.low - 1e-6 * bounds.low.abs().max(1.0);
            assert!(bounds.check("key", below).is_err(), "{text}");
        }
    }
}
