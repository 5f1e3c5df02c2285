//! What the guard says of a place, and how it judges one.

use super::settings::GuardConfig;
use super::stance::{Margins, Stance, Turning};
use crate::path::Point2;
use crate::trajectory::ReferencePoint;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use sidehill_plant::frames::{Attitude, PlanarPose, wrap_angle};

/// What is beyond its limit at a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SteepMeasure {
    /// Tip-over margin.
    RolloverMargin,
    /// Use of friction.
    FrictionUse,
    /// Roll, deg.
    Roll,
    /// Pitch, deg.
    Pitch,
}

impl std::fmt::Display for SteepMeasure {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.write_str(match self {
            Self::RolloverMargin => "tip-over margin",
            Self::FrictionUse => "use of friction",
            Self::Roll => "roll",
            Self::Pitch => "pitch",
        })
    }
}

/// A place on the path that is steeper than the guard allows at full speed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SteepPlace {
    /// What is beyond its limit.
    pub measure: SteepMeasure,
    /// Its value there.
    pub value: f64,
    /// Its limit.
    pub limit: f64,
    /// X_g, m.
    pub x_m: f64,
    /// Y_g, m.
    pub y_m: f64,
    /// Distance along the path from its start, m.
    pub arc_length_m: f64,
    /// Time until the reference would be there at full speed, s.
    pub in_s: f64,
    /// Whether it is so near to its limit that the vehicle may have to stop before it, where it is off its
    /// path then or the ground is not quite as known.
    #[serde(default)]
    pub may_stop: bool,
    /// Whether the vehicle stops before it; else it drives over it, slower.
    pub stops: bool,
}

impl std::fmt::Display for SteepPlace {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { value, limit, .. } = self;
        match self.measure {
            SteepMeasure::RolloverMargin => {
                write!(out, "tip-over margin {value:.2}, less than {limit:.2}")?;
            }
            SteepMeasure::FrictionUse => {
                write!(out, "use of friction {value:.2}, more than {limit:.2}")?;
            }
            SteepMeasure::Roll => write!(out, "roll {value:.1} deg, beyond {limit} deg")?,
            SteepMeasure::Pitch => write!(out, "pitch {value:.1} deg, beyond {limit} deg")?,
        }
        write!(
            out,
            ", {:.1} m along the path at ({:.2}, {:.2}) m",
            self.arc_length_m, self.x_m, self.y_m
        )
    }
}

/// A measure beyond a limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Excess {
    pub(super) measure: SteepMeasure,
    pub(super) value: f64,
    pub(super) limit: f64,
}

impl Excess {
    /// Returns it at a point of the reference, which calls for `call`.
    pub(super) fn at(&self, point: &ReferencePoint, in_s: f64, call: Call) -> SteepPlace {
        SteepPlace {
            measure: self.measure,
            value: self.value,
            limit: self.limit,
            x_m: point.position.x_m,
            y_m: point.position.y_m,
            arc_length_m: point.arc_length_m,
            in_s,
            may_stop: call != Call::Slow,
            stops: call == Call::Stop,
        }
    }
}

/// What a place calls for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Call {
    /// A lower speed.
    Slow,
    /// A warning: the vehicle may have to stop.
    Warning,
    /// A stop.
    Stop,
}

/// What a place allows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Judgement {
    /// Why it must not be driven over, even slowly.
    pub(super) blocked: Option<Excess>,
    /// Why the vehicle may yet have to stop before it.
    pub(super) near_limit: Option<Excess>,
    /// Why it is driven over slower.
    pub(super) slow: Option<Excess>,
    /// Share of the reference's speed with which it may be driven over.
    pub(super) share: f64,
}

impl Judgement {
    /// Returns what both allow.
    pub(super) fn and(self, other: Self) -> Self {
        Self {
            blocked: self.blocked.or(other.blocked),
            near_limit: self.near_limit.or(other.near_limit),
            slow: self.slow.or(other.slow),
            share: self.share.min(other.share),
        }
    }
}

/// Where a vehicle is, seen from its reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ReferenceOffset {
    right_m: f64,
    forward_m: f64,
    /// Its heading less that of the reference, rad.
    pub(super) turned_rad: f64,
}

impl ReferenceOffset {
    pub(super) fn of(pose: &PlanarPose, reference: &ReferencePoint) -> Self {
        let (sin, cos) = reference.heading_rad.sin_cos();
        let x_m = pose.x_m - reference.position.x_m;
        let y_m = pose.y_m - reference.position.y_m;
        Self {
            right_m: cos * x_m + sin * y_m,
            forward_m: -sin * x_m + cos * y_m,
            turned_rad: wrap_angle(pose.yaw_rad - reference.heading_rad),
        }
    }

    /// Returns the position of a vehicle with the same offset from the reference at `point`.
    pub(super) fn place(&self, point: &ReferencePoint) -> Point2 {
        let (sin, cos) = point.heading_rad.sin_cos();
        Point2 {
            x_m: point.position.x_m + cos * self.right_m - sin * self.forward_m,
            y_m: point.position.y_m + sin * self.right_m + cos * self.forward_m,
        }
    }
}

/// Reserve to a limit of margin or friction at which the vehicle stops before a place: it is somewhat off its
/// path and its heading, and its sensors are noisy.
const RESERVE: f64 = 0.02;
/// Reserve to a limit of margin or friction within which a place is announced: where the vehicle is beside its
/// path when it comes there, it may have to stop.
const WARNING_RESERVE: f64 = 0.12;
/// The same of roll and pitch, deg.
const WARNING_RESERVE_DEG: f64 = 4.0;

/// A vehicle and its limits on ground of a coefficient of friction.
#[derive(Debug, Clone, Copy)]
pub(super) struct Judge<'a> {
    pub(super) config: &'a GuardConfig,
    pub(super) stance: &'a Stance,
    pub(super) friction: f64,
}

impl Judge<'_> {
    /// Returns what the ground at a point of the reference allows to a vehicle that is `turned_rad` off the
    /// reference's heading, by the worst of the headings within the spread.
    pub(super) fn judge(
        &self,
        point: &ReferencePoint,
        turned_rad: f64,
        normal: &Vector3<f64>,
    ) -> Judgement {
        let spread_rad = self.config.heading_spread_deg.to_radians();
        let attitudes = [0.0, spread_rad, -spread_rad]
            .map(|turn| Attitude::on_plane(normal, point.heading_rad + turned_rad + turn));
        let (c, slowest) = (self.config, self.config.speed_share_min);
        let worst = |share: f64| {
            let turning = Turning {
                speed_m_s: share * point.speed_m_s,
                yaw_rate_rad_s: share * point.yaw_rate_rad_s,
            };
            attitudes
                .iter()
                .map(|attitude| self.stance.margins(attitude, &turning, self.friction))
                .fold(None, |worst: Option<Margins>, next| {
                    Some(worst.map_or(next, |worst| Margins {
                        rollover: worst.rollover.min(next.rollover),
                        friction_use: worst.friction_use.max(next.friction_use),
                    }))
                })
        };
        let slowly = worst(slowest);
        let beyond = |reserve: f64, reserve_deg: f64| {
            let tilted = |attitude| self.tilt_beyond(attitude, reserve_deg);
            attitudes.iter().find_map(tilted).or_else(|| {
                let rollover = c.rollover_margin_min + reserve;
                excess(&slowly?, rollover, c.friction_use_max - reserve)
            })
        };
        let blocked = beyond(RESERVE, 0.0);
        let near_limit = blocked.or_else(|| beyond(WARNING_RESERVE, WARNING_RESERVE_DEG));
        let (mut share, mut slow) = (1.0, None);
        if let Some(m) = worst(1.0) {
            slow = excess(&m, c.rollover_margin_slow(), c.friction_use_slow);
            let ramp = |value: f64, none: f64, full: f64| {
                if full == none {
                    return f64::from(value >= full);
                }
                ((value - none) / (full - none)).clamp(0.0, 1.0)
            };
            let left = ramp(m.rollover, c.rollover_margin_min, c.rollover_margin_slow()).min(ramp(
                -m.friction_use,
                -c.friction_use_max,
                -c.friction_use_slow,
            ));
            share = slowest + (1.0 - slowest) * left;
        }
        Judgement {
            blocked,
            near_limit,
            slow,
            share,
        }
    }

    /// Returns which limit an attitude is beyond.
    pub(super) fn tilt(&self, attitude: &Attitude) -> Option<Excess> {
        self.tilt_beyond(attitude, 0.0)
    }

    /// Returns which limit an attitude is beyond that is lower by a reserve.
    fn tilt_beyond(&self, attitude: &Attitude, reserve_deg: f64) -> Option<Excess> {
        let beyond = |measure, angle_rad: f64, limit: f64| {
            let value = angle_rad.to_degrees();
            exceeds(value.abs(), limit).then_some(Excess {
                measure,
                value,
                limit,
            })
        };
        beyond(
            SteepMeasure::Roll,
            attitude.roll_rad,
            self.config.roll_max_deg - reserve_deg,
        )
        .or_else(|| {
            beyond(
                SteepMeasure::Pitch,
                attitude.pitch_rad,
                self.config.pitch_max_deg - reserve_deg,
            )
        })
    }
}

/// Returns whether a value is beyond its limit; a NaN is.
fn exceeds(value: f64, limit: f64) -> bool {
    value.is_nan() || value > limit
}

fn excess(margins: &Margins, rollover: f64, friction_use: f64) -> Option<Excess> {
    if exceeds(-margins.rollover, -rollover) {
        return Some(Excess {
            measure: SteepMeasure::RolloverMargin,
            value: margins.rollover,
            limit: rollover,
        });
    }
    exceeds(margins.friction_use, friction_use).then_some(Excess {
        measure: SteepMeasure::FrictionUse,
        value: margins.friction_use,
        limit: friction_use,
    })
}
