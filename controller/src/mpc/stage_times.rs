//! The times of a horizon's stages.

/// Durations of stages that grow geometrically from the first to the last, all stretched by a common factor.
#[derive(Debug, Clone, PartialEq)]
pub struct StageTimes {
    /// Ends of the stages without the stretch, s; the horizon's begin first.
    ends_s: Vec<f64>,
    stretch: f64,
}

impl StageTimes {
    /// Returns `stages` of `first_s`, growing to `last_s` where that is longer, not stretched.
    pub fn new(stages: usize, first_s: f64, last_s: f64) -> Self {
        let between = (stages.max(2) - 1) as f64;
        let growth = (last_s.max(first_s) / first_s).powf(1.0 / between);
        let mut ends_s = vec![0.0];
        for k in 0..stages {
            // A product keeps even stages free of a sum's rounding.
            ends_s.push(if growth > 1.0 {
                ends_s[k] + first_s * growth.powi(k as i32)
            } else {
                first_s * (k + 1) as f64
            });
        }
        Self {
            ends_s,
            stretch: 1.0,
        }
    }

    /// Returns the factor on all durations.
    pub fn stretch(&self) -> f64 {
        self.stretch
    }

    /// Sets the factor on all durations.
    pub(super) fn set_stretch(&mut self, stretch: f64) {
        self.stretch = stretch;
    }

    /// Returns the duration of stage `k`, s.
    pub fn step_s(&self, k: usize) -> f64 {
        self.stretch * (self.ends_s[k + 1] - self.ends_s[k])
    }

    /// Returns when stage `k` ends, from the horizon's begin, s.
    pub fn end_s(&self, k: usize) -> f64 {
        self.stretch * self.ends_s[k + 1]
    }

    /// Returns the duration of the whole, s.
    pub fn duration_s(&self) -> f64 {
        self.stretch * self.whole_s()
    }

    /// Returns the duration of the whole without the stretch, s.
    pub fn whole_s(&self) -> f64 {
        self.ends_s.last().copied().unwrap_or(0.0)
    }
}
