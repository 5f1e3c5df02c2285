//! The true states of the virtual vehicle.

use sidehill_controller::course::FigureEight;
use sidehill_controller::path::{Point2, Window};

/// A row of the virtual vehicle's truth.
#[derive(Debug, Clone, serde::Deserialize)]
pub struct Truth {
    pub unix_s: f64,
    pub x_m: f64,
    pub y_m: f64,
    pub traction_m_s: f64,
    pub steer_m_s: f64,
    pub mode: String,
}

impl Truth {
    /// Whether nothing moves and the drives are off.
    pub fn off(&self) -> bool {
        self.mode != "Enabled" && self.traction_m_s == 0.0 && self.steer_m_s == 0.0
    }
}

/// Root mean square of the distance from the figure of eight, 2 s after the first movement until the
/// drives go off.
pub fn cross_track_rms_m(truth: &[Truth], rows_min: usize) -> f64 {
    let trajectory = FigureEight::default().trajectory().unwrap();
    let path = trajectory.path().unwrap();
    let mut reached_m = 0.0;
    let moving: Vec<&Truth> = truth
        .iter()
        .skip_while(|row| row.traction_m_s == 0.0)
        .take_while(|row| row.mode == "Enabled")
        .collect();
    let squares: Vec<f64> = moving
        .iter()
        .map(|row| {
            let position = Point2 {
                x_m: row.x_m,
                y_m: row.y_m,
            };
            let found = path.nearest_within(
                &position,
                reached_m,
                &Window {
                    behind_m: 1.0,
                    ahead_m: 1.0,
                },
            );
            reached_m = found.point.arc_length_m;
            found.cross_track_m * found.cross_track_m
        })
        .skip(40)
        .collect();
    assert!(squares.len() > rows_min, "{} rows", squares.len());
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

/// Time from `unix_s` to the first row of the truth from which on the drives are off and stand, s.
pub fn standing_after_s(truth: &[Truth], unix_s: f64) -> Option<f64> {
    let last_on = truth.iter().rposition(|row| !row.off());
    let first_off = last_on.map_or(0, |last| last + 1);
    truth.get(first_off).map(|row| row.unix_s - unix_s)
}
