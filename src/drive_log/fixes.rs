//! Positions from the fixes of a satellite receiver.

use super::interpolation::{Timed, at};
use anyhow::{Result, bail};
use nalgebra::{UnitQuaternion, Vector3};
use sidehill_bridge::ros2::message::NavSatFix;
use sidehill_controller::path::GeodeticOrigin;
use sidehill_plant::frames::{Pose, paper_attitude};

/// A fix with a position.
#[derive(Debug, Clone, Copy)]
struct Fix {
    latitude_deg: f64,
    longitude_deg: f64,
    altitude_m: f64,
}

/// Fixes of a topic, in the order of its messages.
#[derive(Default)]
pub(super) struct Fixes {
    fixes: Timed<Fix>,
    without_position: usize,
}

impl Fix {
    /// Returns the position for a route: on the ellipsoid, with heights relative to the first one.
    fn position(&self, origin: &GeodeticOrigin) -> Option<[f64; 3]> {
        let at = origin.project(self.latitude_deg, self.longitude_deg);
        Some([at.x_m, at.y_m, self.altitude_m - origin.elevation_m])
    }
}

impl Fixes {
    /// Takes a message; `time_ns` matters only if it has a position.
    ///
    /// # Errors
    /// The error of `time_ns`, or a position that does not exist on earth.
    pub(super) fn take(&mut self, time_ns: Result<i64>, fix: &NavSatFix) -> Result<()> {
        let fix_is_whole = [fix.latitude, fix.longitude, fix.altitude]
            .iter()
            .all(|value| value.is_finite());
        if fix.status.status < 0 || !fix_is_whole {
            self.without_position += 1;
            return Ok(());
        }
        if fix.latitude.abs() > 90.0 || fix.longitude.abs() > 180.0 {
            bail!(
                "latitude {} and longitude {} are out of range",
                fix.latitude,
                fix.longitude
            );
        }
        let time_ns = time_ns?;
        let fix = Fix {
            latitude_deg: fix.latitude,
            longitude_deg: fix.longitude,
            altitude_m: fix.altitude,
        };
        self.fixes.push((time_ns, fix));
        Ok(())
    }

    /// Returns the number of fixes with a position.
    pub(super) fn len(&self) -> usize {
        self.fixes.len()
    }

    /// Returns the place of the first fix, the origin of the world.
    pub(super) fn origin(&self) -> Option<GeodeticOrigin> {
        let (_, first) = self.fixes.first()?;
        Some(GeodeticOrigin {
            latitude_deg: first.latitude_deg,
            longitude_deg: first.longitude_deg,
            elevation_m: first.altitude_m,
        })
    }

    /// Returns a note with the number of fixes left out.
    pub(super) fn note(&self) -> Option<String> {
        let without = self.without_position;
        (without > 0).then(|| format!("{without} fixes without a position are left out"))
    }

    /// Returns poses of the vehicle's origin at fixes during which its orientation is known.
    pub(super) fn poses(
        &self,
        rotations: &[(i64, UnitQuaternion<f64>)],
        antenna_m: &[f64; 3],
    ) -> Timed<Pose> {
        let Some(origin) = self.origin() else {
            return Vec::new();
        };
        let pose = |(time_ns, fix): &(i64, Fix)| {
            let rotation = at(rotations, *time_ns, |a, b, share| a.slerp(b, share))?;
            let lever = rotation * Vector3::from(*antenna_m);
            let [x_m, y_m, z_m] = fix.position(&origin)?;
            let (_, yaw_rad) = paper_attitude(&rotation);
            let pose = Pose {
                x_m: x_m - lever.x,
                y_m: y_m - lever.y,
                z_m: z_m - lever.z,
                yaw_rad,
            };
            Some((*time_ns, pose))
        };
        self.fixes.iter().filter_map(pose).collect()
    }

    /// Returns east, north and height of every fix from the origin, m.
    pub(super) fn positions_m(&self) -> Vec<[f64; 3]> {
        let origin = self.origin();
        let point = |(_, fix): &(i64, Fix)| fix.position(&origin?);
        self.fixes.iter().filter_map(point).collect()
    }
}
