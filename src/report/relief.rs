//! The slope on the map: contour lines with their heights, arrows uphill, scale.

use super::Scene;
use super::contours::{Heights, Segment};
use super::frame::{Frame, nice_step, px};
use super::map::{Ground, level_text, levels};
use maud::{Markup, html};
use std::fmt::Write;

/// A place on the drawing, px.
type Spot = [f64; 2];
/// Left, top, right and bottom edge, px.
type Bounds = [f64; 4];

const BOX_WIDTH_PX: f64 = 128.0;
const BOX_HEIGHT_PX: f64 = 92.0;
/// Distance from lines beyond which a label is not better placed.
const CLEAR_PX: f64 = 22.0;
const ARROWS: usize = 12;

/// Where labels of contour lines may stand.
pub(super) struct Labels {
    lines: Vec<Spot>,
    taken: Vec<Bounds>,
}

impl Labels {
    /// Returns room for labels away from points of lines and clear of boxes.
    pub(super) fn beside(lines: Vec<Spot>, boxes: &[Bounds]) -> Self {
        // A few thousand points show where the lines are.
        let stride = lines.len().div_ceil(4000).max(1);
        Self {
            lines: lines.into_iter().step_by(stride).collect(),
            taken: boxes.to_vec(),
        }
    }

    /// Takes and returns the best of the spots: clear of lines, then far to the right.
    fn take(&mut self, spots: &[Spot], frame: &Frame) -> Option<usize> {
        let around = |[x, y]: Spot| [x - 26.0, y - 13.0, x + 26.0, y + 13.0];
        let fits = |spot: Spot| {
            let [left, top, right, bottom] = around(spot);
            left > frame.left
                && right < frame.right()
                && top > frame.top
                && bottom < frame.bottom()
                && !self
                    .taken
                    .iter()
                    .any(|t| left < t[2] && right > t[0] && top < t[3] && bottom > t[1])
        };
        let clearance = |[x, y]: Spot| {
            let distances = self.lines.iter().map(|l| (l[0] - x).hypot(l[1] - y));
            distances.fold(CLEAR_PX, f64::min)
        };
        let (index, _) = (0..spots.len())
            .filter(|&index| fits(spots[index]))
            .map(|index| (index, 100.0 * clearance(spots[index]) + spots[index][0]))
            .max_by(|a, b| a.1.total_cmp(&b.1))?;
        self.taken.push(around(spots[index]));
        Some(index)
    }
}

/// Returns the corners that [`slope_box`] and [`scale_bar`] take.
pub(super) fn boxes(frame: &Frame) -> [Bounds; 2] {
    let (right, bottom) = (frame.right() - 10.0, frame.bottom() - 10.0);
    [
        [
            right - BOX_WIDTH_PX,
            frame.top + 10.0,
            right,
            frame.top + 10.0 + BOX_HEIGHT_PX,
        ],
        [frame.left + 10.0, bottom - 40.0, frame.left + 250.0, bottom],
    ]
}

/// Draws the contour lines, each labelled with its height once where there is room.
pub(super) fn contours(frame: &Frame, heights: &Heights, mut labels: Labels) -> Markup {
    let (levels, step) = levels(heights);
    html! {
        @for level in levels {
            @let segments: Vec<Segment> = heights
                .contour(level)
                .into_iter()
                .map(|segment| segment.map(|point| frame.place(point)))
                .collect();
            path.contour d=(segments_data(&segments)) {}
            @if let Some((spot, tilt_deg)) = label_spot(&segments, &mut labels, frame) {
                @let (x, y) = (px(spot[0]), px(spot[1]));
                text.height x=(x) y=(px(spot[1] + 4.0)) text-anchor="middle"
                    transform={ "rotate(" (px(tilt_deg)) " " (x) " " (y) ")" } {
                    (level_text(level, step))
                }
            }
        }
    }
}

fn segments_data(segments: &[Segment]) -> String {
    let mut data = String::new();
    for [p, q] in segments {
        // Writing to a string does not fail.
        let _ = write!(data, "M{},{}L{},{}", px(p[0]), px(p[1]), px(q[0]), px(q[1]));
    }
    data
}

/// Returns where a label stands, and how it is turned so that it reads along the line.
fn label_spot(segments: &[Segment], labels: &mut Labels, frame: &Frame) -> Option<(Spot, f64)> {
    // Every place on a line is within a few pixels of one of so many.
    let stride = segments.len().div_ceil(300).max(1);
    let chosen: Vec<_> = segments.iter().step_by(stride).collect();
    let middle = |[p, q]: &Segment| [0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1])];
    let spots: Vec<_> = chosen.iter().map(|segment| middle(segment)).collect();
    let index = labels.take(&spots, frame)?;
    let [p, q] = chosen[index];
    let tilt_deg = ((q[1] - p[1]) / (q[0] - p[0])).atan().to_degrees();
    Some((
        spots[index],
        if tilt_deg.is_finite() { tilt_deg } else { 0.0 },
    ))
}

/// Draws which way is uphill, or how to read the arrows where that differs from place to place.
pub(super) fn slope_box(frame: &Frame, ground: &Ground) -> Markup {
    let [[left, top, ..], _] = boxes(frame);
    let middle = left + 0.5 * BOX_WIDTH_PX;
    let steepest_deg = ground.steepest.atan().to_degrees();
    let level = steepest_deg < 0.05;
    let [x, y] = ground.gradient;
    let lines = match (level, ground.even) {
        _ if ground.share == 0.0 => ["no ground known".to_owned(), String::new()],
        (true, _) => ["level ground".to_owned(), String::new()],
        (false, true) => [
            "uphill".to_owned(),
            format!("slope {steepest_deg:.1}\u{b0}"),
        ],
        (false, false) => [
            "uphill".to_owned(),
            format!("steepest {steepest_deg:.1}\u{b0}"),
        ],
    };
    let arrow_shown = !level && ground.even;
    html! {
        rect.box x=(px(left)) y=(px(top)) width=(BOX_WIDTH_PX)
            height=(if level { 30.0 } else { BOX_HEIGHT_PX }) {}
        @if arrow_shown {
            (arrow([middle, top + 27.0], [x, y], 36.0))
        } @else if !level {
            (arrow([middle, top + 27.0], [1.0, 0.0], 36.0))
        }
        @if level {
            text x=(px(middle)) y=(px(top + 20.0)) text-anchor="middle" { (lines[0]) }
        } @else {
            text x=(px(middle)) y=(px(top + 64.0)) text-anchor="middle" { (lines[0]) }
            text x=(px(middle)) y=(px(top + 81.0)) text-anchor="middle" { (lines[1]) }
        }
    }
}

/// Draws arrows uphill along the path, longer where it is steeper.
pub(super) fn arrows(frame: &Frame, scene: &Scene) -> Markup {
    let stride = (scene.path.len() / ARROWS).max(1);
    let feet = scene.path.iter().skip(stride / 2).step_by(stride);
    let slopes: Vec<_> = feet
        .filter_map(|foot| {
            let surface = scene.terrain.surface(foot[0], foot[1]).ok()?;
            let gradient = surface.gradient_in_world();
            Some((frame.place(*foot), gradient, gradient[0].hypot(gradient[1])))
        })
        .collect();
    let steepest = slopes.iter().map(|slope| slope.2).fold(1e-3, f64::max);
    html! {
        @for (foot, gradient, slope) in slopes {
            @if slope > 0.05 * steepest {
                (arrow(foot, gradient, 12.0 + 24.0 * slope / steepest))
            }
        }
    }
}

/// Draws an arrow about a middle, along a direction in the world.
fn arrow(middle: Spot, direction: [f64; 2], length_px: f64) -> Markup {
    let norm = direction[0].hypot(direction[1]).max(f64::MIN_POSITIVE);
    // The drawing's y points down.
    let (x, y) = (direction[0] / norm, -direction[1] / norm);
    let at = |along: f64, aside: f64| {
        let along = along * length_px - 0.5 * length_px;
        let spot = [
            middle[0] + along * x - aside * y,
            middle[1] + along * y + aside * x,
        ];
        format!("{},{}", px(spot[0]), px(spot[1]))
    };
    let head = 1.0 - 9.0 / length_px;
    html! {
        path.shaft d={ "M" (at(0.0, 0.0)) "L" (at(head, 0.0)) } {}
        path.head d={ "M" (at(1.0, 0.0)) "L" (at(head, 5.0)) "L" (at(head, -5.0)) "Z" } {}
    }
}

/// Draws a bar of a round length.
pub(super) fn scale_bar(frame: &Frame, metre_px: f64) -> Markup {
    let [_, [left, top, ..]] = boxes(frame);
    let length_m = nice_step(60.0 / metre_px, 1.0);
    let width = length_m * metre_px;
    let (x, y) = (left + 14.0, top + 28.0);
    html! {
        rect.box x=(px(left)) y=(px(top)) width=(px(width + 28.0)) height="40" {}
        path.shaft d={ "M" (px(x)) "," (px(y - 5.0)) "v10m0,-5h" (px(width)) "m0,-5v10" } {}
        text x=(px(x + 0.5 * width)) y=(px(y - 9.0)) text-anchor="middle" { (length_m) " m" }
    }
}
