//! The plots over time and along the path: what each shows, and its limits.

use super::chart::Panel;
use super::scene::Scene;
use crate::record::Row;
use sidehill_controller::guard::GuardConfig;
use sidehill_controller::mpc::limits::InputLimits;

/// Steer speed below which a vehicle counts as going straight.
const TURNING_M_S: f64 = 0.005;

pub(super) fn cross_track_panel() -> Panel<'static> {
    Panel {
        title: "cross-track (cm)",
        limits: vec![(0.0, "on the path".to_owned())],
        value: &|row| 100.0 * row.cross_track_m,
    }
}

pub(super) fn command_panels(limits: &InputLimits) -> [Panel<'static>; 2] {
    let both = |speed_m_s: f64| {
        [("", 1.0), ("\u{2212}", -1.0)]
            .map(|(sign, side)| (side * speed_m_s, format!("limit {sign}{speed_m_s} m/s")))
            .into()
    };
    [
        Panel {
            title: "traction \u{3c4} (m/s)",
            limits: both(limits.traction.speed_m_s),
            value: &|row| row.command.traction_m_s,
        },
        Panel {
            title: "steer \u{3c3} (m/s)",
            limits: both(limits.steer.speed_m_s),
            value: &|row| row.command.steer_m_s,
        },
    ]
}

pub(super) fn margin_panels(guard: &GuardConfig) -> [Panel<'static>; 3] {
    let limits = |slow: f64, stop: f64| {
        vec![
            (slow, format!("slower {slow}")),
            (stop, format!("stop {stop}")),
        ]
    };
    [
        Panel {
            title: "tip-over margin",
            limits: limits(guard.rollover_margin_slow(), guard.rollover_margin_min),
            value: &|row| row.slope.map_or(f64::NAN, |slope| slope.margins.rollover),
        },
        Panel {
            title: "use of friction",
            limits: limits(guard.friction_use_slow, guard.friction_use_max),
            value: &|row| {
                row.slope
                    .map_or(f64::NAN, |slope| slope.margins.friction_use)
            },
        },
        Panel {
            title: "share of speed",
            limits: vec![(1.0, "full speed".to_owned())],
            value: &|row| row.slope.map_or(f64::NAN, |slope| slope.speed_share),
        },
    ]
}

pub(super) fn attitude_panels() -> [Panel<'static>; 2] {
    let panel = |title, value| Panel {
        title,
        limits: vec![(0.0, "level".to_owned())],
        value,
    };
    [
        panel("roll (\u{b0})", &|row: &Row| {
            row.attitude.roll_rad.to_degrees()
        }),
        panel("pitch (\u{b0})", &|row: &Row| {
            row.attitude.pitch_rad.to_degrees()
        }),
    ]
}

pub(super) fn icr_panels(scene: &Scene) -> [Panel<'static>; 3] {
    let vehicle = scene.vehicle;
    let (half_width_m, half_length_m) = (vehicle.base_half_width_m, vehicle.base_half_length_m);
    let edge =
        |value: f64, name: &str| (value, format!("{name} {value} m").replace('-', "\u{2212}"));
    [
        Panel {
            title: "right, x_r (m)",
            limits: vec![edge(half_width_m, "right edge")],
            value: &|row| while_turning(row, row.icrs.right_m),
        },
        Panel {
            title: "left, x_l (m)",
            limits: vec![edge(-half_width_m, "left edge")],
            value: &|row| while_turning(row, row.icrs.left_m),
        },
        Panel {
            title: "ahead, y (m)",
            limits: vec![edge(half_length_m, "front"), edge(-half_length_m, "rear")],
            value: &|row| while_turning(row, row.icrs.forward_m),
        },
    ]
}

/// Returns a coordinate of an ICR while the vehicle turns, else a gap: on a straight the ICRs depend on the sign of a
/// turn rate near zero.
fn while_turning(row: &Row, icr_m: f64) -> f64 {
    if row.motors.steer_m_s.abs() > TURNING_M_S {
        icr_m
    } else {
        f64::NAN
    }
}
