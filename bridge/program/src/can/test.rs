//! `sidehill can test`: turns each motor and judges what the layout says of it.

use super::bench::Bench;
use super::bus::ConfiguredBus;
use super::correct::corrected;
use super::terminal::Terminal;
use crate::interrupts::Interrupts;
use anyhow::{Context, Result, ensure};
use serde::Serialize;
use sidehill::config::ConfigFile;
use sidehill::console::{self, Printer};
use sidehill::drive::CanTestArgs;
use sidehill::exit::Exit;
use sidehill::output;
use sidehill::simulate::Format;
use sidehill_can::commissioning::{CommissioningVerdict, DriveKeys, MotorVerdict, judge};
use sidehill_plant::bounds::Bounds;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

/// Longest wait at the end for a reader of the output.
const PRINT_TIMEOUT: Duration = Duration::from_millis(500);

/// The verdict, as it is printed.
#[derive(Debug, Serialize)]
struct TestReport<'a> {
    #[serde(flatten)]
    verdict: &'a CommissioningVerdict,
    /// The corrected layout; none where nothing was written.
    written: Option<PathBuf>,
}

/// Turns the motors one after the other while a key is held, and prints what their layout has wrong. The exit status is 0
/// only if nothing is wrong or unknown.
///
/// # Errors
/// A file that cannot be read or written, no terminal, drives that do not report, a signal, or a person who does not act.
pub(super) fn run(args: &CanTestArgs) -> Result<ExitCode> {
    let speed_m_s = Bounds::new(0.01, 0.1, "m/s").check("--speed-m-s", args.speed_m_s)?;
    let bus = ConfiguredBus::read(&args.config)?;
    let layout = bus.layout_file()?;
    if let Some(path) = &args.write {
        output::check_writable(path, args.force)?;
        ensure!(
            folder(path)? == folder(layout.path())?,
            "--write: name a file beside {}, which names its database relative to itself",
            layout.name()
        );
    }
    // From now on a signal ends the test in order, so that the terminal is left as it was.
    let interrupts = Interrupts::watch()?;
    let terminal = Terminal::take()?;
    let printer = Printer::start()?;
    let trials = {
        let on_bus = (&bus.config, bus.interface.as_str(), &bus.layout);
        let mut bench = Bench::start(on_bus, speed_m_s, terminal, &interrupts, &printer)?;
        bench
            .trial(0)
            .and_then(|first| Ok([first, bench.trial(1)?]))
    };
    printer.finish(PRINT_TIMEOUT);
    let verdict = judge(&DriveKeys::of(&bus.layout), &trials?);
    let written = match &args.write {
        Some(path) if !verdict.corrections.is_empty() => {
            let text = corrected(&layout, &verdict.corrections)?;
            output::write(path, text.as_bytes(), args.force)?;
            Some(path.clone())
        }
        _ => None,
    };
    let report = TestReport {
        verdict: &verdict,
        written,
    };
    match args.format {
        Format::Json => console::line(serde_json::to_string(&report)?),
        Format::Table => print(&report, &layout),
    }
    Ok(Exit::answer(verdict.is_right()).into())
}

fn folder(path: &Path) -> Result<PathBuf> {
    let folder = path.parent().filter(|parent| *parent != Path::new(""));
    let folder = folder.unwrap_or(Path::new("."));
    let canonical = folder.canonicalize();
    canonical.with_context(|| folder.display().to_string())
}

fn print(report: &TestReport<'_>, layout: &ConfigFile) {
    for motor in &report.verdict.motors {
        console::line(measured(motor));
        for complaint in &motor.complaints {
            console::line(format_args!("  {complaint}"));
        }
    }
    let file = layout.name();
    match (&report.written, report.verdict.is_right()) {
        (_, true) => console::line(format_args!("{file} is right")),
        (None, false) => console::line(format_args!(
            "{file} is as it was: change it and test again"
        )),
        (Some(written), false) => console::line(format_args!(
            "{} has {} corrected scales: name it in the configuration and test again",
            written.display(),
            report.verdict.corrections.len()
        )),
    }
}

/// Returns what was measured of a motor, in a line.
fn measured(motor: &MotorVerdict) -> String {
    let mut line = format!(
        "{}: commanded {:.3} m at {} m/s, reported {:.3} m",
        motor.role.name(),
        motor.commanded_m,
        motor.command_m_s,
        motor.reported_m
    );
    if let Some(gain) = motor.gain {
        line += &format!(", {gain:+.3} times the command");
    }
    if let Some(measured_m) = motor.measured_m {
        line += &format!(", measured {measured_m:.3} m");
    }
    if let Some(counts_per_m) = motor.counts_per_m {
        line += &format!(", {counts_per_m:.0} encoder counts/m");
    }
    if motor.complaints.is_empty() {
        line += ": right";
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;
    use sidehill_can::commissioning::Seen;
    use sidehill_can::message::DriveRole;

    #[test]
    fn a_motor_is_told_in_a_line_with_all_that_was_measured() {
        let mut motor = MotorVerdict {
            role: DriveRole::Steer,
            seen: Seen::Forward,
            command_m_s: 0.05,
            gain: Some(-1.0004),
            commanded_m: 0.2525,
            reported_m: -0.2526,
            measured_m: Some(0.25),
            counts_per_m: Some(64171.4),
            complaints: vec!["the steer motor reports backward".to_owned()],
        };
        assert_eq!(
            measured(&motor),
            "steer: commanded 0.253 m at 0.05 m/s, reported -0.253 m, -1.000 times the command, measured 0.250 m, 64171 encoder counts/m"
        );
        (motor.gain, motor.measured_m, motor.counts_per_m) = (None, None, None);
        motor.complaints.clear();
        assert_eq!(
            measured(&motor),
            "steer: commanded 0.253 m at 0.05 m/s, reported -0.253 m: right"
        );
    }
}
