//! The whole bridge in virtual time: controller, safety, cycle and a simulated vehicle.
#![allow(clippy::unwrap_used)]

use sidehill_bridge::control_loop::channel::{PathCommand, command_channel};
use sidehill_bridge::control_loop::learned::learned_channel;
use sidehill_bridge::control_loop::record::{LogEntry, LoopRecord, Record, RecordSource, ring};
use sidehill_bridge::control_loop::runner::{ControllerRunner, InlineRunner, ThreadedRunner};
use sidehill_bridge::control_loop::{
    ControlLoop, CycleConfig, LoopSetup, RunEnding, RunOptions, Signals,
};
use sidehill_bridge::drives::{Clock, DriveCommand, Epoch, Port, PortInputs, SendError};
use sidehill_bridge::rover::{DriveConfig, SimulatedPort};
use sidehill_bridge::safety::{
    Geofence, OperatorRequests, Reason, SafetyConfig, SafetyState, StopCause,
};
use sidehill_controller::config::{ControllerConfig, ControllerKind};
use sidehill_controller::controller::{Controller, Decision, Status, StopReason};
use sidehill_controller::course::FigureEight;
use sidehill_controller::path::{Point2, Window};
use sidehill_controller::reference::Reference;
use sidehill_plant::frames::PlanarPose;
use sidehill_plant::sample::Sample;
use sidehill_plant::simulation::{Simulation, SimulationSetup};
use sidehill_plant::speeds::MotorSpeeds;
use sidehill_plant::terrain::{PlaneTerrain, Terrain};
use sidehill_plant::vehicle::IcrMotion;
use sidehill_plant::vehicle::Vehicle;
use std::time::Duration;

const ARM: OperatorRequests = OperatorRequests {
    arm: true,
    stop: None,
    halt: None,
};
const NOTHING: OperatorRequests = OperatorRequests {
    arm: false,
    stop: None,
    halt: None,
};

fn j8() -> Vehicle {
    serde_yaml::from_str(include_str!("../../config/vehicles/j8.yaml")).unwrap()
}

fn port() -> SimulatedPort {
    port_with(
        "{traction: {acceleration_max_m_s2: 2, deceleration_max_m_s2: 2}, steer: {acceleration_max_m_s2: 2, deceleration_max_m_s2: 2}}",
    )
}

fn port_with(drive_train: &str) -> SimulatedPort {
    let vehicle = j8();
    let start = FigureEight::default().trajectory().unwrap().at(0.0);
    let setup = SimulationSetup {
        terrain: Terrain::Plane(PlaneTerrain::new(5.3, 0.0).unwrap()),
        encoder_scale: vehicle.encoder_scale,
        motion: Box::new(IcrMotion {
            vehicle: vehicle.clone(),
            inclined: true,
        }),
        drive_train: serde_yaml::from_str(drive_train).unwrap(),
        sensors: Default::default(),
        start: PlanarPose {
            x_m: 0.0,
            y_m: 0.0,
            yaw_rad: start.heading_rad,
        },
        dt_s: 0.005,
        seed: 1,
    };
    let simulation = Simulation::new(setup).unwrap();
    SimulatedPort::new(
        simulation,
        0.005,
        vehicle.encoder_scale,
        DriveConfig::default(),
    )
    .unwrap()
}

fn cycle<Q: ControllerRunner>(
    pilot: Q,
) -> (ControlLoop<SimulatedPort, Q>, RecordSource<LoopRecord>) {
    cycle_of(CycleConfig::default(), pilot)
}

fn cycle_of<Q: ControllerRunner>(
    config: CycleConfig,
    pilot: Q,
) -> (ControlLoop<SimulatedPort, Q>, RecordSource<LoopRecord>) {
    cycle_over(port(), config, SafetyConfig::default(), pilot)
}

fn cycle_over<Q: ControllerRunner>(
    port: SimulatedPort,
    config: CycleConfig,
    safety: SafetyConfig,
    pilot: Q,
) -> (ControlLoop<SimulatedPort, Q>, RecordSource<LoopRecord>) {
    let (sink, source) = ring(64);
    let cycle = ControlLoop::new(
        config,
        safety,
        Clock::Virtual { now_s: 0.0 },
        port,
        pilot,
        sink,
    )
    .unwrap();
    (cycle, source)
}

fn controller(period_s: f64) -> Controller {
    let config = ControllerConfig {
        period_s,
        ..ControllerConfig::default()
    };
    let trajectory = FigureEight::default().trajectory().unwrap();
    let reference = Reference::new(trajectory);
    let mut controller = Controller::new(ControllerKind::IcrikMpc, config, &j8()).unwrap();
    controller.follow(reference);
    controller
}

/// Wants a constant speed, until it hangs.
struct Constant {
    from_s: f64,
    hangs_s: f64,
    last: Option<Decision>,
}

impl ControllerRunner for Constant {
    fn decide(&mut self, sample: &Sample, _: bool, _: Option<Duration>) -> Option<Decision> {
        if sample.time_s < self.hangs_s && sample.time_s >= self.from_s {
            self.last = Some(Decision::of_command(
                sample.time_s,
                MotorSpeeds {
                    traction_m_s: 0.5,
                    steer_m_s: 0.1,
                },
                Status::Tracking,
            ));
        }
        self.last
    }
}

fn constant(hangs_s: f64) -> Constant {
    Constant {
        from_s: 0.0,
        hangs_s,
        last: None,
    }
}

/// A vehicle whose drives are switched on only later.
struct SwitchedOn {
    vehicle: SimulatedPort,
    from_s: f64,
}

impl Port for SwitchedOn {
    fn receive(&mut self, now_s: f64) -> PortInputs {
        let mut inputs = self.vehicle.receive(now_s);
        inputs.feedback = inputs.feedback.filter(|_| now_s >= self.from_s);
        inputs
    }

    fn send(&mut self, now_s: f64, command: &DriveCommand) -> Result<(), SendError> {
        self.vehicle.send(now_s, command)
    }
}

#[test]
fn a_request_to_arm_at_the_start_expires_before_drives_that_are_switched_on_late() {
    for (from_s, moves) in [(4.0, true), (12.0, false)] {
        let port = SwitchedOn {
            vehicle: port(),
            from_s,
        };
        let (sink, mut records) = ring(1024);
        // No cycle begins exactly when the request expires.
        let config = CycleConfig {
            period_s: 0.03,
            decision_time_s: 0.02,
        };
        let mut cycle = ControlLoop::new(
            config,
            SafetyConfig::default(),
            Clock::Virtual { now_s: 0.0 },
            port,
            constant(f64::INFINITY),
            sink,
        )
        .unwrap();
        let options = RunOptions {
            arm: true,
            duration_s: Some(16.0),
        };
        cycle.run(&options, &Signals::default(), None);
        let mut expired = false;
        let mut moved = false;
        while let Some(record) = records.pop() {
            match record {
                LoopRecord::ArmingExpired { .. } => expired = true,
                LoopRecord::Cycle(row) => moved |= row.traction_m_s != 0.0 || row.enable,
                _ => {}
            }
        }
        assert_eq!((moved, expired), (moves, !moves), "drives from {from_s} s");
    }
}

#[test]
fn the_vehicle_stops_before_the_edge_of_the_geofence_and_stays() {
    // The figure of eight reaches 3.9 m along Y_g.
    for edge_m in [1.0, 2.5, 3.5] {
        let corners = vec![[-9.0, -9.0], [9.0, -9.0], [9.0, edge_m], [-9.0, edge_m]];
        let geofence = Geofence::try_from(corners).unwrap();
        let (cycle, _records) = cycle(InlineRunner::new(controller(0.05)));
        let mut cycle = cycle.within(Some(geofence));
        let mut highest_m = f64::NEG_INFINITY;
        for i in 0..600 {
            // An operator who arms again and again.
            cycle.step(if i > 5 && i % 100 > 0 { ARM } else { NOTHING });
            highest_m = highest_m.max(cycle.port().state().pose.y_m);
        }
        assert_eq!(cycle.stopped_by(), Some(Reason::Geofence));
        assert!(
            (edge_m - 0.5..edge_m).contains(&highest_m),
            "{highest_m} of {edge_m}"
        );
    }
}

/// Drives for `cycles` cycles, and returns the time in which it drove, s, the root mean square of the
/// distance from the path after 2 s of it, m, and the state at the end.
fn follow(period_s: f64, cycles: usize) -> (f64, f64, SafetyState) {
    let config = CycleConfig {
        period_s,
        decision_time_s: 0.6 * period_s,
    };
    let (mut cycle, _records) = cycle_of(config, InlineRunner::new(controller(period_s)));
    let trajectory = FigureEight::default().trajectory().unwrap();
    let path = trajectory.path().unwrap();
    let mut errors = Vec::new();
    let mut reached_m = 0.0;
    let mut driving_s = 0.0;
    for i in 0..cycles {
        let row = cycle.step(if i > 5 { ARM } else { NOTHING });
        if row.state != SafetyState::Driving {
            continue;
        }
        driving_s += period_s;
        let pose = cycle.port().state().pose;
        let position = Point2 {
            x_m: pose.x_m,
            y_m: pose.y_m,
        };
        let found = path.nearest_within(
            &position,
            reached_m,
            &Window {
                behind_m: 1.0,
                ahead_m: 1.0,
            },
        );
        reached_m = found.point.arc_length_m;
        if driving_s > 2.0 {
            errors.push(found.cross_track_m);
        }
    }
    let square: f64 = errors.iter().map(|error| error * error).sum();
    let rms_m = (square / errors.len() as f64).sqrt();
    (driving_s, rms_m, cycle.state())
}

#[test]
fn the_figure_of_eight_is_followed_through_the_bridge() {
    let (driving_s, rms_m, state) = follow(0.05, 1400);
    // The lap takes 60 s at the speeds asked for, and some more from standstill; then the controller has finished and
    // the bridge latches.
    assert!((60.0..63.0).contains(&driving_s), "{driving_s}");
    assert_eq!(state, SafetyState::Latched);
    assert!(rms_m < 0.01, "{rms_m}");
}

#[test]
fn the_figure_of_eight_is_followed_at_100_hz() {
    let (driving_s, rms_m, state) = follow(0.01, 6_500);
    println!(
        "{driving_s:.2} s at 100 Hz: cross-track RMS {:.2} mm",
        1e3 * rms_m
    );
    assert!((60.0..63.0).contains(&driving_s), "{driving_s}");
    assert_eq!(state, SafetyState::Latched);
    assert!(rms_m < 0.01, "{rms_m}");
}

#[test]
fn time_outs_are_as_long_at_100_hz() {
    let config = CycleConfig {
        period_s: 0.01,
        decision_time_s: 0.006,
    };
    let (mut cycle, _records) = cycle_of(config, constant(3.0));
    let (mut moved, mut zero_s) = (false, 0.0);
    for i in 0..500 {
        let row = cycle.step(if i > 2 { ARM } else { NOTHING });
        moved |= row.traction_m_s == 0.5;
        if row.traction_m_s != 0.0 {
            zero_s = row.time_s + 0.01;
        }
    }
    assert!(moved);
    // 0.15 s until it is noticed and 0.25 s for the ramp, each to a cycle.
    assert!((zero_s - 3.4_f64).abs() < 0.025, "{zero_s}");
    assert_eq!(cycle.state(), SafetyState::Latched);
}

#[test]
fn a_controller_that_hangs_brings_the_vehicle_to_a_stop_until_re_armed() {
    let (mut cycle, _records) = cycle(constant(3.0));
    let mut moved = false;
    for i in 0..200 {
        let row = cycle.step(if i > 2 { ARM } else { NOTHING });
        moved |= row.traction_m_s == 0.5;
        // 0.15 s until it is noticed, a cycle at most until it acts, 0.25 s for the ramp.
        if row.time_s > 3.0 + 0.15 + 0.05 + 0.25 + 0.05 {
            assert_eq!((row.traction_m_s, row.steer_m_s), (0.0, 0.0));
        }
    }
    assert!(moved);
    assert_eq!(cycle.state(), SafetyState::Latched);
    assert_eq!(cycle.port().state().motors, MotorSpeeds::STOP);
}

#[test]
fn the_last_word_is_zero_and_off() {
    use sidehill_bridge::drives::{DriveCommand, Port, PortInputs, SendError};
    use std::sync::{Arc, Mutex};

    struct Overheard {
        inner: SimulatedPort,
        last: Arc<Mutex<Option<DriveCommand>>>,
    }
    impl Port for Overheard {
        fn receive(&mut self, now_s: f64) -> PortInputs {
            self.inner.receive(now_s)
        }
        fn send(&mut self, now_s: f64, order: &DriveCommand) -> Result<(), SendError> {
            *self.last.lock().unwrap() = Some(*order);
            self.inner.send(now_s, order)
        }
    }
    let last = Arc::new(Mutex::new(None));
    let inside = Arc::clone(&last);
    let panicked = std::thread::spawn(move || {
        let port = Overheard {
            inner: port(),
            last: Arc::clone(&inside),
        };
        let (sink, _source) = ring(64);
        let clock = Clock::Virtual { now_s: 0.0 };
        let (config, safety) = (CycleConfig::default(), SafetyConfig::default());
        let mut cycle = ControlLoop::new(config, safety, clock, port, constant(1e9), sink).unwrap();
        for i in 0..40 {
            cycle.step(if i > 2 { ARM } else { NOTHING });
        }
        assert!(inside.lock().unwrap().unwrap().speeds.traction_m_s > 0.0);
        panic!("on purpose");
    })
    .join();
    assert!(panicked.is_err());
    assert_eq!(last.lock().unwrap().unwrap(), DriveCommand::OFF);
}

#[test]
fn a_client_gives_paths_arms_once_and_halts() {
    let (mut client, mut loop_end, controller_end) = command_channel(60);
    let controller =
        Controller::new(ControllerKind::IcrikMpc, ControllerConfig::default(), &j8()).unwrap();
    let (tap, paths, mut log) = sidehill_bridge::control_loop::tap::tap(60);
    client.log_paths(paths);
    let runner = InlineRunner::with_channel(controller, Some(controller_end), Some(tap));
    let (mut cycle, _records) = cycle(runner);
    let mut run = |cycles: u32| {
        for _ in 0..cycles {
            cycle.step_with(NOTHING, Some(&mut loop_end));
        }
        cycle.state()
    };
    let path = |number: u64| {
        Some(PathCommand {
            number,
            trajectory: FigureEight::default().trajectory().unwrap(),
            from_m: 0.0,
        })
    };
    client.set_path(path(7));
    assert_eq!(run(5), SafetyState::Disarmed);
    client.arm(3);
    assert_eq!(run(40), SafetyState::Driving);
    let status = client.loop_status().unwrap();
    assert_eq!((status.armed, status.row.state), (3, SafetyState::Driving));
    assert!(status.row.traction_m_s > 0.0);
    let status = client.controller_status();
    assert_eq!(status.decision.unwrap().reference, 7);
    assert!(status.view.plan.len() > 1 && status.view.reference.len() > 1);
    // Without its path it stops, and the request to arm that was carried out does not arm again.
    client.set_path(None);
    assert_eq!(run(20), SafetyState::Latched);
    let why = StopReason::NoPath;
    let stopped_by = client.loop_status().unwrap().stopped_by;
    assert_eq!(stopped_by, Some(Reason::ControllerStopped { why }));
    client.set_path(path(8));
    assert_eq!(run(40), SafetyState::Latched);
    client.arm(4);
    assert_eq!(run(40), SafetyState::Driving);
    assert_eq!(client.loop_status().unwrap().armed, 4);
    client.halt_switch().set(Some(StopCause::EmergencyStop));
    assert_eq!(run(1), SafetyState::Latched);
    let pressed = Some(Reason::Requested(StopCause::EmergencyStop));
    assert_eq!(client.loop_status().unwrap().stopped_by, pressed);
    // The recording tells which path was followed from which step on.
    let given = std::iter::from_fn(|| log.next_path());
    let given: Vec<_> = given
        .map(|path| (path.serial, path.path.map(|path| path.number)))
        .collect();
    assert_eq!(given, [(1, Some(7)), (2, None), (3, Some(8))]);
    let steps = std::iter::from_fn(|| log.steps.pop());
    let applied: Vec<_> = steps
        .map(|step| step.path)
        .filter(|path| *path > 0)
        .collect();
    assert_eq!((applied, log.lost()), (vec![1, 2, 3], 0));
}

/// Waits for its controller in simulated time as well.
struct Patient<Q>(Q);

impl<Q: ControllerRunner> ControllerRunner for Patient<Q> {
    fn decide(&mut self, sample: &Sample, engaged: bool, _: Option<Duration>) -> Option<Decision> {
        self.0
            .decide(sample, engaged, Some(Duration::from_secs(20)))
    }
}

#[test]
fn a_controller_in_its_thread_drives_like_one_in_the_loop() {
    fn commands(pilot: impl ControllerRunner) -> Vec<(f64, f64)> {
        let (mut cycle, _records) = cycle(pilot);
        let rows = (0..100).map(|i| cycle.step(if i > 5 { ARM } else { NOTHING }));
        let commands = rows.map(|row| (row.traction_m_s, row.steer_m_s)).collect();
        assert_eq!(cycle.state(), SafetyState::Driving);
        commands
    }
    let inline = || InlineRunner::new(controller(0.05));
    let threaded = ThreadedRunner::start(controller(0.05), None, None, None).unwrap();
    let expected = commands(inline());
    assert!(expected[99].0 > 0.0);
    assert_eq!(commands(Patient(inline())), expected);
    assert_eq!(commands(Patient(threaded)), expected);
}

#[test]
fn a_controller_in_its_thread_ends_with_its_runner() {
    let controller = controller(0.05);
    let (outlet, inlet) = learned_channel(&controller, 60.0);
    let mut runner = ThreadedRunner::start(controller, None, None, Some(outlet)).unwrap();
    assert!(runner.thread_id().is_some() && runner.drives().is_none());
    let sample = Sample {
        time_s: 0.0,
        tread_speeds: None,
        attitude: None,
        yaw_rate: None,
        pose: None,
    };
    let decision = runner.decide(&sample, false, Some(Duration::from_secs(20)));
    assert_eq!(decision.unwrap().time_s, 0.0);
    assert!(runner.drives().is_some() && !inlet.is_abandoned());
    drop(runner);
    assert!(inlet.is_abandoned());
}

#[test]
fn a_run_in_real_time_ends_and_reports() {
    let (sink, _records) = ring(4096);
    let thread = LoopSetup {
        cycle: CycleConfig::default(),
        safety: SafetyConfig::default(),
        geofence: None,
        realtime: Default::default(),
        clock: Clock::Real(Epoch::now()),
        port: Box::new(port()),
        controller: controller(0.05),
        channel: None,
        tap: None,
        learned: None,
        records: sink,
        options: RunOptions {
            arm: false,
            duration_s: Some(0.5),
        },
        signals: Signals::default(),
    }
    .start()
    .unwrap();
    let report = thread.join().unwrap();
    assert_eq!(report.ended, RunEnding::TimeOverStopped);
    assert_eq!(report.state, SafetyState::Disarmed);
    assert!(report.timing.cycles > 5, "{report:?}");
}

#[test]
fn a_steady_cycle_allocates_nothing() {
    let (mut cycle, _records) = cycle(constant(1e9));
    for i in 0..100 {
        cycle.step(if i > 2 { ARM } else { NOTHING });
    }
    assert_eq!(cycle.state(), SafetyState::Driving);
    let counted = allocation_counter::measure(|| {
        for _ in 0..200 {
            cycle.step(ARM);
        }
    });
    assert_eq!(counted.count_total, 0, "{counted:?}");
}

#[test]
fn a_steady_cycle_that_is_recorded_allocates_nothing() {
    let (tap, _paths, mut log) = sidehill_bridge::control_loop::tap::tap(60);
    let (mut cycle, _records) = cycle(InlineRunner::recorded(controller(0.05), tap));
    for i in 0..100 {
        cycle.step(if i > 2 { ARM } else { NOTHING });
    }
    assert_eq!(cycle.state(), SafetyState::Driving);
    let counted = allocation_counter::measure(|| {
        for _ in 0..100 {
            cycle.step(ARM);
        }
    });
    assert_eq!(counted.count_total, 0, "{counted:?}");
    let row = cycle.step(ARM);
    let steps: Vec<_> = std::iter::from_fn(|| log.steps.pop()).collect();
    assert_eq!((steps.len(), log.lost()), (201, 0));
    let solve = steps[200].decision.solve.unwrap();
    assert_eq!(row.solve_us, 1e6 * solve.solve_time_s);
    assert!(
        steps
            .iter()
            .enumerate()
            .all(|(i, step)| step.index == i as u64)
    );
    assert!(log.new_plan().is_some_and(|view| view.plan.len() > 1));
}

#[test]
fn a_run_repeats_every_bit() {
    let run = || {
        let (mut cycle, _records) = cycle(InlineRunner::new(controller(0.05)));
        (0..200)
            .map(|i| {
                let row = cycle.step(if i > 5 { ARM } else { NOTHING });
                format!("{} {} {}", row.traction_m_s, row.steer_m_s, row.x_m)
            })
            .collect::<Vec<_>>()
    };
    assert_eq!(run(), run());
}

/// Drives for 25 s over drives of this kind, and returns what was recorded of them.
fn said_of_drives(drive_train: &str, safety: SafetyConfig) -> Vec<String> {
    let config = CycleConfig::default();
    let pilot = InlineRunner::new(controller(config.period_s));
    let (mut cycle, mut records) = cycle_over(port_with(drive_train), config, safety, pilot);
    let mut said = Vec::new();
    for i in 0..(25.0 / config.period_s) as u32 {
        cycle.step(if i > 2 { ARM } else { NOTHING });
        while let Some(record) = records.pop() {
            if matches!(record, LoopRecord::Drives { .. })
                && let LogEntry::Event { event, reason, .. } = record.entry()
            {
                assert_eq!(event, "drives");
                said.push(reason);
            }
        }
    }
    assert_eq!(cycle.state(), SafetyState::Driving);
    said
}

#[test]
fn a_motor_that_is_weaker_than_told_is_named_and_one_that_is_not_never() {
    const STEER: &str = "steer: {acceleration_max_m_s2: 2, deceleration_max_m_s2: 2}";
    let weak = format!(
        "{{traction: {{speed_max_m_s: 0.4, acceleration_max_m_s2: 2, deceleration_max_m_s2: 2}}, {STEER}}}"
    );
    let said = said_of_drives(&weak, SafetyConfig::default());
    // It is fast enough where the course is slow: then it is short no more, and later again.
    assert!((1..=5).contains(&said.len()), "{said:?}");
    for (i, said) in said.iter().enumerate() {
        let is_short = said.starts_with("the traction motor reaches 0.4");
        assert_eq!(is_short, i % 2 == 0, "{said}");
        assert!(is_short || said == "the motors reach the commanded speeds");
    }
    let strong =
        format!("{{traction: {{acceleration_max_m_s2: 2, deceleration_max_m_s2: 2}}, {STEER}}}");
    let said = said_of_drives(&strong, SafetyConfig::default());
    assert_eq!(said, Vec::<String>::new());
}

#[test]
fn commands_that_are_scaled_down_are_told_from_a_weak_motor() {
    // As where the safety hears what is forwarded.
    let safety = SafetyConfig {
        plausible_difference_m_s: 0.5,
        ..SafetyConfig::default()
    };
    let slow = "{collision_monitor: [{from_s: 0, to_s: 1000, slowdown_ratio: 0.6}]}";
    let said = said_of_drives(slow, safety);
    let scaled = "commands are scaled down to 60 %";
    let found = said.iter().position(|said| said.contains(scaled));
    let found = found.unwrap_or_else(|| panic!("{said:?}"));
    for said in &said[found..] {
        assert!(!said.contains("the traction motor reaches"), "{said}");
    }
}

#[test]
fn a_motor_that_runs_at_a_gain_of_its_commands_is_named() {
    let safety = SafetyConfig {
        plausible_difference_m_s: 0.5,
        ..SafetyConfig::default()
    };
    let rates = "acceleration_max_m_s2: 2, deceleration_max_m_s2: 2";
    for (motors, motor, percent) in [
        (
            format!("{{traction: {{{rates}}}, steer: {{{rates}, gain: 0.6}}}}"),
            "steer",
            60.0,
        ),
        (
            format!("{{traction: {{{rates}, gain: 1.3}}, steer: {{{rates}}}}}"),
            "traction",
            130.0,
        ),
    ] {
        let said = said_of_drives(&motors, safety);
        let begin = format!("the {motor} motor runs at ");
        let named = said.last().and_then(|said| said.strip_prefix(&begin));
        let figure = named.and_then(|said| said.strip_suffix(" % of its commands"));
        let found: f64 = figure.map_or(f64::NAN, |figure| figure.parse().unwrap());
        assert!((found - percent).abs() < 3.0, "{said:?}");
    }
}
