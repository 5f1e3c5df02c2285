use super::Point2;
use sidehill_plant::bounds::RangeError;

fn rounded(value: f64) -> f64 {
    (1e3 * value).round() / 1e3
}

/// Returns which settings would do, rounded up.
fn remedies(deviation_m: Option<f64>, curvature_per_m: Option<f64>) -> String {
    let up = |value: f64| (100.0 * value).ceil() / 100.0;
    let within = |value: f64, limit: f64| (value <= limit).then_some(value);
    let deviation = deviation_m
        .and_then(|m| within(up(m), 100.0))
        .map(|m| format!("max_deviation_m: {m}"));
    let curvature = curvature_per_m
        .and_then(|per_m| within(up(per_m), 10.0))
        .map(|per_m| format!("max_curvature_per_m: {per_m}"));
    match (deviation, curvature) {
        (Some(deviation), Some(curvature)) => format!("{deviation} would do, or {curvature}"),
        (Some(one), None) | (None, Some(one)) => format!("{one} would do"),
        (None, None) => "move or remove points there".to_owned(),
    }
}

/// Why a path, or a trajectory along it, cannot be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PathError {
    /// The path has no points.
    #[error("the path has no points")]
    Empty,
    /// There is only one point.
    #[error("the path has a single point")]
    SinglePoint,
    /// All points are in the same place.
    #[error("the path has no length: all its points are in the same place")]
    ZeroLength,
    /// The points are so far apart that one of them must be wrong.
    #[error("the path is {length_m:.0} m long, at most {limit_m:.0} m are allowed")]
    TooLong {
        /// Length of the polyline, m.
        length_m: f64,
        /// Largest length allowed, m.
        limit_m: f64,
    },
    /// A coordinate is NaN, infinite or larger than the earth.
    #[error("point {index} of the path must be finite and within 1e8 m of the origin: x = {x_m:?} m, y = {y_m:?} m", x_m = position.x_m, y_m = position.y_m)]
    NotFinite {
        /// Index of the point, from 0.
        index: usize,
        /// The point.
        position: Point2,
    },
    /// Travel turns back on the spot although the direction of driving does not change.
    #[error(
        "the path turns back on the spot at point {index} (x = {x_m:.3} m, y = {y_m:.3} m) without a change of direction; mark the points after it as driven the other way, or give the path room to turn",
        x_m = position.x_m, y_m = position.y_m
    )]
    TurnsBack {
        /// Index of the nearest given point, from 0.
        index: usize,
        /// Where.
        position: Point2,
    },
    /// The direction of driving changes where travel does not turn back.
    #[error(
        "the direction of driving changes at point {index} (x = {x_m:.3} m, y = {y_m:.3} m), but travel does not turn back there; mark the point at which it does",
        x_m = position.x_m, y_m = position.y_m
    )]
    NoCusp {
        /// Index of the point, from 0.
        index: usize,
        /// The point.
        position: Point2,
    },
    /// A curve stands still, turns back or has a gap.
    #[error(
        "the path has a gap, a standstill or a fold at x = {x_m:.3} m, y = {y_m:.3} m",
        x_m = position.x_m, y_m = position.y_m
    )]
    NotRegular {
        /// Where.
        position: Point2,
    },
    /// No curve within the allowed deviation meets the curvature bound.
    #[error(
        "the path is too sharp at point {index} (x = {x_m:.3} m, y = {y_m:.3} m): curvature {curvature_per_m:.3} 1/m is left within smoothing.max_deviation_m = {} m, more than smoothing.max_curvature_per_m = {limit_per_m:.3} 1/m; {}",
        rounded(*deviation_m), remedies(*deviation_needed_m, *curvature_needed_per_m), x_m = position.x_m, y_m = position.y_m
    )]
    TooSharp {
        /// Index of the nearest given point, from 0.
        index: usize,
        /// Where.
        position: Point2,
        /// Magnitude of the curvature that is left, 1/m.
        curvature_per_m: f64,
        /// Largest curvature allowed, 1/m.
        limit_per_m: f64,
        /// Largest deviation allowed, m.
        deviation_m: f64,
        /// Deviation within which the curvature can be met, m, if one was found.
        deviation_needed_m: Option<f64>,
        /// Largest curvature with which the deviation can be met, 1/m, if one was found.
        curvature_needed_per_m: Option<f64>,
    },
    /// A point is far from the path that its neighbours make.
    #[error(
        "point {index} (x = {x_m:.3} m, y = {y_m:.3} m) is {distance_m:.2} m from the smooth path, more than smoothing.max_deviation_m = {} m; {}",
        rounded(*deviation_m), remedies(*deviation_needed_m, None), x_m = position.x_m, y_m = position.y_m
    )]
    TooFar {
        /// Index of the point, from 0.
        index: usize,
        /// The point.
        position: Point2,
        /// Its distance from the path, m.
        distance_m: f64,
        /// Largest distance allowed, m.
        deviation_m: f64,
        /// Deviation that would do, m, if one was found.
        deviation_needed_m: Option<f64>,
    },
    /// A CSV text is not a table of points.
    #[error("line {line} of the CSV: {what}")]
    Csv {
        /// Line, from 1.
        line: u64,
        /// What is wrong there.
        what: String,
    },
    /// A GPX text is not well-formed or lacks something.
    #[error("line {line} of the GPX: {what}")]
    Gpx {
        /// Line, from 1.
        line: u32,
        /// What is wrong there.
        what: String,
    },
    /// The reader failed.
    #[error("the route could not be read: {0}")]
    Read(String),
    /// A parameter is out of range.
    #[error(transparent)]
    Range(#[from] RangeError),
}

impl PathError {
    /// Returns the index of the given point at which a path bends too much.
    pub(super) fn sharp_at(&self) -> Option<usize> {
        match self {
            Self::TooSharp { index, .. }
            | Self::TurnsBack { index, .. }
            | Self::TooFar { index, .. } => Some(*index),
            _ => None,
        }
    }
}
