//! Differences between replayed and recorded commands.

use serde::Serialize;
use sidehill_plant::speeds::MotorSpeeds;
use sidehill_recording::ControllerCycle;

/// The first cycle that differs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct First {
    /// Its number, from 0.
    pub(super) cycle: u64,
    /// Its time, s.
    pub(super) time_s: f64,
    /// What differs.
    pub(super) what: String,
}

/// Differences between replayed and recorded commands.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub(super) struct ReplayComparison {
    /// Cycles compared.
    pub(super) cycles: u64,
    /// Cycles whose command, status or estimate differs.
    pub(super) different: u64,
    /// Largest difference of traction or steer, m/s.
    pub(super) largest_difference_m_s: f64,
    /// Root mean square of the differences of traction, m/s.
    pub(super) traction_rms_m_s: f64,
    /// Root mean square of the differences of steer, m/s.
    pub(super) steer_rms_m_s: f64,
    /// The first cycle that differs.
    #[serde(skip_serializing_if = "Option::is_none", rename = "first_difference")]
    pub(super) first: Option<First>,
}

impl ReplayComparison {
    /// Compares cycle by cycle. Without a tolerance, commands and estimates must agree bit by bit.
    pub(super) fn of(
        recorded: &[ControllerCycle],
        replayed: &[ControllerCycle],
        tolerance_m_s: f64,
    ) -> Self {
        let mut all = Self::default();
        for (cycle, again) in recorded.iter().zip(replayed) {
            let pair = [("recorded", cycle.command()), ("replayed", again.command())];
            let what = all.add(pair, tolerance_m_s);
            let also = || other(cycle, again).filter(|_| tolerance_m_s == 0.0);
            all.note(cycle.index, cycle.time_s, what.or_else(also));
        }
        all.averaged()
    }

    /// Adds the named motor speeds of a cycle, and returns those that differ by more than the tolerance, or, without
    /// one, in any bit.
    pub(super) fn add(
        &mut self,
        [(one, a), (other, b)]: [(&str, MotorSpeeds); 2],
        tolerance_m_s: f64,
    ) -> Option<String> {
        self.cycles += 1;
        let pairs = [
            ("traction", a.traction_m_s, b.traction_m_s),
            ("steer", a.steer_m_s, b.steer_m_s),
        ];
        let [traction, steer] = pairs.map(|(_, a, b)| difference(a, b));
        self.largest_difference_m_s = self.largest_difference_m_s.max(traction).max(steer);
        self.traction_rms_m_s += traction.powi(2);
        self.steer_rms_m_s += steer.powi(2);
        let differs = |a: f64, b: f64| {
            if tolerance_m_s > 0.0 {
                difference(a, b) > tolerance_m_s
            } else {
                a.to_bits() != b.to_bits()
            }
        };
        pairs
            .iter()
            .find(|(_, a, b)| differs(*a, *b))
            .map(|(name, a, b)| format!("{name} {a} m/s {one}, {b} m/s {other}"))
    }

    /// Records the differences of the last cycle added.
    pub(super) fn note(&mut self, cycle: u64, time_s: f64, what: Option<String>) {
        if let Some(what) = what {
            self.different += 1;
            self.first.get_or_insert(First {
                cycle,
                time_s,
                what,
            });
        }
    }

    /// Returns the comparison of all cycles, with sums of squares converted to root mean squares.
    pub(super) fn averaged(mut self) -> Self {
        let count = self.cycles.max(1) as f64;
        self.traction_rms_m_s = (self.traction_rms_m_s / count).sqrt();
        self.steer_rms_m_s = (self.steer_rms_m_s / count).sqrt();
        self
    }
}

/// Returns what differs besides the command.
fn other(cycle: &ControllerCycle, again: &ControllerCycle) -> Option<String> {
    if cycle.status != again.status {
        return Some(format!(
            "{} recorded, {} replayed",
            cycle.status, again.status
        ));
    }
    let pairs = [
        ("estimated x", cycle.estimated_x_m, again.estimated_x_m),
        ("estimated y", cycle.estimated_y_m, again.estimated_y_m),
        (
            "estimated yaw",
            cycle.estimated_yaw_rad,
            again.estimated_yaw_rad,
        ),
    ];
    pairs
        .iter()
        .find(|(_, a, b)| a.to_bits() != b.to_bits() && !(a.is_nan() && b.is_nan()))
        .map(|(name, a, b)| format!("{name} {a} recorded, {b} replayed"))
}

/// Returns |a - b|: 0 for equal bits, infinite if only one of them is a number.
fn difference(a: f64, b: f64) -> f64 {
    if a.to_bits() == b.to_bits() {
        return 0.0;
    }
    let difference = (a - b).abs();
    if difference.is_nan() {
        f64::INFINITY
    } else {
        difference
    }
}

/// Returns the root mean square of the finite values; NaN if there are none.
pub(super) fn cross_track_rms_m(values_m: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for value_m in values_m.filter(|value| value.is_finite()) {
        sum += value_m * value_m;
        count += 1.0;
    }
    f64::sqrt(sum / count)
}
