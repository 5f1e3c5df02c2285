use super::*;
use proptest::prelude::*;
use rand_free::Noise;
use sidehill_bridge::ros2::message::NavSatStatus;
use sidehill_controller::path::Point2;
use sidehill_plant::frames::{BodyVelocity, pose_rate};
use std::f64::consts::{FRAC_PI_2, PI};

const DATUM: GeodeticOrigin = GeodeticOrigin {
    latitude_deg: 36.717,
    longitude_deg: -4.489,
    elevation_m: 60.0,
};
const SETTINGS: FixSettings = FixSettings {
    datum: DATUM,
    sigma_max_m: 0.03,
    heading_sigma_max_rad: 0.03,
};

/// A sequence without a pattern that tests can repeat.
mod rand_free {
    pub(super) struct Noise(pub u64);

    impl Noise {
        /// Returns a number of standard deviation 1: the sum of twelve uniform ones.
        pub(super) fn next(&mut self) -> f64 {
            let uniform = |seed: &mut u64| {
                *seed = seed
                    .wrapping_mul(6364136223846793005)
                    .wrapping_add(1442695040888963407);
                (*seed >> 11) as f64 / (1u64 << 53) as f64
            };
            (0..12).map(|_| uniform(&mut self.0)).sum::<f64>() - 6.0
        }
    }
}

fn fix_at(place: &Vector3<f64>, sigma_m: f64) -> NavSatFix {
    let (latitude, longitude) = DATUM.unproject(Point2 {
        x_m: place.x,
        y_m: place.y,
    });
    let mut fix = NavSatFix {
        status: NavSatStatus {
            status: STATUS_GBAS,
            service: 1,
        },
        latitude,
        longitude,
        altitude: place.z + DATUM.elevation_m,
        position_covariance_type: 2,
        ..NavSatFix::default()
    };
    fix.position_covariance[0] = sigma_m.powi(2);
    fix.position_covariance[4] = sigma_m.powi(2);
    fix
}

/// Places a point of the vehicle (forward, left, up) in the world by the design's own words: forward is (-sin psi, cos
/// psi) on level ground, a positive pitch lifts the nose, a positive roll lowers the right side.
fn antenna(pose: &Pose, attitude: &Attitude, lever: &Vector3<f64>) -> Vector3<f64> {
    let (sin, cos) = pose.yaw_rad.sin_cos();
    let (s_roll, c_roll) = attitude.roll_rad.sin_cos();
    let (s_pitch, c_pitch) = attitude.pitch_rad.sin_cos();
    // R = Rz Ry Rx of (right, forward, up).
    let (right, forward, up) = (-lever.y, lever.x, lever.z);
    let (forward, up) = (
        c_pitch * forward - s_pitch * up,
        s_pitch * forward + c_pitch * up,
    );
    let (right, up) = (c_roll * right + s_roll * up, -s_roll * right + c_roll * up);
    Vector3::new(
        pose.x_m + cos * right - sin * forward,
        pose.y_m + sin * right + cos * forward,
        pose.z_m + up,
    )
}

proptest! {
    #[test]
    fn the_lever_arm_turns_with_heading_roll_and_pitch(
        x_m in -500.0..500.0f64, y_m in -500.0..500.0f64, z_m in -20.0..20.0f64, yaw_rad in -3.1..3.1f64,
        roll_rad in -0.5..0.5f64, pitch_rad in -0.5..0.5f64,
        forward in -1.0..1.0f64, left in -1.0..1.0f64, up in 0.0..2.0f64, turned_rad in -3.1..3.1f64,
    ) {
        let pose = Pose { x_m, y_m, z_m, yaw_rad };
        let attitude = Attitude { roll_rad, pitch_rad };
        let lever = Vector3::new(forward, left, up);
        let mut poses = FixPoses::new(SETTINGS, false);
        poses.attitude(1.0, attitude);
        // A second antenna 1 m from the first in some direction of the vehicle.
        let direction = Vector3::new(turned_rad.cos(), turned_rad.sin(), 0.0);
        let baseline = antenna(&pose, &attitude, &(lever + direction)) - antenna(&pose, &attitude, &lever);
        poses.heading(1.0, (-baseline.x).atan2(baseline.y), direction);
        poses.fix(1.0, &fix_at(&antenna(&pose, &attitude, &lever), 0.01), lever).unwrap();
        let found = poses.next(1.0).unwrap().unwrap();
        prop_assert_eq!(found.time_s, 1.0);
        let found = found.value;
        // The plane and the ellipsoid differ by 1e-6 at this distance.
        prop_assert!((found.x_m - x_m).hypot(found.y_m - y_m) < 1e-3 && (found.z_m - z_m).abs() < 1e-3);
        prop_assert!(wrap_angle(found.yaw_rad - yaw_rad).abs() < 1e-9);
    }
}

#[test]
fn a_bad_fix_is_refused_with_its_reason() {
    let good = fix_at(&Vector3::new(3.0, 4.0, 1.0), 0.014);
    let with = |change: &dyn Fn(&mut NavSatFix)| {
        let mut fix = good.clone();
        change(&mut fix);
        FixPoses::new(SETTINGS, false)
            .fix(1.0, &fix, Vector3::zeros())
            .map_err(|error| error.to_string())
    };
    assert_eq!(with(&|_| {}), Ok(()));
    // Without an altitude the place on the ground is as good.
    assert_eq!(with(&|fix| fix.altitude = f64::NAN), Ok(()));
    // RTK of a driver that states no covariance.
    assert_eq!(with(&|fix| fix.position_covariance_type = 0), Ok(()));
    type Change = dyn Fn(&mut NavSatFix);
    let cases: [(&Change, &str); 10] = [
        (&|fix| fix.status.status = -1, "no fix: its status is -1"),
        (
            &|fix| (fix.latitude, fix.longitude) = (0.0, 0.0),
            "no fix: latitude 0 and",
        ),
        (&|fix| fix.latitude = f64::NAN, "no fix: latitude NaN"),
        (&|fix| fix.longitude = f64::INFINITY, "longitude inf"),
        (&|fix| fix.latitude = 91.0, "latitude 91"),
        (
            &|fix| std::mem::swap(&mut fix.latitude, &mut fix.longitude),
            "km from the datum",
        ),
        (&|fix| fix.latitude = -fix.latitude, "km from the datum"),
        (
            &|fix| fix.position_covariance[4] = 0.09,
            "standard deviation is 0.300 m",
        ),
        (
            &|fix| fix.position_covariance[0] = f64::NAN,
            "standard deviation is NaN",
        ),
        (
            &|fix| {
                fix.position_covariance_type = 0;
                fix.status.status = 0;
            },
            "standard deviation is 2.500 m",
        ),
    ];
    for (change, reason) in cases {
        let error = with(change).unwrap_err();
        assert!(error.contains(reason), "{error}");
    }
}

#[test]
fn a_fix_waits_for_the_heading_of_its_instant() {
    let mut poses = FixPoses::new(SETTINGS, false);
    let fix = fix_at(&Vector3::zeros(), 0.01);
    poses.attitude(1.0, Attitude::LEVEL);
    poses.heading(0.9, PI - 0.1, Vector3::x());
    poses.fix(1.0, &fix, Vector3::zeros()).unwrap();
    assert!(poses.next(1.1).is_none());
    // Halfway between two headings either side of pi.
    poses.heading(1.1, -PI + 0.1, Vector3::x());
    let found = poses.next(1.1).unwrap().unwrap();
    assert!(wrap_angle(found.value.yaw_rad - PI).abs() < 1e-9);
    assert!(poses.next(1.1).is_none());
    // No heading comes any more, then no attitude.
    poses.attitude(2.0, Attitude::LEVEL);
    poses.fix(2.0, &fix, Vector3::zeros()).unwrap();
    assert!(poses.next(2.2).is_none());
    let error = poses.next(2.31).unwrap().unwrap_err();
    assert_eq!(error, FixError::Alone { reading: "heading" });
    poses.heading(3.0, 0.0, Vector3::x());
    poses.fix(3.0, &fix, Vector3::zeros()).unwrap();
    let error = poses.next(3.31).unwrap().unwrap_err();
    assert_eq!(
        error,
        FixError::Alone {
            reading: "attitude"
        }
    );
}

/// A vehicle on a slope that moves by its own small simulation, with a gyroscope that has a bias.
struct Drive {
    poses: FixPoses,
    pose: Pose,
    lever: Vector3<f64>,
    bias_rad_s: f64,
    noise_m: f64,
    noise: Noise,
    step: u32,
    /// Errors of the headings found, rad, and why there was none.
    found: Vec<Result<f64, FixError>>,
}

impl Drive {
    fn new(yaw_rad: f64, noise_m: f64) -> Self {
        Self {
            poses: FixPoses::new(SETTINGS, true),
            pose: Pose {
                yaw_rad,
                ..Pose::default()
            },
            lever: Vector3::new(0.4, -0.2, 1.0),
            bias_rad_s: 0.01,
            noise_m,
            noise: Noise(7),
            step: 0,
            found: Vec::new(),
        }
    }

    /// Drives for a time at 100 Hz, with fixes at 5 Hz that come a reading late.
    fn drive(&mut self, seconds: f64, speed_m_s: f64, yaw_rate_rad_s: f64) {
        // A plane of 15 deg.
        let normal = Vector3::new(15f64.to_radians().sin(), 0.0, 15f64.to_radians().cos());
        for _ in 0..(100.0 * seconds).round() as u32 {
            self.step += 1;
            let time_s = 0.01 * f64::from(self.step);
            let attitude = Attitude::on_plane(&normal, self.pose.yaw_rad);
            let turning = BodyVelocity {
                right_m_s: 0.0,
                forward_m_s: speed_m_s,
                yaw_rate_rad_s,
            };
            let rate = pose_rate(&turning, &attitude, self.pose.yaw_rad);
            self.pose.x_m += 0.01 * rate.x_m_s;
            self.pose.y_m += 0.01 * rate.y_m_s;
            self.pose.z_m += 0.01 * rate.z_m_s;
            self.pose.yaw_rad += 0.01 * rate.yaw_rad_s;
            let attitude = Attitude::on_plane(&normal, self.pose.yaw_rad);
            if self.step.is_multiple_of(20) {
                let mut place = antenna(&self.pose, &attitude, &self.lever);
                place.x += self.noise_m * self.noise.next();
                place.y += self.noise_m * self.noise.next();
                let fix = fix_at(&place, self.noise_m.max(0.005));
                self.poses.fix(time_s, &fix, self.lever).unwrap();
            }
            self.poses.attitude(time_s, attitude);
            self.poses
                .yaw_rate(time_s, yaw_rate_rad_s + self.bias_rad_s);
            self.poses.speeds(time_s, speed_m_s, 0.3 * yaw_rate_rad_s);
            while let Some(next) = self.poses.next(time_s) {
                let off =
                    |found: Stamped<Pose>| wrap_angle(found.value.yaw_rad - self.pose.yaw_rad);
                self.found.push(next.map(off));
            }
        }
    }

    fn last(&self) -> Result<f64, FixError> {
        self.found.last().unwrap().clone()
    }
}

#[test]
fn the_first_metres_straight_show_the_heading_and_standing_shows_none() {
    for (yaw_rad, speed_m_s) in [(0.7, 0.6_f64), (-2.0, 0.6), (3.0, -0.5), (1.6, -0.4)] {
        let mut drive = Drive::new(yaw_rad, 0.01);
        drive.drive(3.0, 0.0, 0.0);
        let needed = FixError::NoCourse {
            metres: HeadingFromMotion::NEEDED_M,
        };
        assert!(
            drive
                .found
                .iter()
                .all(|found| *found == Err(needed.clone()))
        );
        drive.drive(1.0 / speed_m_s.abs(), speed_m_s, 0.0);
        assert_eq!(drive.last(), Err(needed), "{yaw_rad} {speed_m_s}");
        drive.drive(1.5 / speed_m_s.abs(), speed_m_s, 0.0);
        assert!(
            drive.last().unwrap().abs() < 0.04,
            "{yaw_rad} {speed_m_s}: {:?}",
            drive.last()
        );
        // It is held where the vehicle stands, whatever the bias.
        drive.drive(20.0, 0.0, 0.0);
        assert!(drive.last().unwrap().abs() < 0.04, "{:?}", drive.last());
    }
}

#[test]
fn bends_and_turns_on_the_spot_are_those_of_the_gyroscope() {
    let mut drive = Drive::new(0.7, 0.01);
    drive.drive(2.0, 0.0, 0.0);
    drive.drive(8.0, 0.6, 0.0);
    let errors = |drive: &Drive, since: usize| {
        let found = drive.found[since..].iter();
        found
            .map(|found| found.clone().map_or(f64::INFINITY, f64::abs))
            .fold(0.0, f64::max)
    };
    let since = drive.found.len();
    for (seconds, speed_m_s, yaw_rate_rad_s) in [
        (PI / 0.3, 0.4, 0.3),
        (6.0, 0.6, 0.0),
        (FRAC_PI_2 / 0.4, 0.0, -0.4),
        (5.0, -0.5, 0.05),
        (10.0, 0.0, 0.0),
        (6.0, 0.6, 0.0),
    ] {
        drive.drive(seconds, speed_m_s, yaw_rate_rad_s);
    }
    assert!(errors(&drive, since) < 0.1, "{}", errors(&drive, since));
    assert!(drive.last().unwrap().abs() < 0.03, "{:?}", drive.last());
}

#[test]
fn a_vehicle_that_was_turned_by_hand_finds_its_heading_again() {
    let mut drive = Drive::new(0.7, 0.01);
    drive.drive(2.0, 0.0, 0.0);
    drive.drive(5.0, 0.6, 0.0);
    drive.pose.yaw_rad += 2.0;
    drive.drive(8.0, 0.6, 0.0);
    assert!(drive.last().unwrap().abs() < 0.05, "{:?}", drive.last());
}

#[test]
fn treads_that_slip_and_noise_show_no_heading() {
    // The treads turn, the vehicle stands.
    let mut drive = Drive::new(0.7, 0.01);
    drive.drive(2.0, 0.0, 0.0);
    let stuck = drive.pose;
    for _ in 0..100 {
        drive.drive(0.1, 0.6, 0.0);
        drive.pose = stuck;
    }
    assert!(drive.last().is_err(), "{:?}", drive.last());
    // Fixes that err by as much as the vehicle drives.
    let mut drive = Drive::new(0.7, 0.5);
    drive.poses.settings.sigma_max_m = 2.0;
    drive.drive(2.0, 0.0, 0.0);
    drive.drive(5.0, 0.6, 0.0);
    assert!(drive.last().is_err(), "{:?}", drive.last());
}
