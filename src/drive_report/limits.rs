//! What a drive has to keep to.

use super::facts::{CheckedLimit, DriveFacts};
use super::stops::StopKind;
use serde::Deserialize;

/// Limits of a drive; what is not given is not judged.
#[derive(Debug, Clone, Default, clap::Args, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LimitArgs {
    /// Largest cross-track error, m.
    #[arg(long, value_name = "M")]
    pub max_cross_track_m: Option<f64>,
    /// Largest root mean square of the cross-track error, m.
    #[arg(long, value_name = "M")]
    pub max_cross_track_rms_m: Option<f64>,
    /// Largest number of stops that neither the end of the path nor an operator or client caused.
    #[arg(long, value_name = "COUNT")]
    pub max_stops: Option<u32>,
    /// Largest age of the pose while driving, s.
    #[arg(long, value_name = "S")]
    pub max_pose_age_s: Option<f64>,
    /// Largest use of friction, where the steepness guard is on: 1 slides.
    #[arg(long, value_name = "SHARE")]
    pub max_friction_use: Option<f64>,
    /// Least tip-over margin, where the steepness guard is on: 0 tips over.
    #[arg(long, value_name = "MARGIN")]
    pub min_tip_over_margin: Option<f64>,
    /// Least distance along the path, m.
    #[arg(long, value_name = "M")]
    pub min_distance_m: Option<f64>,
}

impl LimitArgs {
    /// Judges a drive.
    pub(super) fn judge(&self, facts: &DriveFacts) -> Vec<CheckedLimit> {
        let faults = facts
            .stops
            .iter()
            .filter(|stop| stop.kind == StopKind::Fault);
        let (error, guard) = (facts.cross_track, facts.guard);
        let most = [
            (
                "largest cross-track error",
                "m",
                self.max_cross_track_m,
                error.map(|error| error.max_m),
            ),
            (
                "cross-track error, RMS",
                "m",
                self.max_cross_track_rms_m,
                error.map(|error| error.rms_m),
            ),
            (
                "stops that nobody asked for",
                "",
                self.max_stops.map(f64::from),
                Some(faults.count() as f64),
            ),
            (
                "largest age of the pose",
                "s",
                self.max_pose_age_s,
                facts.pose_age_max_s,
            ),
            (
                "largest use of friction",
                "",
                self.max_friction_use,
                guard.map(|guard| guard.friction_use_max),
            ),
        ];
        let least = [
            (
                "least tip-over margin",
                "",
                self.min_tip_over_margin,
                guard.map(|guard| guard.tip_over_margin_min),
            ),
            (
                "distance along the path",
                "m",
                self.min_distance_m,
                Some(facts.driven.along_path_m),
            ),
        ];
        let judged = |is_least: bool| {
            move |(name, unit, limit, found): (_, _, Option<f64>, Option<f64>)| {
                let limit = limit?;
                let within = |found: f64| {
                    if is_least {
                        found >= limit
                    } else {
                        found <= limit
                    }
                };
                let passed = found.is_some_and(within);
                Some(CheckedLimit {
                    name,
                    unit,
                    is_least,
                    limit,
                    found,
                    passed,
                })
            }
        };
        let most = most.into_iter().filter_map(judged(false));
        most.chain(least.into_iter().filter_map(judged(true)))
            .collect()
    }
}
