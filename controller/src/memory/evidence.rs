//! What was seen of a place.

use super::settings::MemoryConfig;
use nalgebra::{SVector, Vector3};
use serde::{Deserialize, Serialize};
use sidehill_plant::slip_gains::{SlipGains, TERMS};

/// Sums over the way driven at a place, each weighted by that way.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Evidence {
    /// Way that was seen, m.
    pub way_m: f64,
    /// Motion that the model does not have without learned gains: m to the right of the path's heading,
    /// m ahead and rad.
    pub slip: [f64; 3],
    /// Terms of the learned gains, times the way's time, m.
    pub terms_m: [f64; TERMS],
    /// Distance to the right of the path to aim at, times the way, m^2.
    pub aim_m2: f64,
    /// Distance to the right of the path of a vehicle that knew the slip, times the way, m^2.
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
        self.aim_m2 += share * other.aim_m2;
        self.error_m2 += share * other.error_m2;
    }

    /// Returns what is known after a visit.
    pub(super) fn after(&self, visit: &Self, config: &MemoryConfig) -> Self {
        if visit.way_m <= 0.0 {
            return *self;
        }
        let mut known = *visit;
        let kept = super::knob("KEPT", 0.8);
        known.add(kept, self);
        let aim_m = if self.way_m > 0.0 { self.aim_m2 / self.way_m } else { 0.0 };
        let error_m = visit.error_m2 / visit.way_m;
        let aim_m = config.kept_share * aim_m - super::knob("SHARE", config.error_share) * error_m;
        known.aim_m2 = aim_m.clamp(-config.aim_max_m, config.aim_max_m) * known.way_m;
        known.error_m2 = 0.0;
        known
    }

    /// Returns whether all numbers are finite and the way is none driven backwards.
    pub(super) fn is_finite(&self) -> bool {
        let sums = self.slip.iter().chain(&self.terms_m);
        let rest = [self.way_m, self.aim_m2, self.error_m2];
        self.way_m >= 0.0 && sums.chain(&rest).all(|sum| sum.is_finite())
    }

    /// Returns the share with which what is known counts against what the gains have learned, 0 to 1.
    pub(super) fn share(&self) -> f64 {
        self.way_m / (self.way_m + super::knob("M0", 0.05))
    }

    /// Returns how far to the right of the path to aim, m.
    pub(super) fn aim_right_m(&self) -> f64 {
        if self.way_m > 0.0 { self.aim_m2 / self.way_m * self.share() } else { 0.0 }
    }

    /// Returns the motion per metre that neither the model nor `gains` have: to the right of the path's
    /// heading, ahead, rad/m.
    pub(super) fn slip_per_m(&self, gains: &SlipGains) -> Vector3<f64> {
        if self.way_m <= 0.0 {
            return Vector3::zeros();
        }
        let terms: SVector<f64, TERMS> = SVector::from(self.terms_m);
        let found = (Vector3::from(self.slip) - gains * terms) * (self.share() / self.way_m);
        let bound = super::knob("BOUND", 0.4);
        let mut f = found.map(|part| part.clamp(-bound, bound));
        f.z *= super::knob("YAWSHARE", 1.0);
        f.x *= super::knob("LATSHARE", 1.0);
        f.y *= super::knob("FWDSHARE", 1.0);
        f
    }
}
