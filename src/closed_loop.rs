//! A controller driving the simulated vehicle of a scenario.

use crate::config::Prepared;
use crate::guard_watch::GuardWatch;
use crate::record::{Quantiles, Row, Run, Summary};
use anyhow::Result;
use serde::Serialize;
use sidehill_controller::closed_loop::{
    Account, ClosedLoop, Cycle, Driver, LapFigures, RunEnd, SETTLING_S, TrackingFigures,
};
use sidehill_controller::config::ControllerKind;
use sidehill_controller::controller::{AHEAD_S, Controller, StopReason};
use sidehill_controller::guard::SteepPlace;
use sidehill_controller::mpc::SolvePath;
use sidehill_controller::reference::stands;
use sidehill_controller::trajectory::Ending;
use sidehill_plant::simulation::{Plant, TrueState};
use sidehill_plant::speeds::MotorSpeeds;
use std::ops::Deref;

/// Farthest from the end of its path, or from a closed path, at which a run counts as completed, m;
/// Nav2's default.
const GOAL_TOLERANCE_M: f64 = 0.25;
/// Cycles between two reports of the progress.
const PROGRESS_CYCLES: usize = 20;

/// Observes a run.
pub trait Observer {
    /// Called with the controller before its first cycle.
    ///
    /// # Errors
    /// What ends the run.
    fn begin(&mut self, controller: &Controller) -> Result<()>;

    /// Called after each cycle.
    ///
    /// # Errors
    /// What ends the run.
    fn cycle(&mut self, cycle: &Cycle, controller: &Controller) -> Result<()>;
}

/// Returns the run of one controller. `progress` is called with the completed share, 0 to 1, once per second of
/// simulated time, and `observer` in each cycle.
///
/// # Errors
/// Why the run cannot start: invalid settings, or no ground under the start.
pub fn run(
    prepared: &Prepared,
    kind: ControllerKind,
    progress: impl FnMut(f64),
    observer: Option<&mut dyn Observer>,
) -> Result<Run> {
    let name = prepared.plant.kind().name();
    run_plant(
        prepared,
        kind,
        prepared.simulation()?,
        name,
        progress,
        observer,
    )
}

/// Returns the run of one controller with another plant, of that name, than the scenario's own.
///
/// # Errors
/// As [`run`].
pub fn run_plant<P: Plant>(
    prepared: &Prepared,
    kind: ControllerKind,
    plant: P,
    name: &str,
    mut progress: impl FnMut(f64),
    mut observer: Option<&mut dyn Observer>,
) -> Result<Run> {
    let mut drive = Drive::new(prepared, kind, plant, name)?;
    if let Some(observer) = &mut observer {
        observer.begin(drive.controller())?;
    }
    while let Some(cycle) = drive.decide() {
        if let Some(observer) = &mut observer {
            observer.cycle(&cycle, drive.controller())?;
        }
        if drive.rows.len() % PROGRESS_CYCLES == 0 {
            progress(cycle.progress);
        }
        drive.advance();
    }
    progress(1.0);
    Ok(Run {
        learned: drive.controller().learned(),
        summary: drive.summary(),
        rows: drive.rows,
    })
}

/// Names of a run in tables.
#[derive(Debug, Clone, Copy)]
pub struct RunNames<'a> {
    /// Controller.
    pub controller: &'a str,
    /// Plant.
    pub plant: &'a str,
}

/// Returns the run of a law of the user's own with a plant.
///
/// # Errors
/// As [`run`].
pub fn run_law<P: Plant, C: Driver>(
    prepared: &Prepared,
    law: C,
    plant: P,
    names: RunNames<'_>,
) -> Result<Run> {
    let mut drive = Drive::of(prepared, law, plant, names)?;
    while drive.decide().is_some() {
        drive.advance();
    }
    Ok(Run {
        learned: None,
        summary: drive.summary(),
        rows: drive.rows,
    })
}

/// A run under way: call [`Drive::decide`] and [`Drive::advance`] in turn.
pub struct Drive<S, P, C = Controller> {
    prepared: S,
    controller_name: String,
    plant_name: String,
    closed_loop: ClosedLoop<P, C>,
    guard: Option<GuardWatch>,
    refused: Option<SteepPlace>,
    rows: Vec<Row>,
    ended: Option<Result<RunEnd, String>>,
}

impl<S: Deref<Target = Prepared>, P: Plant> Drive<S, P> {
    /// Begins the run of one controller with a plant of that name.
    ///
    /// # Errors
    /// Settings out of range.
    pub fn new(prepared: S, kind: ControllerKind, plant: P, name: &str) -> Result<Self> {
        let controller = prepared.controller(kind)?;
        let names = RunNames {
            controller: kind.name(),
            plant: name,
        };
        Self::of(prepared, controller, plant, names)
    }
}

impl<S: Deref<Target = Prepared>, P: Plant, C: Driver> Drive<S, P, C> {
    /// Begins the run of a controller or a law of the user's own.
    ///
    /// # Errors
    /// A control period that does not fit the plant.
    pub fn of(prepared: S, controller: C, plant: P, names: RunNames<'_>) -> Result<Self> {
        let refused = prepared.refused_place();
        let stance = prepared.stance();
        Ok(Self {
            controller_name: names.controller.to_owned(),
            plant_name: names.plant.to_owned(),
            closed_loop: ClosedLoop::new(plant, controller)?,
            guard: stance.map(|stance| GuardWatch::new(stance, &prepared)),
            refused,
            rows: Vec::new(),
            ended: refused.map(|place| Ok(RunEnd::Stopped(StopReason::TooSteep { place }))),
            prepared,
        })
    }

    /// Returns the next control cycle; none where the run has ended.
    pub fn decide(&mut self) -> Option<Cycle> {
        if self.ended.is_some() {
            return None;
        }
        let cycle = self.closed_loop.decide();
        let slope = self.guard.as_mut().and_then(|guard| guard.watch(&cycle));
        self.rows.push(Row {
            slope,
            ..row(&cycle, &self.prepared)
        });
        self.ended = cycle.ending.map(Ok);
        Some(cycle)
    }

    /// Moves the plant on to the next cycle, unless the run has ended.
    pub fn advance(&mut self) {
        if self.ended.is_none()
            && let Err(error) = self.closed_loop.advance()
        {
            self.ended = Some(Err(error.to_string()));
        }
    }

    /// Returns whether the run has ended.
    pub fn has_ended(&self) -> bool {
        self.ended.is_some()
    }

    /// Returns the controller.
    pub fn controller(&self) -> &C {
        self.closed_loop.controller()
    }

    /// Returns the plant, for a hand that moves it.
    pub fn plant_mut(&mut self) -> &mut P {
        self.closed_loop.plant_mut()
    }

    /// Returns the figures so far; a run that has not ended is not completed.
    pub fn summary(&self) -> Summary {
        let figures = self.closed_loop.figures();
        let ended_by = match &self.ended {
            None => Some("under way".to_owned()),
            Some(Ok(RunEnd::Finished)) => missed(&self.prepared, &figures),
            Some(Ok(end)) if self.refused.is_some() => Some(format!("refused, {end}")),
            Some(Ok(end)) => Some(end.to_string()),
            Some(Err(error)) => Some(error.clone()),
        };
        let rows = &self.rows;
        let solves = rows.iter().filter(|row| row.qp_iterations > 0);
        let solved = |path| rows.iter().filter(|row| row.qp_path == Some(path)).count() as u32;
        let iterations: u64 = solves.clone().map(|row| u64::from(row.qp_iterations)).sum();
        Summary {
            controller: self.controller_name.clone(),
            plant: self.plant_name.clone(),
            scenario: self.prepared.name.clone(),
            seed: self.prepared.seed,
            completed: ended_by.is_none(),
            ended_by,
            cross_track_rms_m: figures.cross_track_rms_m,
            cross_track_p95_m: figures.cross_track_p95_m,
            cross_track_max_m: figures.cross_track_max_m,
            cross_track_bound_held: bound_held(rows),
            cross_track_ahead_bound_held: ahead_bound_held(rows),
            origin_cross_track_rms_m: figures.origin_cross_track_rms_m,
            along_track_rms_m: figures.along_track_rms_m,
            laps: several(self.closed_loop.laps()),
            guard: self.guard.as_ref().map(|guard| guard.summary(self.refused)),
            heading_rms_rad: figures.heading_rms_rad,
            steer_total_variation_m_s: figures.steer_total_variation_m_s,
            goal_error_m: figures.goal_error_m,
            mean_speed_m_s: figures.mean_speed_m_s,
            time_s: figures.time_s,
            tread_speed_max_m_s: figures.tread_speed_max_m_s,
            constraint_violations: figures.constraint_violations,
            fallbacks: figures.fallbacks,
            deadline_misses: figures.deadline_misses,
            qp_iterations_mean: iterations as f64 / solves.clone().count().max(1) as f64,
            qp_working_set: solved(SolvePath::ActiveSet),
            qp_interior_point: solved(SolvePath::InteriorPoint),
            qp_cut_short: solved(SolvePath::CutShort),
            solve_us: Quantiles::of(solves.map(|row| row.solve_us).collect()),
            cycle_us: Quantiles::of(rows.iter().map(|row| row.cycle_us).collect()),
        }
    }
}

/// Returns the share of cycles, once the vehicle is under way, whose true position is within the estimate's bound.
fn bound_held(rows: &[Row]) -> Option<f64> {
    share_held(under_way(rows).filter_map(Row::holds_bound))
}

/// Returns the share of cycles, once the vehicle is under way, whose true distance from the path [`AHEAD_S`] later is
/// within the bound of the prediction.
fn ahead_bound_held(rows: &[Row]) -> Option<f64> {
    let mut later = rows.iter().peekable();
    share_held(under_way(rows).filter_map(|row| {
        let then_s = row.time_s + AHEAD_S - 1e-6;
        while later.next_if(|later| later.time_s < then_s).is_some() {}
        let (ahead, then) = row.ahead.zip(later.peek())?;
        Some((then.cross_track_m - ahead.cross_track_m).abs() <= ahead.bound_m)
    }))
}

/// Returns the cycles from when the vehicle is under way.
fn under_way(rows: &[Row]) -> impl Iterator<Item = &Row> {
    let begin_s = rows.first().map_or(0.0, |row| row.time_s) + SETTLING_S;
    rows.iter().filter(move |row| row.time_s >= begin_s)
}

/// Returns the share of cycles that hold; none without any.
fn share_held(holds: impl Iterator<Item = bool>) -> Option<f64> {
    let (held, cycles) = holds.fold((0_u32, 0_u32), |(held, cycles), holds| {
        (held + u32::from(holds), cycles + 1)
    });
    (cycles > 0).then(|| f64::from(held) / f64::from(cycles))
}

/// Returns why a finished run does not count as completed.
fn missed(prepared: &Prepared, figures: &TrackingFigures) -> Option<String> {
    let missed = match prepared.reference.trajectory().ending() {
        Ending::Periodic => "path",
        Ending::Stop => "goal",
    };
    let miss_m = figures.miss_m;
    (miss_m > GOAL_TOLERANCE_M)
        .then(|| format!("{miss_m:.2} m from the {missed}, more than {GOAL_TOLERANCE_M} m"))
}

fn row(cycle: &Cycle, prepared: &Prepared) -> Row {
    let (state, decision) = (&cycle.state, &cycle.decision);
    Row {
        time_s: state.time_s,
        pose: state.pose,
        attitude: state.attitude,
        estimate: decision.estimate.map(|estimate| estimate.pose),
        cross_track_bound_m: decision.cross_track_bound_m(),
        ahead: decision.ahead,
        slope: None,
        reference: cycle.reference.pose(),
        tracked: cycle.tracked.map(|point| [point.x_m, point.y_m]),
        cross_track_m: cycle.errors.cross_track_m,
        along_track_m: cycle.errors.along_track_m,
        heading_error_rad: cycle.errors.heading_error_rad,
        command: decision.command_effective,
        motors: state.motors,
        tread_speeds: prepared.plant.encoder_scale().invert(state.treads),
        icrs: prepared.vehicle.icrik(state.attitude, state.treads),
        contact: decision.estimate.and_then(|estimate| estimate.contact),
        status: decision.status,
        qp_iterations: decision.solve.map_or(0, |s| s.iterations),
        qp_path: decision.solve.map(|s| s.path),
        solve_us: decision.solve.map_or(0.0, |s| 1e6 * s.solve_time_s),
        cycle_us: 1e6 * cycle.duration.as_secs_f64(),
    }
}

/// A state of a log, with what is known beside it.
#[derive(Debug, Clone, Copy)]
pub struct LoggedState {
    /// Time, pose and, where they are known, attitude and effective tread speeds.
    pub state: TrueState,
    /// Effective command given there.
    pub command: Option<MotorSpeeds>,
}

/// The figures of a log, as [`Summary`] has them; what a log does not tell is none.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LogFigures {
    completed: bool,
    cross_track_rms_m: f64,
    cross_track_p95_m: f64,
    cross_track_max_m: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    origin_cross_track_rms_m: Option<f64>,
    along_track_rms_m: f64,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    laps: Vec<LapFigures>,
    heading_rms_rad: f64,
    goal_error_m: f64,
    mean_speed_m_s: f64,
    time_s: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    steer_total_variation_m_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    constraint_violations: Option<u32>,
}

/// Returns how well a log follows a scenario's reference, up to its end; a step goes from one row to the next.
pub fn figures_of_log(prepared: &Prepared, log: &[LoggedState]) -> LogFigures {
    let mut reference = prepared.reference.clone();
    let mut account = Account::new(&reference, &prepared.controller);
    let mut point = reference.ahead(0.0);
    let tracked = account.tracked_point();
    let (mut ended, mut told, mut before_s) = (false, MotorSpeeds::STOP, None);
    for LoggedState { state, command } in log {
        if before_s.is_some() {
            account.step(reference.path(), state, &point);
        }
        let normal = state.attitude.plane_normal(state.pose.yaw_rad);
        let elapsed_s = state.time_s - before_s.unwrap_or(state.time_s);
        let place = tracked.of(&state.pose.planar(), &normal);
        let stands = command.is_some() && stands(told);
        ended = reference.advance(elapsed_s, &place, stands).ended;
        point = reference.ahead(0.0);
        told = command.unwrap_or(told);
        account.cycle(reference.path(), state, &point, told);
        before_s = Some(state.time_s);
        if ended {
            break;
        }
    }
    let figures = account.figures(Some(&reference), &point);
    let commanded = log.iter().any(|row| row.command.is_some());
    let laps = account.laps();
    LogFigures {
        completed: ended && missed(prepared, &figures).is_none(),
        cross_track_rms_m: figures.cross_track_rms_m,
        cross_track_p95_m: figures.cross_track_p95_m,
        cross_track_max_m: figures.cross_track_max_m,
        origin_cross_track_rms_m: figures.origin_cross_track_rms_m,
        along_track_rms_m: figures.along_track_rms_m,
        laps: several(laps),
        heading_rms_rad: figures.heading_rms_rad,
        goal_error_m: figures.goal_error_m,
        mean_speed_m_s: figures.mean_speed_m_s,
        time_s: figures.time_s,
        steer_total_variation_m_s: commanded.then_some(figures.steer_total_variation_m_s),
        constraint_violations: commanded.then_some(figures.constraint_violations),
    }
}

/// Returns the figures of laps where there are several.
fn several(laps: &[LapFigures]) -> Vec<LapFigures> {
    match laps {
        [_, _, ..] => laps.to_vec(),
        _ => Vec::new(),
    }
}
