//! The times of a horizon's stages.

/// Durations of stages that grow geometrically from the first to the last.
#[derive(Debug, Clone, PartialEq)]
pub struct StageTimes {
    steps_s: Vec<f64>,
    ends_s: Vec<f64>,
}

impl StageTimes {
    /// Returns `stages` of `first_s`, growing to `last_s` where that is longer.
    pub fn new(stages: usize, first_s: f64, last_s: f64) -> Self {
        let between = (stages.max(2) - 1) as f64;
        let growth = (last_s.max(first_s) / first_s).powf(1.0 / between);
        let steps_s: Vec<f64> = (0..stages)
            .map(|k| {
                if growth > 1.0 {
                    first_s * growth.powi(k as i32)
                } else {
                    first_s
                }
            })
            .collect();
        let mut end_s = 0.0;
        let ends_s = steps_s
            .iter()
            .enumerate()
            .map(|(k, step_s)| {
                // A product keeps even stages free of a sum's rounding.
                end_s += step_s;
                if growth > 1.0 {
                    end_s
                } else {
                    first_s * (k + 1) as f64
                }
            })
            .collect();
        Self { steps_s, ends_s }
    }

    /// Returns the duration of stage `k`, s.
    pub fn step_s(&self, k: usize) -> f64 {
        self.steps_s[k]
    }

    /// Returns the ends of all stages, from the horizon's begin, s.
    pub fn ends_s(&self) -> &[f64] {
        &self.ends_s
    }

    /// Returns the duration of the whole, s.
    pub fn duration_s(&self) -> f64 {
        self.ends_s.last().copied().unwrap_or(0.0)
    }
}
