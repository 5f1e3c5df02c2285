//! A controller driving the simulated vehicle, and the figures of its run.

use crate::config::Prepared;
use crate::qp_recording::QpRecording;
use crate::record::{Quantiles, Row, Run, Summary, nearest_rank};
use anyhow::Context;
use sidehill_controller::config::ControllerKind;
use sidehill_controller::controller::{Controller, Decision, Status};
use sidehill_controller::mpc::SolvePath;
use sidehill_controller::mpc::limits::{InputLimits, MotorLimits};
use sidehill_controller::path::{Path, Point2};
use sidehill_controller::reference::{PROJECTION_WINDOW, Reference};
use sidehill_controller::trajectory::{Ending, ReferencePoint};
use sidehill_plant::frames::wrap_angle;
use sidehill_plant::simulation::{SimulationError, TrueState};
use sidehill_plant::speeds::MotorSpeeds;
use std::time::Instant;

/// Time at the start that does not count in the figures: the vehicle has to get under way, s.
const SETTLING_S: f64 = 2.0;
/// Farthest from the end of its path, or from a closed path, at which a run counts as completed, m;
/// Nav2's default.
const GOAL_TOLERANCE_M: f64 = 0.25;

/// Returns the run of one controller; `progress` hears the share done, 0 to 1, once a second of
/// simulated time, and `qps` takes each cycle's QP.
///
/// # Errors
/// What keeps the run from starting: settings, or no ground under the start.
pub fn run(
    prepared: &Prepared,
    kind: ControllerKind,
    mut progress: impl FnMut(f64),
    mut qps: Option<&mut QpRecording>,
) -> anyhow::Result<Run> {
    let config = &prepared.controller;
    let mut simulation = prepared.simulation()?;
    let mut controller = Controller::new(
        kind,
        config.clone(),
        &prepared.vehicle,
        prepared.trajectory.clone(),
        prepared.tracking,
        prepared.laps,
        Some(prepared.terrain.clone()),
    )?;
    let steps = (config.period_s / prepared.step_s).round() as u64;
    let end_s = followed(&controller)?.end_s();
    let give_up_s = 1.5 * end_s + 30.0;
    let mut figures = Figures::new(prepared, config.limits, config.period_s);
    let mut rows = Vec::new();
    let ending = loop {
        let state = *simulation.state();
        let sample = simulation.sample();
        let begin = Instant::now();
        let decision = controller.step(&sample, None);
        let cycle_us = begin.elapsed().as_secs_f64() * 1e6;
        if let (Some(qps), Some(mpc), Some(report)) = (&mut qps, controller.mpc(), &decision.solve)
        {
            qps.push(state.time_s, mpc.qp(), report);
        }
        let reference = followed(&controller)?.ahead(0.0);
        rows.push(figures.cycle(&state, &decision, &reference, cycle_us, prepared));
        match decision.status {
            Status::Finished => break Ok(()),
            Status::Stopping(reason) if decision.command == MotorSpeeds::STOP => {
                break Err(reason.to_string());
            }
            _ if state.time_s > give_up_s => {
                break Err(format!("not at the end after {give_up_s:.0} s"));
            }
            _ => {}
        }
        if rows.len() % 20 == 0 {
            progress((followed(&controller)?.time_s() / end_s).min(1.0));
        }
        simulation.set_command(decision.command)?;
        let moved = (0..steps).try_for_each(|_| {
            figures.step(simulation.step()?, &reference);
            Ok::<_, SimulationError>(())
        });
        if let Err(error) = moved {
            break Err(error.to_string());
        }
    };
    progress(1.0);
    let summary = figures.summary(
        prepared,
        kind,
        ending,
        &rows,
        followed(&controller)?.ahead(0.0),
    );
    Ok(Run { summary, rows })
}

/// Returns what a controller follows.
fn followed(controller: &Controller) -> anyhow::Result<&Reference> {
    controller.reference().context("there is nothing to follow")
}

/// Sums and extremes of a run under way.
struct Figures<'a> {
    path: Option<&'a Path>,
    limits: InputLimits,
    period_s: f64,
    cross_track_m: f64,
    along_track_m: f64,
    heading_error_rad: f64,
    cross_tracks_m: Vec<f64>,
    along_squares: f64,
    heading_squares: f64,
    last_command: MotorSpeeds,
    steer_variation_m_s: f64,
    violations: u32,
    fallbacks: u32,
    deadline_misses: u32,
    position: Point2,
}

impl<'a> Figures<'a> {
    fn new(prepared: &'a Prepared, limits: InputLimits, period_s: f64) -> Self {
        Self {
            path: prepared.trajectory.path(),
            limits,
            period_s,
            cross_track_m: 0.0,
            along_track_m: 0.0,
            heading_error_rad: 0.0,
            cross_tracks_m: Vec::new(),
            along_squares: 0.0,
            heading_squares: 0.0,
            last_command: MotorSpeeds::STOP,
            steer_variation_m_s: 0.0,
            violations: 0,
            fallbacks: 0,
            deadline_misses: 0,
            position: Point2 {
                x_m: prepared.start.x_m,
                y_m: prepared.start.y_m,
            },
        }
    }

    /// Measures the true state against the path and `reference`.
    fn measure(&mut self, state: &TrueState, reference: &ReferencePoint) {
        self.position = Point2 {
            x_m: state.pose.x_m,
            y_m: state.pose.y_m,
        };
        if let Some(path) = self.path {
            let nearest =
                path.nearest_within(&self.position, reference.arc_length_m, &PROJECTION_WINDOW);
            self.cross_track_m = nearest.cross_track_m;
            self.along_track_m = nearest.point.arc_length_m - reference.arc_length_m;
        } else {
            self.cross_track_m = reference.position.distance_m(&self.position);
            self.along_track_m = 0.0;
        }
        self.heading_error_rad = wrap_angle(state.pose.yaw_rad - reference.heading_rad);
    }

    /// Counts one step of the plant.
    fn step(&mut self, state: &TrueState, reference: &ReferencePoint) {
        self.measure(state, reference);
        if state.time_s > SETTLING_S {
            self.cross_tracks_m.push(self.cross_track_m);
            self.along_squares += self.along_track_m.powi(2);
            self.heading_squares += self.heading_error_rad.powi(2);
        }
    }

    /// Counts one control cycle and returns its row.
    fn cycle(
        &mut self,
        state: &TrueState,
        decision: &Decision,
        reference: &ReferencePoint,
        cycle_us: f64,
        prepared: &Prepared,
    ) -> Row {
        self.measure(state, reference);
        let command = decision.command;
        if state.time_s > SETTLING_S {
            self.steer_variation_m_s += (command.steer_m_s - self.last_command.steer_m_s).abs();
        }
        if !self.permitted(command) {
            self.violations += 1;
        }
        self.last_command = command;
        self.fallbacks += u32::from(matches!(decision.status, Status::Fallback { .. }));
        self.deadline_misses += u32::from(cycle_us > 1e6 * self.period_s);
        Row {
            time_s: state.time_s,
            pose: state.pose,
            attitude: state.attitude,
            estimate: decision.estimate.map(|estimate| estimate.pose),
            reference: reference.pose(),
            cross_track_m: self.cross_track_m,
            along_track_m: self.along_track_m,
            heading_error_rad: self.heading_error_rad,
            command,
            motors: state.motors,
            icrs: prepared.vehicle.icrik(state.attitude, state.treads),
            status: decision.status,
            qp_iterations: decision.solve.map_or(0, |s| s.iterations),
            qp_path: decision.solve.map(|s| s.path),
            solve_us: decision.solve.map_or(0.0, |s| 1e6 * s.solve_time_s),
            cycle_us,
        }
    }

    /// Returns whether a command keeps bounds and rates, independently of the controller's own
    /// projection but for the limits' definition.
    fn permitted(&self, command: MotorSpeeds) -> bool {
        const ROUNDING: f64 = 1e-9;
        let one = |now: f64, before: f64, motor: &MotorLimits| {
            let change = motor.change(before, self.period_s);
            now.abs() <= motor.speed_m_s + ROUNDING
                && now - before <= change.rise + ROUNDING
                && before - now <= change.fall + ROUNDING
        };
        let (now, before) = (command, self.last_command);
        command.is_finite()
            && one(now.traction_m_s, before.traction_m_s, &self.limits.traction)
            && one(now.steer_m_s, before.steer_m_s, &self.limits.steer)
            && now.traction_m_s.abs() + now.steer_m_s.abs()
                <= self.limits.tread_speed_m_s + ROUNDING
    }

    fn summary(
        self,
        prepared: &Prepared,
        kind: ControllerKind,
        ending: Result<(), String>,
        rows: &[Row],
        reference: ReferencePoint,
    ) -> Summary {
        let goal = match prepared.trajectory.ending() {
            Ending::Periodic => reference.position,
            Ending::Stop => {
                prepared
                    .trajectory
                    .at(prepared.trajectory.duration_s())
                    .position
            }
        };
        let goal_error_m = goal.distance_m(&self.position);
        // A closed course has no place to stop at: who is late but on the path has driven it.
        let (miss_m, missed) = match prepared.trajectory.ending() {
            Ending::Periodic => (self.cross_track_m.abs(), "path"),
            Ending::Stop => (goal_error_m, "goal"),
        };
        let ended_by = match ending {
            Err(reason) => Some(reason),
            Ok(()) if miss_m > GOAL_TOLERANCE_M => Some(format!(
                "{miss_m:.2} m from the {missed}, more than {GOAL_TOLERANCE_M} m"
            )),
            Ok(()) => None,
        };
        let count = self.cross_tracks_m.len().max(1) as f64;
        let root_mean = |squares: f64| (squares / count).sqrt();
        let squares = self.cross_tracks_m.iter().map(|e| e * e).sum();
        let mut absolute: Vec<f64> = self.cross_tracks_m.iter().map(|e| e.abs()).collect();
        absolute.sort_by(f64::total_cmp);
        let solves = rows.iter().filter(|row| row.qp_iterations > 0);
        let solved = |path| rows.iter().filter(|row| row.qp_path == Some(path)).count() as u32;
        let iterations: u64 = solves.clone().map(|row| u64::from(row.qp_iterations)).sum();
        Summary {
            controller: kind.name().to_owned(),
            plant: prepared.plant.kind().name().to_owned(),
            scenario: prepared.name.clone(),
            seed: prepared.seed,
            completed: ended_by.is_none(),
            ended_by,
            cross_track_rms_m: root_mean(squares),
            cross_track_p95_m: nearest_rank(&absolute, 0.95).unwrap_or(0.0),
            cross_track_max_m: absolute.last().copied().unwrap_or(0.0),
            along_track_rms_m: root_mean(self.along_squares),
            heading_rms_rad: root_mean(self.heading_squares),
            steer_total_variation_m_s: self.steer_variation_m_s,
            goal_error_m,
            constraint_violations: self.violations,
            fallbacks: self.fallbacks,
            deadline_misses: self.deadline_misses,
            qp_iterations_mean: iterations as f64 / solves.clone().count().max(1) as f64,
            qp_working_set: solved(SolvePath::WorkingSet),
            qp_interior_point: solved(SolvePath::InteriorPoint),
            qp_cut_short: solved(SolvePath::CutShort),
            solve_us: Quantiles::of(solves.map(|row| row.solve_us).collect()),
            cycle_us: Quantiles::of(rows.iter().map(|row| row.cycle_us).collect()),
        }
    }
}
