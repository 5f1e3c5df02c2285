use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::{Bounds, RangeError};

/// When the controller gives up and stops the vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SupervisorConfig {
    /// Largest bound of the position across the path, kept with a probability of 95 %. Without poses it grows; the
    /// vehicle drives slower from half of it on, and stops at it.
    pub cross_track_uncertainty_max_m: f64,
    /// Largest age of the pose before the controller stops, however certain the position is. Poses that are refused
    /// count for 0.5 s.
    pub pose_timeout_s: f64,
    /// Oldest attitude that is still driven on, s.
    #[serde(skip)]
    pub attitude_timeout_s: f64,
    /// Oldest tread speeds that are still driven on, s.
    #[serde(skip)]
    pub speeds_timeout_s: f64,
    /// Largest distance from the path before the controller stops.
    pub cross_track_max_m: f64,
    /// Largest difference between heading and reference, rad.
    #[serde(skip)]
    pub heading_error_max_rad: f64,
    /// Time for which the vehicle may drive on the shifted previous plan, s.
    #[serde(skip)]
    pub fallback_s: f64,
    /// Time after which a vehicle is stopped that does not move as it should, s: steer or traction at
    /// its limit without turn or way, or no progress along the path.
    #[serde(skip)]
    pub stall_time_s: f64,
    /// Share of the motion that steer or traction at its limit should give, and of the way that the
    /// reference asks for, below which the vehicle does not move as it should. A way of 0.3 m is enough at any speed.
    #[serde(skip)]
    pub stall_share: f64,
}

impl Default for SupervisorConfig {
    fn default() -> Self {
        Self {
            cross_track_uncertainty_max_m: 0.25,
            pose_timeout_s: 12.0,
            attitude_timeout_s: 0.3,
            speeds_timeout_s: 0.3,
            cross_track_max_m: 2.0,
            heading_error_max_rad: 2.0,
            fallback_s: 0.5,
            stall_time_s: 4.5,
            stall_share: 0.1,
        }
    }
}

impl SupervisorConfig {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub(super) fn validate(&self) -> Result<(), RangeError> {
        Bounds::new(0.01, 60.0, "s").check("supervisor.pose_timeout_s", self.pose_timeout_s)?;
        Bounds::new(0.01, 100.0, "m")
            .check("supervisor.cross_track_max_m", self.cross_track_max_m)?;
        Bounds::new(0.01, 10.0, "m").check(
            "supervisor.cross_track_uncertainty_max_m",
            self.cross_track_uncertainty_max_m,
        )?;
        Ok(())
    }
}
