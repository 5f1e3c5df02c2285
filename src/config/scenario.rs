//! A scenario: vehicle, ground, reference, plant, sensors and controllers of a simulation.

use super::reference::{Reference, RouteConfig, Source, SpeedConfig};
use super::{CONTACT_IDENTIFIED, CONTACT_VEHICLE, ConfigError, ConfigFile};
use serde::Deserialize;
use sidehill_controller::config::{ControllerConfig, ControllerKind};
use sidehill_controller::course::Course;
use sidehill_controller::reference::Tracking;
use sidehill_controller::trajectory::Trajectory;
use sidehill_plant::contact::{ContactModel, ContactVehicle, FrictionField};
use sidehill_plant::drive_train::DriveTrainConfig;
use sidehill_plant::frames::PlanarPose;
use sidehill_plant::motion::{IcrMotion, MotionModel};
use sidehill_plant::sensors::SensorsConfig;
use sidehill_plant::simulation::{Simulation, SimulationError, SimulationSetup};
use sidehill_plant::terrain::{
    GridTerrain, PlaneTerrain, RoutePoint, RouteSmoothing, RouteTerrain, Terrain, ZonedTerrain,
};
use sidehill_plant::vehicle::{RangeError, SpeedCorrection, Vehicle};
use std::path::PathBuf;

/// What moves the simulated vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum PlantKind {
    /// The exact ICRIK model.
    Icrik,
    /// Wheels with friction on the ground.
    Contact,
}

impl PlantKind {
    /// Returns the name of command lines and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Icrik => "icrik",
            Self::Contact => "contact",
        }
    }
}

/// The ground of a scenario.
#[derive(Debug, Clone, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum TerrainConfig {
    /// Level ground.
    Level,
    /// One plane.
    Plane(PlaneTerrain),
    /// Plane zones along an axis.
    Zones(ZonedTerrain),
    /// An elevation grid.
    Grid {
        /// ESRI ASCII grid, relative to the scenario.
        file: PathBuf,
        /// Easting of the world's origin in the grid's coordinates, m.
        #[serde(default)]
        origin_east_m: f64,
        /// Northing of the world's origin in the grid's coordinates, m.
        #[serde(default)]
        origin_north_m: f64,
    },
    /// The elevation recorded with the route.
    Route(RouteSmoothing),
}

/// Where the vehicle starts, against the start of the reference.
#[derive(Debug, Clone, Copy, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct StartOffset {
    right_m: f64,
    forward_m: f64,
    heading_deg: f64,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawScenario {
    name: String,
    vehicle: PathBuf,
    terrain: TerrainConfig,
    #[serde(default)]
    course: Option<Course>,
    #[serde(default)]
    route: Option<RouteConfig>,
    #[serde(default = "one_lap")]
    laps: u32,
    #[serde(default)]
    speed: SpeedConfig,
    #[serde(default)]
    start: StartOffset,
    controllers: Vec<ControllerKind>,
    plant: PlantKind,
    #[serde(default)]
    contact: Option<ContactFiles>,
    #[serde(default)]
    friction: Option<GroundFriction>,
    #[serde(default)]
    model_error: ModelError,
    seed: u64,
    step_s: f64,
    #[serde(default)]
    drive_train: DriveTrainConfig,
    #[serde(default)]
    sensors: SensorsConfig,
    #[serde(default)]
    controller: ControllerConfig,
}

/// Friction of the ground in place of that in the contact vehicle's file.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum GroundFriction {
    /// The same everywhere.
    Uniform {
        /// Coefficient of friction.
        coefficient: f64,
    },
    /// Smooth patches, which the run's seed chooses.
    Patches {
        /// Smallest coefficient of friction.
        minimum: f64,
        /// Largest coefficient of friction.
        maximum: f64,
        /// About the size of a patch, m.
        cell_size_m: f64,
    },
}

impl GroundFriction {
    fn field(&self, seed: u64) -> FrictionField {
        match *self {
            Self::Uniform { coefficient } => FrictionField::Uniform { coefficient },
            Self::Patches {
                minimum,
                maximum,
                cell_size_m,
            } => FrictionField::Patches {
                minimum,
                maximum,
                cell_size_m,
                seed,
            },
        }
    }

    /// Checks the ranges of all values.
    ///
    /// # Errors
    /// Names the key, value and range that is wrong.
    pub fn check(&self) -> Result<(), RangeError> {
        self.field(0).check()
    }
}

/// Factors on the parameters that controllers believe in, which so are wrong; all 1 by default.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct ModelError {
    x_icr_left: f64,
    x_icr_right: f64,
    y_icr: f64,
    lambda_1: f64,
    lambda_2: f64,
    correction_left: f64,
    correction_right: f64,
}

impl Default for ModelError {
    fn default() -> Self {
        Self {
            x_icr_left: 1.0,
            x_icr_right: 1.0,
            y_icr: 1.0,
            lambda_1: 1.0,
            lambda_2: 1.0,
            correction_left: 1.0,
            correction_right: 1.0,
        }
    }
}

impl ModelError {
    /// Returns what controllers believe instead of `vehicle`.
    fn apply(&self, mut vehicle: Vehicle) -> Result<Vehicle, RangeError> {
        vehicle.icrs.left_m *= self.x_icr_left;
        vehicle.icrs.right_m *= self.x_icr_right;
        vehicle.icrs.forward_m *= self.y_icr;
        vehicle.slide.shift_s_per_rad *= self.lambda_1;
        vehicle.slide.aggravated_s_per_rad *= self.lambda_2;
        vehicle.correction.left *= self.correction_left;
        vehicle.correction.right *= self.correction_right;
        vehicle.validated()
    }
}

/// Files of the contact plant, relative to the scenario.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct ContactFiles {
    /// The vehicle on wheels.
    vehicle: PathBuf,
    /// What identification found of it.
    identified: PathBuf,
}

fn one_lap() -> u32 {
    1
}

/// A scenario as its file and the command line give it.
pub struct Scenario {
    file: ConfigFile,
    raw: RawScenario,
}

/// What the command line puts in place of the scenario's own.
#[derive(Debug, Clone, Default)]
pub struct Overrides {
    /// Path to follow instead of the course or route.
    pub path: Option<PathBuf>,
    /// What moves the vehicle.
    pub plant: Option<PlantKind>,
    /// Seed.
    pub seed: Option<u64>,
    /// Controllers; none for the scenario's.
    pub controllers: Vec<ControllerKind>,
}

/// What moves the vehicle, with its parameters.
#[derive(Debug, Clone)]
pub enum Plant {
    /// The exact ICRIK model of a vehicle.
    Icrik(Vehicle),
    /// Wheels with friction on the ground.
    Contact {
        /// The vehicle on wheels.
        vehicle: ContactVehicle,
        /// Its true c_l and c_r: those of the scenario's vehicle.
        correction: SpeedCorrection,
    },
}

impl Plant {
    /// Returns which kind it is.
    pub fn kind(&self) -> PlantKind {
        match self {
            Self::Icrik(_) => PlantKind::Icrik,
            Self::Contact { .. } => PlantKind::Contact,
        }
    }

    /// Returns its true c_l and c_r.
    pub fn correction(&self) -> SpeedCorrection {
        match self {
            Self::Icrik(vehicle) => vehicle.correction,
            Self::Contact { correction, .. } => *correction,
        }
    }

    fn motion(&self) -> Box<dyn MotionModel + Send> {
        match self {
            Self::Icrik(vehicle) => Box::new(IcrMotion {
                vehicle: vehicle.clone(),
                inclined: true,
            }),
            Self::Contact { vehicle, .. } => Box::new(ContactModel::new(vehicle.clone())),
        }
    }
}

/// A scenario with everything read, checked and built; runs share it.
pub struct Prepared {
    /// Name for tables.
    pub name: String,
    /// What moves the vehicle.
    pub plant: Plant,
    /// The vehicle, as controllers know it.
    pub vehicle: Vehicle,
    /// The ground.
    pub terrain: Terrain,
    /// The reference.
    pub trajectory: Trajectory,
    /// How the reference moves on.
    pub tracking: Tracking,
    /// Rounds of a periodic reference.
    pub laps: u32,
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
    /// What was done to recorded points, in words; empty for a course.
    pub route_note: String,
}

impl Prepared {
    /// Returns the vehicle in its world, standing at its start.
    ///
    /// # Errors
    /// Names the setting out of range, or says why there is no ground at the start.
    pub fn simulation(&self) -> Result<Simulation, SimulationError> {
        Simulation::new(SimulationSetup {
            terrain: self.terrain.clone(),
            motion: self.plant.motion(),
            drive_train: self.drive_train,
            sensors: self.sensors,
            correction: self.plant.correction(),
            start: self.start,
            dt_s: self.step_s,
            seed: self.seed,
        })
    }
}

impl Scenario {
    /// Reads a scenario's own file.
    ///
    /// # Errors
    /// [`ConfigError`] with file, key, value and range.
    pub fn read(file: ConfigFile) -> Result<Self, ConfigError> {
        let raw: RawScenario = file.parse()?;
        Ok(Self { file, raw })
    }

    /// Returns the scenario's name.
    pub fn name(&self) -> &str {
        &self.raw.name
    }

    /// Reads what the scenario names and builds vehicle, ground and reference.
    ///
    /// # Errors
    /// [`ConfigError`] with the file at fault, key, value and range.
    pub fn prepare(&self, overrides: &Overrides) -> Result<Prepared, ConfigError> {
        let (raw, file) = (&self.raw, &self.file);
        let ranges = || -> Result<(), RangeError> {
            RangeError::check("laps", f64::from(raw.laps), 1.0, 1e6, "from 1 to 1000000")?;
            RangeError::check("step_s", raw.step_s, 1e-4, 0.05, "from 0.0001 to 0.05 s")?;
            raw.speed.validate()?;
            let start = &raw.start;
            RangeError::check(
                "start.right_m",
                start.right_m,
                -100.0,
                100.0,
                "within +-100 m",
            )?;
            RangeError::check(
                "start.forward_m",
                start.forward_m,
                -100.0,
                100.0,
                "within +-100 m",
            )?;
            RangeError::check(
                "start.heading_deg",
                start.heading_deg,
                -180.0,
                180.0,
                "within +-180 deg",
            )?;
            let steps = raw.controller.period_s / raw.step_s;
            let uneven = (steps - steps.round()).abs();
            RangeError::check(
                "controller.period_s / step_s, its distance from a whole number",
                uneven,
                0.0,
                1e-6,
                "0: the period must be a whole number of steps",
            )?;
            raw.controller.validate()
        };
        ranges().map_err(|error| file.error(error))?;
        let controllers = if overrides.controllers.is_empty() {
            &raw.controllers
        } else {
            &overrides.controllers
        };
        if controllers.is_empty() {
            return Err(file.error("controllers: the list is empty"));
        }
        let seed = overrides.seed.unwrap_or(raw.seed);
        let (plant, vehicle) = self.plant(overrides.plant.unwrap_or(raw.plant), seed)?;
        let vehicle = raw
            .model_error
            .apply(vehicle)
            .map_err(|error| file.error(format!("model_error: {error}")))?;
        let limits = raw.speed.limits(&raw.controller.limits, &vehicle);
        let source = Source::of(
            file,
            raw.course.as_ref(),
            raw.route.as_ref(),
            overrides.path.as_deref(),
        )?;
        let reference = Reference::build(file, source, &limits)?;
        let terrain = self.terrain(reference.route.as_ref())?;
        let first = reference.trajectory.at(0.0);
        let (sin, cos) = first.heading_rad.sin_cos();
        let offset = &raw.start;
        let start = PlanarPose {
            x_m: first.position.x_m + cos * offset.right_m - sin * offset.forward_m,
            y_m: first.position.y_m + sin * offset.right_m + cos * offset.forward_m,
            yaw_rad: first.heading_rad + offset.heading_deg.to_radians(),
        };
        Ok(Prepared {
            name: raw.name.clone(),
            plant,
            vehicle,
            terrain,
            tracking: reference.tracking(raw.controller.lead_max_m),
            trajectory: reference.trajectory,
            laps: raw.laps,
            start,
            controllers: controllers.clone(),
            seed,
            step_s: raw.step_s,
            drive_train: raw.drive_train,
            sensors: raw.sensors,
            controller: raw.controller.clone(),
            route_note: reference.note,
        })
    }

    /// Returns what moves the vehicle, and the vehicle as controllers know it.
    fn plant(&self, kind: PlantKind, seed: u64) -> Result<(Plant, Vehicle), ConfigError> {
        let own: Vehicle = self.file.sibling(&self.raw.vehicle)?.parse()?;
        match kind {
            PlantKind::Icrik => Ok((Plant::Icrik(own.clone()), own)),
            PlantKind::Contact => {
                let (vehicle, identified) = match &self.raw.contact {
                    Some(files) => (
                        self.file.sibling(&files.vehicle)?,
                        self.file.sibling(&files.identified)?,
                    ),
                    None => (
                        ConfigFile::built_in(CONTACT_VEHICLE)?,
                        ConfigFile::built_in(CONTACT_IDENTIFIED)?,
                    ),
                };
                let mut vehicle: ContactVehicle = vehicle.parse()?;
                if let Some(friction) = &self.raw.friction {
                    friction
                        .check()
                        .map_err(|error| self.file.error(format!("friction.{error}")))?;
                    vehicle.friction.field = friction.field(seed);
                }
                let plant = Plant::Contact {
                    vehicle,
                    correction: own.correction,
                };
                Ok((plant, identified.parse()?))
            }
        }
    }

    fn terrain(
        &self,
        route: Option<&(ConfigFile, Option<Vec<RoutePoint>>)>,
    ) -> Result<Terrain, ConfigError> {
        Ok(match &self.raw.terrain {
            TerrainConfig::Level => Terrain::Level,
            TerrainConfig::Plane(plane) => Terrain::Plane(plane.clone()),
            TerrainConfig::Zones(zones) => Terrain::Zones(zones.clone()),
            TerrainConfig::Grid {
                file,
                origin_east_m,
                origin_north_m,
            } => {
                let grid = self.file.sibling(file)?;
                let terrain = GridTerrain::parse(grid.text()).map_err(|error| grid.error(error))?;
                Terrain::Grid(terrain.with_origin_at(*origin_east_m, *origin_north_m))
            }
            TerrainConfig::Route(smoothing) => match route {
                None => {
                    return Err(self
                        .file
                        .error("terrain.kind: route needs a route with elevations, not a course"));
                }
                Some((file, None)) => {
                    return Err(file.error(
                        "not every point has an elevation, which terrain.kind route needs",
                    ));
                }
                Some((file, Some(points))) => Terrain::Route(
                    RouteTerrain::new(points, *smoothing).map_err(|error| file.error(error))?,
                ),
            },
        })
    }
}
