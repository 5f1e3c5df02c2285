//! Configuration of `run`.

use super::bus::{bus, needed};
use super::record::{RecordConfig, recording, yes};
use super::reference::{LoadedReference, RouteConfig, Source, read_route};
use super::virtual_rover::VehicleConfig;
use super::{ConfigError, ConfigFile};
use crate::learned::KeptFile;
use serde::Deserialize;
use sidehill_bridge::control_loop::CycleConfig;
use sidehill_bridge::control_loop::scheduling::RealtimeConfig;
use sidehill_bridge::ros2::convert::TwistMapping;
use sidehill_bridge::ros2::settings::server::Ros2Config;
use sidehill_bridge::ros2::settings::topics::{AttitudeSource, PoseMessage, YawRateSource};
use sidehill_bridge::rover::SimulatedPort;
use sidehill_bridge::safety::{Geofence, SafetyConfig};
use sidehill_can::layout::Layout;
use sidehill_controller::config::{AttitudePreview, ControllerConfig, ControllerKind};
use sidehill_controller::controller::Controller;
use sidehill_controller::course::Course;
use sidehill_controller::estimator::EstimatorSettings;
use sidehill_controller::guard::{Stance, first_steep_place};
use sidehill_controller::path::GeodeticOrigin;
use sidehill_controller::reference::Reference;
use sidehill_controller::speed_profile::SpeedConfig;
use sidehill_plant::bounds::Bounds;
use sidehill_plant::vehicle::Vehicle;
use sidehill_recording::RecordLimits;
use std::path::{Path, PathBuf};

/// Standard deviation of a heading from the motion of the vehicle, rad.
const COURSE_SIGMA_RAD: f64 = 0.03;

/// How `run` commands the drives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RunPort {
    /// A CAN bus.
    #[default]
    Can,
    /// A virtual vehicle in the same process.
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
    /// SocketCAN interface. Required with `port: can`.
    #[serde(default)]
    pub interface: Option<String>,
    /// [CAN layout](#can-layout) file. Required with `port: can`.
    #[serde(default)]
    pub can: Option<PathBuf>,
    /// [Virtual rover](#virtual-rover) file. Required with `port: simulated`.
    #[serde(default)]
    pub simulated: Option<PathBuf>,
    /// [Vehicle](#vehicle) file that the controller uses.
    pub vehicle: PathBuf,
    /// Controller.
    pub controller: ControllerKind,
    /// [Controller settings](#controller-settings).
    #[serde(default)]
    pub settings: ControllerConfig,
    /// [File](#learned-file) in which what was learned is kept over a restart.
    #[serde(default)]
    pub learned: Option<LearnedConfig>,
    /// [Course](#course) to drive. Without ROS 2, exactly one of `course` and `route`.
    #[serde(default)]
    pub course: Option<Course>,
    /// [Route](#route) to drive.
    #[serde(default)]
    pub route: Option<RouteConfig>,
    /// [Place on earth](#datum) at which a GPX route and satellite fixes have x = 0, y = 0. None: the datum of the GPX
    /// file, or its first point.
    #[serde(default)]
    pub datum: Option<GeodeticOrigin>,
    /// [Speed](#speed), where the course gives no times, and of paths over ROS 2.
    #[serde(default)]
    pub speed: SpeedConfig,
    /// Rounds of a periodic course.
    #[serde(default = "one")]
    pub laps: u32,
    /// [Control cycle](#cycle).
    #[serde(default)]
    pub cycle: CycleConfig,
    /// [Safety](#safety).
    #[serde(default)]
    pub safety: SafetyConfig,
    /// Area that the vehicle may not leave, in the frame of its poses: corners of a polygon, m, as `[[0, 0], [20, 0], [20,
    /// 10], [0, 10]]`. A path that leaves it is refused, and the vehicle's origin stops before the edge.
    #[serde(default)]
    pub geofence: Option<Geofence>,
    /// [Real-time scheduling](#real-time).
    #[serde(default)]
    pub realtime: RealtimeConfig,
    /// [ROS 2](#ros-2): with this section, paths come over ROS 2.
    #[serde(default)]
    pub ros2: Option<Ros2Config>,
    /// [Recording](#record).
    #[serde(default)]
    pub record: Option<RecordConfig>,
}

impl RunConfig {
    /// Returns the file that keeps what was learned, if it is kept.
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

    /// Returns the vehicle model of the controller.
    ///
    /// # Errors
    /// [`ConfigError`] with the file at fault, key, value and range.
    pub fn load_vehicle(&self, file: &ConfigFile) -> Result<Vehicle, ConfigError> {
        let vehicle: Vehicle = file.sibling(&self.vehicle)?.parse()?;
        // The port converts speeds by the factors of the controller's model.
        Ok(match self.controller {
            ControllerKind::IcrikMpc => vehicle.extended(),
            ControllerKind::ContactMpc => vehicle.on_wheels(),
            ControllerKind::IcrhkMpc
            | ControllerKind::DiffdriveMpc
            | ControllerKind::PurePursuit => vehicle,
        })
    }

    /// Returns the controller with its reference; if paths come over ROS 2 without one, but with the ground of the
    /// route.
    ///
    /// # Errors
    /// [`ConfigError`] with the file at fault, key, value and range.
    pub fn controller(
        &self,
        file: &ConfigFile,
        vehicle: &Vehicle,
    ) -> Result<Controller, ConfigError> {
        let made = self.controller_and_reference(file, vehicle);
        made.map(|(controller, _)| controller)
    }

    /// Returns the controller as [`Self::controller`] does, and the course or route that was read for it; none if paths
    /// come over ROS 2 alone.
    ///
    /// # Errors
    /// As [`Self::controller`].
    pub fn controller_and_reference(
        &self,
        file: &ConfigFile,
        vehicle: &Vehicle,
    ) -> Result<(Controller, Option<LoadedReference>), ConfigError> {
        let mut settings = self.settings.clone();
        if self.learned_file(file)?.is_some() {
            settings.memory.get_or_insert_default();
        }
        if self.fixes_heading() == Some(false) {
            // A course over ground is no better.
            let sigma_rad = &mut settings.estimator.pose_sigma_rad;
            *sigma_rad = sigma_rad.max(COURSE_SIGMA_RAD);
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
        let loaded = self.reference(file, vehicle)?;
        if let Some(loaded) = &loaded {
            if let Some(geofence) = &self.geofence
                && let Some([x_m, y_m]) = geofence.first_outside(&loaded.trajectory)
            {
                return Err(file.error(format!(
                    "geofence: the path leaves it at x = {x_m:.2} m, y = {y_m:.2} m"
                )));
            }
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
            if !self.over_ros2() {
                let reference = Reference::new(loaded.trajectory.clone());
                controller.follow(reference.for_laps(self.laps));
            }
        }
        Ok((controller, loaded))
    }

    /// Returns the course or the route; none if paths come over ROS 2 alone.
    fn reference(
        &self,
        file: &ConfigFile,
        vehicle: &Vehicle,
    ) -> Result<Option<LoadedReference>, ConfigError> {
        if self.over_ros2() {
            if self.course.is_some() {
                let reason = "course: paths come over ROS 2, or from a `route`";
                return Err(file.error(reason));
            }
            if self.route.is_none() {
                return Ok(None);
            }
        }
        let (course, route) = (self.course.as_ref(), self.route.as_ref());
        let source = Source::of(file, course, route, self.datum, None)?;
        let limits = self.speed.limits(&self.settings.limits, vehicle);
        LoadedReference::build(file, source, &limits).map(Some)
    }

    /// Returns a route by its file, with how it was read: a path as typed, or a name without ending of a file beside
    /// this one.
    ///
    /// # Errors
    /// [`ConfigError`] with the file at fault.
    pub fn stored_route(
        &self,
        file: &ConfigFile,
        vehicle: &Vehicle,
        name: &Path,
    ) -> Result<LoadedReference, ConfigError> {
        let beside = file.path().parent().unwrap_or(Path::new("."));
        let stored = ["csv", "gpx"]
            .map(|ending| beside.join(name).with_extension(ending))
            .into_iter()
            .find(|path| name.extension().is_none() && path.is_file());
        let datum = match self.datum {
            Some(datum) => Some(datum),
            None => self.fixes(file)?.map(|(datum, _)| datum),
        };
        let path = stored.as_deref().unwrap_or(name);
        let source = Source::of(file, None, self.route.as_ref(), datum, Some(path))?;
        let limits = self.speed.limits(&self.settings.limits, vehicle);
        LoadedReference::build(file, source, &limits)
    }

    /// Returns whether paths come over ROS 2.
    pub fn over_ros2(&self) -> bool {
        self.port == RunPort::Ros2 || self.ros2.is_some()
    }

    /// Returns the configuration of the ROS 2 server.
    ///
    /// # Errors
    /// [`ConfigError`] with the file, key, value and range.
    pub fn ros2(&self, file: &ConfigFile, vehicle: &Vehicle) -> Result<Ros2Config, ConfigError> {
        let config = self.ros2.clone().unwrap_or_default();
        config
            .validate()
            .and_then(|()| TwistMapping::new(config.commands.track_width_m, vehicle).map(drop))
            .map_err(|error| file.error(error))?;
        self.check_clock(file, &config)?;
        self.check_sensors(file, &config)?;
        self.fixes(file)?;
        Ok(config)
    }

    /// Checks that the clock of the cycle can date the port's readings.
    ///
    /// # Errors
    /// [`ConfigError`] for a CAN bus in simulated time: its frames come in real time, so its silence would go
    /// unnoticed.
    pub fn check_clock(&self, file: &ConfigFile, ros2: &Ros2Config) -> Result<(), ConfigError> {
        if self.port == RunPort::Can && ros2.use_sim_time {
            return Err(file.error("ros2.use_sim_time: a CAN bus has no simulated time"));
        }
        Ok(())
    }

    /// Checks that no sensor is asked for where nobody would read it.
    fn check_sensors(&self, file: &ConfigFile, ros2: &Ros2Config) -> Result<(), ConfigError> {
        if self.port != RunPort::Ros2 && ros2.inputs.yaw_rate == YawRateSource::Imu {
            let reason = "an imu is read with port: ros2 only, must be none";
            return Err(file.error(format!("ros2.inputs.yaw_rate: {reason}")));
        }
        if let Some(pose) = &ros2.inputs.pose {
            if self.port != RunPort::Ros2 {
                return Err(file.error("ros2.inputs.pose: it is read with port: ros2 only"));
            }
            pose.validate().map_err(|error| file.error(error))?;
            if pose.message == PoseMessage::NavSatFix {
                let inputs = &ros2.inputs;
                if inputs.attitude != AttitudeSource::Imu {
                    let reason = "fixes have no orientation, must be imu";
                    return Err(file.error(format!("ros2.inputs.attitude: {reason}")));
                }
                if pose.heading.is_none() && inputs.yaw_rate != YawRateSource::Imu {
                    let reason =
                        "the heading of fixes needs `yaw_rate: imu`, or a topic in `pose.heading`";
                    return Err(file.error(format!("ros2.inputs.yaw_rate: {reason}")));
                }
            }
            if pose.topic == ros2.inputs.odometry {
                let reason = "this is the topic of odometry, whose poses are read without it";
                return Err(file.error(format!("ros2.inputs.pose.topic: {reason}")));
            }
        }
        Ok(())
    }

    /// Returns where on earth x = 0, y = 0 is: the datum, or that of a GPX route; none where neither is there.
    ///
    /// # Errors
    /// A route that cannot be read.
    pub fn place_on_earth(&self, file: &ConfigFile) -> Result<Option<GeodeticOrigin>, ConfigError> {
        match (&self.datum, &self.route) {
            (None, Some(route)) => Ok(read_route(&file.sibling(&route.file)?, None)?.origin),
            (datum, _) => Ok(*datum),
        }
    }

    /// Returns how fixes of a satellite receiver become poses; none where poses come otherwise.
    ///
    /// # Errors
    /// [`ConfigError`] where the origin of the poses is not known.
    pub fn fixes(
        &self,
        file: &ConfigFile,
    ) -> Result<Option<(GeodeticOrigin, &EstimatorSettings)>, ConfigError> {
        if self.fixes_heading().is_none() {
            return Ok(None);
        }
        let datum = self.place_on_earth(file)?.ok_or_else(|| {
            file.error(
                "datum: it is missing, and satellite fixes have no place in the frame of the poses without it, as \
                 `datum: {latitude_deg: 36.717, longitude_deg: -4.489}`; a GPX route has one, too",
            )
        })?;
        Ok(Some((datum, &self.settings.estimator)))
    }

    /// Returns whether poses come from satellite fixes and, if so, whether their heading is measured.
    fn fixes_heading(&self) -> Option<bool> {
        let pose = self.ros2.as_ref()?.inputs.pose.as_ref()?;
        (pose.message == PoseMessage::NavSatFix).then_some(pose.heading.is_some())
    }

    /// Returns the file of the recording and its limits; none if the drive is not recorded. `given` is the file from
    /// the command line.
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

    /// Returns the virtual vehicle of port `simulated`, simulated in this process.
    ///
    /// # Errors
    /// As [`RunConfig::simulated`], or the file at fault, key, value and range.
    pub fn simulated_port(&self, file: &ConfigFile) -> Result<SimulatedPort, ConfigError> {
        let (file, config) = self.simulated(file)?;
        let world = config.world(&file)?;
        let simulation = world.simulation().map_err(|error| file.error(error))?;
        let encoder_scale = world.plant.encoder_scale();
        SimulatedPort::new(simulation, world.step_s, encoder_scale, config.drive)
            .map_err(|error| file.error(error))
    }
}

/// The file that keeps what was learned.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LearnedConfig {
    /// File, relative to the configuration. It is made after `every_s` of driving or when the vehicle is disarmed for
    /// the first time.
    pub file: PathBuf,
    /// Whether the file is read and written.
    #[serde(default = "yes")]
    pub keep: bool,
    /// Age beyond which the file is refused, days.
    #[serde(default = "days_max")]
    pub days_max: f64,
    /// Time of driving after which the file is written again: a program that is killed loses what it learned since.
    #[serde(default = "every_s")]
    pub every_s: f64,
}

fn one() -> u32 {
    1
}

fn every_s() -> f64 {
    30.0
}

fn days_max() -> f64 {
    crate::learned::DAYS_MAX
}
