//! Configuration of `run` and `vehicle`.

use super::reference::{LoadedReference, RouteConfig, Source};
use super::{ConfigError, ConfigFile, Overrides, PlantKind, Prepared, Scenario};
use crate::learned::KeptFile;
use serde::Deserialize;
use sidehill_bridge::can::config::CanConfig;
use sidehill_bridge::can::database::Database;
use sidehill_bridge::can::layout::Layout;
use sidehill_bridge::control_loop::CycleConfig;
use sidehill_bridge::control_loop::scheduling::RealtimeConfig;
use sidehill_bridge::recording::RecordLimits;
use sidehill_bridge::ros2::port::convert::TwistMapping;
use sidehill_bridge::ros2::port::rover::VehicleNodeConfig;
use sidehill_bridge::ros2::server::config::Ros2Config;
use sidehill_bridge::ros2::server::obstacles::StoppingSettings;
use sidehill_bridge::ros2::server::route::RouteSettings;
use sidehill_bridge::rover::DriveConfig;
use sidehill_bridge::rover::{CanFault, FaultWindow};
use sidehill_bridge::safety::SafetyConfig;
use sidehill_controller::config::{AttitudePreview, ControllerConfig, ControllerKind};
use sidehill_controller::controller::Controller;
use sidehill_controller::course::Course;
use sidehill_controller::guard::{Stance, first_steep_place};
use sidehill_controller::speed_profile::SpeedConfig;
use sidehill_plant::bounds::Bounds;
use sidehill_plant::drive_train::DriveTrainConfig;
use sidehill_plant::sensors::SensorsConfig;
use sidehill_plant::vehicle::Vehicle;
use std::path::{Path, PathBuf};

/// Through what `run` tells the drives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RunPort {
    /// A CAN bus.
    #[default]
    Can,
    /// A virtual vehicle within the program.
    Simulated,
    /// Topics of ROS 2.
    Ros2,
}

/// What `sidehill run` reads.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunConfig {
    /// How the drives are commanded.
    #[serde(default)]
    pub port: RunPort,
    /// SocketCAN interface.
    #[serde(default)]
    pub interface: Option<String>,
    /// Layout of the bus, relative to this file.
    #[serde(default)]
    pub can: Option<PathBuf>,
    /// The virtual vehicle of port `simulated`, relative to this file.
    #[serde(default)]
    pub simulated: Option<PathBuf>,
    /// Vehicle that the controller steers by, relative to this file.
    pub vehicle: PathBuf,
    /// Which controller.
    pub controller: ControllerKind,
    /// Its settings.
    #[serde(default)]
    pub settings: ControllerConfig,
    /// File in which what was learned is kept over a restart.
    #[serde(default)]
    pub learned: Option<LearnedConfig>,
    /// What is driven, unless it is a route.
    #[serde(default)]
    pub course: Option<Course>,
    /// What is driven, unless it is a course.
    #[serde(default)]
    pub route: Option<RouteConfig>,
    /// How fast, where the course gives no times.
    #[serde(default)]
    pub speed: SpeedConfig,
    /// Rounds of a periodic course.
    #[serde(default = "one")]
    pub laps: u32,
    /// The cycle.
    #[serde(default)]
    pub cycle: CycleConfig,
    /// The safety.
    #[serde(default)]
    pub safety: SafetyConfig,
    /// What is asked of the system.
    #[serde(default)]
    pub realtime: RealtimeConfig,
    /// What is offered and listened to on ROS 2: paths come from there, through whatever port the
    /// drives are told.
    #[serde(default)]
    pub ros2: Option<Ros2Config>,
    /// What is recorded.
    #[serde(default)]
    pub record: Option<RecordConfig>,
}

/// Where a drive is recorded, and how large the recording may become.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordConfig {
    /// MCAP file, relative to this file; none records only what the command line asks for.
    #[serde(default)]
    pub file: Option<PathBuf>,
    /// Largest size of a file, MB.
    #[serde(default = "record_size")]
    pub max_size: f64,
    /// Whether a file that is full is followed by another.
    #[serde(default = "yes")]
    pub split: bool,
    /// Newest files that are kept, with `split`; 0 keeps all.
    #[serde(default)]
    pub keep: u32,
}

fn record_size() -> f64 {
    RecordLimits::default().max_size
}

fn yes() -> bool {
    true
}

/// Returns the file of a recording and its limits, as the command line or else the configuration says;
/// none where nothing is recorded.
///
/// # Errors
/// [`ConfigError`] with the file, key, value and range.
fn recording(
    file: &ConfigFile,
    config: Option<&RecordConfig>,
    given: Option<&Path>,
) -> Result<Option<(PathBuf, RecordLimits)>, ConfigError> {
    let limits = config.map_or_else(RecordLimits::default, |config| RecordLimits {
        max_size: config.max_size,
        split: config.split,
        keep: config.keep,
    });
    limits
        .validate()
        .map_err(|error| file.error(format!("record.{error}")))?;
    let own = config
        .and_then(|config| config.file.as_deref())
        .map(|name| file.path().parent().unwrap_or(Path::new("")).join(name));
    Ok(given.map(Path::to_owned).or(own).map(|path| (path, limits)))
}

/// Where what was learned is kept.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LearnedConfig {
    /// File of this vehicle, relative to the configuration.
    pub file: PathBuf,
    /// Whether the file is read and written.
    #[serde(default = "yes")]
    pub keep: bool,
    /// Age beyond which the file is refused, days.
    #[serde(default = "days_max")]
    pub days_max: f64,
    /// Time of driving after which the file is written again, s: a program that is killed loses what it learned
    /// since. It is written whenever the vehicle is disarmed, too.
    #[serde(default = "every_s")]
    pub every_s: f64,
}

impl RunConfig {
    /// Returns the file in which what was learned is kept, where it is kept.
    ///
    /// # Errors
    /// [`ConfigError`] with file, key, value and range.
    pub fn learned_file(&self, file: &ConfigFile) -> Result<Option<KeptFile>, ConfigError> {
        let Some(learned) = self.learned.as_ref().filter(|learned| learned.keep) else {
            return Ok(None);
        };
        Bounds::new(0.01, 10_000.0, "days")
            .check("learned.days_max", learned.days_max)
            .and_then(|_| Bounds::new(1.0, 3600.0, "s").check("learned.every_s", learned.every_s))
            .map_err(|error| file.error(error))?;
        let folder = file.path().parent().unwrap_or(Path::new("."));
        Ok(Some(KeptFile {
            path: folder.join(&learned.file),
            days_max: learned.days_max,
            every_s: learned.every_s,
        }))
    }

    /// Returns the vehicle that the controller steers by.
    ///
    /// # Errors
    /// [`ConfigError`] with the file at fault, key, value and range.
    pub fn load_vehicle(&self, file: &ConfigFile) -> Result<Vehicle, ConfigError> {
        let vehicle: Vehicle = file.sibling(&self.vehicle)?.parse()?;
        // The port converts speeds by the factors of the model that the controller steers by.
        Ok(match self.controller {
            ControllerKind::IcrikMpc => vehicle.extended(),
            ControllerKind::ContactMpc => vehicle.on_wheels(),
            ControllerKind::IcrhkMpc
            | ControllerKind::DiffdriveMpc
            | ControllerKind::PurePursuit => vehicle,
        })
    }

    /// Returns the controller with what it follows; without a path where paths come over ROS 2.
    ///
    /// # Errors
    /// [`ConfigError`] with the file at fault, key, value and range.
    pub fn controller(
        &self,
        file: &ConfigFile,
        vehicle: &Vehicle,
    ) -> Result<Controller, ConfigError> {
        let mut settings = self.settings.clone();
        if self.learned_file(file)?.is_some() {
            settings.memory.get_or_insert_default();
        }
        let settings = &settings;
        if settings.period_s != self.cycle.period_s {
            return Err(file.error(format!(
                "settings.period_s: {} must be the same as cycle.period_s: {}",
                settings.period_s, self.cycle.period_s
            )));
        }
        Bounds::new(1.0, 1e6, "")
            .check("laps", f64::from(self.laps))
            .and_then(|_| self.speed.validate())
            .map_err(|error| file.error(error))?;
        settings
            .validate()
            .map_err(|error| file.error(format!("settings.{error}")))?;
        let mut controller = Controller::new(self.controller, settings.clone(), vehicle)
            .map_err(|error| file.error(error))?;
        if !self.over_ros2() {
            let source = Source::of(file, self.course.as_ref(), self.route.as_ref(), None)?;
            let limits = self.speed.limits(&settings.limits, vehicle);
            let loaded = LoadedReference::build(file, source, &limits)?;
            if settings.attitude_preview == AttitudePreview::Terrain
                && let Some(ground) = loaded.ground()?
            {
                let refuses = settings.guard.filter(|guard| guard.refuse_route);
                if let (Some(guard), Some(stance)) = (refuses, Stance::of(vehicle))
                    && let Some(place) =
                        first_steep_place(&guard, &stance, &loaded.trajectory, &ground)
                {
                    return Err(file.error(format!("route: refused, too steep: {place}")));
                }
                controller = controller.with_terrain(ground);
            }
            controller.follow(settings.reference(loaded.trajectory).for_laps(self.laps));
        } else if self.course.is_some() || self.route.is_some() {
            return Err(file.error("course and route: paths come over ROS 2, not from here"));
        }
        Ok(controller)
    }

    /// Returns whether paths come over ROS 2.
    pub fn over_ros2(&self) -> bool {
        self.port == RunPort::Ros2 || self.ros2.is_some()
    }

    /// Returns what is offered and listened to on ROS 2, and how its paths are driven.
    ///
    /// # Errors
    /// [`ConfigError`] with the file, key, value and range.
    pub fn ros2(
        &self,
        file: &ConfigFile,
        vehicle: &Vehicle,
    ) -> Result<(Ros2Config, RouteSettings), ConfigError> {
        let config = self.ros2.clone().unwrap_or_default();
        config
            .validate()
            .and_then(|()| TwistMapping::new(config.commands.track_width_m, vehicle).map(drop))
            .map_err(|error| file.error(error))?;
        self.check_clock(file, &config)?;
        let route = RouteSettings {
            smoothing: config.smoothing,
            limits: self.speed.limits(&self.settings.limits, vehicle),
            tracked_point: self.settings.tracked_point,
            use_orientations: config.follow_path.use_orientations,
        };
        Ok((config, route))
    }

    /// Returns how the vehicle stops ahead of an obstacle.
    ///
    /// From a check of the costmap until the treads obey pass the time until the next check, a cycle, and the
    /// delay of a command.
    pub fn stopping(&self) -> StoppingSettings {
        StoppingSettings {
            deceleration_m_s2: self.safety.deceleration_m_s2,
            reaction_s: StoppingSettings::CHECK_S + self.cycle.period_s + self.settings.delay_s(),
        }
    }

    /// Checks that the cycle goes by a clock by which the port's readings can be dated.
    ///
    /// # Errors
    /// [`ConfigError`] where a bus, whose frames come at times of the world, is to be driven in
    /// simulated time: no silence of it would be noticed.
    pub fn check_clock(&self, file: &ConfigFile, ros2: &Ros2Config) -> Result<(), ConfigError> {
        if self.port == RunPort::Can && ros2.use_sim_time {
            return Err(file.error("ros2.use_sim_time: a CAN bus has no simulated time"));
        }
        Ok(())
    }

    /// Returns where the drive is recorded, and how large that may become; none where it is not.
    /// `given` is the file of the command line.
    ///
    /// # Errors
    /// [`ConfigError`] with the file, key, value and range.
    pub fn recording(
        &self,
        file: &ConfigFile,
        given: Option<&Path>,
    ) -> Result<Option<(PathBuf, RecordLimits)>, ConfigError> {
        recording(file, self.record.as_ref(), given)
    }

    /// Returns interface and layout of the bus.
    ///
    /// # Errors
    /// [`ConfigError`] where a key is missing or the layout's files are wrong.
    pub fn bus(&self, file: &ConfigFile) -> Result<(&str, Layout), ConfigError> {
        bus(file, self.interface.as_deref(), self.can.as_deref())
    }

    /// Returns the virtual vehicle of port `simulated`.
    ///
    /// # Errors
    /// [`ConfigError`] where the key is missing or the file cannot be read or parsed.
    pub fn simulated(&self, file: &ConfigFile) -> Result<(ConfigFile, VehicleConfig), ConfigError> {
        let name = needed(file, "simulated", self.simulated.as_deref())?;
        let vehicle_file = file.sibling(name)?;
        let config = vehicle_file.parse()?;
        Ok((vehicle_file, config))
    }
}

/// Behind what a virtual vehicle is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum VehiclePort {
    /// A CAN bus.
    #[default]
    Can,
    /// The graph of ROS 2.
    Ros2,
}

/// What `sidehill vehicle` reads.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VehicleConfig {
    /// Behind what it is.
    #[serde(default)]
    pub port: VehiclePort,
    /// Its topics and frames, of port `ros2`.
    #[serde(default)]
    pub ros2: VehicleNodeConfig,
    /// SocketCAN interface.
    #[serde(default)]
    pub interface: Option<String>,
    /// Layout of the bus, relative to this file.
    #[serde(default)]
    pub can: Option<PathBuf>,
    /// The world: vehicle, ground, start, drive train and sensors of a scenario, relative to this
    /// file.
    pub scenario: PathBuf,
    /// What moves the vehicle, instead of what the scenario says.
    #[serde(default)]
    pub plant: Option<PlantKind>,
    /// Seed of everything random, instead of the scenario's.
    #[serde(default)]
    pub seed: Option<u64>,
    /// Between command and treads, instead of the scenario's.
    #[serde(default)]
    pub drive_train: Option<DriveTrainConfig>,
    /// Errors of the sensors, instead of the scenario's.
    #[serde(default)]
    pub sensors: Option<SensorsConfig>,
    /// The drives' own side of the handshake.
    #[serde(default)]
    pub drive: DriveConfig,
    /// Time between reports, s.
    #[serde(default = "fifty_milliseconds")]
    pub report_period_s: f64,
    /// What goes wrong on purpose, of port `can`.
    #[serde(default)]
    pub faults: Vec<FaultWindow<CanFault>>,
    /// What is recorded.
    #[serde(default)]
    pub record: Option<RecordConfig>,
}

impl VehicleConfig {
    /// Returns where the drive is recorded, as [`RunConfig::recording`] does.
    ///
    /// # Errors
    /// [`ConfigError`] with the file, key, value and range.
    pub fn recording(
        &self,
        file: &ConfigFile,
        given: Option<&Path>,
    ) -> Result<Option<(PathBuf, RecordLimits)>, ConfigError> {
        recording(file, self.record.as_ref(), given)
    }

    /// Returns the scenario with what replaces its own.
    ///
    /// # Errors
    /// [`ConfigError`] with the file at fault, key, value and range.
    pub fn world(&self, file: &ConfigFile) -> Result<Prepared, ConfigError> {
        let scenario = Scenario::read(file.sibling(&self.scenario)?)?;
        let mut world = scenario.prepare(&Overrides {
            plant: self.plant,
            seed: self.seed,
            ..Overrides::default()
        })?;
        world.drive_train = self.drive_train.unwrap_or(world.drive_train);
        world.sensors = self.sensors.unwrap_or(world.sensors);
        Ok(world)
    }

    /// Returns interface and layout of the bus.
    ///
    /// # Errors
    /// [`ConfigError`] where a key is missing or the layout's files are wrong.
    pub fn bus(&self, file: &ConfigFile) -> Result<(&str, Layout), ConfigError> {
        bus(file, self.interface.as_deref(), self.can.as_deref())
    }
}

/// Returns the layout of the bus in a file and the database it names.
///
/// # Errors
/// Names the file, the message and the signal that is wrong.
pub fn load_layout(file: &ConfigFile) -> Result<Layout, ConfigError> {
    let config: CanConfig = file.parse()?;
    let database = file.sibling(Path::new(&config.database))?;
    let database =
        Database::parse(&database.name(), database.text()).map_err(|error| file.error(error))?;
    Layout::new(&config, &database).map_err(|error| file.error(error))
}

fn bus<'a>(
    file: &ConfigFile,
    interface: Option<&'a str>,
    layout: Option<&Path>,
) -> Result<(&'a str, Layout), ConfigError> {
    let interface = needed(file, "interface", interface)?;
    let layout = needed(file, "can", layout)?;
    Ok((interface, load_layout(&file.sibling(layout)?)?))
}

fn needed<T>(file: &ConfigFile, key: &str, value: Option<T>) -> Result<T, ConfigError> {
    value.ok_or_else(|| file.error(format!("{key}: is missing, which this port needs")))
}

fn every_s() -> f64 {
    30.0
}

fn days_max() -> f64 {
    crate::learned::DAYS_MAX
}

fn one() -> u32 {
    1
}

fn fifty_milliseconds() -> f64 {
    0.05
}
