//! A scenario that is ready to run.

use super::plant::Plant;
use crate::learned::LearnedFile;
use sidehill_controller::config::{AttitudePreview, ControllerConfig, ControllerKind};
use sidehill_controller::controller::{Controller, ControllerError};
use sidehill_controller::guard::{Stance, SteepPlace, first_steep_place};
use sidehill_controller::reference::Reference;
use sidehill_controller::speed_profile::SpeedLimits;
use sidehill_plant::drive_train::DriveTrainConfig;
use sidehill_plant::frames::PlanarPose;
use sidehill_plant::sensors::SensorsConfig;
use sidehill_plant::simulation::{Simulation, SimulationError, SimulationSetup};
use sidehill_plant::terrain::Terrain;
use sidehill_plant::vehicle::Vehicle;
use std::sync::Arc;

/// A scenario with everything read, checked and built. Runs share it.
#[derive(Clone)]
pub struct Prepared {
    /// Name for tables.
    pub name: String,
    /// What moves the vehicle.
    pub plant: Plant,
    /// The vehicle, as controllers know it.
    pub vehicle: Vehicle,
    /// The ground.
    pub terrain: Terrain,
    /// The reference from its start.
    pub reference: Reference,
    /// Where the vehicle starts.
    pub start: PlanarPose,
    /// Controllers to run.
    pub controllers: Vec<ControllerKind>,
    /// Seed of everything random.
    pub seed: u64,
    /// Step of the simulation, s.
    pub step_s: f64,
    /// Simulated drive train.
    pub drive_train: DriveTrainConfig,
    /// Simulated sensors.
    pub sensors: SensorsConfig,
    /// Settings of the controllers.
    pub controller: ControllerConfig,
    /// How recorded points were processed, as text; empty for a course.
    pub route_note: String,
    /// Bounds on the speed along a path.
    pub speed_limits: SpeedLimits,
    /// What was learned before; controllers start from it.
    pub learned: Option<Arc<LearnedFile>>,
    /// Settings that are valid but probably unintended.
    pub warnings: Vec<String>,
}

impl Prepared {
    /// Returns the vehicle in its world, standing at its start.
    ///
    /// # Errors
    /// Names the setting that is out of range, or why there is no ground at the start.
    pub fn simulation(&self) -> Result<Simulation, SimulationError> {
        Simulation::new(SimulationSetup {
            terrain: self.terrain.clone(),
            motion: self.plant.motion(),
            drive_train: self.drive_train.clone(),
            sensors: self.sensors,
            encoder_scale: self.plant.encoder_scale(),
            start: self.start,
            dt_s: self.step_s,
            seed: self.seed,
        })
    }

    /// Returns the vehicle's stance, where the steepness guard is on and the mass is known.
    pub fn stance(&self) -> Option<Stance> {
        self.controller.guard?;
        Stance::of(&self.vehicle)
    }

    /// Returns the first place of the reference at which the guard would stop, if the guard is on, knows the ground,
    /// and is to refuse such routes.
    pub fn refused_place(&self) -> Option<SteepPlace> {
        let guard = self.controller.guard.filter(|guard| guard.refuse_route)?;
        if self.controller.attitude_preview != AttitudePreview::Terrain {
            return None;
        }
        let trajectory = self.reference.trajectory();
        first_steep_place(&guard, &self.stance()?, trajectory, &self.terrain)
    }

    /// Returns a controller of one kind at the start of the reference.
    ///
    /// # Errors
    /// [`ControllerError`] for settings out of range.
    pub fn controller(&self, kind: ControllerKind) -> Result<Controller, ControllerError> {
        let mut controller = Controller::new(kind, self.controller.clone(), &self.vehicle)?
            .with_terrain(self.terrain.clone());
        if let Some(learned) = &self.learned {
            controller.recall(&learned.learned)?;
        }
        controller.follow(self.reference.clone());
        Ok(controller)
    }
}
