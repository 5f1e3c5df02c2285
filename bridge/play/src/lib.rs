//! The simulation of `sidehill simulate` for a page: scenarios in, frames and figures out.
//!
//! A [`Hillside`] is a scenario that is read and checked. Each [`Rover`] on it is a run of one controller, with the
//! program's own configuration, closed loop and figures.

mod files;
mod rover;
mod setup;
mod vehicles;

pub use rover::Rover;

use serde_json::json;
use setup::Setup;
use sidehill::config::{Bundle, ConfigError, ConfigFile, Overrides, Plant, Prepared, Scenario};
use sidehill_controller::config::ControllerKind;
use sidehill_plant::contact::FrictionField;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::{Arc, Mutex};
use wasm_bindgen::prelude::*;

/// Where a scenario stands among the shipped files.
const SCENARIO: &str = "config/scenarios/scenario.yaml";
/// Longest drive, s.
const DRIVE_MAX_S: f64 = 1800.0;
/// Points of the reference that are shown.
const PATH_POINTS: u32 = 600;

/// Makes a panic a line of the page's console.
#[wasm_bindgen(start)]
pub fn start() {
    console_error_panic_hook::set_once();
}

/// Returns what there is to choose, and the columns of frames, as JSON.
#[wasm_bindgen]
pub fn choices() -> String {
    let controllers: Vec<_> = ControllerKind::ALL.iter().map(|kind| kind.name()).collect();
    json!({
        "vehicles": vehicles::VEHICLES,
        "controllers": controllers,
        "columns": rover::COLUMNS,
    })
    .to_string()
}

/// Returns the scenario of what was chosen, as YAML.
///
/// # Errors
/// Names the choice at fault.
#[wasm_bindgen]
pub fn scenario(setup: &str) -> Result<String, JsError> {
    let setup: Setup = serde_json::from_str(setup)?;
    setup.scenario().map_err(|error| JsError::new(&error))
}

/// A scenario with its vehicle, ground and path.
#[wasm_bindgen]
pub struct Hillside {
    prepared: Rc<Prepared>,
}

#[wasm_bindgen]
impl Hillside {
    /// Reads and checks a scenario. It may name shipped vehicles as the shipped scenarios do, and what is in its `files`.
    ///
    /// # Errors
    /// Names file, key, value and range.
    #[wasm_bindgen(constructor)]
    pub fn new(scenario: &str) -> Result<Self, JsError> {
        let prepared = prepare(scenario).map_err(|error| JsError::new(&error))?;
        Ok(Self {
            prepared: Rc::new(prepared),
        })
    }

    /// Returns the names of the scenario's controllers.
    pub fn controllers(&self) -> Vec<String> {
        let kinds = self.prepared.controllers.iter();
        kinds.map(|kind| kind.name().to_owned()).collect()
    }

    /// Returns as JSON: `path` as x, y, x, y ..., m; `vehicle` with its body's length and width and, of each wheel, place
    /// forward and left, diameter and width, m; duration, period and warnings.
    pub fn facts(&self) -> String {
        let prepared = &self.prepared;
        let reference = &prepared.reference;
        let end_s = reference.trajectory().duration_s();
        let path: Vec<f64> = (0..=PATH_POINTS)
            .flat_map(|i| {
                let time_s = end_s * f64::from(i) / f64::from(PATH_POINTS);
                let pose = reference.trajectory().at(time_s).pose();
                [pose.x_m, pose.y_m]
            })
            .collect();
        json!({
            "name": prepared.name,
            "path": path,
            "vehicle": prepared.vehicle.outline(),
            "duration_s": reference.end_s(),
            "period_s": prepared.controller.period_s,
            "note": prepared.route_note,
            "warnings": prepared.warnings,
        })
        .to_string()
    }

    /// Returns the heights of the ground at `points` x `points` places of a square, m, row by row from its lowest x and
    /// y; not a number where there is no ground.
    pub fn ground(&self, x_m: f64, y_m: f64, side_m: f64, points: u32) -> Vec<f64> {
        at_places([x_m, y_m], side_m, points, |x_m, y_m| {
            let surface = self.prepared.terrain.surface(x_m, y_m);
            surface.map_or(f64::NAN, |surface| surface.height_m)
        })
    }

    /// Returns how slippery the ground is at such places: 0 at the middle coefficient of friction and above, 1 at the
    /// least; empty where it is the same everywhere.
    pub fn slippery(&self, x_m: f64, y_m: f64, side_m: f64, points: u32) -> Vec<f64> {
        let Plant::Contact { vehicle, .. } = &self.prepared.plant else {
            return Vec::new();
        };
        let field = vehicle.friction.field;
        let FrictionField::Patches { minimum, .. } = field else {
            return Vec::new();
        };
        let middle = field.middle();
        at_places([x_m, y_m], side_m, points, |x_m, y_m| {
            let less = middle - field.coefficient_at(x_m, y_m);
            (less / (middle - minimum).max(1e-9)).clamp(0.0, 1.0)
        })
    }

    /// Returns a rover at the start, driven by a controller of that name.
    ///
    /// # Errors
    /// There is no such controller, or why the run cannot start.
    pub fn rover(&self, controller: &str) -> Result<Rover, JsError> {
        let kind = ControllerKind::from_name(controller)
            .ok_or_else(|| JsError::new(&format!("there is no controller {controller}")))?;
        Rover::new(self.prepared.clone(), kind).map_err(|error| JsError::new(&error))
    }
}

/// Returns the values at `points` x `points` places of a square, row by row from its lowest x and y, m.
fn at_places(
    [x_m, y_m]: [f64; 2],
    side_m: f64,
    points: u32,
    value: impl Fn(f64, f64) -> f64,
) -> Vec<f64> {
    let step_m = side_m / f64::from(points.max(2) - 1);
    let along = |i: u32| f64::from(i) * step_m;
    let places = (0..points).flat_map(|row| (0..points).map(move |column| (column, row)));
    places
        .map(|(column, row)| value(x_m + along(column), y_m + along(row)))
        .collect()
}

fn prepare(scenario: &str) -> Result<Prepared, String> {
    let shipped = files::FILES.iter();
    let shipped = shipped.map(|(path, text)| (PathBuf::from(path), (*text).to_owned()));
    let bundle: Bundle = Arc::new(Mutex::new(shipped.collect()));
    let file = ConfigFile::with_text(Path::new(SCENARIO), scenario.to_owned()).with_bundle(bundle);
    let prepared = Scenario::read(file).and_then(|read| read.prepare(&Overrides::default()));
    let prepared = prepared.map_err(|error| match error {
        ConfigError::Read { file, .. } => format!(
            "{file}: a page reads no files. Put its text into the scenario, under `files`, or name a shipped vehicle"
        ),
        content => content.to_string(),
    })?;
    let end_s = prepared.reference.end_s();
    if end_s > DRIVE_MAX_S {
        return Err(format!(
            "this path takes {end_s:.0} s; the page drives at most {DRIVE_MAX_S:.0} s: shorten it or drive it faster"
        ));
    }
    Ok(prepared)
}
