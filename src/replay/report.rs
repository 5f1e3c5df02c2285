//! The report of a replay: the recorded and the replayed drive, in the form of `simulate`.

use super::compare::{ReplayComparison, cross_track_rms_m};
use super::rebuild::{Rebuilt, slope};
use crate::record::{Quantiles, Row, Run, Summary};
use crate::recording::datum;
use crate::report::figures::two_digits;
use crate::report::{self, Scene};
use anyhow::Result;
use sidehill_controller::controller::Status;
use sidehill_controller::path::Path;
use sidehill_plant::frames::{Attitude, PlanarPose, Pose};
use sidehill_plant::speeds::MeasuredTreadSpeeds;
use sidehill_recording::{ControllerCycle, Recording};

/// Returns the page.
///
/// # Errors
/// The recorded attitudes make no plane.
pub(super) fn html(
    recording: &Recording,
    rebuilt: &Rebuilt,
    replayed: &[ControllerCycle],
    comparison: &ReplayComparison,
) -> Result<String> {
    let rows = |cycles: &[ControllerCycle]| -> Vec<Row> {
        let inputs = recording.cycles.iter().zip(cycles);
        inputs
            .map(|(input, cycle)| row(rebuilt, input, cycle))
            .collect()
    };
    let path = recording
        .paths
        .values()
        .find_map(|record| record.path.as_ref()?.trajectory.path());
    let (terrain, ground) = match &rebuilt.terrain {
        Some(terrain) => (terrain.clone(), ""),
        None => (
            slope(recording)?,
            " The ground is the plane on which the vehicle stood on average.",
        ),
    };
    let scene = Scene {
        title: "Replay".to_owned(),
        subtitle: format!(
            "{}: {} of {} cycles differ, by at most {} m/s. Positions are the controller's estimates.{ground}",
            recording
                .files
                .first()
                .map_or_else(String::new, |file| file.display().to_string()),
            comparison.different,
            comparison.cycles,
            two_digits(comparison.largest_difference_m_s)
        ),
        path: path.map_or_else(Vec::new, |path| {
            (0..=2000)
                .map(|i| path.at(path.length_m() * f64::from(i) / 2000.0).position)
                .map(|position| [position.x_m, position.y_m])
                .collect()
        }),
        terrain: &terrain,
        limits: &rebuilt.config.limits,
        vehicle: &rebuilt.vehicle,
        period_s: rebuilt.config.period_s,
        datum: datum(&recording.header),
        perfect_sensors: false,
        guard: None,
    };
    let name = rebuilt.kind.name();
    let runs = [
        run(
            "recorded",
            rows(&recording.cycles),
            End::of(&recording.cycles, path),
        ),
        run(
            &format!("{name}, replayed"),
            rows(replayed),
            End::of(replayed, path),
        ),
    ];
    Ok(report::html(&scene, &runs))
}

/// How a drive ended, by its own steps.
struct End {
    completed: bool,
    /// Why it was not completed.
    reason: Option<String>,
    fallbacks: u32,
}

impl End {
    fn of(steps: &[ControllerCycle], path: Option<&Path>) -> Self {
        let finished = Status::Finished.to_string();
        let completed = steps.iter().any(|step| step.status == finished);
        let reason = || {
            let status = steps.last().map_or("no cycle", |step| step.status.as_str());
            let passed = steps.iter().rev().map(|step| step.arc_length_m);
            let passed_m = passed.into_iter().find(|way_m| way_m.is_finite());
            match (passed_m, path) {
                (Some(passed_m), Some(path)) => format!(
                    "{:.2} m before the end of the path ({status})",
                    (path.length_m() - passed_m).max(0.0)
                ),
                _ => status.to_owned(),
            }
        };
        let fallbacks = steps
            .iter()
            .filter(|step| step.status.starts_with("fallback"));
        Self {
            completed,
            reason: (!completed).then(reason),
            fallbacks: fallbacks.count() as u32,
        }
    }
}

/// Returns a row of a cycle that got what `input` did.
fn row(rebuilt: &Rebuilt, input: &ControllerCycle, cycle: &ControllerCycle) -> Row {
    let nan = f64::NAN;
    let pose = PlanarPose {
        x_m: cycle.estimated_x_m,
        y_m: cycle.estimated_y_m,
        yaw_rad: cycle.estimated_yaw_rad,
    };
    let attitude = Attitude {
        roll_rad: cycle.estimated_roll_rad,
        pitch_rad: cycle.estimated_pitch_rad,
    };
    let measured = MeasuredTreadSpeeds {
        left_m_s: input.left_m_s,
        right_m_s: input.right_m_s,
    };
    let treads = rebuilt.vehicle.encoder_scale.apply(measured);
    Row {
        time_s: cycle.time_s,
        pose: Pose {
            x_m: pose.x_m,
            y_m: pose.y_m,
            z_m: input.z_m,
            yaw_rad: pose.yaw_rad,
        },
        attitude,
        estimate: pose.x_m.is_finite().then_some(pose),
        cross_track_bound_m: None,
        ahead: None,
        reference: pose,
        cross_track_m: cycle.cross_track_m,
        along_track_m: nan,
        heading_error_rad: nan,
        command: cycle.command(),
        motors: cycle.command(),
        tread_speeds: measured,
        icrs: rebuilt.vehicle.icrik(attitude, treads),
        status: Status::Tracking,
        qp_iterations: 0,
        qp_path: None,
        solve_us: if cycle.solve_us.is_finite() {
            cycle.solve_us
        } else {
            0.0
        },
        cycle_us: 0.0,
        contact: None,
        slope: None,
        tracked: None,
    }
}

fn run(name: &str, rows: Vec<Row>, end: End) -> Run {
    let errors_m = || rows.iter().map(|row| row.cross_track_m);
    let finite_m = || {
        errors_m()
            .filter(|error_m| error_m.is_finite())
            .map(f64::abs)
    };
    let mut sorted_m: Vec<f64> = finite_m().collect();
    sorted_m.sort_by(f64::total_cmp);
    let steers = rows.windows(2).map(|pair| {
        let [a, b] = [&pair[0], &pair[1]].map(|row| row.command.steer_m_s);
        (b - a).abs()
    });
    let solves = rows.iter().map(|row| row.solve_us).filter(|us| *us > 0.0);
    let summary = Summary {
        laps: Vec::new(),
        controller: name.to_owned(),
        plant: "recorded".to_owned(),
        scenario: String::new(),
        seed: 0,
        completed: end.completed,
        ended_by: end.reason,
        cross_track_bound_held: None,
        cross_track_ahead_bound_held: None,
        origin_cross_track_rms_m: None,
        guard: None,
        cross_track_rms_m: cross_track_rms_m(errors_m()),
        cross_track_p95_m: sidehill_plant::statistics::quantile(&sorted_m, 0.95)
            .unwrap_or(f64::NAN),
        cross_track_max_m: sorted_m.last().copied().unwrap_or(f64::NAN),
        along_track_rms_m: f64::NAN,
        heading_rms_rad: f64::NAN,
        steer_total_variation_m_s: steers.sum(),
        goal_error_m: f64::NAN,
        mean_speed_m_s: f64::NAN,
        time_s: match &rows[..] {
            [first, .., last] => last.time_s - first.time_s,
            _ => 0.0,
        },
        tread_speed_max_m_s: rows
            .iter()
            .flat_map(|row| [row.tread_speeds.left_m_s, row.tread_speeds.right_m_s])
            .map(f64::abs)
            .fold(0.0, f64::max),
        constraint_violations: 0,
        fallbacks: end.fallbacks,
        deadline_misses: 0,
        qp_iterations_mean: f64::NAN,
        qp_working_set: 0,
        qp_interior_point: 0,
        qp_cut_short: 0,
        solve_us: Quantiles::of(solves.collect()),
        cycle_us: Quantiles::default(),
    };
    Run {
        summary,
        rows,
        learned: None,
    }
}
