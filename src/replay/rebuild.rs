//! Rebuilds the recorded controller, or a changed one, from the header of a recording.

use crate::closed_loop::{Observer, run as drive};
use crate::config::{ConfigFile, Overrides, PlantKind, Prepared, RunConfig, RunPort, Scenario};
use crate::learned::LearnedFile;
use crate::recording::fact;
use anyhow::{Context, Result, anyhow, ensure};
use sidehill_bridge::control_loop::tap::{RecordedPath, StepRecord};
use sidehill_controller::closed_loop::Cycle;
use sidehill_controller::config::{ControllerConfig, ControllerKind};
use sidehill_controller::controller::Controller;
use sidehill_controller::reference::Reference;
use sidehill_plant::frames::PlanarPose;
use sidehill_plant::terrain::{PlaneTerrain, Terrain};
use sidehill_plant::vehicle::Vehicle;
use sidehill_recording::{ControllerCycle, Recording};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

/// Requested changes to the recording.
#[derive(Debug, Clone, Default)]
pub(crate) struct ReplayChanges {
    pub(crate) controller: Option<ControllerKind>,
    pub(crate) vehicle: Option<PathBuf>,
    pub(crate) settings: Vec<String>,
    pub(crate) plant: Option<PlantKind>,
}

impl ReplayChanges {
    /// Returns whether the commands are expected to differ.
    pub(super) fn changed(&self) -> bool {
        self.controller.is_some() || self.vehicle.is_some() || !self.settings.is_empty()
    }

    /// Returns the other vehicle, if one was requested.
    pub(super) fn vehicle(&self) -> Result<Option<Vehicle>> {
        let read = |path| -> Result<Vehicle> { Ok(ConfigFile::read(path)?.parse()?) };
        self.vehicle.as_deref().map(read).transpose()
    }

    /// Returns the settings with these changes.
    pub(super) fn settings(&self, config: ControllerConfig) -> Result<ControllerConfig> {
        let mut all = serde_yaml::to_value(config)?;
        for setting in &self.settings {
            let named = || format!("--set {setting}");
            let (name, value) = setting
                .split_once('=')
                .with_context(|| format!("--set {setting}: must be KEY=VALUE"))?;
            let mut place = &mut all;
            for key in name.split('.') {
                place = place
                    .get_mut(key)
                    .with_context(|| format!("--set {setting}: there is no setting {key}"))?;
            }
            *place = serde_yaml::from_str(value).with_context(named)?;
            // One by one, so that the error names the one at fault.
            let changed: ControllerConfig =
                serde_yaml::from_value(all.clone()).with_context(named)?;
            changed.validate().with_context(named)?;
        }
        Ok(serde_yaml::from_value(all)?)
    }
}

/// A controller made of a recording.
pub(crate) struct Rebuilt {
    pub(crate) kind: ControllerKind,
    pub(crate) config: ControllerConfig,
    pub(crate) vehicle: Vehicle,
    /// Whether a control loop held the controller until it drove.
    pub(super) held: bool,
    /// The ground of the scenario.
    pub(super) terrain: Option<Terrain>,
    /// Configuration of `run`; none for a simulation.
    run: Option<(RunConfig, ConfigFile)>,
    /// The simulated world; none if the vehicle was real or in another process.
    world: Option<Prepared>,
    /// Learned parameters that the controller started from.
    learned: Option<Arc<LearnedFile>>,
}

impl Rebuilt {
    /// Rebuilds the controller with changes.
    ///
    /// # Errors
    /// Names what is missing in the recording, or the invalid change.
    pub(crate) fn of(recording: &Recording, changes: &ReplayChanges) -> Result<Self> {
        let facts = &recording.header.facts;
        let get = |name: &str| {
            facts
                .get(name)
                .map(String::as_str)
                .with_context(|| format!("the recording has no `{name}` in its metadata"))
        };
        let bundle = Arc::new(Mutex::new(recording.header.files.clone()));
        let name = Path::new(get(fact::CONFIG)?);
        let text = recording
            .header
            .files
            .get(name)
            .with_context(|| format!("the recording has no file {}", name.display()))?;
        let file = ConfigFile::with_text(name, text.clone()).with_bundle(bundle);
        let recorded = get(fact::CONTROLLER)?;
        let kind = changes
            .controller
            .or_else(|| ControllerKind::from_name(recorded))
            .with_context(|| format!("{recorded}: no such controller"))?;
        let vehicle = changes.vehicle()?;
        let learned = facts
            .get(fact::LEARNED)
            .filter(|_| !changes.changed())
            .map(|text| LearnedFile::of(text.clone()).map(Arc::new))
            .transpose()
            .context("what the recorded controller had learned")?;
        match get(fact::COMMAND)? {
            "simulate" => {
                let plant = facts.get(fact::PLANT).map(|name| {
                    <PlantKind as clap::ValueEnum>::from_str(name, false)
                        .map_err(|_| anyhow!("{name}: no such plant"))
                });
                let mut world = Scenario::read(file)?.prepare(&Overrides {
                    path: facts.get(fact::PATH).map(PathBuf::from),
                    plant: changes.plant.or(plant.transpose()?),
                    seed: facts.get(fact::SEED).map(|seed| seed.parse()).transpose()?,
                    controllers: vec![kind],
                    ..Overrides::default()
                })?;
                if let Some(vehicle) = vehicle {
                    world.vehicle = vehicle;
                }
                world.controller = changes.settings(world.controller)?;
                world.learned.clone_from(&learned);
                Ok(Self {
                    learned,
                    kind,
                    config: world.controller.clone(),
                    vehicle: world.vehicle.clone(),
                    run: None,
                    held: false,
                    terrain: Some(world.terrain.clone()),
                    world: Some(world),
                })
            }
            "run" => {
                let mut config: RunConfig = file.parse()?;
                config.controller = kind;
                config.settings = changes.settings(config.settings)?;
                let vehicle = match vehicle {
                    Some(vehicle) if kind == ControllerKind::IcrikMpc => vehicle.extended(),
                    Some(vehicle) => vehicle,
                    None => config.load_vehicle(&file)?,
                };
                let world = if config.port == RunPort::Simulated {
                    let (file, simulated) = config.simulated(&file)?;
                    Some(simulated.world(&file)?)
                } else {
                    None
                };
                Ok(Self {
                    learned,
                    kind,
                    config: config.settings.clone(),
                    vehicle,
                    run: Some((config, file)),
                    held: true,
                    terrain: None,
                    world,
                })
            }
            command => Err(anyhow!(
                "a recording of `{command}` has no controller in it to be replayed"
            )),
        }
    }

    /// Returns the controller before its first step, without a path.
    pub(super) fn controller(&self) -> Result<Controller> {
        let mut controller = match (&self.run, &self.world) {
            (Some((config, file)), _) => {
                let mut controller = config.controller(file, &self.vehicle)?;
                if let Some(file) = &self.learned {
                    controller.recall(&file.learned)?;
                }
                controller
            }
            (None, Some(world)) => world.controller(self.kind)?,
            (None, None) => Controller::new(self.kind, self.config.clone(), &self.vehicle)?,
        };
        controller.forget_path();
        Ok(controller)
    }

    /// Returns a recorded path as the controller follows it.
    pub(super) fn reference(&self, path: &RecordedPath) -> Reference {
        let reference = Reference::new(path.trajectory.clone()).for_laps(path.laps);
        let reference = match path.from_m {
            Some(from_m) => reference.starting_at(from_m),
            None => reference,
        };
        reference.numbered(path.number)
    }

    /// Returns the steps of a drive along the first recorded path on a simulated vehicle: that of the
    /// recording, or one that moves as ICRIK says on the slope that the recording shows.
    ///
    /// # Errors
    /// A recording without a path, or an error of the simulation.
    pub(super) fn drive(&self, recording: &Recording) -> Result<Vec<ControllerCycle>> {
        let path = recording
            .paths
            .values()
            .find_map(|record| record.path.as_ref())
            .context("the recording has no path to drive along")?;
        let reference = self.reference(path);
        let start = recording
            .cycles
            .iter()
            .find(|cycle| cycle.has_pose)
            .map(|cycle| PlanarPose {
                x_m: cycle.x_m,
                y_m: cycle.y_m,
                yaw_rad: cycle.yaw_rad,
            });
        let world = match &self.world {
            Some(world) => Prepared {
                name: world.name.clone(),
                plant: world.plant.clone(),
                terrain: world.terrain.clone(),
                start: if self.held {
                    start.unwrap_or(world.start)
                } else {
                    world.start
                },
                seed: world.seed,
                step_s: world.step_s,
                drive_train: world.drive_train.clone(),
                sensors: world.sensors,
                ..self.assumed(reference, world.start)?
            },
            None => Prepared {
                terrain: slope(recording)?,
                ..self.assumed(reference, start.unwrap_or_default())?
            },
        };
        let mut steps = Steps::default();
        drive(&world, self.kind, |_| {}, Some(&mut steps))?;
        ensure!(!steps.0.is_empty(), "the simulation has no cycle");
        Ok(steps.0)
    }

    /// Returns a world of which only the vehicle is known.
    fn assumed(&self, reference: Reference, start: PlanarPose) -> Result<Prepared> {
        let default = ConfigFile::built_in(crate::config::DEFAULT_SCENARIO)?;
        let world = Scenario::read(default)?.prepare(&Overrides::default())?;
        Ok(Prepared {
            name: "recorded".to_owned(),
            plant: crate::config::Plant::Icrik(Box::new(self.vehicle.extended())),
            vehicle: self.vehicle.clone(),
            reference,
            start,
            controllers: vec![self.kind],
            controller: self.config.clone(),
            route_note: String::new(),
            warnings: Vec::new(),
            ..world
        })
    }
}

/// Returns the plane on which the vehicle stood on average.
pub(super) fn slope(recording: &Recording) -> Result<Terrain> {
    use sidehill_plant::frames::Attitude;
    let mut normal = [0.0; 3];
    for cycle in recording
        .cycles
        .iter()
        .filter(|cycle| cycle.estimated_roll_rad.is_finite())
    {
        let attitude = Attitude {
            roll_rad: cycle.estimated_roll_rad,
            pitch_rad: cycle.estimated_pitch_rad,
        };
        let here = attitude.plane_normal(cycle.estimated_yaw_rad);
        for axis in 0..3 {
            normal[axis] += here[axis];
        }
    }
    let [x, y, z] = normal;
    if z <= 0.0 || (x == 0.0 && y == 0.0) {
        return Ok(Terrain::Level);
    }
    let slope_deg = x.hypot(y).atan2(z).to_degrees();
    // Uphill is against the normal's horizontal part; headings count from Y_g.
    let uphill_deg = x.atan2(-y).to_degrees();
    Ok(Terrain::Plane(PlaneTerrain::new(slope_deg, uphill_deg)?))
}

#[derive(Default)]
struct Steps(Vec<ControllerCycle>);

impl Observer for Steps {
    fn begin(&mut self, _: &Controller) -> Result<()> {
        Ok(())
    }

    fn cycle(&mut self, cycle: &Cycle, controller: &Controller) -> Result<()> {
        let step = StepRecord {
            index: self.0.len() as u64,
            sample: cycle.sample,
            engaged: true,
            path: 0,
            cut_at: controller.was_cut_at(),
            decision: cycle.decision,
            drives: controller.drive_response(),
        };
        self.0.push(ControllerCycle {
            cross_track_m: cycle.errors.cross_track_m,
            ..ControllerCycle::from(&step)
        });
        Ok(())
    }
}
