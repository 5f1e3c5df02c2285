//! What was seen of a place.

use super::settings::MemoryConfig;
use nalgebra::{SVector, Vector3};
use serde::{Deserialize, Serialize};
use sidehill_plant::slip_gains::{SlipGains, TERMS};

/// Share of what was seen of the slip before that counts beside a new visit.
const KEPT_SHARE: f64 = 0.8;
/// Way after which what was seen counts half, m: it is noisy.
const HALF_KNOWN_M: f64 = 0.01;
/// Largest slip per metre that is reckoned with: to the side, along the path, rad/m. Treads that spin lose far
/// more way than that, but only as long as they spin.
const SLIP_MAX: [f64; 3] = [0.4, 0.05, 0.4];

/// Sums over the way driven at a place, each weighted by that way.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Evidence {
    /// Way over which slip was seen, m.
    pub way_m: f64,
    /// Motion that the model does not have without learned gains: m to the right of the path's heading,
    /// m ahead and rad.
    pub slip: [f64; 3],
    /// Terms of the learned gains, times the way's time, m.
    pub terms_m: [f64; TERMS],
    /// Way over which the error was seen, m.
    pub error_way_m: f64,
    /// Distance to the right of the path to aim at, times that way, m^2.
    pub aim_m2: f64,
    /// Distance to the right of the path that calls for another aim, times that way, m^2; of a visit under way
    /// only.
    pub error_m2: f64,
}

impl Evidence {
    /// Adds a share of other evidence.
    pub(super) fn add(&mut self, share: f64, other: &Self) {
        self.way_m += share * other.way_m;
        for (sum, value) in self.slip.iter_mut().zip(&other.slip) {
            *sum += share * value;
        }
        for (sum, value) in self.terms_m.iter_mut().zip(&other.terms_m) {
            *sum += share * value;
        }
        self.error_way_m += share * other.error_way_m;
        self.aim_m2 += share * other.aim_m2;
        self.error_m2 += share * other.error_m2;
    }

    /// Returns what is known after a visit.
    pub(super) fn after(&self, visit: &Self, config: &MemoryConfig) -> Self {
        let mut known = *visit;
        known.add(KEPT_SHARE, self);
        let mut aim_m = mean(self.aim_m2, self.error_way_m);
        if visit.error_way_m > 0.0 {
            let error_m = mean(visit.error_m2, visit.error_way_m);
            aim_m = config.kept_share * aim_m - config.error_share * error_m;
        }
        known.aim_m2 = aim_m.clamp(-config.aim_max_m, config.aim_max_m) * known.error_way_m;
        known.error_m2 = 0.0;
        known
    }

    /// Returns whether all numbers are finite and the way is none driven backwards.
    pub(super) fn is_finite(&self) -> bool {
        let sums = self.slip.iter().chain(&self.terms_m);
        let rest = [self.aim_m2, self.error_m2];
        self.way_m >= 0.0 && self.error_way_m >= 0.0 && sums.chain(&rest).all(|sum| sum.is_finite())
    }

    /// Returns the share with which what is known counts against what the gains have learned, 0 to 1.
    pub(super) fn share(&self) -> f64 {
        self.way_m / (self.way_m + HALF_KNOWN_M)
    }

    /// Returns how far to the right of the path to aim, m; less where little was seen.
    pub(super) fn aim_right_m(&self) -> f64 {
        self.aim_m2 / (self.error_way_m + HALF_KNOWN_M)
    }

    /// Returns the motion per metre that neither the model nor `gains` have: to the right of the path's
    /// heading, ahead, rad/m.
    pub(super) fn slip_per_m(&self, gains: &SlipGains) -> Vector3<f64> {
        if self.way_m <= 0.0 {
            return Vector3::zeros();
        }
        let terms: SVector<f64, TERMS> = SVector::from(self.terms_m);
        let found = (Vector3::from(self.slip) - gains * terms) * (self.share() / self.way_m);
        let most = Vector3::from(SLIP_MAX);
        found.zip_map(&most, |part, most| part.clamp(-most, most))
    }
}

fn mean(sum: f64, weight: f64) -> f64 {
    if weight > 0.0 { sum / weight } else { 0.0 }
}
