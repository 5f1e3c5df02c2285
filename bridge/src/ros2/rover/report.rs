//! What a virtual vehicle publishes, made from its sensors' readings.

use super::config::{GnssConfig, Stream, VehicleFaultKind, VehicleNodeConfig};
use crate::ros2::conversions;
use crate::ros2::convert::{self, TwistMapping};
use crate::ros2::message::{
    self, Header, Imu, JointState, NavSatFix, NavSatStatus, Odometry, TfMessage, Time,
    TransformStamped,
};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use sidehill_controller::path::Point2;
use sidehill_plant::frames::{Attitude, BodyVelocity, Pose};
use sidehill_plant::sample::Sample;
use sidehill_plant::speeds::MeasuredTreadSpeeds;

/// Frame of the antenna.
pub const GNSS_FRAME: &str = "gps";
/// Standard deviation that an RTK receiver states, m.
const RTK_SIGMA_M: f64 = 0.014;
const GRAVITY_M_S2: f64 = 9.80665;

/// One report; fields without a new sensor reading are missing.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Report {
    /// odom: the pose source's pose; the twist is what a differential drive counts from its treads.
    pub odometry: Option<Odometry>,
    /// fix: the place of the antenna of a satellite receiver, where the vehicle has one.
    pub fix: Option<NavSatFix>,
    /// imu: attitude, heading, yaw rate, and gravity as the acceleration of a slow vehicle. The yaw rate is the newest that
    /// its sensor has read, or the true one where the sensors have none.
    pub imu: Option<Imu>,
    /// /tf: odom to base_link.
    pub transforms: Option<TfMessage>,
    /// joint_states.
    pub joint_states: Option<JointState>,
    /// emergency_stop.
    pub emergency_stop: bool,
    /// /clock.
    pub clock: Option<Time>,
}

impl Report {
    /// Makes a report wrong.
    pub(super) fn spoil(&mut self, fault: &VehicleFaultKind) {
        match fault {
            VehicleFaultKind::Stop(streams) => {
                for stream in streams {
                    match stream {
                        Stream::Odometry => self.odometry = None,
                        Stream::Imu => self.imu = None,
                        Stream::Transforms => self.transforms = None,
                        Stream::JointStates => self.joint_states = None,
                        Stream::Clock => self.clock = None,
                        Stream::Fix => self.fix = None,
                    }
                }
            }
            VehicleFaultKind::NotANumber(stream) => self.not_a_number(*stream),
            VehicleFaultKind::WrongFrame(stream) => self.wrong_frame(*stream),
            VehicleFaultKind::FreezeStamps
            | VehicleFaultKind::DelayS(_)
            | VehicleFaultKind::ClockJumpS(_)
            | VehicleFaultKind::EmergencyStop
            | VehicleFaultKind::IgnoreCommands => {}
        }
    }

    fn not_a_number(&mut self, stream: Stream) {
        match stream {
            Stream::Odometry => {
                if let Some(odometry) = &mut self.odometry {
                    odometry.pose.pose.position.x = f64::NAN;
                }
            }
            Stream::Imu => {
                if let Some(imu) = &mut self.imu {
                    imu.orientation.x = f64::NAN;
                    imu.angular_velocity.z = f64::NAN;
                }
            }
            Stream::Transforms => {
                for transform in self.transforms.iter_mut().flat_map(|tf| &mut tf.transforms) {
                    transform.transform.translation.x = f64::NAN;
                }
            }
            Stream::JointStates => {
                if let Some(joints) = &mut self.joint_states {
                    joints.velocity.fill(f64::NAN);
                }
            }
            Stream::Fix => {
                if let Some(fix) = &mut self.fix {
                    fix.latitude = f64::NAN;
                }
            }
            Stream::Clock => {}
        }
    }

    fn wrong_frame(&mut self, stream: Stream) {
        let wrong = || "nowhere".to_owned();
        match stream {
            Stream::Odometry => {
                if let Some(odometry) = &mut self.odometry {
                    odometry.header.frame_id = wrong();
                }
            }
            Stream::Imu => {
                if let Some(imu) = &mut self.imu {
                    imu.header.frame_id = wrong();
                }
            }
            Stream::Transforms => {
                for transform in self.transforms.iter_mut().flat_map(|tf| &mut tf.transforms) {
                    transform.header.frame_id = wrong();
                }
            }
            Stream::Fix => {
                if let Some(fix) = &mut self.fix {
                    fix.header.frame_id = wrong();
                }
            }
            Stream::JointStates | Stream::Clock => {}
        }
    }
}

/// What a report is made of.
pub(super) struct ReportReadings {
    pub sample: Sample,
    pub true_yaw_rate_rad_s: f64,
    pub true_yaw_rad: f64,
    pub angles_rad: [f64; 2],
    pub time_s: f64,
    pub jump_s: f64,
    pub frozen: bool,
}

/// Makes reports, with the newest reading of what is not read each time.
pub(super) struct Reporter {
    config: VehicleNodeConfig,
    odom_from_map: Isometry3<f64>,
    origin_ns: i64,
    twist: TwistMapping,
    attitude: Attitude,
    /// None before the first reading.
    yaw_rate_rad_s: Option<f64>,
    pose: Pose,
    treads: MeasuredTreadSpeeds,
    wheels: WheelOdometry,
    frozen_s: Option<f64>,
}

/// Where the vehicle would be if its wheels rolled without slip on level ground.
#[derive(Debug, Default)]
struct WheelOdometry {
    pose: Pose,
    read_s: Option<f64>,
}

impl WheelOdometry {
    fn advance(&mut self, time_s: f64, velocity: &BodyVelocity) {
        let elapsed_s = self
            .read_s
            .replace(time_s)
            .map_or(0.0, |at_s| time_s - at_s);
        let turned_rad = velocity.yaw_rate_rad_s * elapsed_s;
        let way_m = velocity.forward_m_s * elapsed_s;
        let (sin, cos) = (self.pose.yaw_rad + 0.5 * turned_rad).sin_cos();
        self.pose.x_m -= sin * way_m;
        self.pose.y_m += cos * way_m;
        self.pose.yaw_rad += turned_rad;
    }
}

impl Reporter {
    pub fn new(config: &VehicleNodeConfig, twist: TwistMapping, origin_ns: i64) -> Self {
        Self {
            config: config.clone(),
            odom_from_map: map_from_odom(config).inverse(),
            origin_ns,
            twist,
            attitude: Attitude::default(),
            yaw_rate_rad_s: None,
            pose: Pose::default(),
            treads: MeasuredTreadSpeeds::default(),
            wheels: WheelOdometry::default(),
            frozen_s: None,
        }
    }

    pub fn report(&mut self, readings: &ReportReadings) -> Report {
        if readings.frozen {
            self.frozen_s.get_or_insert(readings.time_s);
        } else {
            self.frozen_s = None;
        }
        let frames = self.config.frames.clone();
        let header = |reporter: &Self, time_s: f64, frame: &str| Header {
            stamp: reporter.stamp(time_s, readings.jump_s),
            frame_id: frame.to_owned(),
        };
        let Sample {
            attitude,
            yaw_rate,
            pose,
            tread_speeds,
            ..
        } = readings.sample;
        self.attitude = attitude.map_or(self.attitude, |attitude| attitude.value);
        self.yaw_rate_rad_s = yaw_rate.map_or(self.yaw_rate_rad_s, |read| Some(read.value));
        self.pose = pose.map_or(self.pose, |pose| pose.value);
        self.treads = tread_speeds.map_or(self.treads, |treads| treads.value);
        let twist = self.twist.twist(self.treads.into());
        let gnss = self.config.gnss;
        let standing = match gnss {
            Some(_) => Pose {
                yaw_rad: readings.true_yaw_rad,
                ..self.pose
            },
            None => self.pose,
        };
        let map_from_base = convert::world_from_base_link(&standing, &self.attitude);
        // Of the pose source, or of the wheels.
        let (read_s, odom_from_base) = match gnss {
            Some(_) => {
                if let (Some(read), Ok(velocity)) = (tread_speeds, convert::from_twist(&twist)) {
                    self.wheels.advance(read.time_s, &velocity);
                }
                let pose = &self.wheels.pose;
                let rolled = convert::world_from_base_link(pose, &self.attitude);
                (tread_speeds.map(|read| read.time_s), rolled)
            }
            None => {
                let read_s = pose.map(|pose| pose.time_s);
                (read_s, self.odom_from_map * map_from_base)
            }
        };
        Report {
            odometry: read_s.map(|time_s| Odometry {
                header: header(self, time_s, &frames.odom),
                child_frame_id: frames.base.clone(),
                pose: message::PoseWithCovariance {
                    pose: conversions::to_pose(&odom_from_base),
                    ..Default::default()
                },
                twist: message::TwistWithCovariance {
                    twist,
                    ..Default::default()
                },
            }),
            fix: gnss.zip(pose).map(|(gnss, pose)| {
                let header = header(self, pose.time_s, GNSS_FRAME);
                fix(header, &gnss, &pose.value, &self.attitude)
            }),
            transforms: read_s.map(|time_s| TfMessage {
                transforms: [
                    (&frames.odom, &frames.base, odom_from_base),
                    (
                        &frames.base,
                        &frames.footprint,
                        level_in_base(&self.attitude),
                    ),
                ]
                .into_iter()
                .filter(|(_, child, _)| !child.is_empty())
                .map(|(parent, child, transform)| TransformStamped {
                    header: header(self, time_s, parent),
                    child_frame_id: child.clone(),
                    transform: conversions::to_transform(&transform),
                })
                .collect(),
            }),
            imu: attitude.map(|attitude| Imu {
                header: header(self, attitude.time_s, &frames.base),
                orientation: conversions::to_quaternion(&map_from_base.rotation),
                angular_velocity: message::Vector3 {
                    z: self.yaw_rate_rad_s.unwrap_or(readings.true_yaw_rate_rad_s),
                    ..Default::default()
                },
                linear_acceleration: conversions::to_vector(
                    &(map_from_base.rotation.inverse() * Vector3::z() * GRAVITY_M_S2),
                ),
                ..Default::default()
            }),
            joint_states: tread_speeds.map(|treads| {
                self.config.joints.joint_state(
                    header(self, treads.time_s, ""),
                    treads.value,
                    readings.angles_rad,
                )
            }),
            emergency_stop: false,
            clock: self
                .config
                .clock_factor
                .map(|_| self.stamp(readings.time_s, readings.jump_s)),
        }
    }

    fn stamp(&self, time_s: f64, jump_s: f64) -> Time {
        let time_s = self
            .frozen_s
            .map_or(time_s, |frozen_s| time_s.min(frozen_s));
        conversions::stamp(self.origin_ns + ((time_s + jump_s) * 1e9).round() as i64)
    }
}

/// Returns the fix of a receiver whose antenna is where a vehicle at a pose has it.
fn fix(header: Header, gnss: &GnssConfig, pose: &Pose, attitude: &Attitude) -> NavSatFix {
    let map_from_base = convert::world_from_base_link(pose, attitude);
    let antenna = map_from_base * Point3::from(gnss.antenna.in_base());
    let (latitude, longitude) = gnss.datum.unproject(Point2 {
        x_m: antenna.x,
        y_m: antenna.y,
    });
    let variance = RTK_SIGMA_M * RTK_SIGMA_M;
    let mut position_covariance = [0.0; 9];
    position_covariance[0] = variance;
    position_covariance[4] = variance;
    position_covariance[8] = 4.0 * variance;
    NavSatFix {
        header,
        // RTK of ground stations, by GPS and the others.
        status: NavSatStatus {
            status: 2,
            service: 15,
        },
        latitude,
        longitude,
        altitude: antenna.z + gnss.datum.elevation_m,
        position_covariance,
        position_covariance_type: 2,
    }
}

/// Returns the level frame of a vehicle in the vehicle's own: at the same place, with the same heading.
fn level_in_base(attitude: &Attitude) -> Isometry3<f64> {
    let here = Pose::default();
    convert::world_from_base_link(&here, attitude).inverse()
        * convert::world_from_base_link(&here, &Attitude::LEVEL)
}

/// Returns the pose of the odometry's frame in the map.
pub fn map_from_odom(config: &VehicleNodeConfig) -> Isometry3<f64> {
    let offset = &config.map_from_odom;
    Isometry3::from_parts(
        Translation3::new(offset.x_m, offset.y_m, 0.0),
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), offset.yaw_deg.to_radians()),
    )
}
