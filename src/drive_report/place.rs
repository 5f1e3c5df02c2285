//! Where the vehicle was at a time.

use super::input::DecodedRecording;
use serde::Serialize;
use sidehill_controller::path::Point2;

/// A place, and when the vehicle was there.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct PlaceInTime {
    /// On the clock of the recording, s.
    pub(super) time_s: f64,
    /// Since the recording began, s.
    pub(super) after_s: f64,
    /// As estimated, m; none where there was no pose.
    pub(super) x_m: Option<f64>,
    pub(super) y_m: Option<f64>,
    /// Deg; none without a datum.
    pub(super) latitude_deg: Option<f64>,
    pub(super) longitude_deg: Option<f64>,
}

impl PlaceInTime {
    pub(super) fn at(input: &DecodedRecording, time_s: f64) -> Self {
        let step = input.step_at(time_s);
        let at = step.filter(|step| step.estimated_x_m.is_finite());
        let at = at.map(|step| Point2 {
            x_m: step.estimated_x_m,
            y_m: step.estimated_y_m,
        });
        let earth = at.zip(input.datum).map(|(at, datum)| datum.unproject(at));
        Self {
            time_s,
            after_s: time_s - input.range_s[0],
            x_m: at.map(|at| at.x_m),
            y_m: at.map(|at| at.y_m),
            latitude_deg: earth.map(|(latitude_deg, _)| latitude_deg),
            longitude_deg: earth.map(|(_, longitude_deg)| longitude_deg),
        }
    }
}
