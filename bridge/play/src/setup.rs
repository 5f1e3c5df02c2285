//! Choices of the page as a scenario file that holds all files it names.

use crate::files;
use crate::vehicles::{ShippedVehicle, VEHICLES};
use serde::Deserialize;
use serde_json::json;
use serde_yaml::{Mapping, Value};
use std::f64::consts::TAU;
use std::fmt::Write;

/// What is chosen on the page.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Setup {
    vehicle: String,
    terrain: GroundChoice,
    slope_deg: f64,
    /// Heading that leads up, counter-clockwise from Y_g.
    uphill_deg: f64,
    /// Coefficient of friction; with patches the middle of it.
    friction: f64,
    patches: bool,
    sensors: SensorChoice,
    drives: DriveChoice,
    course: CourseChoice,
    speed_m_s: f64,
    controllers: Vec<String>,
    seed: u64,
    /// Points of a path that was drawn: x, y, x, y ..., m.
    path: Vec<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum GroundChoice {
    Plane,
    Terrace,
    Hummocks,
}

#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum SensorChoice {
    Perfect,
    Realistic,
}

#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum DriveChoice {
    Ideal,
    Realistic,
    Late,
    Weak,
}

#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum CourseChoice {
    FigureEight,
    Slalom,
    Circle,
    Straight,
    Cusp,
    Drawn,
}

/// Largest distance of a patch's friction from the middle.
const PATCHES: f64 = 0.2;
/// Step of the simulation, s.
const STEP_S: f64 = 0.005;

impl Setup {
    /// Returns the scenario as YAML.
    ///
    /// # Errors
    /// Names a vehicle that is not shipped, or what cannot be written.
    pub fn scenario(&self) -> Result<String, String> {
        let vehicle = VEHICLES
            .iter()
            .find(|vehicle| vehicle.id == self.vehicle)
            .ok_or_else(|| format!("there is no vehicle {}", self.vehicle))?;
        let mut texts = Texts::default();
        let mut keys = Mapping::new();
        let mut put = |key: &str, value: serde_json::Value| -> Result<(), String> {
            let value = serde_yaml::to_value(value).map_err(|error| error.to_string())?;
            keys.insert(key.into(), value);
            Ok(())
        };
        put("name", json!("play"))?;
        put(
            "vehicle",
            json!(texts.shipped("vehicle.yaml", vehicle.vehicle)?),
        )?;
        if let Some([wheels, identified]) = vehicle.contact {
            let wheels = texts.shipped("wheels.yaml", wheels)?;
            let identified = texts.shipped("identified.yaml", identified)?;
            put("plant", json!("contact"))?;
            put(
                "contact",
                json!({ "vehicle": wheels, "identified": identified }),
            )?;
            put("friction", self.friction())?;
        } else {
            put("plant", json!("icrik"))?;
        }
        put("terrain", self.terrain(vehicle, &mut texts))?;
        match self.course(vehicle) {
            Some(course) => put("course", course)?,
            None => {
                let file = texts.add("path.csv", self.drawn());
                put("route", json!({ "file": file }))?;
                put("speed", json!({ "speed_m_s": self.speed_m_s }))?;
            }
        }
        put("controllers", json!(self.controllers))?;
        put("seed", json!(self.seed))?;
        put("step_s", json!(STEP_S))?;
        keys.extend(self.conditions()?);
        keys.insert("files".into(), Value::Mapping(texts.0));
        let text = serde_yaml::to_string(&keys).map_err(|error| error.to_string())?;
        Ok(format!(
            "# Made by `sidehill play`: drive it with `sidehill simulate FILE`. The files that it names are in `files`.\n{text}"
        ))
    }

    fn friction(&self) -> serde_json::Value {
        if self.patches {
            json!({
                "kind": "patches",
                "minimum": self.friction - PATCHES,
                "maximum": self.friction + PATCHES,
                "cell_size_m": 3.0,
            })
        } else {
            json!({ "kind": "uniform", "coefficient": self.friction })
        }
    }

    fn terrain(&self, vehicle: &ShippedVehicle, texts: &mut Texts) -> serde_json::Value {
        let (slope_deg, size) = (self.slope_deg, vehicle.size);
        match self.terrain {
            GroundChoice::Plane => json!({
                "kind": "plane",
                "slope_deg": slope_deg,
                "uphill_heading_deg": self.uphill_deg,
            }),
            // A slope, a shelf across it, and the slope again.
            GroundChoice::Terrace => json!({
                "kind": "zones",
                "axis_heading_deg": self.uphill_deg,
                "cross_slope_deg": 0.0,
                "transition_m": 2.0 * size,
                "zones": [
                    { "start_m": -1000.0, "slope_deg": slope_deg },
                    { "start_m": -1.5 * size, "slope_deg": 0.0 },
                    { "start_m": 1.5 * size, "slope_deg": slope_deg },
                ],
            }),
            GroundChoice::Hummocks => {
                let file = texts.add("ground.asc", self.hummocks(size));
                json!({ "kind": "grid", "file": file })
            }
        }
    }

    /// Returns a grid of hummocks on a plane of half the slope; together they are as steep as the slope.
    fn hummocks(&self, size: f64) -> String {
        /// Points along a side.
        const POINTS: i32 = 81;
        let cell_m = 0.6 * size;
        let wave_m = 8.0 * size;
        let rise = (0.5 * self.slope_deg).to_radians().tan();
        let amplitude_m = rise * wave_m / TAU;
        let (sin, cos) = self.uphill_deg.to_radians().sin_cos();
        let corner_m = -0.5 * f64::from(POINTS - 1) * cell_m;
        let mut text = format!(
            "ncols {POINTS}\nnrows {POINTS}\nxllcenter {corner_m}\nyllcenter {corner_m}\ncellsize {cell_m}\n"
        );
        // From the north down.
        for row in (0..POINTS).rev() {
            for column in 0..POINTS {
                let x_m = corner_m + f64::from(column) * cell_m;
                let y_m = corner_m + f64::from(row) * cell_m;
                let up_m = cos * y_m - sin * x_m;
                let wave = (TAU * x_m / wave_m).cos() * (TAU * y_m / wave_m).sin();
                let separator = if column == 0 { "" } else { " " };
                // Writing to a text does not fail.
                let _ = write!(text, "{separator}{:.4}", rise * up_m + amplitude_m * wave);
            }
            text.push('\n');
        }
        text
    }

    /// Returns the course; none for a path that was drawn.
    fn course(&self, vehicle: &ShippedVehicle) -> Option<serde_json::Value> {
        let (size, speed_m_s) = (vehicle.size, self.speed_m_s);
        Some(match self.course {
            CourseChoice::Drawn => return None,
            CourseChoice::FigureEight => json!({
                "shape": "figure_eight",
                "half_width_m": 2.4 * size,
                "half_length_m": 3.9 * size,
                "period_s": eight_length_m(2.4 * size, 3.9 * size) / speed_m_s,
            }),
            CourseChoice::Slalom => json!({
                "shape": "slalom",
                "length_m": 16.0 * size,
                "amplitude_m": size,
                "wavelength_m": 8.0 * size,
                "speed_m_s": speed_m_s,
            }),
            CourseChoice::Circle => json!({
                "shape": "circle",
                "radius_m": 2.5 * size,
                "speed_m_s": speed_m_s,
                "turns": 1,
            }),
            CourseChoice::Straight => json!({
                "shape": "straight",
                "length_m": 12.0 * size,
                "speed_m_s": speed_m_s,
            }),
            CourseChoice::Cusp => json!({
                "shape": "cusp",
                "radius_m": 3.0 * size,
                "speed_m_s": speed_m_s,
            }),
        })
    }

    fn drawn(&self) -> String {
        let mut text = String::from("x_m,y_m\n");
        for point in self.path.chunks_exact(2) {
            let _ = writeln!(text, "{:.3},{:.3}", point[0], point[1]);
        }
        text
    }

    /// Returns sensors, drives and what the controllers know of them.
    fn conditions(&self) -> Result<Mapping, String> {
        let realistic = files::shipped("config/conditions/realistic.yaml")
            .ok_or("the realistic conditions are missing")?;
        let mut realistic: Mapping =
            serde_yaml::from_str(realistic).map_err(|error| error.to_string())?;
        let mut keys = Mapping::new();
        let mut known = match realistic.remove("controller") {
            Some(Value::Mapping(known)) => known,
            _ => Mapping::new(),
        };
        match self.sensors {
            SensorChoice::Realistic => keys.extend(realistic.remove_entry("sensors")),
            SensorChoice::Perfect => {
                known.remove("weights");
                let exact = "{pose_sigma_m: 0.0001, pose_sigma_rad: 0.0001, gate: 100000}";
                let exact = serde_yaml::from_str(exact).map_err(|error| error.to_string())?;
                known.insert("estimator".into(), exact);
            }
        }
        if self.drives == DriveChoice::Ideal {
            for key in ["command_delay_s", "motor_lag_s", "limits"] {
                known.remove(key);
            }
        } else if let Some((key, mut drives)) = realistic.remove_entry("drive_train") {
            let changes = match self.drives {
                DriveChoice::Ideal | DriveChoice::Realistic => "{}",
                // The controllers are told 0.1 s and 0.15 s.
                DriveChoice::Late => {
                    "{delay_s: 0.35, traction: {time_constant_s: 0.4}, steer: {time_constant_s: 0.4}}"
                }
                // The controllers are told 1 m/s.
                DriveChoice::Weak => {
                    "{traction: {speed_max_m_s: 0.4, acceleration_max_m_s2: 0.3}, \
                     steer: {speed_max_m_s: 0.25, acceleration_max_m_s2: 0.5}}"
                }
            };
            let changes = serde_yaml::from_str(changes).map_err(|error| error.to_string())?;
            merge(&mut drives, changes);
            keys.insert(key, drives);
        }
        keys.insert("controller".into(), Value::Mapping(known));
        Ok(keys)
    }
}

/// Texts of files by their names.
#[derive(Default)]
struct Texts(Mapping);

impl Texts {
    fn add<'a>(&mut self, name: &'a str, text: String) -> &'a str {
        self.0.insert(name.into(), text.into());
        name
    }

    fn shipped<'a>(&mut self, name: &'a str, path: &str) -> Result<&'a str, String> {
        let text = files::shipped(path).ok_or_else(|| format!("{path} is missing"))?;
        Ok(self.add(name, text.to_owned()))
    }
}

/// Merges `new` into `old`, key by key.
fn merge(old: &mut Value, new: Value) {
    match (old, new) {
        (Value::Mapping(old), Value::Mapping(new)) => {
            for (key, value) in new {
                merge(old.entry(key).or_insert(Value::Null), value);
            }
        }
        (old, new) => *old = new,
    }
}

/// Returns the length of the figure of eight x = w sin 2a, y = l sin a, m.
fn eight_length_m(half_width_m: f64, half_length_m: f64) -> f64 {
    const PARTS: i32 = 1000;
    let speed = |i: i32| {
        let angle = TAU * f64::from(i) / f64::from(PARTS);
        let x = 2.0 * half_width_m * (2.0 * angle).cos();
        x.hypot(half_length_m * angle.cos())
    };
    (0..PARTS).map(speed).sum::<f64>() * TAU / f64::from(PARTS)
}
