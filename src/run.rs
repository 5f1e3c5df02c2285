//! `sidehill run`: the controller in real time on a CAN bus or on ROS 2.

use crate::config::ros2::{environment, parameters};
use crate::config::{ConfigFile, RunConfig, RunPort};
use crate::console::Printer;
use crate::learned::Keeper;
use anyhow::{Context, Result, anyhow, ensure};
use serde::Serialize;
use sidehill_bridge::can::CanPort;
use sidehill_bridge::control_loop::record::{CycleRow, LogSource, Outputs, Recorder, ring};
use sidehill_bridge::control_loop::{LoopSetup, RunOptions, Signals};
use sidehill_bridge::drives::{Clock, Epoch, Port};
use sidehill_bridge::ros2::node::arguments::RosArguments;
use sidehill_bridge::ros2::node::names::Names;
use sidehill_bridge::ros2::server::parameters::override_config;
use sidehill_bridge::ros2::server::{self, Ros2};
use sidehill_bridge::rover::SimulatedPort;
use sidehill_plant::vehicle::Vehicle;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

/// Arguments of `sidehill run`.
#[derive(Debug, clap::Args)]
pub struct RunArgs {
    /// Configuration: interface, layout of the bus, vehicle, controller, course, safety.
    pub config: PathBuf,
    /// Arm once as soon as the drives' feedback is fresh. Without it, and after every stop, SIGUSR1
    /// arms.
    #[arg(long)]
    pub arm: bool,
    /// Folder for candump.log, cycles.csv and events.jsonl; created if it does not exist.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Duration of the run, s. Without it, the run ends with the course or on a signal.
    #[arg(long)]
    pub duration_s: Option<f64>,
}

/// Records that a ring holds: seconds of a busy bus.
const RING: usize = 8192;

/// One line a second on standard output.
#[derive(Serialize)]
struct StatusLine<'a> {
    unix_s: f64,
    #[serde(flatten)]
    cycle: &'a CycleRow,
    records_lost: u64,
    /// Lines of text that nobody took; absent while there are none.
    #[serde(skip_serializing_if = "is_zero")]
    lines_dropped: u64,
    /// Batches of records that could not be written to --out; absent while there are none.
    #[serde(skip_serializing_if = "is_zero")]
    batches_unwritten: u64,
}

fn is_zero(count: &u64) -> bool {
    *count == 0
}

/// Longest wait for a reader of the output at the end.
const PRINT_TIMEOUT: Duration = Duration::from_millis(500);

/// Runs the control loop of a configuration until its course is finished, its time is over, or a
/// signal comes. SIGUSR1 arms; SIGUSR2 stops on the ramp; SIGINT, SIGTERM and SIGHUP (a connection that
/// drops) send zero speed, disable the drives and end the program, as SIGCONT does over ROS 2.
///
/// Text that nobody reads and records that the disk does not take are dropped and counted: the vehicle
/// drives on.
///
/// The exit status is that of the [`Ending`](sidehill_bridge::control_loop::Ending).
///
/// # Errors
/// A file that cannot be read, a setting out of range, a name that the CAN database does not have, or
/// a real-time setting that the system does not permit.
pub fn run(args: &RunArgs, ros_arguments: &[String]) -> Result<ExitCode> {
    let file = ConfigFile::read(&args.config)?;
    let config: RunConfig = file.parse()?;
    let vehicle = config.load_vehicle(&file)?;
    let mut controller = config.controller(&file, &vehicle)?;
    let keeper = config
        .learned_file(&file)?
        .map(|(path, days_max)| Keeper::start(path, days_max, &mut controller))
        .transpose()?;
    let mut files = args.out.as_deref().map(Files::create).transpose()?;
    let signals = register_signals()?;

    let epoch = Epoch::now();
    let ros2 = start_ros2(&file, &config, &vehicle, ros_arguments, epoch)?;
    let (clock, channel, ros2_port, _server) = match ros2 {
        Some(ros2) => (
            ros2.clock,
            Some((ros2.loop_end, ros2.controller_end)),
            ros2.port,
            Some(ros2.server),
        ),
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
            let port = CanPort::new(interface, layout, scale, epoch, received, sent)?;
            (Box::new(port), interface.to_owned())
        }
        RunPort::Simulated => (Box::new(simulated(&file, &config)?), "simulated".to_owned()),
        RunPort::Ros2 => {
            let port = ros2_port.ok_or_else(|| anyhow!("there is no port of ROS 2"))?;
            (Box::new(port), "ros2".to_owned())
        }
    };
    let mut recorder = Recorder::new(logs, epoch, &interface);
    let setup = LoopSetup {
        cycle: config.cycle,
        safety: config.safety,
        realtime: config.realtime,
        clock,
        port,
        controller,
        channel,
        learned: keeper.as_ref().map(Keeper::sender),
        records,
        options: RunOptions {
            arm: args.arm,
            duration_s: args.duration_s,
        },
        signals,
    };
    let printer = Printer::start()?;
    let control_loop = setup.start()?;

    let mut reported_s = 0.0;
    let mut batches_unwritten = 0;
    let mut record = |recorder: &mut Recorder| {
        if let Err(error) = write(recorder, files.as_mut(), &printer) {
            if batches_unwritten == 0 {
                let line = serde_json::json!({ "event": "records not written", "reason": format!("{error:#}") });
                let _ = writeln!(printer.errors(), "{line}");
            }
            batches_unwritten += 1;
        }
        batches_unwritten
    };
    while !control_loop.is_finished() {
        std::thread::sleep(Duration::from_millis(50));
        let batches_unwritten = record(&mut recorder);
        let now_s = epoch.elapsed_s();
        if now_s >= reported_s + 1.0 {
            reported_s = now_s;
            if let Some(cycle) = recorder.latest() {
                let line = StatusLine {
                    unix_s: epoch.unix_s(cycle.time_s),
                    cycle,
                    records_lost: recorder.lost(),
                    lines_dropped: printer.dropped(),
                    batches_unwritten,
                };
                if let Ok(line) = serde_json::to_string(&line) {
                    printer.line(line);
                }
            }
        }
    }
    let report = control_loop.join();
    record(&mut recorder);
    if let Ok(line) = report.as_ref().map(serde_json::to_string) {
        printer.line(line?);
    }
    printer.finish(PRINT_TIMEOUT);
    if let Some(keeper) = keeper {
        keeper.finish();
    }
    let report = report.with_context(|| file.name())?;
    Ok(ExitCode::from(report.ended.exit_code()))
}

fn register_signals() -> Result<Signals> {
    use signal_hook::consts::{SIGCONT, SIGHUP, SIGINT, SIGTERM, SIGUSR1, SIGUSR2};
    use signal_hook::flag::register;
    let signals = Signals::default();
    for end in [SIGINT, SIGTERM, SIGHUP] {
        register(end, Arc::clone(&signals.end))?;
    }
    register(SIGUSR1, Arc::clone(&signals.arm))?;
    register(SIGUSR2, Arc::clone(&signals.stop))?;
    register(SIGCONT, Arc::clone(&signals.resumed))?;
    Ok(signals)
}

/// Starts the ROS 2 server, where the configuration has one.
fn start_ros2(
    file: &ConfigFile,
    config: &RunConfig,
    vehicle: &Vehicle,
    arguments: &[String],
    epoch: Epoch,
) -> Result<Option<Ros2>> {
    if !config.over_ros2() {
        ensure!(
            arguments.is_empty(),
            "--ros-args: this configuration has no ROS 2 in it"
        );
        return Ok(None);
    }
    let (mut ros2, mut route) = config.ros2(file, vehicle)?;
    let arguments = RosArguments::parse(arguments)?;
    let environment = environment()?;
    let names = Names::new(&ros2.node, "/", &arguments.remaps)?;
    let given = parameters(&arguments, &names)?;
    let (speed_m_s, period_s) = (&mut route.limits.speed_max_m_s, config.cycle.period_s);
    override_config(&mut ros2, speed_m_s, period_s, &given)
        .map_err(|reason| anyhow!("parameter {reason}"))?;
    config.check_clock(file, &ros2)?;
    let started = server::start(server::Setup {
        config: ros2,
        vehicle,
        route,
        arguments: &arguments,
        environment: &environment,
        epoch,
        drives: config.port == RunPort::Ros2,
        stages: config.settings.stages,
        period_s,
        realtime: config.realtime,
        stopping: config.stopping(),
    });
    Ok(Some(started.map_err(|error| file.error(error))?))
}

/// Returns the virtual rover of a configuration, simulated in this process.
///
/// # Errors
/// The file at fault, key, value and range.
pub fn simulated(file: &ConfigFile, config: &RunConfig) -> Result<SimulatedPort> {
    let (file, config) = config.simulated(file)?;
    let world = config.world(&file)?;
    let simulation = world.simulation().map_err(|error| file.error(error))?;
    let encoder_scale = world.plant.encoder_scale();
    Ok(
        SimulatedPort::new(simulation, world.step_s, encoder_scale, config.drive)
            .map_err(|error| file.error(error))?,
    )
}

/// The files of `--out`.
struct Files {
    candump: BufWriter<File>,
    events: BufWriter<File>,
    cycles: csv::Writer<File>,
}

/// First column of `cycles.csv`.
#[derive(Serialize)]
struct UnixTime {
    unix_s: f64,
}

impl Files {
    fn create(folder: &Path) -> Result<Self> {
        let named = |file: &Path| format!("cannot write {}", file.display());
        std::fs::create_dir_all(folder).with_context(|| named(folder))?;
        let open = |name: &str| {
            let file = folder.join(name);
            File::create(&file).with_context(|| named(&file))
        };
        Ok(Self {
            candump: BufWriter::new(open("candump.log")?),
            events: BufWriter::new(open("events.jsonl")?),
            cycles: csv::Writer::from_writer(open("cycles.csv")?),
        })
    }

    fn flush(&mut self) -> Result<()> {
        self.candump.flush()?;
        self.events.flush()?;
        self.cycles.flush()?;
        Ok(())
    }
}

/// Writes what the threads have left: to the files, else events to standard error.
fn write(recorder: &mut Recorder, files: Option<&mut Files>, printer: &Printer) -> Result<()> {
    let Some(files) = files else {
        recorder.drain(&mut Outputs {
            events: Some(&mut printer.errors()),
            ..Outputs::default()
        })?;
        return Ok(());
    };
    let cycles = &mut files.cycles;
    recorder.drain(&mut Outputs {
        candump: Some(&mut files.candump),
        events: Some(&mut files.events),
        cycles: Some(&mut |unix_s, row| Ok(cycles.serialize((UnixTime { unix_s }, row))?)),
    })?;
    // Through to the file, so that little is missing where the program is killed.
    files.flush()
}
