//! `sidehill run`: the controller in real time on a CAN bus or on ROS 2.
#![allow(clippy::print_stdout, clippy::print_stderr)]

use crate::config::ros2::{environment, parameters};
use crate::config::{ConfigFile, RunConfig, RunPort};
use anyhow::{Context, Result, anyhow, ensure};
use serde::Serialize;
use sidehill_bridge::can::CanPort;
use sidehill_bridge::control_loop::channel::{ControllerEnd, LoopEnd};
use sidehill_bridge::control_loop::record::{CycleRow, Outputs, RecordSink, Recorder, ring};
use sidehill_bridge::control_loop::runner::ThreadedRunner;
use sidehill_bridge::control_loop::scheduling::ThreadId;
use sidehill_bridge::control_loop::{ControlLoop, Timing};
use sidehill_bridge::drives::{Clock, Epoch, Port};
use sidehill_bridge::ros2::arguments::RosArguments;
use sidehill_bridge::ros2::names::Names;
use sidehill_bridge::ros2::parameters::override_config;
use sidehill_bridge::ros2::server::{self, Ros2};
use sidehill_bridge::rover::SimulatedPort;
use sidehill_bridge::safety::{OperatorRequests, Reason, SafetyState, StopCause};
use sidehill_controller::controller::Controller;
use sidehill_plant::vehicle::Vehicle;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Arguments of `sidehill run`.
#[derive(Debug, clap::Args)]
pub struct RunArgs {
    /// Configuration: interface, layout of the bus, vehicle, controller, course, safety.
    pub config: PathBuf,
    /// Arms once when the drives' feedback has come. Without it, and after every stop, SIGUSR1 arms.
    #[arg(long)]
    pub arm: bool,
    /// Folder for candump.log, cycles.csv and events.jsonl; it is made where it does not exist.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Ends after so many seconds; without it, at the end of the course or on a signal.
    #[arg(long)]
    pub duration_s: Option<f64>,
}

/// Records that a ring holds: seconds of a busy bus.
const RING: usize = 8192;
/// Cycles of zeros after a signal, before the program ends.
const LAST_CYCLES: u32 = 5;

/// What signals ask for.
#[derive(Clone, Default)]
struct Signals {
    end: Arc<AtomicBool>,
    arm: Arc<AtomicBool>,
    stop: Arc<AtomicBool>,
    resumed: Arc<AtomicBool>,
}

/// One line a second on standard output.
#[derive(Serialize)]
struct StatusLine<'a> {
    unix_s: f64,
    #[serde(flatten)]
    cycle: &'a CycleRow,
    records_lost: u64,
}

/// How a run ended, as the last line on standard output.
#[derive(Serialize)]
struct Ending {
    ended: &'static str,
    state: SafetyState,
    #[serde(flatten)]
    timing: Timing,
}

/// Drives the course of a configuration until it ends or a signal comes: SIGUSR1 arms, SIGUSR2 stops
/// on the ramp, SIGINT and SIGTERM send zeros, switch the drives off and end the program, as does over
/// ROS 2 a SIGCONT: its middleware does not outlive a suspension.
///
/// The exit status is 0 where the course has been driven to its end or the time was over while
/// driving, or where paths come over ROS 2, else 1.
///
/// # Errors
/// A file that cannot be read, a setting that is out of range, a name that the CAN database does not
/// know, or something asked of the system that it does not permit.
pub fn run(args: &RunArgs, ros_arguments: &[String]) -> Result<ExitCode> {
    let file = ConfigFile::read(&args.config)?;
    let config: RunConfig = file.parse()?;
    let vehicle = config.load_vehicle(&file)?;
    let controller = config.controller(&file, &vehicle)?;
    let mut files = args.out.as_deref().map(Files::create).transpose()?;
    let signals = Signals::register()?;

    let epoch = Epoch::now();
    let (heard_sink, heard) = ring(RING);
    let (sent_sink, sent) = ring(RING);
    let (cycle_sink, cycles) = ring(RING);
    let over_ros2 = config.over_ros2();
    let ros2 = start_ros2(&file, &config, &vehicle, ros_arguments, epoch)?;
    let (clock, desks, ros2_port, _server) = match ros2 {
        Some(ros2) => (
            ros2.time.clock(),
            Some((ros2.cycle, ros2.pilot)),
            ros2.port,
            Some(ros2.server),
        ),
        None => (Clock::Real(epoch), None, None, None),
    };
    let mut listener = None;
    let (port, bus): (Box<dyn Port + Send>, _) = match config.port {
        RunPort::Can => {
            let (interface, layout) = config.bus(&file)?;
            let port = CanPort::new(
                interface,
                Arc::new(layout),
                vehicle.encoder_scale,
                epoch,
                heard_sink,
                sent_sink,
            )?;
            listener = port.listener_id();
            (Box::new(port), interface.to_owned())
        }
        RunPort::Simulated => (Box::new(simulated(&file, &config)?), "simulated".to_owned()),
        RunPort::Ros2 => {
            let port = ros2_port.ok_or_else(|| anyhow!("there is no port of ROS 2"))?;
            (Box::new(port), "ros2".to_owned())
        }
    };
    let mut recorder = Recorder::new(vec![heard, sent, cycles], epoch, &bus);
    let job = Job {
        config,
        arm: args.arm,
        duration_s: args.duration_s,
        signals,
        listener,
    };
    let thread = std::thread::Builder::new()
        .name("cycle".to_owned())
        .spawn(move || job.drive(clock, port, controller, desks, cycle_sink))?;

    let mut reported_s = 0.0;
    while !thread.is_finished() {
        std::thread::sleep(Duration::from_millis(50));
        write(&mut recorder, files.as_mut())?;
        let now_s = epoch.elapsed_s();
        if now_s >= reported_s + 1.0 {
            reported_s = now_s;
            if let Some(cycle) = recorder.latest() {
                let line = StatusLine {
                    unix_s: epoch.unix_s(cycle.time_s),
                    cycle,
                    records_lost: recorder.lost(),
                };
                println!("{}", serde_json::to_string(&line)?);
            }
        }
    }
    let ending = thread.join().map_err(|_| {
        anyhow!("the cycle has panicked; zeros were sent and the drives switched off")
    })?;
    write(&mut recorder, files.as_mut())?;
    if let Some(files) = &mut files {
        files.flush()?;
    }
    let ending = ending.with_context(|| file.name())?;
    println!("{}", serde_json::to_string(&ending)?);
    Ok(match ending.ended {
        "finished" | "time_over" => ExitCode::SUCCESS,
        // Where paths come from outside, nothing but a signal ends.
        "signal" if over_ros2 => ExitCode::SUCCESS,
        _ => ExitCode::FAILURE,
    })
}

/// What the cycle's thread does.
struct Job {
    config: RunConfig,
    arm: bool,
    duration_s: Option<f64>,
    signals: Signals,
    /// Thread that listens to the bus.
    listener: Option<ThreadId>,
}

impl Job {
    fn drive(
        self,
        clock: Clock,
        port: Box<dyn Port + Send>,
        controller: Controller,
        desks: Option<(LoopEnd, ControllerEnd)>,
        records: RecordSink,
    ) -> Result<Ending> {
        let (mut desk, pilot_desk) = desks.unzip();
        if let Clock::External(told) = &clock {
            // There is no time before somebody tells it.
            while told.now_s().is_none() && !self.signals.end.load(Ordering::Relaxed) {
                std::thread::sleep(Duration::from_millis(20));
            }
        }
        // The controller's thread before this one's CPU and priority, which it would inherit.
        let pilot = ThreadedRunner::start(controller, pilot_desk)?;
        let realtime = &self.config.realtime;
        realtime.apply_to_cycle()?;
        for helper in [pilot.thread_id(), self.listener].into_iter().flatten() {
            realtime.apply_to_helper(helper)?;
        }
        let config = &self.config;
        let mut cycle = ControlLoop::new(config.cycle, config.safety, clock, port, pilot, records)?;
        let (mut operator, mut last_cycles, mut ended) = (OperatorRequests::default(), 0, "signal");
        let mut arm = self.arm;
        loop {
            let asked = match &mut desk {
                Some(desk) => desk.operator(operator, cycle.state()),
                None => operator,
            };
            let row = cycle.step(asked);
            if let Some(desk) = &mut desk {
                desk.leave(row, &cycle);
            }
            operator.arm = false;
            if self.signals.arm.swap(false, Ordering::Relaxed)
                || (arm && row.feedback_age_s <= config.safety.feedback_timeout_s)
            {
                operator.arm = true;
                arm = false;
            }
            let stop = self.signals.stop.swap(false, Ordering::Relaxed);
            operator.stop = stop.then_some(StopCause::Operator);
            if operator.halt.is_some() {
                last_cycles += 1;
                if last_cycles > LAST_CYCLES {
                    break;
                }
                continue;
            }
            if self.signals.end.load(Ordering::Relaxed) {
                operator.halt = Some(StopCause::ProgramEnds);
            }
            // A middleware that was suspended hears and says nothing any more.
            if desk.is_some() && self.signals.resumed.load(Ordering::Relaxed) {
                ended = "suspended";
                operator.halt = Some(StopCause::Suspended);
            }
            if self
                .duration_s
                .is_some_and(|duration_s| row.time_s >= duration_s)
            {
                ended = match row.state {
                    SafetyState::Driving => "time_over",
                    _ => "stopped",
                };
                operator.halt = Some(StopCause::TimeOver);
            }
            // Where paths come from outside, another may come.
            if desk.is_none()
                && row.state == SafetyState::Latched
                && cycle.stopped_by() == Some(Reason::Finished)
            {
                ended = "finished";
                operator.halt = Some(StopCause::ProgramEnds);
            }
        }
        Ok(Ending {
            ended,
            state: cycle.state(),
            timing: cycle.timing(),
        })
    }
}

impl Signals {
    fn register() -> Result<Self> {
        use signal_hook::consts::{SIGCONT, SIGINT, SIGTERM, SIGUSR1, SIGUSR2};
        use signal_hook::flag::register;
        let signals = Self::default();
        register(SIGINT, Arc::clone(&signals.end))?;
        register(SIGTERM, Arc::clone(&signals.end))?;
        register(SIGUSR1, Arc::clone(&signals.arm))?;
        register(SIGUSR2, Arc::clone(&signals.stop))?;
        register(SIGCONT, Arc::clone(&signals.resumed))?;
        Ok(signals)
    }
}

/// Starts what is offered on ROS 2, where paths come from there.
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
    });
    Ok(Some(started.map_err(|error| file.error(error))?))
}

/// Returns the virtual vehicle that a configuration names, within this program.
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

#[derive(Serialize)]
struct CycleLine<'a>(f64, &'a CycleRow);

impl Files {
    fn create(folder: &Path) -> Result<Self> {
        let named = |file: &Path| format!("cannot write {}", file.display());
        std::fs::create_dir_all(folder).with_context(|| named(folder))?;
        let open = |name: &str| {
            let file = folder.join(name);
            File::create(&file).with_context(|| named(&file))
        };
        let mut cycles = csv::WriterBuilder::new()
            .has_headers(false)
            .from_writer(open("cycles.csv")?);
        cycles.write_record([
            "unix_s",
            "time_s",
            "lateness_s",
            "slack_s",
            "state",
            "enable",
            "traction_m_s",
            "steer_m_s",
            "sent",
            "feedback_traction_m_s",
            "feedback_steer_m_s",
            "feedback_age_s",
            "bus",
            "x_m",
            "y_m",
            "yaw_rad",
            "cross_track_m",
            "solve_us",
            "refused",
            "skipped",
        ])?;
        Ok(Self {
            candump: BufWriter::new(open("candump.log")?),
            events: BufWriter::new(open("events.jsonl")?),
            cycles,
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
fn write(recorder: &mut Recorder, files: Option<&mut Files>) -> Result<()> {
    let Some(files) = files else {
        recorder.drain(&mut Outputs {
            events: Some(&mut std::io::stderr()),
            ..Outputs::default()
        })?;
        return Ok(());
    };
    let cycles = &mut files.cycles;
    recorder.drain(&mut Outputs {
        candump: Some(&mut files.candump),
        events: Some(&mut files.events),
        cycles: Some(&mut |unix_s, row| Ok(cycles.serialize(CycleLine(unix_s, row))?)),
    })?;
    // Through to the file, so that little is missing where the program is killed.
    files.flush()
}
