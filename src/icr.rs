//! `sidehill icr`: tread ICRs and body velocities of a vehicle for attitudes and tread speeds.
//!
//! The tread speeds are effective ones, V_l and V_r of equation (11): the vehicle's c_l and c_r are not
//! applied to them. Multiply what encoders read by c_l and c_r first.

use crate::config::ConfigFile;
use anyhow::{Context, Result, anyhow};
use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::{Bounds, RangeError};
use sidehill_plant::frames::Attitude;
use sidehill_plant::speeds::TreadSpeeds;
use sidehill_plant::vehicle::Vehicle;
use std::io::{Read, Write};
use std::path::PathBuf;

/// Arguments of `sidehill icr`.
#[derive(Debug, Clone, clap::Args)]
pub struct IcrArgs {
    /// Vehicle whose ICRIK is evaluated.
    #[arg(long, value_name = "FILE")]
    pub vehicle: PathBuf,
}

/// A line of input; other columns are ignored.
#[derive(Debug, Deserialize)]
struct IcrLine {
    roll_rad: String,
    pitch_rad: String,
    v_left_m_s: String,
    v_right_m_s: String,
}

/// Inputs of the models.
#[derive(Debug, Clone, Copy)]
pub struct IcrInput {
    /// Roll, rad.
    pub roll_rad: f64,
    /// Pitch, rad.
    pub pitch_rad: f64,
    /// Effective speed of the left tread V_l, m/s.
    pub v_left_m_s: f64,
    /// Effective speed of the right tread V_r, m/s.
    pub v_right_m_s: f64,
}

impl IcrLine {
    /// Returns the numbers.
    fn input(&self) -> Result<IcrInput> {
        // Parsed by hand, because the csv crate names neither the column nor the text.
        let number = |key: &str, text: &str| -> Result<f64> {
            text.parse()
                .map_err(|_| anyhow!("{key}: `{text}` is not a number"))
        };
        Ok(IcrInput {
            roll_rad: number("roll_rad", &self.roll_rad)?,
            pitch_rad: number("pitch_rad", &self.pitch_rad)?,
            v_left_m_s: number("v_left_m_s", &self.v_left_m_s)?,
            v_right_m_s: number("v_right_m_s", &self.v_right_m_s)?,
        })
    }
}

#[derive(Debug, Serialize)]
struct Output<'a> {
    vehicle: &'a str,
    roll_rad: f64,
    pitch_rad: f64,
    v_left_m_s: f64,
    v_right_m_s: f64,
    x_icr_left_m: f64,
    x_icr_right_m: f64,
    y_icr_m: f64,
    v_x_m_s: f64,
    v_y_m_s: f64,
    omega_z_rad_s: f64,
}

/// Reads CSV from `input`, one attitude and effective tread speeds (V_l, V_r, after c_l and c_r) a
/// line, and writes the model's results to `output`.
///
/// # Errors
/// Names the vehicle's file, or the line and column at fault.
pub fn run(args: &IcrArgs, input: impl Read, output: impl Write) -> Result<()> {
    let vehicle: Vehicle = ConfigFile::read(&args.vehicle)?.parse()?;
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_reader(input);
    let mut writer = csv::Writer::from_writer(output);
    for (index, line) in reader.deserialize().enumerate() {
        // The header is line 1.
        let line_number = index + 2;
        let place = || format!("standard input, line {line_number}");
        let line: IcrLine = line.with_context(place)?;
        let input = line.input().with_context(place)?;
        let (attitude, treads) = input.checked().with_context(place)?;
        let icrs = vehicle.icrik(attitude, treads);
        let velocity = icrs.body_velocity(treads);
        writer.serialize(Output {
            vehicle: &vehicle.name,
            roll_rad: input.roll_rad,
            pitch_rad: input.pitch_rad,
            v_left_m_s: input.v_left_m_s,
            v_right_m_s: input.v_right_m_s,
            x_icr_left_m: icrs.left_m,
            x_icr_right_m: icrs.right_m,
            y_icr_m: icrs.forward_m,
            v_x_m_s: velocity.right_m_s,
            v_y_m_s: velocity.forward_m_s,
            omega_z_rad_s: velocity.yaw_rate_rad_s,
        })?;
    }
    writer.flush()?;
    Ok(())
}

impl IcrInput {
    /// Returns attitude and effective tread speeds, each within its range.
    ///
    /// # Errors
    /// Names the value and its range.
    pub fn checked(&self) -> Result<(Attitude, TreadSpeeds), RangeError> {
        const QUARTER_TURN: f64 = std::f64::consts::FRAC_PI_2;
        let angle = |key, value| Bounds::new(-QUARTER_TURN, QUARTER_TURN, "rad").check(key, value);
        let speed = |key, value| Bounds::new(-100.0, 100.0, "m/s").check(key, value);
        let attitude = Attitude {
            roll_rad: angle("roll_rad", self.roll_rad)?,
            pitch_rad: angle("pitch_rad", self.pitch_rad)?,
        };
        let treads = TreadSpeeds {
            left_m_s: speed("v_left_m_s", self.v_left_m_s)?,
            right_m_s: speed("v_right_m_s", self.v_right_m_s)?,
        };
        Ok((attitude, treads))
    }
}
