//! `sidehill vehicle`: a virtual rover in real time behind a CAN bus or on ROS 2.
#![allow(clippy::print_stdout)]

mod can;
mod ros2;
mod rover;

use crate::interrupts::Interrupts;
use crate::recording::VehicleRecording;
use anyhow::{Context, Result, ensure};
use can::BusRover;
use ros2::RosRover;
use rover::Rover;
use sidehill::config::{Bundle, ConfigFile, VehicleConfig, VehiclePort};
use sidehill::drive::VehicleArgs;
use sidehill::recording;
use sidehill::{console, output};
use sidehill_bridge::drives::DriveMode;
use sidehill_bridge::drives::{Clock, Epoch};
use sidehill_plant::simulation::TrueState;
use sidehill_recording::Sinks;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::process::ExitCode;

/// Runs a virtual vehicle until its time is over or a signal ends it; `ros` are the arguments after
/// `--ros-args`.
///
/// # Errors
/// A file that cannot be read, a setting that is out of range, or a simulation that has left its
/// ground.
pub fn run(args: &VehicleArgs, ros: &[String]) -> Result<ExitCode> {
    let bundle = Bundle::default();
    let file = ConfigFile::read(&args.config)?.with_bundle(bundle.clone());
    let config: VehicleConfig = file.parse()?;
    let world = config.world(&file)?;
    let truth = match &args.truth {
        Some(path) => {
            output::keep_earlier(&[path])?;
            Some(RoverTruth::create(path)?)
        }
        None => None,
    };
    let epoch = Epoch::now();
    let live = recording::live(&args.live, None)?;
    let file_of_record = match config.recording(&file, args.record.as_deref())? {
        Some((path, limits)) => {
            let header = recording::header("vehicle", None, &file, &bundle, &[]);
            Some(recording::create(&path, header, limits, args.force)?)
        }
        None => None,
    };
    let watched = file_of_record.is_some() || live.is_some();
    let sinks = Sinks {
        file: file_of_record,
        live,
    };
    let recording = match watched {
        true => Some(VehicleRecording::start(sinks, &world, epoch)?),
        false => None,
    };
    let mut pace = Pace {
        epoch,
        dt_s: world.step_s,
        factor: 1.0,
        duration_s: args.duration_s,
        interrupts: Interrupts::watch()?,
    };
    match config.port {
        VehiclePort::Can => {
            ensure!(
                ros.is_empty(),
                "--ros-args: the port of {} is can",
                file.name()
            );
            pace.drive(
                BusRover::start(&file, &config, &world, epoch)?,
                truth,
                recording,
            )
        }
        VehiclePort::Ros2 => {
            pace.factor = config.ros2.clock_factor.unwrap_or(1.0);
            let rover = RosRover::start(&file, &config, &world, ros, epoch)?;
            pace.drive(rover, truth, recording)
        }
    }
}

/// How fast simulated time runs, and when it ends.
struct Pace {
    epoch: Epoch,
    dt_s: f64,
    /// Simulated seconds per second.
    factor: f64,
    duration_s: Option<f64>,
    interrupts: Interrupts,
}

impl Pace {
    fn drive(
        &self,
        mut rover: impl Rover,
        mut truth: Option<RoverTruth>,
        recording: Option<VehicleRecording>,
    ) -> Result<ExitCode> {
        let mut clock = Clock::Real(self.epoch);
        let mut step: u64 = 0;
        while !self.interrupts.ended() {
            step += 1;
            clock.wait_until(step as f64 * self.dt_s / self.factor);
            let now_s = clock.now_s() * self.factor;
            if self
                .duration_s
                .is_some_and(|duration_s| now_s >= duration_s)
            {
                break;
            }
            // Catch up after a late wake-up.
            step = step.max((now_s / self.dt_s) as u64);
            if self.interrupts.take_resumed() {
                rover.resume()?;
            }
            let reported = rover.advance(now_s)?;
            if let Some(recording) = recording.as_ref().filter(|_| reported) {
                recording.take(rover.state());
            }
            if reported && let Some(truth) = &mut truth {
                let state = rover.state();
                let unix_s = self.epoch.unix_s(state.time_s / self.factor);
                truth.write(unix_s, state, rover.mode())?;
            }
        }
        if let Some(reason) = recording
            .and_then(VehicleRecording::finish)
            .and_then(|status| status.ended)
        {
            console::complain(format_args!("--record: {reason}"));
        }
        let state = rover.state();
        console::line(format_args!(
            "{{\"time_s\":{:.3},\"x_m\":{:.4},\"y_m\":{:.4}}}",
            state.time_s, state.pose.x_m, state.pose.y_m
        ));
        Ok(ExitCode::SUCCESS)
    }
}

/// The file of `--truth`.
struct RoverTruth(BufWriter<File>);

impl RoverTruth {
    fn create(path: &Path) -> Result<Self> {
        let file =
            File::create(path).with_context(|| format!("cannot write {}", path.display()))?;
        let mut file = BufWriter::new(file);
        writeln!(
            file,
            "unix_s,time_s,x_m,y_m,yaw_rad,traction_m_s,steer_m_s,mode"
        )?;
        Ok(Self(file))
    }

    fn write(&mut self, unix_s: f64, s: &TrueState, mode: DriveMode) -> Result<()> {
        writeln!(
            self.0,
            "{unix_s:.6},{:.6},{:.9},{:.9},{:.9},{:.9},{:.9},{mode:?}",
            s.time_s,
            s.pose.x_m,
            s.pose.y_m,
            s.pose.yaw_rad,
            s.motors.traction_m_s,
            s.motors.steer_m_s,
        )?;
        // Flush, so that the rows survive if the process is killed.
        self.0.flush()?;
        Ok(())
    }
}
