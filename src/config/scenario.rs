//! A scenario: vehicle, ground, reference, plant, sensors and controllers of a simulation.

use super::ground::{TerrainConfig, on_the_ground};
use super::plant::{ContactFiles, GroundFriction, Plant, PlantKind, VehicleErrors};
use super::prepared::Prepared;
use super::reference::{LoadedReference, RouteConfig, Source};
use super::start::{StartOffset, with_point_at};
use super::{CONTACT_IDENTIFIED, CONTACT_VEHICLE, ConfigError, ConfigFile};
use serde::Deserialize;
use sidehill_controller::config::{ControllerConfig, ControllerKind};
use sidehill_controller::course::Course;
use sidehill_controller::path::GeodeticOrigin;
use sidehill_controller::reference::Reference;
use sidehill_controller::speed_profile::{SpeedConfig, SpeedLimits};
use sidehill_controller::tracked_point::TrackedPoint;
use sidehill_controller::trajectory::Trajectory;
use sidehill_plant::bounds::{Bounds, RangeError};
use sidehill_plant::contact::ContactVehicle;
use sidehill_plant::drive_train::DriveTrainConfig;
use sidehill_plant::sensors::SensorsConfig;
use sidehill_plant::vehicle::Vehicle;
use std::collections::BTreeMap;
use std::path::PathBuf;

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawScenario {
    /// Name for tables and plots.
    name: String,
    /// [Vehicle](#vehicle) file: the plant, and the model of the controllers.
    vehicle: PathBuf,
    /// [Ground](#terrain).
    terrain: TerrainConfig,
    /// [Course](#course) to drive. Exactly one of `course` and `route`.
    #[serde(default)]
    course: Option<Course>,
    /// Recorded [route](#route) to drive.
    #[serde(default)]
    route: Option<RouteConfig>,
    /// [Place on earth](#datum) at which a GPX route and satellite fixes have x = 0, y = 0. None: the datum of the GPX
    /// file, or its first point.
    #[serde(default)]
    datum: Option<GeodeticOrigin>,
    /// Rounds of a periodic course.
    #[serde(default = "one_lap")]
    laps: u32,
    /// [Speed](#speed), where the course gives no times.
    #[serde(default)]
    speed: SpeedConfig,
    /// [Start](#start), relative to the start of the reference.
    #[serde(default)]
    start: StartOffset,
    /// Controllers to run: `icrik-mpc`, `icrhk-mpc`, `diffdrive-mpc`, `pure-pursuit` and what `simulate --help` lists.
    controllers: Vec<ControllerKind>,
    /// What moves the vehicle: the ICRIK model, or wheels with friction.
    plant: PlantKind,
    /// [Files](#contact-files) of the plant `contact`.
    #[serde(default)]
    contact: Option<ContactFiles>,
    /// [Friction](#friction) of the ground, in place of that in the contact vehicle file.
    #[serde(default)]
    friction: Option<GroundFriction>,
    /// [Factors](#model-error) on the parameters of the controllers' vehicle.
    #[serde(default)]
    model_error: VehicleErrors,
    /// Seed of everything random.
    seed: u64,
    /// Step of the simulation. The control period is a whole multiple of it.
    step_s: f64,
    /// [Drive train](#drive-train) between command and treads.
    #[serde(default)]
    drive_train: DriveTrainConfig,
    /// [Sensors](#sensors).
    #[serde(default)]
    sensors: SensorsConfig,
    /// [Controller settings](#controller-settings).
    #[serde(default)]
    controller: ControllerConfig,
    /// Texts of files that this file names, by their names in it: one file is then a whole scenario.
    #[serde(default)]
    files: BTreeMap<PathBuf, String>,
}

impl RawScenario {
    /// Checks the numbers of the scenario's own file.
    fn validate(&self, file: &ConfigFile) -> Result<(), ConfigError> {
        let ranges = || -> Result<(), RangeError> {
            Bounds::new(1.0, 1e6, "").check("laps", f64::from(self.laps))?;
            Bounds::new(1e-4, 0.05, "s").check("step_s", self.step_s)?;
            self.speed.validate()?;
            self.start.validate()?;
            let steps = self.controller.period_s / self.step_s;
            Bounds::new(0.0, 1e-6, "")
                .with_note("the period is a whole number of steps")
                .check(
                    "controller.period_s / step_s, its distance from a whole number",
                    (steps - steps.round()).abs(),
                )
                .map(drop)
        };
        ranges().map_err(|error| file.error(error))?;
        self.controller
            .validate()
            .map_err(|error| file.error(format!("controller.{error}")))
    }
}

fn one_lap() -> u32 {
    1
}

/// A scenario as given by its file.
pub struct Scenario {
    file: ConfigFile,
    raw: RawScenario,
}

/// Settings of the command line that replace the scenario's own.
#[derive(Debug, Clone, Default)]
pub struct Overrides {
    /// Path to follow instead of the course or route.
    pub path: Option<PathBuf>,
    /// What moves the vehicle.
    pub plant: Option<PlantKind>,
    /// Seed.
    pub seed: Option<u64>,
    /// Controllers; empty for the scenario's.
    pub controllers: Vec<ControllerKind>,
    /// Whether another vehicle than the scenario's plant is driven, one with inertia.
    pub other_vehicle: bool,
}

impl Scenario {
    /// Reads a scenario's own file.
    ///
    /// # Errors
    /// [`ConfigError`] with file, key, value and range.
    pub fn read(file: ConfigFile) -> Result<Self, ConfigError> {
        let mut raw: RawScenario = file.parse()?;
        let file = file.with_files(std::mem::take(&mut raw.files));
        Ok(Self { file, raw })
    }

    /// Returns whether the steepness guard is on.
    pub fn has_guard(&self) -> bool {
        self.raw.controller.guard.is_some()
    }

    /// Returns where the world's origin is on earth, if that is stated.
    pub fn datum(&self) -> Option<GeodeticOrigin> {
        self.raw.datum
    }

    /// Returns the scenario's name.
    pub fn name(&self) -> &str {
        &self.raw.name
    }

    /// Reads the files that the scenario names and builds vehicle, ground and reference.
    ///
    /// # Errors
    /// [`ConfigError`] with the file at fault, key, value and range.
    pub fn prepare(&self, overrides: &Overrides) -> Result<Prepared, ConfigError> {
        let (raw, file) = (&self.raw, &self.file);
        raw.validate(file)?;
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
        // The geometry of any vehicle is known.
        let wheels = match &plant {
            Plant::Contact { vehicle, .. } => Some(&**vehicle),
            Plant::Icrik(_) => None,
        };
        let mut vehicle = raw
            .model_error
            .apply(vehicle, wheels)
            .map_err(|error| file.error(format!("model_error: {error}")))?;
        // So is whether the plant has inertia, as every real vehicle has, but not how much.
        let at_once = wheels.is_some_and(|wheels| wheels.yaw_inertia_kg_m2.is_none());
        if let Some(contact) = vehicle
            .contact
            .as_mut()
            .filter(|_| at_once && !overrides.other_vehicle)
        {
            contact.set_inertia(0.0);
        }
        let limits = raw.speed.limits(&raw.controller.limits, &vehicle);
        let source = Source::of(
            file,
            raw.course.as_ref(),
            raw.route.as_ref(),
            raw.datum,
            overrides.path.as_deref(),
        )?;
        let loaded = LoadedReference::build(file, source, &limits)?;
        let mut warnings = loaded.warnings;
        let terrain = raw
            .terrain
            .build(file, loaded.route.as_ref(), &mut warnings)?;
        on_the_ground(&loaded.trajectory, &terrain, vehicle.base_half_width_m)
            .map_err(|error| file.error(error))?;
        let requested_m_s = raw.speed.speed_m_s;
        if loaded.route.is_some() && requested_m_s > vehicle.speed_max_m_s {
            warnings.push(format!(
                "speed.speed_m_s: {requested_m_s} m/s is requested, but {} was identified up to {} m/s \
                 (speed_max_m_s), and its motors' limit is {} m/s",
                vehicle.name, vehicle.speed_max_m_s, limits.traction_max_m_s
            ));
        }
        if loaded.route.is_none() && overrides.path.is_none() {
            warnings.extend(
                raw.course
                    .as_ref()
                    .and_then(|course| too_fast(course, &loaded.trajectory, &limits)),
            );
        }
        warnings.extend(point_behind_icrs(&raw.controller.tracked_point, &vehicle));
        let start = raw.start.from(&loaded.trajectory.at(0.0).pose());
        let start = match loaded.trajectory.path() {
            Some(_) => with_point_at(&raw.controller.tracked_point, &start, &terrain),
            None => start,
        };
        Ok(Prepared {
            name: raw.name.clone(),
            plant,
            vehicle,
            terrain,
            reference: Reference::new(loaded.trajectory).for_laps(raw.laps),
            start,
            controllers: controllers.clone(),
            seed,
            step_s: raw.step_s,
            drive_train: raw.drive_train.clone(),
            sensors: raw.sensors,
            controller: raw.controller.clone(),
            route_note: loaded.note,
            speed_limits: limits,
            learned: None,
            warnings,
        })
    }

    /// Returns the plant, and the vehicle as controllers know it.
    fn plant(&self, kind: PlantKind, seed: u64) -> Result<(Plant, Vehicle), ConfigError> {
        let own: Vehicle = self.file.sibling(&self.raw.vehicle)?.parse()?;
        match kind {
            PlantKind::Icrik => Ok((Plant::Icrik(Box::new(own.extended())), own)),
            PlantKind::Contact => {
                let (vehicle, identified) = match &self.raw.contact {
                    Some(files) => (
                        self.file.sibling(&files.vehicle)?,
                        self.file.sibling(&files.identified)?,
                    ),
                    None if is_j8(&own)? => (
                        ConfigFile::built_in(CONTACT_VEHICLE)?,
                        ConfigFile::built_in(CONTACT_IDENTIFIED)?,
                    ),
                    None => {
                        return Err(self.file.error(format!(
                            "contact: missing; the vehicle {} on wheels is not known. Name its file and what \
                             identification finds of it: `contact: {{vehicle: FILE, identified: FILE}}`. \
                             `sidehill init` writes an example of the first, `sidehill identify --simulate` \
                             makes the second of it",
                            own.name
                        )));
                    }
                };
                let mut vehicle: ContactVehicle = vehicle.parse()?;
                let mut identified: Vehicle = identified.parse()?;
                if let Some(files) = &self.raw.contact {
                    let vary = || -> Result<_, RangeError> {
                        let varied = files.variation.of_truth(&vehicle)?;
                        Ok((varied, files.variation.of_identified(identified)?))
                    };
                    (vehicle, identified) = vary()
                        .map_err(|error| self.file.error(format!("contact.variation: {error}")))?;
                }
                if let Some(friction) = &self.raw.friction {
                    friction
                        .check()
                        .map_err(|error| self.file.error(format!("friction.{error}")))?;
                    vehicle.friction.field = friction.field(seed);
                }
                // The guard uses the true mass.
                identified
                    .centre_of_mass
                    .get_or_insert(own.centre_of_mass.unwrap_or(vehicle.centre_of_mass));
                let plant = Plant::Contact {
                    vehicle: Box::new(vehicle),
                    encoder_scale: own.encoder_scale,
                };
                Ok((plant, identified))
            }
        }
    }
}

/// Returns the warning for a course that asks a speed above a limit, with the keys of both.
fn too_fast(course: &Course, trajectory: &Trajectory, limits: &SpeedLimits) -> Option<String> {
    /// Steps in which the speed of a course given in time is looked at.
    const STEPS: u32 = 1000;
    let profiled_m_s = match course {
        Course::Straight(course) => Some(course.speed_m_s),
        Course::Slalom(course) => Some(course.speed_m_s),
        Course::Cusp(course) => Some(course.speed_m_s),
        Course::FigureEight(_) | Course::Circle(_) | Course::Pivot(_) => None,
    };
    let mut bounds = vec![
        (
            "controller.limits.traction.speed_m_s",
            limits.traction_max_m_s,
        ),
        ("controller.limits.tread_speed_m_s", limits.tread_max_m_s),
    ];
    if profiled_m_s.is_some() {
        bounds.insert(0, ("speed.speed_m_s", limits.speed_max_m_s));
    }
    let asked_m_s = profiled_m_s.unwrap_or_else(|| {
        let times = (0..=STEPS).map(|i| f64::from(i) / f64::from(STEPS) * trajectory.duration_s());
        let speeds = times.map(|time_s| trajectory.at(time_s).speed_m_s.abs());
        speeds.fold(0.0, f64::max)
    });
    let (key, allowed_m_s) = bounds.into_iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
    (asked_m_s > allowed_m_s * (1.0 + 1e-6)).then(|| {
        let source = profiled_m_s.map_or("course", |_| "course.speed_m_s");
        format!("{source}: {asked_m_s:.2} m/s is asked, but {key} allows {allowed_m_s:.2} m/s")
    })
}

/// Returns the warning for a tracked point behind the line through the treads' ICRs, if the point is there.
pub(crate) fn point_behind_icrs(point: &TrackedPoint, vehicle: &Vehicle) -> Option<String> {
    let line_m = vehicle.icrs.forward_m;
    let behind = !point.is_origin() && point.forward_m < line_m;
    behind.then(|| {
        format!(
            "tracked_point.forward_m: {} m is behind the line through the treads' ICRs ({line_m} m ahead of the \
             origin). Driving forward, such a point steers like a trailer in reverse: expect errors of 2 to 6 cm 0.4 m behind it and \
             far more 0.8 m behind it. A point ahead of that line is tracked to 0.2 cm",
            point.forward_m
        )
    })
}

/// Returns whether a vehicle is the J8, whose contact vehicle is built in; its name may differ.
fn is_j8(vehicle: &Vehicle) -> Result<bool, ConfigError> {
    let j8: Vehicle = ConfigFile::built_in("config/vehicles/j8.yaml")?.parse()?;
    Ok(*vehicle
        == Vehicle {
            name: vehicle.name.clone(),
            centre_of_mass: vehicle.centre_of_mass,
            ..j8
        })
}
