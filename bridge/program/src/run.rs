//! `sidehill run`: the controller in real time on a CAN bus or on ROS 2.

mod files;
mod screen;
mod service;

use crate::interrupts::Interrupts;
use crate::keeper::Keeper;
use crate::recording::DriveRecording;
use crate::ros2::{environment, parameters};
use anyhow::{Context, Result, anyhow, ensure};
use files::Files;
use screen::Screen;
use service::ServiceManager;
use sidehill::config::{Bundle, ConfigFile, RunConfig, RunPort};
use sidehill::console::Printer;
use sidehill::drive::RunArgs;
use sidehill::drive_report::write_page;
use sidehill::exit::Exit;
use sidehill::output;
use sidehill::recording::{self, fact, ground_around};
use sidehill_bridge::control_loop::record::{LogEntry, LogSource, Recorder, ring};
use sidehill_bridge::control_loop::tap::{PathLog, PathRecord, tap};
use sidehill_bridge::control_loop::{LoopSetup, RunOptions, Signals};
use sidehill_bridge::drives::{Clock, Epoch, Input, InputStatus, Port};
use sidehill_bridge::ros2::arguments::RosArguments;
use sidehill_bridge::ros2::names::Names;
use sidehill_can_port::CanPort;
use sidehill_controller::path::PendingActions;
use sidehill_plant::vehicle::Vehicle;
use sidehill_recording::Sinks;
use sidehill_recording::live::{LiveView, ParameterOwner};
use sidehill_ros2::port::FixSettings;
use sidehill_ros2::server::obstacles::StoppingSettings;
use sidehill_ros2::server::parameters::override_config;
use sidehill_ros2::server::requested_path::RequestedPath;
use sidehill_ros2::server::route::RouteSettings;
use sidehill_ros2::server::{self, ConfiguredRoute, Ros2, Ros2Inputs};
use std::process::ExitCode;
use std::sync::atomic::Ordering;
use std::sync::{Arc, OnceLock};
use std::time::Duration;

/// Records that a ring holds: seconds of a busy bus.
const RING: usize = 8192;

/// Longest wait at the end for a reader of the output.
const PRINT_TIMEOUT: Duration = Duration::from_millis(500);

/// Runs the control loop of a configuration until its course is finished, its time is over, or a
/// signal comes. SIGUSR1 arms; SIGUSR2 stops on the ramp; SIGINT, SIGTERM and SIGHUP (a connection that
/// drops) send zero speed, disable the drives and end the program, as SIGCONT does over ROS 2.
///
/// Text that nobody reads and records that the disk does not take are dropped and counted: the vehicle
/// drives on.
///
/// The exit status is that of the [`Exit`].
///
/// # Errors
/// A file that cannot be read, a setting out of range, a name that the CAN database does not have, or
/// a real-time setting that the system does not permit.
pub fn run(args: &RunArgs, ros_arguments: &[String]) -> Result<ExitCode> {
    let bundle = Bundle::default();
    let file = ConfigFile::read(&args.config)?.with_bundle(bundle.clone());
    let config: RunConfig = file.parse()?;
    let vehicle = config.load_vehicle(&file)?;
    let (mut controller, reference) = config.controller_and_reference(&file, &vehicle)?;
    let (keeper, outlet, begun_with) = match config.learned_file(&file)? {
        Some(kept) => {
            let (keeper, outlet, begun_with) = Keeper::start(kept, &mut controller)?;
            (Some(keeper), Some(outlet), begun_with)
        }
        None => (None, None, None),
    };
    let mut files = args.out.as_deref().map(Files::create).transpose()?;
    let mut signals = register_signals()?;

    let epoch = Epoch::now();
    let mut inputs: Vec<Box<dyn InputStatus>> = Vec::new();
    let mut ready = screen::ready_to_arm(args.arm);
    let initial = PathRecord::initial(&controller);
    let (controller_tap, path_log, controller_log) = tap(config.settings.stages);
    let recording_ended = Arc::new(OnceLock::new());
    let recorded = config.recording(&file, args.record.as_deref())?;
    if let Some((path, _)) = &recorded {
        recording::check_free(path, args.force)?;
    }
    if let Some(report) = &args.report {
        ensure!(
            recorded.is_some(),
            "--report: it tells of a recording, add --record FILE.mcap"
        );
        output::check_writable(report, args.force)?;
    }
    let live = recording::live(&args.live, Some(&config.settings))?;
    if let Some(live) = &live
        && let Some(datum) = config.place_on_earth(&file)?
    {
        live.place(&datum);
    }
    let watched = recorded.is_some() || live.is_some();
    let settable = live.as_ref().filter(|_| config.over_ros2());
    let watch = Watch {
        recording: watched.then(|| (path_log, Arc::clone(&recording_ended))),
        parameters: settable.map(LiveView::parameter_owner),
    };
    let ground = match &reference {
        Some(loaded) if watched => loaded
            .ground()?
            .map(|ground| ground_around(&ground, loaded.trajectory.path())),
        _ => None,
    };
    let mut arm = args.arm;
    let frame = config.ros2.clone().unwrap_or_default().frames.odometry;
    let mut actions = PendingActions::default();
    let mut over_ros2 = None;
    match reference {
        Some(loaded) if config.over_ros2() => over_ros2 = Some(loaded),
        Some(loaded) => actions = PendingActions::new(loaded.actions),
        None => {}
    }
    let route = over_ros2.and_then(|loaded| {
        let path = RequestedPath::from_curve(&frame, loaded.trajectory.path()?);
        Some((path, PendingActions::new(loaded.actions)))
    });
    let route = route.map(|(path, actions)| ConfiguredRoute {
        path,
        actions,
        // The operator arms the route: the server arms the drives for it.
        begin: std::mem::take(&mut signals.arm),
        at_start: std::mem::take(&mut arm),
    });
    let has_route = route.is_some();
    let ros2 = start_ros2(
        (&file, &config, &vehicle),
        ros_arguments,
        epoch,
        watch,
        route,
    )?;
    Interrupts::admit()?;
    let notes = ros2.as_ref().map(|ros2| ros2.inputs.clone());
    let (clock, channel, ros2_port, _server) = match ros2 {
        Some(ros2) => {
            inputs.push(Box::new(ros2.inputs));
            let goal = format!("a goal on {}", ros2.action);
            ready = match has_route {
                true => format!("{ready} for its route, or {goal}"),
                false => format!("waits for {goal}"),
            };
            (
                ros2.clock,
                Some((ros2.loop_end, ros2.controller_end)),
                ros2.port,
                Some(ros2.server),
            )
        }
        None => (Clock::Real(epoch), None, None, None),
    };
    let (records, loop_log) = ring(RING);
    let mut logs: Vec<Box<dyn LogSource>> = vec![Box::new(loop_log)];
    let (port, interface): (Box<dyn Port + Send>, _) = match config.port {
        RunPort::Can => {
            let (interface, layout) = config.bus(&file)?;
            let (received, received_log) = ring(RING);
            let (sent, sent_log) = ring(RING);
            logs.extend([
                Box::new(received_log) as Box<dyn LogSource>,
                Box::new(sent_log),
            ]);
            let layout = Arc::new(layout);
            let scale = vehicle.encoder_scale;
            let mut port = CanPort::new(interface, layout, scale, epoch, received, sent)?;
            if let Some(messages) = port.take_inputs() {
                inputs.push(Box::new(messages));
            }
            (Box::new(port), interface.to_owned())
        }
        RunPort::Simulated => (
            Box::new(config.simulated_port(&file)?),
            "simulated".to_owned(),
        ),
        RunPort::Ros2 => {
            let port = ros2_port.ok_or_else(|| anyhow!("there is no ROS 2 port"))?;
            (Box::new(port), "ros2".to_owned())
        }
    };
    let file_of_record = match recorded {
        Some((path, limits)) => {
            let facts = [(fact::LEARNED, begun_with)];
            let header = recording::header("run", Some(config.controller), &file, &bundle, &facts);
            Some(recording::create(&path, header, limits, args.force)?)
        }
        None => None,
    };
    let sinks = Sinks {
        file: file_of_record,
        live,
    };
    let mut recording = watched.then(|| {
        let (initial, ended) = (initial.as_ref(), recording_ended);
        let scene = (&vehicle, ground.as_slice());
        DriveRecording::new(sinks, controller_log, scene, epoch, initial, ended)
    });
    let mut recorder = Recorder::new(logs, epoch, &interface).with_actions(actions);
    let period_s = config.cycle.period_s;
    let start = format!(
        "sidehill-drive {}: {} steers {} at {:.0} Hz over {interface}{}",
        crate::VERSION,
        config.controller.name(),
        vehicle.name,
        1.0 / period_s,
        screen::listens_to(&all(&mut inputs, epoch.elapsed_s())),
    );
    let turns = Arc::clone(&signals.turns);
    let of_the_loop = clock.clone();
    let setup = LoopSetup {
        cycle: config.cycle,
        safety: config.safety,
        geofence: config.geofence.clone(),
        realtime: config.realtime,
        clock,
        port,
        controller,
        channel,
        tap: recording.is_some().then_some(controller_tap),
        learned: outlet,
        records,
        options: RunOptions {
            arm,
            duration_s: args.duration_s,
        },
        signals,
    };
    let printer = Printer::start()?;
    recorder.note(0.0, LogEntry::event("start", start));
    let mut screen = Screen::new(args, &printer, ready);
    let control_loop = setup.start()?;

    let mut service = ServiceManager::new();
    let mut reported_s = 0.0;
    let mut waits_for = String::new();
    while !control_loop.is_finished() {
        std::thread::sleep(Duration::from_millis(50));
        for note in notes.iter().flat_map(Ros2Inputs::take_notes) {
            let entry = LogEntry::event(note.event, note.message);
            recorder.note(of_the_loop.now_s(), entry);
        }
        if let (Some(inputs), Some(recording)) = (&notes, &mut recording) {
            inputs
                .take_fixes()
                .iter()
                .for_each(|fix| recording.fix(fix));
            if let Some((time_s, obstacles)) = inputs.take_obstacles() {
                recording.obstacles(time_s, obstacles);
            }
        }
        screen.record(&mut recorder, files.as_mut(), recording.as_mut());
        service.live(turns.load(Ordering::Relaxed));
        let now_s = epoch.elapsed_s();
        if now_s >= reported_s + 1.0 {
            reported_s = now_s;
            let inputs = all(&mut inputs, now_s);
            let missing: Vec<&Input> = inputs.iter().filter(|i| i.missing.is_some()).collect();
            let said = screen::waits_for(&missing);
            // A growing age is not a change.
            if !said
                .chars()
                .filter(|c| !c.is_ascii_digit())
                .eq(waits_for.chars().filter(|c| !c.is_ascii_digit()))
            {
                let entry = match said.is_empty() {
                    true => LogEntry::event("inputs", "all inputs arrive".to_owned()),
                    false => LogEntry::warning("waits_for", said.clone()),
                };
                recorder.note(of_the_loop.now_s(), entry);
                waits_for = said;
            }
            screen.record(&mut recorder, files.as_mut(), recording.as_mut());
            let state = recording.as_ref().and_then(DriveRecording::status);
            screen.status(now_s, &recorder, &missing, state, epoch);
            service.state(&screen.state(recorder.latest(), &missing));
        }
    }
    let report = control_loop.join();
    screen.record(&mut recorder, files.as_mut(), recording.as_mut());
    let status = recording.and_then(DriveRecording::finish);
    if let Some((report, status)) = args.report.as_ref().zip(status.as_ref())
        && let Err(error) = write_page(&status.file, report, args.force)
    {
        screen.fault("no report", &format!("{error:#}"));
    }
    if let Some(reason) = status.and_then(|status| status.ended) {
        screen.fault("recording ended early", &reason);
    }
    screen.end(report.as_ref().ok());
    printer.finish(PRINT_TIMEOUT);
    if let Some(keeper) = keeper {
        keeper.finish();
    }
    let report = report.with_context(|| file.name())?;
    Ok(Exit::from(report.ended).into())
}

/// Returns the inputs of all ports.
fn all(ports: &mut [Box<dyn InputStatus>], now_s: f64) -> Vec<Input> {
    let ports = ports.iter_mut();
    ports.flat_map(|port| port.inputs(now_s)).collect()
}

fn register_signals() -> Result<Signals> {
    use signal_hook::consts::{SIGUSR1, SIGUSR2};
    use signal_hook::flag::register;
    let Interrupts { end, resumed } = Interrupts::watch()?;
    let signals = Signals {
        end,
        resumed,
        ..Signals::default()
    };
    register(SIGUSR1, Arc::clone(&signals.arm))?;
    register(SIGUSR2, Arc::clone(&signals.stop))?;
    Ok(signals)
}

/// Links between the ROS 2 server and recording and live view.
struct Watch {
    /// Takes the paths, and tells why the recording ended.
    recording: Option<(PathLog, Arc<OnceLock<String>>)>,
    /// Access of live clients to the parameters.
    parameters: Option<ParameterOwner>,
}

/// Starts the ROS 2 server, if the configuration has one.
fn start_ros2(
    (file, config, vehicle): (&ConfigFile, &RunConfig, &Vehicle),
    arguments: &[String],
    epoch: Epoch,
    watch: Watch,
    configured_route: Option<ConfiguredRoute>,
) -> Result<Option<Ros2>> {
    if !config.over_ros2() {
        ensure!(
            arguments.is_empty(),
            "--ros-args: this configuration has no ROS 2 in it"
        );
        return Ok(None);
    }
    let mut ros2 = config.ros2(file, vehicle)?;
    let limits = config.speed.limits(&config.settings.limits, vehicle);
    let mut route = RouteSettings {
        smoothing: ros2.smoothing.planned(limits.track_width_m),
        limits,
        tracked_point: config.settings.tracked_point,
        use_orientations: ros2.follow_path.use_orientations,
    };
    let arguments = RosArguments::parse(arguments)?;
    let environment = environment()?;
    let names = Names::new(&ros2.node, "/", &arguments.remaps)?;
    let given = parameters(&arguments, &names)?;
    let (speed_m_s, period_s) = (&mut route.limits.speed_max_m_s, config.cycle.period_s);
    override_config(&mut ros2, speed_m_s, period_s, &given)
        .map_err(|reason| anyhow!("parameter {reason}"))?;
    config.check_clock(file, &ros2)?;
    let fixes = config.fixes(file)?;
    let started = server::start(server::ServerSetup {
        config: ros2,
        vehicle,
        route,
        arguments: &arguments,
        environment: &environment,
        epoch,
        drives: config.port == RunPort::Ros2,
        fixes: fixes.map(|(datum, estimator)| FixSettings {
            datum,
            sigma_max_m: 3.0 * estimator.pose_sigma_m,
            heading_sigma_max_rad: 3.0 * estimator.pose_sigma_rad,
        }),
        stages: config.settings.stages,
        period_s,
        recording: watch.recording,
        live: watch.parameters,
        realtime: config.realtime,
        configured_route,
        geofence: config.geofence.clone(),
        stopping: StoppingSettings {
            deceleration_m_s2: config.safety.deceleration_m_s2,
            // From a costmap to the treads: the time until the next check, a cycle, and the delay of a command.
            reaction_s: StoppingSettings::CHECK_S + period_s + config.settings.delay_s(),
        },
    });
    Ok(Some(started.map_err(|error| file.error(error))?))
}
