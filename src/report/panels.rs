//! The plots over time and along the path: what each shows, and its limits.

use super::chart::Panel;
use super::scene::Scene;
use crate::record::{Row, Run};
use sidehill_controller::guard::GuardConfig;
use sidehill_controller::mpc::limits::InputLimits;

/// Steer speed below which a vehicle counts as going straight.
const TURNING_M_S: f64 = 0.005;

pub(super) fn cross_track_panels(runs: &[Run]) -> Vec<Panel<'static>> {
    let centimetres = &|row: &Row| 100.0 * row.cross_track_m;
    let panel = |title, magnified_to| Panel {
        title,
        limits: vec![(0.0, "on the path".to_owned())],
        magnified_to,
        logarithmic: false,
        value: centimetres,
    };
    let largest = runs.iter().map(|run| run.summary.cross_track_max_m);
    let largest: Vec<f64> = largest.filter(|m| m.is_finite() && *m > 0.0).collect();
    let best = largest.iter().copied().fold(f64::INFINITY, f64::min);
    let worst = largest.iter().copied().fold(0.0, f64::max);
    let mut panels = vec![panel("cross-track (cm)", None)];
    if worst > 100.0 * best {
        panels.push(Panel {
            title: "distance (cm), logarithmic",
            limits: Vec::new(),
            magnified_to: None,
            logarithmic: true,
            value: &|row| {
                Some(100.0 * row.cross_track_m.abs())
                    .filter(|cm| *cm > 1e-3)
                    .unwrap_or(f64::NAN)
            },
        });
    } else if worst > 5.0 * best {
        panels.push(panel("magnified (cm)", Some(200.0 * best)));
    }
    panels
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
            magnified_to: None,
            logarithmic: false,
            value: &|row| row.command.traction_m_s,
        },
        Panel {
            title: "steer \u{3c3} (m/s)",
            limits: both(limits.steer.speed_m_s),
            magnified_to: None,
            logarithmic: false,
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
            magnified_to: None,
            logarithmic: false,
            value: &|row| row.slope.map_or(f64::NAN, |slope| slope.margins.rollover),
        },
        Panel {
            title: "use of friction",
            limits: limits(guard.friction_use_slow, guard.friction_use_max),
            magnified_to: None,
            logarithmic: false,
            value: &|row| {
                row.slope
                    .map_or(f64::NAN, |slope| slope.margins.friction_use)
            },
        },
        Panel {
            title: "share of speed",
            limits: vec![(1.0, "full speed".to_owned())],
            magnified_to: None,
            logarithmic: false,
            value: &|row| row.slope.map_or(f64::NAN, |slope| slope.speed_share),
        },
    ]
}

pub(super) fn attitude_panels() -> [Panel<'static>; 2] {
    let panel = |title, value| Panel {
        title,
        limits: vec![(0.0, "level".to_owned())],
        magnified_to: None,
        logarithmic: false,
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
    let (half_width_m, half_length_m) = (scene.base_half_width_m, scene.base_half_length_m);
    let edge =
        |value: f64, name: &str| (value, format!("{name} {value} m").replace('-', "\u{2212}"));
    [
        Panel {
            title: "right, x_r (m)",
            limits: vec![edge(half_width_m, "right edge")],
            magnified_to: None,
            logarithmic: false,
            value: &|row| while_turning(row, row.icrs.right_m),
        },
        Panel {
            title: "left, x_l (m)",
            limits: vec![edge(-half_width_m, "left edge")],
            magnified_to: None,
            logarithmic: false,
            value: &|row| while_turning(row, row.icrs.left_m),
        },
        Panel {
            title: "ahead, y (m)",
            limits: vec![edge(half_length_m, "front"), edge(-half_length_m, "rear")],
            magnified_to: None,
            logarithmic: false,
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
