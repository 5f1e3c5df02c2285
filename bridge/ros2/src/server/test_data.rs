//! Decisions, estimates and statuses for the tests of the server.

use super::route::RouteSettings;
use sidehill_bridge::control_loop::LoopTiming;
use sidehill_bridge::control_loop::channel::LoopStatus;
use sidehill_bridge::control_loop::record::CycleRow;
use sidehill_bridge::drives::LinkState;
use sidehill_bridge::safety::SafetyState;
use sidehill_controller::controller::{Decision, Status};
use sidehill_controller::estimator::Estimate;
use sidehill_controller::path::Smoothing;
use sidehill_controller::speed_profile::SpeedLimits;
use sidehill_controller::tracked_point::TrackedPoint;
use sidehill_plant::frames::PlanarPose;
use sidehill_plant::speeds::MotorSpeeds;
use sidehill_plant::vehicle::Vehicle;
use std::sync::LazyLock;

/// An estimate on level ground.
pub(crate) fn estimate(time_s: f64, x_m: f64, yaw_rad: f64) -> Estimate {
    let pose = PlanarPose {
        x_m,
        y_m: 0.0,
        yaw_rad,
    };
    Estimate::standing(time_s, pose)
}

/// A decision of a controller that tracks reference 0.
pub(crate) fn decision(time_s: f64, x_m: f64, yaw_rad: f64) -> Decision {
    Decision {
        estimate: Some(estimate(time_s, x_m, yaw_rad)),
        ..Decision::of_command(time_s, MotorSpeeds::STOP, Status::Tracking)
    }
}

/// A control loop in a state of its safety.
pub(crate) fn loop_status(state: SafetyState) -> LoopStatus {
    LoopStatus {
        row: CycleRow {
            time_s: 1.0,
            lateness_s: 0.0,
            slack_s: 0.02,
            state,
            enable: true,
            traction_m_s: 0.5,
            steer_m_s: 0.0,
            sent: true,
            feedback_traction_m_s: 0.5,
            feedback_steer_m_s: 0.0,
            feedback_age_s: 0.01,
            bus: LinkState::Active,
            x_m: 0.0,
            y_m: 0.0,
            yaw_rad: 0.0,
            cross_track_m: None,
            arc_length_m: None,
            solve_us: f64::NAN,
            refused: 0,
            skipped: 0,
        },
        armed: 0,
        stopped_by: None,
        timing: LoopTiming {
            cycles: 20,
            skipped: 0,
            unsent: 0,
            lateness_p50_s: 0.0,
            lateness_p99_s: 0.001,
            lateness_max_s: 0.001,
            slack_min_s: 0.01,
        },
    }
}

/// Settings of a vehicle that drives 0.5 m/s at most.
pub(crate) fn route_settings() -> RouteSettings {
    RouteSettings {
        tracked_point: TrackedPoint::ORIGIN,
        smoothing: Smoothing::default(),
        limits: SpeedLimits {
            speed_max_m_s: 0.5,
            traction_max_m_s: 1.0,
            steer_max_m_s: 1.0,
            tread_max_m_s: 2.0,
            acceleration_m_s2: 1.0,
            deceleration_m_s2: 1.0,
            steer_acceleration_m_s2: 1.0,
            lateral_acceleration_m_s2: 1.0,
            track_width_m: 2.0,
        },
        use_orientations: false,
    }
}

/// The J8. Its file is read once: random runs ask for it at every distance.
pub(crate) fn j8() -> Vehicle {
    static J8: LazyLock<Vehicle> = LazyLock::new(|| {
        serde_yaml::from_str(include_str!("../../../../config/vehicles/j8.yaml")).unwrap()
    });
    J8.clone()
}
