//! What the horizon of a cycle is asked for.

use crate::config::{AttitudePreview, ControllerConfig};
use crate::estimator::Estimate;
use crate::mpc::{Horizon, StageTarget};
use crate::reference::Reference;
use sidehill_plant::speeds::MotorSpeeds;
use sidehill_plant::terrain::Terrain;
use sidehill_plant::vehicle::Vehicle;

/// Fills `targets` with the reference over the horizon, which begins when a command given now acts.
pub(super) fn preview(
    config: &ControllerConfig,
    horizon: &Horizon,
    vehicle: &Vehicle,
    reference: &Reference,
    terrain: Option<&Terrain>,
    estimate: &Estimate,
    caution: f64,
    targets: &mut Vec<StageTarget>,
) {
    let half_track_m = 0.5 * (vehicle.icrs.right_m - vehicle.icrs.left_m);
    let map = terrain.filter(|_| config.attitude_preview == AttitudePreview::Terrain);
    targets.clear();
    for end_s in horizon.ends_s() {
        let point = reference.ahead(config.delay_s() + end_s);
        // Beyond the map's edge the plane the vehicle stands on is the best guess there is.
        let normal_in_world = map
            .and_then(|map| map.surface(point.position.x_m, point.position.y_m).ok())
            .map_or(estimate.normal_in_world, |surface| surface.normal_in_world);
        targets.push(StageTarget {
            pose: point.pose(),
            along_heading_rad: point.heading_rad,
            normal_in_world,
            feedforward: MotorSpeeds {
                traction_m_s: point.speed_m_s,
                steer_m_s: half_track_m * point.yaw_rate_rad_s,
            },
            weights: config.stage_weights(point.motion, caution),
        });
    }
}
