//! Plots with zoom and a cursor shared by all plots of a page. `report.js` draws them.

use super::figures::significant;
use maud::{Markup, PreEscaped, html};
use serde::Serialize;

/// Intervals of a long line whose extremes are kept.
const COLUMNS: usize = 700;
/// Time between two points of a log that is a gap, s.
const GAP_S: f64 = 1.0;

/// Lines over a common quantity, mostly time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Plot {
    /// Title of the vertical axis, with unit.
    pub(crate) y_title: String,
    /// Title of the horizontal axis, with unit.
    pub(crate) x_title: String,
    /// Height, px.
    pub(crate) height_px: f64,
    /// Whether the vertical axis is logarithmic.
    pub(crate) logarithmic: bool,
    /// Whether the horizontal axis is.
    pub(crate) x_logarithmic: bool,
    /// Limits, each with its label.
    pub(crate) limits: Vec<(f64, String)>,
    pub(crate) lines: Vec<Line>,
}

/// One line of a plot.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Line {
    pub(crate) name: String,
    pub(crate) colour: String,
    /// Number of the run that the page's boxes hide and show; none for a line that always shows.
    pub(crate) run: Option<usize>,
    /// Whether its points are dots, without a line through them.
    pub(crate) dots: bool,
    pub(crate) x: Vec<f64>,
    /// None leaves a gap.
    pub(crate) y: Vec<Option<f64>>,
}

impl Line {
    /// Returns a line through points. A long line keeps only the extremes of equal intervals. Values that are not
    /// finite leave gaps; points whose x does not rise are left out.
    pub(crate) fn through(
        name: &str,
        colour: &str,
        run: Option<usize>,
        points: &[[f64; 2]],
    ) -> Self {
        // Skip places that are unknown or already passed.
        let mut furthest = f64::NEG_INFINITY;
        let ahead = points.iter().copied().filter(|point| {
            let further = point[0] > furthest;
            if further {
                furthest = point[0];
            }
            further
        });
        let points = thinned(&ahead.collect::<Vec<_>>());
        // Seven digits are more than a screen shows.
        let finite = |value: f64| value.is_finite().then(|| rounded(value));
        Self {
            name: name.to_owned(),
            colour: colour.to_owned(),
            run,
            dots: false,
            x: points.iter().map(|point| rounded(point[0])).collect(),
            y: points.iter().map(|point| finite(point[1])).collect(),
        }
    }
}

impl Line {
    /// Returns a line through points over time, s, which has a gap where there is none for a second.
    pub(crate) fn with_gaps(
        name: &str,
        colour: &str,
        points: impl Iterator<Item = [f64; 2]>,
    ) -> Self {
        let mut all: Vec<[f64; 2]> = Vec::new();
        for point in points {
            let before_s = all.last().map_or(f64::NAN, |point| point[0]);
            if point[0] - before_s > GAP_S {
                all.push([before_s + 1e-3, f64::NAN]);
            }
            all.push(point);
        }
        Self::through(name, colour, None, &all)
    }

    /// Returns a line through the values above 0 in ascending order, over their share, %, of so many or of all of them.
    pub(crate) fn ascending(
        name: &str,
        colour: &str,
        run: Option<usize>,
        values: impl Iterator<Item = f64>,
        count: Option<usize>,
    ) -> Self {
        let mut values: Vec<f64> = values.filter(|v| *v > 0.0 && v.is_finite()).collect();
        values.sort_by(f64::total_cmp);
        let count = count.unwrap_or(values.len()) as f64;
        let share = |place: usize| 100.0 * (place + 1) as f64 / count;
        let points = values.iter().enumerate();
        let points: Vec<[f64; 2]> = points.map(|(place, v)| [share(place), *v]).collect();
        Self::through(name, colour, run, &points)
    }

    /// Returns dots at points with finite coordinates.
    pub(crate) fn dots(name: &str, colour: &str, points: &[[f64; 2]]) -> Self {
        let mut points: Vec<[f64; 2]> = points
            .iter()
            .copied()
            .filter(|point| point.iter().all(|value| value.is_finite()))
            .collect();
        points.sort_by(|a, b| a[0].total_cmp(&b[0]));
        Self {
            name: name.to_owned(),
            colour: colour.to_owned(),
            run: None,
            dots: true,
            x: points.iter().map(|point| rounded(point[0])).collect(),
            y: points.iter().map(|point| Some(rounded(point[1]))).collect(),
        }
    }
}

impl Plot {
    /// Returns a plot over time, s.
    pub(crate) fn over_time(y_title: impl Into<String>, height_px: f64, lines: Vec<Line>) -> Self {
        Self {
            y_title: y_title.into(),
            x_title: "time (s)".to_owned(),
            height_px,
            logarithmic: false,
            x_logarithmic: false,
            limits: Vec::new(),
            lines,
        }
    }

    /// Returns what the lines show, in words.
    fn in_words(&self) -> String {
        let lines = self.lines.iter().filter_map(|line| {
            let values = || line.y.iter().flatten().copied();
            let [low, high] = [
                values().min_by(f64::total_cmp)?,
                values().max_by(f64::total_cmp)?,
            ];
            Some(format!(
                "{} from {} to {}",
                line.name,
                significant(low),
                significant(high)
            ))
        });
        let lines: Vec<String> = lines.collect();
        format!("{}: {}", self.y_title, lines.join(", "))
    }

    /// Returns the place of the plot in a page, with its data; plots of one `group` share cursor and zoom.
    pub(crate) fn markup(&self, group: &str) -> Markup {
        let json = serde_json::to_string(self).unwrap_or_else(|_| "{}".to_owned());
        let json = in_script(&json);
        html! {
            div.plot data-group=(group) role="img" aria-label=(self.in_words()) {
                script type="application/json" { (PreEscaped(json)) }
            }
        }
    }
}

/// Returns JSON in which nothing ends its element or begins another: such characters are only in its strings.
pub(super) fn in_script(json: &str) -> String {
    json.replace('<', "\\u003c")
        .replace('>', "\\u003e")
        .replace('&', "\\u0026")
}

fn rounded(value: f64) -> f64 {
    format!("{value:.6e}").parse().unwrap_or(value)
}

fn thinned(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    if points.len() <= 2 * COLUMNS {
        return points.to_vec();
    }
    let stretches = points.chunks(points.len().div_ceil(COLUMNS));
    stretches.flat_map(extremes).collect()
}

/// Returns the least and the greatest point in their order; without any finite one, a gap.
fn extremes(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let finite = || points.iter().filter(|p| p[1].is_finite());
    let least = finite().min_by(|a, b| a[1].total_cmp(&b[1]));
    let most = finite().max_by(|a, b| a[1].total_cmp(&b[1]));
    let (Some(least), Some(most)) = (least, most) else {
        return vec![[points[0][0], f64::NAN]];
    };
    if least[0] < most[0] {
        vec![*least, *most]
    } else if least[0] > most[0] {
        vec![*most, *least]
    } else {
        vec![*least]
    }
}
