//! How the drives respond to commands: `sidehill identify --drives`.

use super::args::IdentifyArgs;
use crate::config::ConfigFile;
use crate::console;
use crate::drive_log::LogReader;
use crate::output;
use crate::progress::Notice;
use crate::simulate::Format;
use anyhow::{Context, Result};
use serde_json::{Value, json};
use sidehill_plant::identification::{Finding, MotorResponse, MotorResponses, identify_drives};
use sidehill_plant::log::DriveRecord;
use sidehill_plant::vehicle::Vehicle;
use std::fmt::Write;

/// How the drives respond to commands.
pub struct IdentifiedDrives(MotorResponses);

impl IdentifiedDrives {
    /// Identifies the drives from commands and measured speeds.
    ///
    /// # Errors
    /// What the records lack.
    pub fn of_records(records: &[DriveRecord]) -> Result<Self> {
        Ok(Self(identify_drives(records)?))
    }

    /// Returns `drives`, `verdict` and `controller`, the keys of [`Self::conditions`], as `identify --drives --format json`
    /// prints them.
    ///
    /// # Errors
    /// None but a defect: conditions that are no YAML.
    pub fn json(&self) -> Result<Value> {
        let motors = motors(&self.0).map(|(name, motor)| (name.to_owned(), motor_json(motor)));
        let conditions: Value = serde_yaml::from_str(&self.conditions())?;
        Ok(json!({
            "drives": Value::Object(motors.into_iter().collect()),
            "verdict": verdict(&self.0),
            "controller": conditions["controller"],
        }))
    }

    /// Returns what `identify --drives` prints: a table of each motor, and the verdict.
    pub fn text(&self) -> String {
        let mut text = String::new();
        for (name, motor) in motors(&self.0) {
            text += &motor.map_or_else(String::new, |motor| table(name, motor));
        }
        for line in verdict(&self.0) {
            text += &line;
            text.push('\n');
        }
        text
    }

    /// Returns the responses as conditions: the keys of the controller, with comments where they are not known.
    pub fn conditions(&self) -> String {
        conditions(&self.0)
    }
}

/// Identifies the drives, prints what was found, and writes it as conditions for a controller.
///
/// # Errors
/// Names the file, row, column or topic at fault, or says what the logs lack.
pub(super) fn run(args: &IdentifyArgs) -> Result<()> {
    let vehicle: Vehicle = ConfigFile::read(&args.vehicle)?.parse()?;
    let notice = Notice::begin(format!(
        "identify: reads {} logs and fits",
        args.drives.len()
    ));
    let reader = LogReader::new(&args.maps)?;
    let records = args
        .drives
        .iter()
        .map(|path| reader.read_commands(path, &vehicle.encoder_scale, console::complain))
        .collect::<Result<Vec<_>>>()?;
    let drives = IdentifiedDrives::of_records(&records).context("--drives")?;
    drop(notice);
    output::write(&args.out, drives.conditions().as_bytes(), args.force)?;
    match args.format {
        Format::Table => {
            console::text(drives.text());
            console::line(format_args!("written: {}", args.out.display()));
        }
        Format::Json => {
            let mut json = drives.json()?;
            json["written"] = serde_json::to_value(&args.out)?;
            console::line(json);
        }
    }
    Ok(())
}

fn motors(response: &MotorResponses) -> [(&'static str, Option<&MotorResponse>); 2] {
    [
        ("traction", response.traction.as_ref()),
        ("steer", response.steer.as_ref()),
    ]
}

/// Quantities of a motor with their names in tables and JSON.
fn quantities(motor: &MotorResponse) -> [(&'static str, Finding); 7] {
    [
        ("delay_s", motor.delay_s),
        ("time_constant_s", motor.time_constant_s),
        ("gain", motor.gain),
        ("speed_max_m_s", motor.speed_max_m_s),
        ("acceleration_max_m_s2", motor.acceleration_max_m_s2),
        ("deceleration_max_m_s2", motor.deceleration_max_m_s2),
        ("dead_band_m_s", motor.dead_band_m_s),
    ]
}

fn table(name: &str, motor: &MotorResponse) -> String {
    let mut out = format!(
        "{name}: {} speeds, {:.4} m/s RMS unexplained\n",
        motor.samples, motor.residual_m_s
    );
    for (key, finding) in quantities(motor) {
        let text = match finding {
            Finding::Found {
                value,
                interval: (low, high),
            } => format!("{value:>9.4}, {low:.4} to {high:.4} (95 %)"),
            Finding::AtLeast(value) => format!("not reached: at least {value:.4}"),
            Finding::AtMost(value) => format!("does not show: at most {value:.4}"),
            Finding::Unknown => "cannot be told from these logs".to_owned(),
        };
        let _ = writeln!(out, "  {key:22} {text}");
    }
    out
}

fn motor_json(motor: Option<&MotorResponse>) -> Value {
    let Some(motor) = motor else {
        return Value::Null;
    };
    let mut fields: serde_json::Map<String, Value> = quantities(motor)
        .into_iter()
        .map(|(key, finding)| {
            let value = match finding {
                Finding::Found { value, interval } => {
                    json!({"value": value, "interval_95": interval})
                }
                Finding::AtLeast(value) => json!({"at_least": value}),
                Finding::AtMost(value) => json!({"at_most": value}),
                Finding::Unknown => Value::Null,
            };
            (key.to_owned(), value)
        })
        .collect();
    fields.insert("command_max_m_s".to_owned(), json!(motor.command_max_m_s));
    fields.insert("residual_m_s".to_owned(), json!(motor.residual_m_s));
    fields.insert("samples".to_owned(), json!(motor.samples));
    Value::Object(fields)
}

/// Share by which a gain or a speed may be off without a word.
const WORTH_SAYING: f64 = 0.03;

/// Returns what the responses mean, a sentence each.
fn verdict(response: &MotorResponses) -> Vec<String> {
    let mut lines = Vec::new();
    for (name, motor) in motors(response) {
        let Some(motor) = motor else {
            lines.push(format!(
                "the {name} motor was never commanded to move: nothing can be told of it"
            ));
            continue;
        };
        let asked_m_s = motor.command_max_m_s;
        match motor.speed_max_m_s {
            Finding::Found { value, .. } if value < (1.0 - WORTH_SAYING) * asked_m_s => lines.push(
                format!("the {name} motor reaches {value:.2} m/s of {asked_m_s:.2} commanded"),
            ),
            _ => lines.push(format!(
                "the {name} motor was never at a limit of its speed: it was commanded up to {asked_m_s:.2} m/s"
            )),
        }
        if let Finding::Found {
            value,
            interval: (low, high),
        } = motor.gain
            && (high < 1.0 - WORTH_SAYING || low > 1.0 + WORTH_SAYING)
        {
            let (percent, word) = (
                100.0 * (value - 1.0).abs(),
                if value < 1.0 { "slower" } else { "faster" },
            );
            lines.push(format!(
                "the {name} motor runs {percent:.0} % {word} than commanded"
            ));
        }
        if let Finding::Found { value, .. } = motor.dead_band_m_s {
            lines.push(format!(
                "the {name} motor does not move below {value:.3} m/s commanded"
            ));
        }
    }
    lines
}

/// Returns the mean of a quantity of both motors, weighted by how well it is known.
fn shared(response: &MotorResponses, quantity: fn(&MotorResponse) -> Finding) -> Option<f64> {
    let (mut sum, mut weights) = (0.0, 0.0);
    for (_, motor) in motors(response) {
        if let Some(Finding::Found {
            value,
            interval: (low, high),
        }) = motor.map(quantity)
        {
            let weight = (high - low).max(1e-3).powi(-2);
            sum += weight * value;
            weights += weight;
        }
    }
    (weights > 0.0).then(|| sum / weights)
}

fn conditions(response: &MotorResponses) -> String {
    let mut out =
        "# Identified by: sidehill identify --drives\nname: identified-drives\ncontroller:\n"
            .to_owned();
    for (key, value) in [
        ("command_delay_s", shared(response, |motor| motor.delay_s)),
        (
            "motor_lag_s",
            shared(response, |motor| motor.time_constant_s),
        ),
    ] {
        let _ = match value {
            Some(value) => writeln!(out, "  {key}: {value:.3}"),
            None => writeln!(out, "  # {key}: cannot be told from these logs"),
        };
    }
    let (Some(traction), Some(steer)) = (&response.traction, &response.steer) else {
        out += "  # limits: one of the motors was never driven\n";
        return out;
    };
    out += "  limits:\n";
    let mut tread_speed_m_s = 0.0;
    for (name, motor) in [("traction", traction), ("steer", steer)] {
        let _ = writeln!(out, "    {name}:");
        for (key, finding) in [
            ("speed_m_s", motor.speed_max_m_s),
            ("acceleration_m_s2", motor.acceleration_max_m_s2),
            ("deceleration_m_s2", motor.deceleration_max_m_s2),
        ] {
            let (value, comment) = match finding {
                Finding::AtLeast(value) => (value, " # not reached: at least this"),
                other => (other.value().unwrap_or_default(), ""),
            };
            let _ = writeln!(out, "      {key}: {:.3}{comment}", value.max(1e-3));
            if key == "speed_m_s" {
                tread_speed_m_s += value;
            }
        }
    }
    let _ = writeln!(
        out,
        "    tread_speed_m_s: {:.3} # both together; a limit of the treads alone is not looked for",
        tread_speed_m_s.max(1e-3)
    );
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Conditions;
    use std::path::Path;

    fn found(value: f64) -> Finding {
        Finding::Found {
            value,
            interval: (0.95 * value, 1.05 * value),
        }
    }

    fn motor() -> MotorResponse {
        MotorResponse {
            delay_s: found(0.1),
            time_constant_s: Finding::Unknown,
            gain: found(0.9),
            speed_max_m_s: found(0.48),
            acceleration_max_m_s2: found(0.5),
            deceleration_max_m_s2: Finding::AtLeast(1.5),
            dead_band_m_s: Finding::AtMost(0.02),
            command_max_m_s: 0.6,
            residual_m_s: 0.01,
            samples: 1000,
        }
    }

    #[test]
    fn what_is_written_are_conditions_and_unknown_keys_are_comments() {
        let both = MotorResponses {
            traction: Some(motor()),
            steer: Some(motor()),
        };
        let text = conditions(&both);
        Conditions::parse(&ConfigFile::with_text(
            Path::new("found.yaml"),
            text.clone(),
        ))
        .unwrap();
        assert!(text.contains("command_delay_s: 0.100"), "{text}");
        assert!(text.contains("# motor_lag_s"), "{text}");
        assert!(
            text.contains("deceleration_m_s2: 1.500 # not reached"),
            "{text}"
        );
        let one = MotorResponses {
            steer: None,
            ..both
        };
        let text = conditions(&one);
        Conditions::parse(&ConfigFile::with_text(
            Path::new("found.yaml"),
            text.clone(),
        ))
        .unwrap();
        assert!(text.contains("# limits"), "{text}");
    }

    #[test]
    fn the_verdict_says_what_a_motor_reaches_and_what_is_not_known() {
        let lines = verdict(&MotorResponses {
            traction: Some(motor()),
            steer: None,
        });
        assert_eq!(
            lines,
            [
                "the traction motor reaches 0.48 m/s of 0.60 commanded",
                "the traction motor runs 10 % slower than commanded",
                "the steer motor was never commanded to move: nothing can be told of it",
            ]
        );
    }
}
