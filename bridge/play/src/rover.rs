//! A rover on the hillside: a run under way, and what the page shows of it.

use sidehill::closed_loop::Drive;
use sidehill::config::Prepared;
use sidehill::record::status_words;
use sidehill_controller::closed_loop::Cycle;
use sidehill_controller::config::ControllerKind;
use sidehill_controller::guard::{Stance, Turning};
use sidehill_plant::frames::PlanarPose;
use sidehill_plant::simulation::Simulation;
use sidehill_plant::vehicle::Vehicle;
use std::f64::consts::FRAC_PI_2;
use std::rc::Rc;
use wasm_bindgen::prelude::*;

/// What a frame holds, in this order; not a number where it is not known. Units: s, m, rad, m/s. x is X_g, y is Y_g, and
/// headings are counter-clockwise from X_g; slides are forward and left.
pub const COLUMNS: [&str; 19] = [
    "t",
    "x",
    "y",
    "heading",
    "downhill_x",
    "downhill_y",
    "cross_track",
    "traction",
    "traction_command",
    "steer",
    "steer_command",
    "tip_over_margin",
    "friction_use",
    "slide_x",
    "slide_y",
    "estimate_x",
    "estimate_y",
    "progress",
    "cycle_us",
];

/// A controller that drives its rover.
#[wasm_bindgen]
pub struct Rover {
    drive: Drive<Rc<Prepared>, Simulation>,
    stance: Option<Stance>,
    friction: f64,
    level: Vehicle,
    state: &'static str,
    reason: String,
}

impl Rover {
    pub(crate) fn new(prepared: Rc<Prepared>, kind: ControllerKind) -> Result<Self, String> {
        let simulation = prepared.simulation().map_err(|error| error.to_string())?;
        let plant = prepared.plant.kind().name();
        let wheels = prepared.vehicle.contact_vehicle();
        let middle = wheels.friction.field.middle();
        let (stance, friction, level) = (
            Stance::of(&prepared.vehicle),
            prepared.plant.friction().unwrap_or(middle),
            prepared.vehicle.on_level_ground(),
        );
        let drive = Drive::new(prepared, kind, simulation, plant);
        Ok(Self {
            drive: drive.map_err(|error| format!("{error:#}"))?,
            stance,
            friction,
            level,
            state: "waiting",
            reason: String::new(),
        })
    }

    fn frame(&self, cycle: &Cycle) -> [f64; COLUMNS.len()] {
        let (state, decision) = (&cycle.state, &cycle.decision);
        let downhill = state.attitude.plane_normal(state.pose.yaw_rad);
        let turning = Turning {
            speed_m_s: state.velocity.forward_m_s,
            yaw_rate_rad_s: state.velocity.yaw_rate_rad_s,
        };
        let margins = self
            .stance
            .map(|stance| stance.margins(&state.attitude, &turning, self.friction));
        // How the vehicle moves otherwise than on level ground.
        let level = self.level.body_velocity(state.attitude, state.treads);
        let estimate = decision.estimate.map(|estimate| estimate.pose);
        let command = decision.command_effective;
        [
            state.time_s,
            state.pose.x_m,
            state.pose.y_m,
            state.pose.yaw_rad + FRAC_PI_2,
            downhill.x,
            downhill.y,
            cycle.errors.cross_track_m,
            state.motors.traction_m_s,
            command.traction_m_s,
            state.motors.steer_m_s,
            command.steer_m_s,
            margins.map_or(f64::NAN, |margins| margins.rollover),
            margins.map_or(f64::NAN, |margins| margins.friction_use),
            state.velocity.forward_m_s - level.forward_m_s,
            level.right_m_s - state.velocity.right_m_s,
            estimate.map_or(f64::NAN, |pose| pose.x_m),
            estimate.map_or(f64::NAN, |pose| pose.y_m),
            cycle.progress,
            1e6 * cycle.duration.as_secs_f64(),
        ]
    }
}

#[wasm_bindgen]
impl Rover {
    /// Decides and moves on to the next control cycle. Returns the frame of the cycle; nothing after the end.
    pub fn step(&mut self) -> Option<Vec<f64>> {
        let cycle = self.drive.decide()?;
        let frame = self.frame(&cycle);
        (self.state, self.reason) = status_words(cycle.decision.status);
        self.drive.advance();
        Some(frame.to_vec())
    }

    /// Returns whether the run has ended.
    pub fn ended(&self) -> bool {
        self.drive.has_ended()
    }

    /// Returns what the controller does: waiting, tracking, fallback, stopping or finished.
    pub fn state(&self) -> String {
        self.state.to_owned()
    }

    /// Returns why, where there is a reason.
    pub fn reason(&self) -> String {
        self.reason.clone()
    }

    /// Returns the plan as x, y, x, y ..., m; empty for a controller without one.
    pub fn plan(&self) -> Vec<f64> {
        let plan = self.drive.controller().plan();
        let states = plan.into_iter().flat_map(|plan| &plan.states);
        states.flat_map(|state| [state.x, state.y]).collect()
    }

    /// Puts the rover to another place, with the same heading.
    ///
    /// # Errors
    /// Why there is no ground.
    pub fn put(&mut self, x_m: f64, y_m: f64) -> Result<(), JsError> {
        let simulation = self.drive.plant_mut();
        let yaw_rad = simulation.state().pose.yaw_rad;
        let at = PlanarPose { x_m, y_m, yaw_rad };
        simulation
            .put(at)
            .map_err(|error| JsError::new(&error.to_string()))
    }

    /// Returns the figures as JSON, those of a run of `simulate --format json`.
    ///
    /// # Errors
    /// What cannot be written.
    pub fn figures(&self) -> Result<String, JsError> {
        Ok(serde_json::to_string(&self.drive.summary())?)
    }
}
