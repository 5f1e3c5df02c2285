//! Pieces of logs over which a model is judged.

use crate::bounds::{Bounds, RangeError};
use crate::frames::wrap_angle;
use crate::log::{DriveLog, GAP_MAX_S, LogRow};
use crate::odometry::KinematicModel;
use crate::vehicle::Vehicle;

/// How logs are cut.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segmentation {
    /// Length of a segment, s; a segment ends with the first pose at which it is at least as long.
    pub length_s: f64,
    /// A segment whose treads are all slower than this, m/s, stands still and is left out.
    pub standstill_m_s: f64,
    /// Rows further apart than this, s, are not connected.
    pub gap_max_s: f64,
}

impl Segmentation {
    /// Returns a cutting into segments of `length_s`, s, leaving out what is slower than 2 cm/s and
    /// gaps of more than half a second.
    ///
    /// # Errors
    /// Says so when the length is not from 0.1 to 1000 s.
    pub fn of_length(length_s: f64) -> Result<Self, RangeError> {
        Ok(Self {
            length_s: Bounds::new(0.1, 1000.0, "s").check("segment_s", length_s)?,
            standstill_m_s: 0.02,
            gap_max_s: GAP_MAX_S,
        })
    }
}

/// Rows of a log from a pose to a later one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment<'a> {
    /// The rows; first and last have a pose.
    pub rows: &'a [LogRow],
}

/// Returns the segments of a log, one after the other, each starting where the one before ended.
pub fn segments<'a>(log: &'a DriveLog, cut: &Segmentation) -> Vec<Segment<'a>> {
    let mut found = Vec::new();
    for rows in log.pieces(cut.gap_max_s) {
        let mut start: Option<usize> = None;
        for (index, row) in rows.iter().enumerate() {
            if row.pose.is_none() {
                continue;
            }
            let Some(first) = start else {
                start = Some(index);
                continue;
            };
            // Rounding of the times must not make a segment a pose longer.
            if row.time_s - rows[first].time_s >= cut.length_s - 1e-6 {
                let segment = Segment {
                    rows: &rows[first..=index],
                };
                if segment.moves(cut.standstill_m_s) && segment.poses().count() > 2 {
                    found.push(segment);
                }
                start = Some(index);
            }
        }
    }
    found
}

impl Segment<'_> {
    fn moves(&self, standstill_m_s: f64) -> bool {
        self.rows
            .iter()
            .any(|row| row.speeds.left_m_s.abs().max(row.speeds.right_m_s.abs()) >= standstill_m_s)
    }

    fn poses(&self) -> impl Iterator<Item = &LogRow> {
        self.rows.iter().filter(|row| row.pose.is_some())
    }
}

/// Errors at the ends of segments that were dead-reckoned from their first poses, in the axes of the
/// measured last pose; root mean squares.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SegmentErrors {
    /// Number of segments.
    pub segments: usize,
    /// To the side, m.
    pub lateral_m: f64,
    /// Along the heading, m.
    pub longitudinal_m: f64,
    /// Of the heading, rad.
    pub yaw_rad: f64,
}

impl SegmentErrors {
    /// Returns the errors over the segments of all parts together.
    pub(super) fn pooled(parts: impl Iterator<Item = Self>) -> Self {
        let mut total = Self {
            segments: 0,
            lateral_m: 0.0,
            longitudinal_m: 0.0,
            yaw_rad: 0.0,
        };
        for part in parts {
            let both = (total.segments + part.segments).max(1) as f64;
            let share = part.segments as f64 / both;
            let mean = |a: f64, b: f64| ((1.0 - share) * a * a + share * b * b).sqrt();
            total = Self {
                segments: total.segments + part.segments,
                lateral_m: mean(total.lateral_m, part.lateral_m),
                longitudinal_m: mean(total.longitudinal_m, part.longitudinal_m),
                yaw_rad: mean(total.yaw_rad, part.yaw_rad),
            };
        }
        total
    }

    /// Returns a model's errors over these segments; zeros for none.
    pub fn of(segments: &[Segment], vehicle: &Vehicle, model: KinematicModel) -> Self {
        let mut sums = [0.0; 3];
        for segment in segments {
            let ends = segment.rows.first().zip(segment.rows.last());
            let Some((start, end)) = ends.and_then(|(first, last)| first.pose.zip(last.pose))
            else {
                continue;
            };
            let Some(estimated) = model.dead_reckon(vehicle, segment.rows, start).last() else {
                continue;
            };
            let (x_m, y_m) = (estimated.x_m - end.x_m, estimated.y_m - end.y_m);
            let (sin, cos) = end.yaw_rad.sin_cos();
            let errors = [
                cos * x_m + sin * y_m,
                -sin * x_m + cos * y_m,
                wrap_angle(estimated.yaw_rad - end.yaw_rad),
            ];
            for (sum, error) in sums.iter_mut().zip(errors) {
                *sum += error * error;
            }
        }
        let [lateral_m, longitudinal_m, yaw_rad] =
            sums.map(|sum: f64| (sum / segments.len().max(1) as f64).sqrt());
        Self {
            segments: segments.len(),
            lateral_m,
            longitudinal_m,
            yaw_rad,
        }
    }
}
