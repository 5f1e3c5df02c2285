//! Poses of the vehicle from the fixes of a satellite receiver.
//!
//! A fix is the place of an antenna. The place of the vehicle is that less the lever arm, turned by heading, roll and
//! pitch at the instant of the fix; so a fix waits until readings around it have arrived. The heading is that of a topic,
//! or of the motion ([`course`](super::course)).

use super::course::{Course, azimuth_rad};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use sidehill_bridge::ros2::convert::pose_and_attitude;
use sidehill_bridge::ros2::message::NavSatFix;
use sidehill_controller::path::GeodeticOrigin;
use sidehill_plant::frames::{Attitude, Pose, ros_quaternion, wrap_angle};
use sidehill_plant::sample::Stamped;
use std::collections::VecDeque;

/// Longest wait of a fix for attitude and heading, s.
const WAIT_S: f64 = 0.3;
/// Distance of two readings in time between which is interpolated, s.
const GAP_S: f64 = 0.5;
/// How far from a single reading it holds, s.
const NEAR_S: f64 = 0.03;
/// Readings kept of a kind, which is over 0.3 s at 400 Hz.
const KEPT: usize = 128;
/// Fixes that wait, at most.
const WAITING: usize = 8;
/// Farthest place from the datum, m: there the plane is true to 1e-6, and the earth 8 m below it.
const DATUM_DISTANCE_MAX_M: f64 = 1e4;
/// Status of a fix that is corrected from ground stations: RTK, float or fixed.
const STATUS_GBAS: i8 = 2;
/// Standard deviation of a fix of unknown covariance without such corrections, m.
const UNCORRECTED_M: f64 = 2.5;

/// How fixes become poses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FixSettings {
    /// Where the frame of the poses has its origin; x is east, y north.
    pub datum: GeodeticOrigin,
    /// Largest standard deviation of a fix that is used, m.
    pub sigma_max_m: f64,
    /// Largest standard deviation of a heading that is used, rad.
    pub heading_sigma_max_rad: f64,
}

/// A fix as it came, used or not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FixReading {
    /// When it came, s.
    pub arrived_s: f64,
    /// When it was measured, s; NaN where its stamp was refused.
    pub time_s: f64,
    /// Status of sensor_msgs/NavSatStatus: -1 no fix, 0 alone, 1 corrected from satellites, 2 from the ground (RTK).
    pub status: i8,
    /// Larger standard deviation of east and north, m; NaN where the receiver does not tell.
    pub sigma_m: f64,
    /// Whether it was good enough for a pose.
    pub used: bool,
}

impl FixReading {
    /// Returns a fix that came at `arrived_s` and was measured at `time_s`.
    pub(super) fn new(arrived_s: f64, time_s: f64, fix: &NavSatFix, used: bool) -> Self {
        Self {
            arrived_s,
            time_s,
            status: fix.status.status,
            sigma_m: told_sigma_m(fix).unwrap_or(f64::NAN),
            used,
        }
    }
}

/// Why a fix is not used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(crate) enum FixError {
    #[error("no fix: its status is {status}")]
    NoFix { status: i8 },
    #[error("no fix: latitude {latitude_deg} and longitude {longitude_deg}")]
    NoPlace {
        latitude_deg: f64,
        longitude_deg: f64,
    },
    #[error("{km:.0} km from the datum, at most 10 km are allowed")]
    Far { km: f64 },
    #[error(
        "its standard deviation is {sigma_m:.3} m (status {status}), more than {max_m:.3} m, three times \
         settings.estimator.pose_sigma_m"
    )]
    Inaccurate {
        sigma_m: f64,
        status: i8,
        max_m: f64,
    },
    #[error("no {reading} of its instant has come within {WAIT_S} s")]
    Alone { reading: &'static str },
    #[error(
        "the heading is not known: it follows from the motion once the vehicle has been driven by hand, straight, for \
         {metres:.0} m"
    )]
    NoCourse { metres: f64 },
}

/// Readings of a kind in the order of time.
#[derive(Debug)]
pub(super) struct RecentReadings<T>(VecDeque<(f64, T)>);

impl<T: Copy> RecentReadings<T> {
    fn new() -> Self {
        Self(VecDeque::with_capacity(KEPT))
    }

    pub(super) fn push(&mut self, time_s: f64, value: T) {
        if self
            .0
            .back()
            .is_some_and(|(newest_s, _)| time_s <= *newest_s)
        {
            return;
        }
        if self.0.len() == KEPT {
            self.0.pop_front();
        }
        self.0.push_back((time_s, value));
    }

    /// Returns the reading at a time, by `between` two of them and the share of the later.
    fn at(&self, time_s: f64, between: impl Fn(&T, &T, f64) -> T) -> Option<T> {
        let after = self.0.partition_point(|(at_s, _)| *at_s <= time_s);
        let before = after.checked_sub(1).and_then(|index| self.0.get(index));
        match (before, self.0.get(after)) {
            (Some((a_s, a)), Some((b_s, b))) if b_s - a_s <= GAP_S => {
                Some(between(a, b, (time_s - a_s) / (b_s - a_s)))
            }
            (Some((at_s, value)), _) if time_s - at_s <= NEAR_S => Some(*value),
            (_, Some((at_s, value))) if at_s - time_s <= NEAR_S => Some(*value),
            _ => None,
        }
    }

    pub(super) fn change(&mut self, mut change: impl FnMut(&mut T)) {
        self.0.iter_mut().for_each(|(_, value)| change(value));
    }
}

/// A fix that waits for readings of its instant.
#[derive(Debug, Clone, Copy)]
struct PendingFix {
    time_s: f64,
    antenna: Vector3<f64>,
    sigma_m: f64,
    lever: Vector3<f64>,
}

/// Makes poses of fixes, attitudes and headings.
#[derive(Debug)]
pub(crate) struct FixPoses {
    settings: FixSettings,
    waiting: VecDeque<PendingFix>,
    attitudes: RecentReadings<Attitude>,
    /// Azimuths of `direction`; of the course the heading itself.
    headings: RecentReadings<f64>,
    direction: Vector3<f64>,
    /// The heading by the motion, where no topic gives it.
    course: Option<Course>,
}

impl FixPoses {
    pub(crate) fn new(settings: FixSettings, heading_from_motion: bool) -> Self {
        Self {
            settings,
            waiting: VecDeque::with_capacity(WAITING),
            attitudes: RecentReadings::new(),
            headings: RecentReadings::new(),
            direction: Vector3::x(),
            course: heading_from_motion.then(Course::default),
        }
    }

    pub(crate) fn settings(&self) -> &FixSettings {
        &self.settings
    }

    /// Forgets all readings, as after a jump of the clock.
    pub(crate) fn forget(&mut self) {
        *self = Self::new(self.settings, self.course.is_some());
    }

    pub(crate) fn attitude(&mut self, time_s: f64, attitude: Attitude) {
        self.attitudes.push(time_s, attitude);
        if let Some(course) = &mut self.course {
            course.attitude(attitude);
        }
    }

    /// Takes where a direction of base_link points, seen from above, rad, counter-clockwise from Y_g.
    pub(crate) fn heading(&mut self, time_s: f64, azimuth_rad: f64, direction: Vector3<f64>) {
        self.direction = direction;
        self.headings.push(time_s, azimuth_rad);
    }

    /// Takes the rate of a gyroscope about the vehicle's upward axis.
    pub(crate) fn yaw_rate(&mut self, time_s: f64, rad_s: f64) {
        if let Some(course) = &mut self.course {
            let yaw_rad = course.yaw_rate(time_s, rad_s);
            self.headings.push(time_s, yaw_rad);
        }
    }

    /// Takes the speed of both treads together, and half of their difference.
    pub(crate) fn speeds(&mut self, time_s: f64, traction_m_s: f64, steer_m_s: f64) {
        if let Some(course) = &mut self.course {
            course.speeds(time_s, traction_m_s, steer_m_s);
        }
    }

    /// Takes a fix; `lever` is the antenna in base_link, m.
    ///
    /// # Errors
    /// Why it is no place.
    pub(crate) fn fix(
        &mut self,
        time_s: f64,
        fix: &NavSatFix,
        lever: Vector3<f64>,
    ) -> Result<(), FixError> {
        let (latitude_deg, longitude_deg) = (fix.latitude, fix.longitude);
        let status = fix.status.status;
        if status < 0 {
            return Err(FixError::NoFix { status });
        }
        let on_earth = latitude_deg.abs() <= 90.0 && longitude_deg.abs() <= 180.0;
        if !on_earth || (latitude_deg == 0.0 && longitude_deg == 0.0) {
            return Err(FixError::NoPlace {
                latitude_deg,
                longitude_deg,
            });
        }
        let datum = &self.settings.datum;
        let at = datum.project(latitude_deg, longitude_deg);
        let away_m = at.x_m.hypot(at.y_m);
        // Beyond the horizon the plane comes back: degrees do not.
        let degrees = (latitude_deg - datum.latitude_deg).abs();
        if away_m > DATUM_DISTANCE_MAX_M || degrees > 1.0 {
            return Err(FixError::Far {
                km: (away_m / 1e3).max(111.0 * degrees),
            });
        }
        let sigma_m = sigma_m(fix, self.settings.sigma_max_m);
        // A covariance that is no number is not within.
        if !(..=self.settings.sigma_max_m).contains(&sigma_m) {
            return Err(FixError::Inaccurate {
                sigma_m,
                status,
                max_m: self.settings.sigma_max_m,
            });
        }
        let up_m = fix.altitude - datum.elevation_m;
        let antenna = Vector3::new(at.x_m, at.y_m, if up_m.is_finite() { up_m } else { 0.0 });
        if self.waiting.len() == WAITING {
            self.waiting.pop_front();
        }
        self.waiting.push_back(PendingFix {
            time_s,
            antenna,
            sigma_m,
            lever,
        });
        Ok(())
    }

    /// Returns attitude and heading at a time, where readings around it have arrived.
    fn readings_at(&self, time_s: f64) -> (Option<Attitude>, Option<f64>) {
        let attitude = self.attitudes.at(time_s, |a, b, share| Attitude {
            roll_rad: a.roll_rad + share * (b.roll_rad - a.roll_rad),
            pitch_rad: a.pitch_rad + share * (b.pitch_rad - a.pitch_rad),
        });
        let turn = |a: &f64, b: &f64, share| a + share * wrap_angle(b - a);
        let azimuth = self.headings.at(time_s, turn);
        let yaw_rad = match (azimuth, &attitude, &self.course) {
            (Some(azimuth), Some(attitude), None) => {
                Some(azimuth - azimuth_rad(&self.direction, attitude, 0.0))
            }
            _ => azimuth,
        };
        (attitude, yaw_rad)
    }

    /// Returns the pose of the oldest waiting fix that has all readings now, or why it never will; none where no fix
    /// is ready.
    pub(crate) fn next(&mut self, now_s: f64) -> Option<Result<Stamped<Pose>, FixError>> {
        let oldest = *self.waiting.front()?;
        let ready = (0..self.waiting.len()).find_map(|index| {
            let (attitude, yaw_rad) = self.readings_at(self.waiting[index].time_s);
            Some((index, attitude?, yaw_rad?))
        });
        let Some((index, attitude, mut yaw_rad)) = ready else {
            let reading = match self.readings_at(oldest.time_s) {
                (None, _) => "attitude",
                _ => "heading",
            };
            return (now_s - oldest.time_s > WAIT_S).then(|| {
                self.waiting.pop_front();
                Err(FixError::Alone { reading })
            });
        };
        // Those before it would come too late.
        let fix = self.waiting.drain(..=index).next_back()?;
        if let Some(course) = &mut self.course {
            let standing = (yaw_rad, &attitude);
            let corrected_rad = course.antenna(&fix.antenna, standing, &fix.lever, fix.sigma_m);
            self.headings.change(|yaw_rad| *yaw_rad += corrected_rad);
            yaw_rad += corrected_rad;
            if !course.is_known() {
                return Some(Err(FixError::NoCourse {
                    metres: Course::NEEDED_M,
                }));
            }
        }
        let rotation: UnitQuaternion<f64> = ros_quaternion(&attitude, yaw_rad);
        let place = fix.antenna - rotation * fix.lever;
        let (pose, _) = pose_and_attitude(&Isometry3::from_parts(place.into(), rotation));
        Some(Ok(Stamped {
            time_s: fix.time_s,
            value: pose,
        }))
    }
}

/// Returns the larger standard deviation of east and north, m; where it is not known, that of the kind of fix, which for
/// RTK is within `rtk_m`.
fn sigma_m(fix: &NavSatFix, rtk_m: f64) -> f64 {
    told_sigma_m(fix).unwrap_or(match fix.status.status {
        STATUS_GBAS => rtk_m,
        _ => UNCORRECTED_M,
    })
}

/// Returns the larger standard deviation of east and north, m, as the receiver tells it.
fn told_sigma_m(fix: &NavSatFix) -> Option<f64> {
    let [east, north] = [fix.position_covariance[0], fix.position_covariance[4]];
    (fix.position_covariance_type != 0).then(|| match (east + north).is_nan() {
        // `max` would leave it out.
        true => f64::NAN,
        false => east.max(north).sqrt(),
    })
}

#[cfg(test)]
mod tests;
