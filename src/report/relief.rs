//! The slope on the map: contour lines with their heights, arrows uphill, scale.

use super::contours::{ContourSegment, Heights};
use super::frame::{PlotFrame, multiples, nice_step, px, range, rounded};
use super::ground::GroundPicture;
use super::scene::Scene;
use maud::{Markup, html};
use std::fmt::Write;

/// A place on the drawing, px.
type Spot = [f64; 2];
/// Left, top, right and bottom edge, px.
type Extent = [f64; 4];

const BOX_WIDTH_PX: f64 = 128.0;
const BOX_HEIGHT_PX: f64 = 92.0;
/// Distance from lines beyond which a label's place does not improve.
const CLEAR_PX: f64 = 22.0;
/// Pieces of a contour below which its label may stand beside it.
const SHORT_SEGMENTS: usize = 60;
const ARROWS: usize = 12;

/// Free space for labels of contour lines.
pub(super) struct Labels {
    lines: Vec<Spot>,
    taken: Vec<Extent>,
}

impl Labels {
    /// Returns the free space away from points of lines and outside boxes.
    pub(super) fn beside(lines: Vec<Spot>, boxes: &[Extent]) -> Self {
        // A few thousand points show where the lines are.
        let stride = lines.len().div_ceil(4000).max(1);
        Self {
            lines: lines.into_iter().step_by(stride).collect(),
            taken: boxes.to_vec(),
        }
    }

    /// Takes and returns the best of the spots: clear of lines, then far to the right.
    fn take(&mut self, spots: &[LabelSpot], frame: &PlotFrame) -> Option<LabelSpot> {
        let around = |spot: &LabelSpot| {
            let ([x, y], tilt) = (spot.middle, spot.tilt_deg.to_radians());
            let (half_x, half_y) = (26.0, 10.0 + 16.0 * tilt.sin().abs());
            [x - half_x, y - half_y, x + half_x, y + half_y]
        };
        let fits = |spot: &&LabelSpot| {
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
        let worth = |spot: &LabelSpot| 100.0 * clearance(spot.middle) + spot.middle[0];
        let best = spots
            .iter()
            .filter(fits)
            .map(|spot| (*spot, worth(spot)))
            .max_by(|a, b| a.1.total_cmp(&b.1))?
            .0;
        self.taken.push(around(&best));
        Some(best)
    }
}

/// Place of a label, and its angle along its line.
#[derive(Clone, Copy)]
struct LabelSpot {
    middle: Spot,
    tilt_deg: f64,
}

/// A contour line on the drawing.
pub(super) struct Contour {
    data: String,
    text: String,
    spot: Option<LabelSpot>,
}

impl Contour {
    pub(super) fn line(&self) -> Markup {
        html! { path.contour d=(self.data) {} }
    }

    /// Draws its height, if there was room.
    pub(super) fn label(&self) -> Markup {
        html! {
            @if let Some(LabelSpot { middle: [x, y], tilt_deg }) = self.spot {
                text.height x=(px(x)) y=(px(y + 4.0)) text-anchor="middle"
                    transform={ "rotate(" (px(tilt_deg)) " " (px(x)) " " (px(y)) ")" } { (self.text) }
            }
        }
    }
}

/// Returns the corners that [`slope_box`] and [`scale_bar`] take.
pub(super) fn boxes(frame: &PlotFrame) -> [Extent; 2] {
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

/// Returns the contour lines, each labelled with its height once where there is room.
pub(super) fn contours(frame: &PlotFrame, heights: &Heights, mut labels: Labels) -> Vec<Contour> {
    let (levels, step) = levels(heights);
    let corridor = heights.values.iter().any(Option::is_none);
    let contour = |level: f64| {
        let segments: Vec<ContourSegment> = heights
            .contour(level)
            .into_iter()
            .map(|segment| segment.map(|point| frame.place(point)))
            .collect();
        Contour {
            data: segments_data(&segments),
            text: rounded(level, step) + " m",
            spot: labels.take(&label_spots(&segments, corridor), frame),
        }
    };
    levels.into_iter().map(contour).collect()
}

/// Levels of about ten contour lines, with their step.
fn levels(heights: &Heights) -> (Vec<f64>, f64) {
    let [low, high] = range(heights.values.iter().flatten().copied(), 0.0);
    let known = heights.values.iter().any(Option::is_some);
    if !known || high - low < 1e-3 {
        return (Vec::new(), 1.0);
    }
    let step = nice_step(high - low, 12.0);
    (multiples([low, high], step), step)
}

fn segments_data(segments: &[ContourSegment]) -> String {
    let mut data = String::new();
    for [p, q] in segments {
        // Writing to a string does not fail.
        let _ = write!(data, "M{},{}L{},{}", px(p[0]), px(p[1]), px(q[0]), px(q[1]));
    }
    data
}

/// Returns spots on the line, and beside it for a line too short to leave a corridor of ground.
fn label_spots(segments: &[ContourSegment], corridor: bool) -> Vec<LabelSpot> {
    // Dense enough: every place on a line is within a few pixels of a spot.
    let stride = segments.len().div_ceil(300).max(1);
    let on_line = segments.iter().step_by(stride).map(|[p, q]| {
        let tilt_deg = ((q[1] - p[1]) / (q[0] - p[0])).atan().to_degrees();
        LabelSpot {
            middle: [0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1])],
            tilt_deg: if tilt_deg.is_finite() { tilt_deg } else { 0.0 },
        }
    });
    let mut spots: Vec<_> = on_line.collect();
    if corridor && segments.len() < SHORT_SEGMENTS {
        for index in 0..spots.len() {
            let [x, y] = spots[index].middle;
            for aside in [-30.0, 30.0] {
                spots.push(LabelSpot {
                    middle: [x + aside, y],
                    tilt_deg: 0.0,
                });
            }
        }
    }
    spots
}

/// Draws which way is uphill, or how to read the arrows where that differs from place to place.
pub(super) fn slope_box(frame: &PlotFrame, ground: &GroundPicture) -> Markup {
    let [[left, top, ..], _] = boxes(frame);
    let middle = left + 0.5 * BOX_WIDTH_PX;
    let degrees = |gradient: f64| gradient.atan().to_degrees();
    let lines = if ground.share == 0.0 {
        vec!["no ground known".to_owned()]
    } else if degrees(ground.steepest) < 0.05 {
        vec!["level ground".to_owned()]
    } else if ground.even {
        vec![
            "uphill".to_owned(),
            format!("slope {:.1}\u{b0}", degrees(ground.steepest)),
        ]
    } else {
        vec![
            "arrows: uphill".to_owned(),
            format!("up to {:.1}\u{b0}", degrees(ground.steepest_on_path)),
        ]
    };
    let arrow_px = if lines.len() > 1 && ground.even {
        44.0
    } else {
        0.0
    };
    let text_top = top + arrow_px + 20.0;
    html! {
        rect.box x=(px(left)) y=(px(top)) width=(BOX_WIDTH_PX)
            height=(px(arrow_px + 13.0 + 17.0 * lines.len() as f64)) {}
        @if arrow_px > 0.0 {
            (arrow([middle, top + 27.0], ground.gradient, 36.0))
        }
        @for (index, line) in lines.iter().enumerate() {
            text x=(px(middle)) y=(px(text_top + 17.0 * index as f64)) text-anchor="middle" { (line) }
        }
    }
}

/// Draws arrows uphill along the path, longer where it is steeper.
pub(super) fn arrows(frame: &PlotFrame, scene: &Scene) -> Markup {
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
pub(super) fn scale_bar(frame: &PlotFrame, metre_px: f64) -> Markup {
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
