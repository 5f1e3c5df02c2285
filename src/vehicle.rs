//! `sidehill vehicle`: a virtual rover in real time behind a CAN bus.
#![allow(clippy::print_stdout)]

use crate::config::{ConfigFile, Prepared, VehicleConfig};
use anyhow::{Context, Result};
use sidehill_bridge::bus::{Heard, Listener, Sender};
use sidehill_bridge::can::layout::Layout;
use sidehill_bridge::clock::{Clock, Epoch};
use sidehill_bridge::virtual_vehicle::{VirtualVehicle, VirtualVehicleSetup};
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
    let file = ConfigFile::read(&args.config)?;
    let config: VehicleConfig = file.parse()?;
    let (interface, layout) = config.bus(&file)?;
    let layout = Arc::new(layout);
    let world = config.world(&file)?;
    let mut vehicle = build(&config, &world, Arc::clone(&layout)).with_context(|| file.name())?;
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
    let _listener = Listener::start(interface, &wanted, epoch, move |heard| {
        if let Heard::Frame { time_s, frame } = heard {
            // A full ring loses the frame, as a slow drive would; the counter shows it.
            let _ = arrived.push((time_s, frame));
        }
    })?;
    let mut sender = Sender::start(interface)?;
    let mut step: u64 = 0;
    while !ended.load(Ordering::Relaxed) {
        step += 1;
        clock.wait_until(step as f64 * world.step_s);
        let now_s = clock.now_s();
        if args
            .duration_s
            .is_some_and(|duration_s| now_s >= duration_s)
        {
            break;
        }
        // What a late wake-up has missed is simulated now.
        step = step.max((now_s / world.step_s) as u64);
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

/// Returns the vehicle of a configuration in its world, off.
///
/// # Errors
/// A setting out of range, or no ground at the start.
pub fn build(
    config: &VehicleConfig,
    world: &Prepared,
    layout: Arc<Layout>,
) -> Result<VirtualVehicle> {
    let setup = VirtualVehicleSetup {
        dt_s: world.step_s,
        correction: world.plant.correction(),
        drive: config.drive,
        report_period_s: config.report_period_s,
        faults: config.faults.clone(),
    };
    Ok(VirtualVehicle::new(world.simulation()?, layout, setup)?)
}

fn create(path: &Path) -> Result<BufWriter<File>> {
    let file = File::create(path).with_context(|| format!("cannot write {}", path.display()))?;
    Ok(BufWriter::new(file))
}
