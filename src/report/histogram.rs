//! Solve times of each run over a logarithmic axis.

use super::frame::{PlotFrame, Tick, px, ticks};
use super::scene::{DRAWING_WIDTH_PX, Style};
use crate::record::Run;
use maud::{Markup, html};

const ROW_PX: f64 = 110.0;
const GAP_PX: f64 = 30.0;
const TOP_PX: f64 = 26.0;
const BINS: usize = 80;

/// Draws the histogram of each run that solved a QP, in shares of its cycles.
pub(super) fn solve_times(runs: &[Run], styles: &[Style]) -> Markup {
    let solved: Vec<_> = runs
        .iter()
        .zip(styles)
        .enumerate()
        .map(|(index, (run, style))| (index, run, style, logarithms(run)))
        .filter(|(.., times)| !times.is_empty())
        .collect();
    if solved.is_empty() {
        return html! { p { "No run solved a QP." } };
    }
    let all = || solved.iter().flat_map(|(.., times)| times.iter().copied());
    let least = all().fold(f64::INFINITY, f64::min);
    let most = all().fold(f64::NEG_INFINITY, f64::max);
    // Room for the labels, and at least most of a decade.
    let room = (0.12 * (most - least)).max(0.5 * (0.8 - (most - least)));
    let (low, high) = (least - room, most + room);
    let total_px = TOP_PX + solved.len() as f64 * (ROW_PX + GAP_PX) + 16.0;
    html! {
        svg viewBox={ "0 0 " (DRAWING_WIDTH_PX) " " (total_px) } role="img" aria-label="solve times" {
            @for (place, (index, run, style, times)) in solved.iter().enumerate() {
                @let shares = shares(times, low, high);
                @let most = shares.iter().copied().fold(0.0, f64::max);
                @let frame = PlotFrame {
                    left: 80.0,
                    top: TOP_PX + place as f64 * (ROW_PX + GAP_PX),
                    width: DRAWING_WIDTH_PX - 110.0,
                    height: ROW_PX,
                    x: [low, high],
                    y: [0.0, 1.35 * most],
                };
                (frame.axis_below(&logarithmic_ticks(low, high), "time within the QP solver (\u{b5}s)", place + 1 == solved.len()))
                (frame.axis_left(&ticks(frame.y, 3.0), "cycles (%)"))
                g.{ "run" (index) } fill=(style.colour) {
                    @for (bin, share) in shares.iter().enumerate() {
                        @if *share > 0.0 { (bar(&frame, bin, *share)) }
                    }
                }
                (mark(&frame, "p50", run.summary.solve_us.p50, "end"))
                (mark(&frame, "p99", run.summary.solve_us.p99, "start"))
                text.strong x=(px(frame.left)) y=(px(frame.top - 7.0)) { (style.name) }
                (frame.border())
            }
        }
    }
}

/// Common logarithms of the run's solve times, us.
fn logarithms(run: &Run) -> Vec<f64> {
    let times = run.rows.iter().map(|row| row.solve_us);
    times
        .filter(|time| time.is_finite() && *time > 0.0)
        .map(f64::log10)
        .collect()
}

/// Shares of the times in equal bins, %.
fn shares(times: &[f64], low: f64, high: f64) -> Vec<f64> {
    let mut counts = vec![0_u32; BINS];
    for time in times {
        let bin = ((time - low) / (high - low) * BINS as f64) as usize;
        counts[bin.min(BINS - 1)] += 1;
    }
    let share = |count| 100.0 * f64::from(count) / times.len() as f64;
    counts.into_iter().map(share).collect()
}

fn bar(frame: &PlotFrame, bin: usize, share: f64) -> Markup {
    let width = frame.width / BINS as f64;
    let top = frame.place([0.0, share])[1];
    html! {
        rect x=(px(frame.left + bin as f64 * width)) y=(px(top)) width=(px(width - 1.0))
            height=(px((frame.bottom() - top).max(1.0))) {}
    }
}

fn mark(frame: &PlotFrame, name: &str, time_us: f64, anchor: &str) -> Markup {
    let x = frame.place([time_us.log10(), 0.0])[0];
    let inside = x >= frame.left && x <= frame.right();
    let offset = if anchor == "end" { -5.0 } else { 5.0 };
    html! {
        @if inside {
            line.mark x1=(px(x)) x2=(px(x)) y1=(px(frame.top)) y2=(px(frame.bottom())) {}
            text.halo x=(px(x + offset)) y=(px(frame.top + 15.0)) text-anchor=(anchor) {
                (name) " " (format!("{time_us:.0}")) " \u{b5}s"
            }
        }
    }
}

/// Ticks at 1, 2 and 5 times powers of ten.
fn logarithmic_ticks(low: f64, high: f64) -> Vec<Tick> {
    let powers = low.floor() as i32..=high.ceil() as i32;
    powers
        .flat_map(|power| [1.0, 2.0, 5.0].map(|factor| factor * 10.0_f64.powi(power)))
        .map(|time| Tick {
            value: time.log10(),
            text: format!("{time}"),
        })
        .filter(|tick| tick.value >= low && tick.value <= high)
        .collect()
}
