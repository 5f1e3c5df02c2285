//! Times of a control cycle and its parts on the figure of eight at 10 deg: `cargo bench --bench cycle`.
//!
//! Everything is replayed from one drive in closed loop, so that all variants see the same inputs.

// A bench that cannot be set up has nothing to report.
#![allow(clippy::unwrap_used, missing_docs)]

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use nalgebra::Vector3;
use sidehill::closed_loop;
use sidehill::config::{Conditions, ConfigFile, Overrides, Scenario};
use sidehill::qp_recording::QpRecording;
use sidehill_controller::config::{ControllerConfig, ControllerKind};
use sidehill_controller::controller::{Controller, Status};
use sidehill_controller::course::FigureEight;
use sidehill_controller::mpc::{
    Horizon, Mpc, MpcSettings, QpMode, QpSettings, QpSolver, SolvePath, StageQp, StageTarget,
    StageWeights,
};
use sidehill_controller::reference::Reference;
use sidehill_controller::tracked_point::TrackedPoint;
use sidehill_controller::trajectory::Trajectory;
use sidehill_plant::contact::BodyState;
use sidehill_plant::drive_train::DriveTrainConfig;
use sidehill_plant::prediction::PredictionModel;
use sidehill_plant::sample::Sample;
use sidehill_plant::sensors::SensorsConfig;
use sidehill_plant::simulation::{Simulation, SimulationSetup};
use sidehill_plant::speeds::MotorSpeeds;
use sidehill_plant::terrain::{PlaneTerrain, Terrain};
use sidehill_plant::vehicle::IcrMotion;
use sidehill_plant::vehicle::Vehicle;
use std::hint::black_box;
use std::path::Path;
use std::time::{Duration, Instant};

const HORIZONS: [usize; 5] = [20, 30, 40, 60, 80];
const SLOPE_DEG: f64 = 10.0;
/// One round of the course at 20 Hz.
const CYCLES: usize = 1200;

fn vehicle() -> Vehicle {
    serde_yaml::from_str(include_str!("../config/vehicles/j8.yaml")).unwrap()
}

fn trajectory() -> Trajectory {
    FigureEight::default().trajectory().unwrap()
}

fn controller(config: &ControllerConfig) -> Controller {
    let mut controller =
        Controller::new(ControllerKind::IcrikMpc, config.clone(), &vehicle()).unwrap();
    controller.follow(Reference::new(trajectory()).for_laps(2));
    controller
}

/// What the sensors read and what was commanded in a round driven with `config`.
fn drive(config: &ControllerConfig) -> Vec<(Sample, MotorSpeeds)> {
    let start = trajectory().at(0.0);
    let mut simulation = Simulation::new(SimulationSetup {
        terrain: Terrain::Plane(PlaneTerrain::new(SLOPE_DEG, 0.0).unwrap()),
        motion: Box::new(IcrMotion {
            vehicle: vehicle(),
            inclined: true,
        }),
        drive_train: DriveTrainConfig::default(),
        sensors: SensorsConfig::default(),
        encoder_scale: vehicle().encoder_scale,
        start: start.pose(),
        dt_s: config.period_s / 10.0,
        seed: 1,
    })
    .unwrap();
    let mut controller = controller(config);
    (0..CYCLES)
        .map(|_| {
            let sample = simulation.sample();
            let decision = controller.step(&sample, None);
            assert_eq!(decision.status, Status::Tracking);
            simulation.set_command(decision.command_effective).unwrap();
            for _ in 0..10 {
                simulation.step().unwrap();
            }
            (sample, decision.command_effective)
        })
        .collect()
}

/// Returns the time of `count` cycles after the first one of a replay, which makes a plan from nothing.
fn replay(config: &ControllerConfig, samples: &[(Sample, MotorSpeeds)], count: u64) -> Duration {
    let mut total = Duration::ZERO;
    let mut done = 0;
    while done < count {
        let mut controller = controller(config);
        for (i, (sample, _)) in samples.iter().enumerate() {
            let begin = Instant::now();
            black_box(controller.step(black_box(sample), None));
            let time = begin.elapsed();
            if i > 0 {
                total += time;
                done += 1;
            }
            if done == count {
                break;
            }
        }
    }
    total
}

fn horizon(stages: usize) -> ControllerConfig {
    ControllerConfig {
        stages,
        ..ControllerConfig::default()
    }
}

/// The whole cycle, from sample to command.
fn cycle(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("cycle");
    for stages in HORIZONS {
        let config = horizon(stages);
        let samples = drive(&config);
        group.bench_function(BenchmarkId::from_parameter(stages), |bencher| {
            bencher.iter_custom(|count| replay(&config, &samples, count));
        });
    }
    group.finish();
}

/// The whole cycle at 40 stages: by the active rows, and by the interior-point method in each cycle.
fn solver_modes(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("cycle_40_stages");
    let active_set = horizon(40);
    let samples = drive(&active_set);
    let mut interior_point = active_set.clone();
    interior_point.solver.mode = QpMode::InteriorPoint;
    for (name, config) in [
        ("active_set", &active_set),
        ("interior_point", &interior_point),
    ] {
        group.bench_function(name, |bencher| {
            bencher.iter_custom(|count| replay(config, &samples, count));
        });
    }
    group.finish();
}

/// One of the stages from horizon to solution.
#[derive(Clone, Copy, PartialEq)]
enum Part {
    Linearise,
    Assemble,
    Solve,
}

fn normal_in_world() -> Vector3<f64> {
    let slope = SLOPE_DEG.to_radians();
    Vector3::new(0.0, -slope.sin(), slope.cos())
}

/// Returns the horizons of a drive.
fn horizons(
    config: &ControllerConfig,
    settings: &MpcSettings,
    samples: &[(Sample, MotorSpeeds)],
) -> Vec<Horizon> {
    let (trajectory, times) = (trajectory(), settings.stage_times());
    let mut previous = MotorSpeeds::STOP;
    samples
        .iter()
        .map(|(sample, command)| {
            let targets = (0..settings.stages)
                .map(|k| {
                    let point = trajectory.at(sample.time_s + times.end_s(k));
                    StageTarget {
                        tracked_point: TrackedPoint::ORIGIN,
                        pose: point.pose(),
                        along_heading_rad: point.heading_rad,
                        curvature_per_m: 0.0,
                        normal_in_world: normal_in_world(),
                        feedforward: MotorSpeeds {
                            traction_m_s: point.speed_m_s,
                            steer_m_s: point.yaw_rate_rad_s,
                        },
                        speed_m_s: point.speed_m_s,
                        slip: Vector3::zeros(),
                        weights: StageWeights {
                            along_per_m2: 0.0,
                            cross_per_m2: config.weights.cross_per_m2,
                            heading_per_rad2: config.weights.heading_per_rad2,
                            speed_s2_per_m2: config.weights.speed / point.speed_m_s.powi(2),
                        },
                        errors_share: 1.0,
                    }
                })
                .collect();
            let horizon = Horizon {
                start: sample.pose.unwrap().value.planar(),
                moving: BodyState::default(),
                previous,
                change_weights: config.weights.changes(),
                half_track_m: 1.0,
                targets,
            };
            previous = *command;
            horizon
        })
        .collect()
}

/// Returns the time that `count` cycles spend in `part`.
fn replay_part(
    config: &ControllerConfig,
    samples: &[(Sample, MotorSpeeds)],
    part: Part,
    count: u64,
) -> Duration {
    let settings = config.mpc();
    let horizons = horizons(config, &settings, samples);
    let mut total = Duration::ZERO;
    let mut done = 0;
    while done < count {
        let model = PredictionModel::new(vehicle(), config.smoothing_m_s);
        let mut mpc = Mpc::new(settings.clone(), model).unwrap();
        for (i, horizon) in horizons.iter().enumerate() {
            mpc.move_on(config.period_s, 1.0, &normal_in_world());
            if i == 0 {
                // The first call is that of the horizon's begin.
                let mut calls: usize = 0;
                mpc.try_first_plan(horizon, |_, _, _| {
                    calls += 1;
                    horizon.targets[calls.saturating_sub(2)]
                });
            }
            let start = Instant::now();
            let linearised = mpc.linearise(black_box(horizon));
            let linearised_at = Instant::now();
            let assembled = linearised.assemble();
            let assembled_at = Instant::now();
            black_box(assembled.solve(None)).unwrap();
            let solved_at = Instant::now();
            // The first cycle solves about a plan that no other was.
            if i == 0 {
                continue;
            }
            total += match part {
                Part::Linearise => linearised_at - start,
                Part::Assemble => assembled_at - linearised_at,
                Part::Solve => solved_at - assembled_at,
            };
            done += 1;
            if done == count {
                break;
            }
        }
    }
    total
}

/// The parts of a cycle over horizons.
fn parts(criterion: &mut Criterion) {
    for (name, part) in [
        ("linearise", Part::Linearise),
        ("assemble", Part::Assemble),
        ("solve", Part::Solve),
    ] {
        let mut group = criterion.benchmark_group(name);
        for stages in HORIZONS {
            let config = horizon(stages);
            let samples = drive(&config);
            group.bench_function(BenchmarkId::from_parameter(stages), |bencher| {
                bencher.iter_custom(|count| replay_part(&config, &samples, part, count));
            });
        }
        group.finish();
    }
}

/// Returns the QPs of a drive at the end of grip, in most of whose cycles limits bind.
fn end_of_grip(stages: usize) -> Vec<StageQp> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/scenarios");
    let file = ConfigFile::read(&folder.join("figure_eight_15deg.yaml")).unwrap();
    let file = Conditions::read(Path::new("realistic"))
        .unwrap()
        .put_into(&file)
        .unwrap();
    let mut prepared = Scenario::read(file)
        .unwrap()
        .prepare(&Overrides {
            seed: Some(42),
            controllers: vec![ControllerKind::IcrikMpc],
            ..Overrides::default()
        })
        .unwrap();
    prepared.controller.stages = stages;
    let mut recording = QpRecording::default();
    closed_loop::run(
        &prepared,
        ControllerKind::IcrikMpc,
        |_| {},
        Some(&mut recording),
    )
    .unwrap();
    recording.qps().to_vec()
}

/// Returns the time that a solver takes for `count` QPs of `qps`, in their order, of those that the
/// active set solves in the way of `path`.
fn replay_solves(qps: &[StageQp], mode: QpMode, path: SolvePath, count: u64) -> Duration {
    let settings = QpSettings {
        mode,
        ..QpSettings::default()
    };
    let mut total = Duration::ZERO;
    let mut done = 0;
    while done < count {
        let mut chooser = QpSolver::new(qps[0].clone(), QpSettings::default()).unwrap();
        let mut solver = QpSolver::new(qps[0].clone(), settings).unwrap();
        for qp in qps {
            chooser.qp_mut().clone_from(qp);
            black_box(chooser.solve(None)).unwrap();
            solver.qp_mut().clone_from(qp);
            let begin = Instant::now();
            let solved = black_box(solver.solve(None));
            if solved.is_ok() && chooser.path() == path {
                total += begin.elapsed();
                done += 1;
            }
            if done == count {
                break;
            }
        }
    }
    total
}

/// The QPs of a drive at the end of grip: those where nothing binds, those with binding limits by the
/// rows that bind, and the same by the interior-point method.
fn solves(criterion: &mut Criterion) {
    for (name, mode, path) in [
        ("solve_relaxed", QpMode::ActiveSet, SolvePath::Relaxed),
        ("solve_active_set", QpMode::ActiveSet, SolvePath::ActiveSet),
        ("solve_whole", QpMode::InteriorPoint, SolvePath::ActiveSet),
    ] {
        let mut group = criterion.benchmark_group(name);
        for stages in HORIZONS {
            let qps = end_of_grip(stages);
            group.bench_function(BenchmarkId::from_parameter(stages), |bencher| {
                bencher.iter_custom(|count| replay_solves(&qps, mode, path, count));
            });
        }
        group.finish();
    }
}

criterion_group!(benches, cycle, solver_modes, parts, solves);
criterion_main!(benches);
