//! The report of odometry: each model's reconstruction of the drive.

use crate::report::figures::two_digits;
use crate::report::map::{MapRun, PageMap};
use crate::report::page::{COLOURS, ReportPage, legend_of, section, table};
use crate::report::plot::{Line, Plot};
use maud::html;
use sidehill_plant::frames::wrap_angle;
use sidehill_plant::odometry::{Comparison, MeanSquaredErrors};
use sidehill_plant::vehicle::Vehicle;

/// What the slope terms of a model act on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slope {
    /// Median tilt of the vehicle in the log, deg.
    pub(super) tilt_deg: f64,
    /// Whether a slide gain of the vehicle is above 0.
    pub(super) slides: bool,
}

/// Returns the page: errors as a table and over time, and the paths.
pub(super) fn html(
    log: &str,
    vehicle: &Vehicle,
    models: &[&str],
    comparisons: &[Vec<Comparison>],
    slope: Slope,
) -> String {
    let names: Vec<(&str, &str)> = models.iter().copied().zip(COLOURS).collect();
    let errors: Vec<MeanSquaredErrors> = comparisons
        .iter()
        .map(|comparisons| MeanSquaredErrors::of(comparisons))
        .collect();
    let rows: Vec<Vec<String>> = names
        .iter()
        .zip(&errors)
        .map(|((name, _), errors)| {
            let values = [
                errors.x_m2,
                errors.y_m2,
                errors.z_m2,
                errors.yaw_rad2,
                errors.fitness(),
            ];
            let mut row = vec![(*name).to_owned()];
            row.extend(values.map(two_digits));
            row
        })
        .collect();
    let over_time = |title: &str, value: &dyn Fn(&Comparison) -> f64| {
        let line = |(comparisons, (name, colour)): (&Vec<Comparison>, &(&str, &str))| {
            // After a gap of the log the reckoning starts again.
            let points = comparisons.iter();
            Line::with_gaps(name, colour, points.map(|c| [c.time_s, value(c)]))
        };
        let lines = comparisons.iter().zip(&names).map(line).collect();
        Plot::over_time(title, 180.0, lines)
    };
    let plots = [
        over_time("position error (m)", &|comparison| {
            let (measured, estimated) = (comparison.measured, comparison.estimated);
            (estimated.x_m - measured.x_m).hypot(estimated.y_m - measured.y_m)
        }),
        over_time("yaw error (\u{b0})", &|comparison| {
            let error = comparison.estimated.yaw_rad - comparison.measured.yaw_rad;
            wrap_angle(error).to_degrees()
        }),
    ];
    let paths = names.iter().zip(comparisons);
    let paths = paths.map(|((name, colour), comparisons)| {
        let poses = comparisons.iter();
        let poses = poses.map(|comparison| (comparison.time_s, comparison.estimated.planar()));
        MapRun::through(name, colour, poses, |_, _| None)
    });
    let measured = comparisons.first().map_or(&[][..], Vec::as_slice).iter();
    let measured = measured.map(|comparison| (comparison.time_s, comparison.measured.planar()));
    let log_path = MapRun::through("log", COLOURS[6], measured, |_, _| None);
    let mut legend = names.clone();
    legend.push(("log", COLOURS[6]));
    let page = ReportPage {
        title: "Odometry",
        subtitle: &format!("Log {log}, vehicle {}", vehicle.name),
        conclusions: &conclusions(
            &names,
            &errors,
            comparisons.first().map_or(0, Vec::len),
            slope,
        ),
        summary: table(
            "figures",
            &[
                "mean squared errors",
                "x (m\u{b2})",
                "y (m\u{b2})",
                "z (m\u{b2})",
                "yaw (rad\u{b2})",
                "J/N",
            ],
            &rows,
        ),
        legend: html! {},
        body: section(
            "Errors over time",
            "How far each model's dead reckoning is from the log's pose: it starts at a measured pose and drifts \
             until it starts again after a gap of the log.",
            &legend_of(&legend),
            "time",
            &plots,
        ),
        map: Some(PageMap::over(
            paths.chain([log_path]).collect(),
            &[],
            vehicle,
        )),
    };
    page.html()
}

/// Returns the conclusions.
fn conclusions(
    names: &[(&str, &str)],
    errors: &[MeanSquaredErrors],
    samples: usize,
    ground: Slope,
) -> Vec<String> {
    let fitness = |name: &str| {
        let index = names.iter().position(|(other, _)| *other == name);
        index
            .and_then(|index| errors.get(index))
            .map_or(f64::NAN, MeanSquaredErrors::fitness)
    };
    let best = names
        .iter()
        .map(|(name, _)| (*name, fitness(name)))
        .filter(|(_, fitness)| fitness.is_finite())
        .min_by(|a, b| a.1.total_cmp(&b.1));
    let Some((best, least)) = best else {
        return vec!["The log has no poses to compare with.".to_owned()];
    };
    let share = |name: &str, of: &str| 100.0 * (fitness(name) / fitness(of) - 1.0);
    let mut sentences = vec![format!(
        "Over {samples} poses {best} is nearest to the log (J/N {}); ideal differential drive has {}.",
        two_digits(least),
        two_digits(fitness("diff_drive"))
    )];
    let slope = share("icrik", "icrhk");
    sentences.push(if slope.abs() < 0.5 {
        let why = if !ground.slides {
            "the vehicle's slide gains are 0".to_owned()
        } else {
            format!("the ground slopes by {:.1} deg", ground.tilt_deg)
        };
        format!("The slope terms (icrik against icrhk) make no difference here: {why}.")
    } else if slope < 0.0 {
        format!("The slope terms help: icrik's J/N is {:.0} % below icrhk's.", -slope)
    } else {
        format!(
            "The slope terms do not help here: icrik's J/N is {slope:.0} % above icrhk's. Identify the slide gains on \
             this ground, or set them to 0."
        )
    });
    sentences.push(
        "One log shows what happened once: judge a vehicle by logs that it was not identified from.".to_owned(),
    );
    sentences
}
