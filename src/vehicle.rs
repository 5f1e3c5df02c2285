//! `sidehill vehicle`: a virtual rover in real time behind a CAN bus.
#![allow(clippy::print_stdout)]

use crate::bridge_config::{VehicleConfig, load_layout, load_vehicle, read_yaml, resolve};
use anyhow::{Context, Result};
use sidehill_bridge::bus::{Heard, Listener, Sender};
use sidehill_bridge::can::layout::Layout;
use sidehill_bridge::clock::{Clock, Epoch};
use sidehill_bridge::virtual_vehicle::{VirtualVehicle, VirtualVehicleSetup};
use sidehill_plant::motion::IcrMotion;
use sidehill_plant::simulation::{Simulation, SimulationSetup};
use sidehill_plant::terrain::{PlaneTerrain, Terrain};
use sidehill_plant::vehicle::SpeedCorrection;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Arguments of `sidehill vehicle`.
#[derive(Debug, clap::Args)]
pub struct VehicleArgs {
    /// Configuration of the virtual vehicle.
    pub config: PathBuf,
    /// File for the truth: CSV with one row a step of the reports.
    #[arg(long)]
    pub truth: Option<PathBuf>,
    /// Ends after so many seconds; without it, on SIGINT or SIGTERM.
    #[arg(long)]
    pub duration_s: Option<f64>,
}

/// Commands that wait for the simulation, at most: two cycles of a dozen messages.
const WAITING_MAX: usize = 64;

/// Runs a virtual vehicle until its time is over or a signal ends it.
///
/// # Errors
/// A file that cannot be read, a setting that is out of range, or a simulation that has left its
/// ground.
pub fn run(args: &VehicleArgs) -> Result<ExitCode> {
    let config: VehicleConfig = read_yaml(&args.config)?;
    let layout = Arc::new(load_layout(&resolve(&args.config, &config.can))?);
    let mut vehicle = build(&args.config, &config, Arc::clone(&layout))
        .with_context(|| args.config.display().to_string())?;
    let mut truth = args.truth.as_deref().map(create).transpose()?;
    if let Some(truth) = &mut truth {
        writeln!(
            truth,
            "unix_s,time_s,x_m,y_m,yaw_rad,traction_m_s,steer_m_s,mode"
        )?;
    }

    let ended = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&ended))?;
    }
    let epoch = Epoch::now();
    let mut clock = Clock::Real(epoch);
    let (mut arrived, mut waiting) = rtrb::RingBuffer::new(WAITING_MAX);
    let wanted: Vec<_> = layout.command.iter().map(|message| message.id()).collect();
    let _listener = Listener::start(&config.interface, &wanted, epoch, move |heard| {
        if let Heard::Frame { time_s, frame } = heard {
            // A full ring loses the frame, as a slow drive would; the counter shows it.
            let _ = arrived.push((time_s, frame));
        }
    })?;
    let mut sender = Sender::start(&config.interface)?;
    let mut step: u64 = 0;
    while !ended.load(Ordering::Relaxed) {
        step += 1;
        clock.wait_until(step as f64 * config.dt_s);
        let now_s = clock.now_s();
        if args
            .duration_s
            .is_some_and(|duration_s| now_s >= duration_s)
        {
            break;
        }
        // What a late wake-up has missed is simulated now.
        step = step.max((now_s / config.dt_s) as u64);
        while let Ok((time_s, frame)) = waiting.pop() {
            // Refusals are counted; the drives go on without.
            let _ = vehicle.take(&frame, time_s);
        }
        vehicle.advance(now_s)?;
        if now_s >= vehicle.next_report_s() {
            vehicle.report(now_s, |frame| {
                // A frame that is lost shows itself as a gap of the counter.
                let _ = sender.send(&frame);
            })?;
            if let Some(truth) = &mut truth {
                let s = vehicle.state();
                writeln!(
                    truth,
                    "{:.6},{:.6},{:.9},{:.9},{:.9},{:.9},{:.9},{:?}",
                    epoch.unix_s(s.time_s),
                    s.time_s,
                    s.pose.x_m,
                    s.pose.y_m,
                    s.pose.yaw_rad,
                    s.motors.traction_m_s,
                    s.motors.steer_m_s,
                    vehicle.mode()
                )?;
                // Written through, so that the rows of a vehicle that is killed are there.
                truth.flush()?;
            }
        }
    }
    let state = vehicle.state();
    println!(
        "{{\"time_s\":{:.3},\"x_m\":{:.4},\"y_m\":{:.4}}}",
        state.time_s, state.pose.x_m, state.pose.y_m
    );
    Ok(ExitCode::SUCCESS)
}

fn build(file: &Path, config: &VehicleConfig, layout: Arc<Layout>) -> Result<VirtualVehicle> {
    let (simulation, correction) = simulation(file, config)?;
    let setup = VirtualVehicleSetup {
        dt_s: config.dt_s,
        correction,
        drive: config.drive,
        report_period_s: config.report_period_s,
        faults: config.faults.clone(),
    };
    Ok(VirtualVehicle::new(simulation, layout, setup)?)
}

/// Returns the simulation of a configuration that was read from `file`, and its true c_l and c_r.
///
/// # Errors
/// A vehicle's file that cannot be read, or a setting out of range.
pub fn simulation(file: &Path, config: &VehicleConfig) -> Result<(Simulation, SpeedCorrection)> {
    config.validate()?;
    let vehicle = load_vehicle(&resolve(file, &config.vehicle))?;
    let terrain = PlaneTerrain::new(config.slope_deg, config.uphill_deg)?;
    let correction = vehicle.correction;
    let simulation = Simulation::new(SimulationSetup {
        terrain: Terrain::Plane(terrain),
        correction,
        motion: Box::new(IcrMotion {
            vehicle,
            inclined: true,
        }),
        drive_train: config.drive_train,
        sensors: config.sensors,
        start: config.start.pose(),
        dt_s: config.dt_s,
        seed: config.seed,
    })?;
    Ok((simulation, correction))
}

fn create(path: &Path) -> Result<BufWriter<File>> {
    let file = File::create(path).with_context(|| format!("cannot write {}", path.display()))?;
    Ok(BufWriter::new(file))
}
