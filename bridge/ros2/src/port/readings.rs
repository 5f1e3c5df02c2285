//! From messages to readings for the controller: frames, stamps and units are checked here.

use super::fixes::{FixError, FixPoses, FixReading, FixSettings};
use super::shared_inputs::SharedInputs;
use super::stamp_clock::{AHEAD_S, STEP_MAX_S, SYSTEM_JUMP_S, StampClock};
use crate::node::time::RosTime;
use nalgebra::{UnitQuaternion, Vector3};
use ros2_client::Gid;
use sidehill_bridge::drives::{ExternalClock, MeasuredMotorSpeeds};
use sidehill_bridge::ros2::conversions::{
    MessageError, from_pose, from_quaternion, from_transform, from_vector, nanoseconds,
};
use sidehill_bridge::ros2::convert::{TwistMapping, pose_and_attitude};
use sidehill_bridge::ros2::message;
use sidehill_bridge::ros2::message::{
    Clock, Header, Imu, JointState, NavSatFix, Odometry, Quaternion, TfMessage, TransformStamped,
    Twist,
};
use sidehill_bridge::ros2::settings::topics::{
    AttitudeSource, Frames, HeadingConfig, InputsConfig, PoseMessage, SpeedSource, YawRateSource,
};
use sidehill_bridge::ros2::transforms::TransformError;
use sidehill_plant::frames::{Attitude, Pose, paper_attitude};
use sidehill_plant::sample::Stamped;
use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// Whether DDS delivers in the order of arrival; built by `bridge/patches/cargo`.
const DDS_IS_PATCHED: bool = option_env!("SIDEHILL_DDS_PATCHES").is_some();
/// The topic of transforms.
pub(crate) const TF: &str = "/tf";
/// The topic of simulated time.
pub(crate) const CLOCK: &str = "/clock";
/// A step of `/clock` that is a jump, s; any step back is one.
const CLOCK_JUMP_S: f64 = 2.0;
/// How far the stamp of a transform may be ahead of the clock, s: a localisation predicts.
const PREDICTION_MAX_S: f64 = 10.0;
/// Height of a direction of length 1 from which on it shows no heading.
const STEEP: f64 = 0.7;
/// Fastest rotation that is believed, rad/s: gyroscopes read at most 2000 deg/s.
const ROTATION_MAX_RAD_S: f64 = 35.0;

/// The newest reading of each kind.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct LatestInputs {
    pub(crate) pose: Option<Stamped<Pose>>,
    pub(crate) attitude: Option<Stamped<Attitude>>,
    /// About the vehicle's upward axis, rad/s, counter-clockwise positive.
    pub(crate) yaw_rate: Option<Stamped<f64>>,
    pub(crate) motors: Option<Stamped<MeasuredMotorSpeeds>>,
    /// The command that reaches the drives, at the instant it came.
    pub(crate) forwarded: Option<Stamped<MeasuredMotorSpeeds>>,
}

/// Why a message is rejected.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(crate) enum Rejection {
    #[error(transparent)]
    Message(#[from] MessageError),
    #[error("it is in {found}, must be in {expected}")]
    Frame { found: String, expected: String },
    #[error("its stamp is {ahead_s:.3} s ahead of the clock")]
    Ahead { ahead_s: f64 },
    #[error("orientation_covariance[0] is -1: this imu has no orientation")]
    NoOrientation,
    #[error("angular_velocity_covariance[0] is -1: this imu has no angular velocity")]
    NoAngularVelocity,
    #[error("angular_velocity is {rad_s:.1} rad/s, must be at most {ROTATION_MAX_RAD_S} rad/s")]
    Rotation { rad_s: f64 },
    #[error(
        "its heading has a standard deviation of {sigma_rad:.3} rad, more than {max_rad:.3} rad, three times \
             settings.estimator.pose_sigma_rad"
    )]
    Heading { sigma_rad: f64, max_rad: f64 },
    #[error("the x axis of its frame points up or down in the vehicle: nothing shows its heading")]
    Steep,
    #[error("{0}; publish it, or give `{1}`")]
    Mounting(TransformError, &'static str),
    #[error(transparent)]
    Fix(#[from] FixError),
    #[error(transparent)]
    Transform(#[from] TransformError),
}

/// What readings and commands share.
#[derive(Clone)]
pub(crate) struct PortContext {
    pub(crate) frames: Frames,
    pub(crate) mapping: TwistMapping,
    pub(crate) time: RosTime,
    /// The control loop's clock, where it is that of `/clock`.
    pub(crate) clock: Option<ExternalClock>,
    pub(crate) shared: Arc<SharedInputs>,
    /// How fixes become poses; none where no fix is read.
    pub(crate) fixes: Option<FixSettings>,
}

/// Converts messages to the newest readings; what it rejects is counted and keeps its reason.
pub(crate) struct NewestReadings {
    config: InputsConfig,
    context: PortContext,
    latest: LatestInputs,
    clock_s: Option<f64>,
    stamp_clocks: StampClocks,
    fixes: Option<FixPoses>,
}

/// The clocks by which the topics are stamped.
#[derive(Debug, Default)]
struct StampClocks {
    odometry: StampClock,
    pose: StampClock,
    heading: StampClock,
    imu: StampClock,
    joint_states: StampClock,
}

impl NewestReadings {
    /// Returns readings before the first message.
    pub(crate) fn new(config: InputsConfig, context: PortContext) -> Self {
        let pose = config.pose.as_ref();
        let of_fixes = pose.filter(|pose| pose.message == PoseMessage::NavSatFix);
        let fixes = context.fixes.zip(of_fixes);
        Self {
            fixes: fixes.map(|(settings, pose)| FixPoses::new(settings, pose.heading.is_none())),
            config,
            context,
            latest: LatestInputs::default(),
            clock_s: None,
            stamp_clocks: StampClocks::default(),
        }
    }

    /// Returns the newest readings.
    pub(crate) fn latest(&self) -> LatestInputs {
        self.latest
    }

    /// Takes a time of `/clock`. A jump drops all readings and transforms.
    pub(crate) fn clock(&mut self, message: &Clock) {
        let (Some(clock), Ok(now_ns)) = (&self.context.clock, nanoseconds(message.clock)) else {
            return;
        };
        let now_s = self.context.time.local_s(now_ns);
        let jumped = self
            .clock_s
            .is_some_and(|before_s| !(0.0..=CLOCK_JUMP_S).contains(&(now_s - before_s)));
        self.clock_s = Some(now_s);
        clock.set(now_s);
        self.context.shared.graph().accepted(CLOCK);
        if jumped {
            self.forget();
        }
    }

    /// Follows system time where it was set. A jump drops all readings and transforms.
    pub(crate) fn follow_system_time(&mut self) {
        let time = &self.context.time;
        let step_s = time.follow_system();
        if step_s != 0.0 && !DDS_IS_PATCHED {
            self.context.shared.clock_was_set(step_s, time.now_s());
        }
        if step_s.abs() > SYSTEM_JUMP_S {
            self.forget();
        }
        if step_s.abs() > AHEAD_S {
            let message = format!("this computer's clock was set by {step_s:+.2} s");
            self.context.shared.note("clock", message);
        }
    }

    fn forget(&mut self) {
        let shared = &self.context.shared;
        shared.transforms().forget();
        shared.clock_jumps.fetch_add(1, Ordering::Relaxed);
        self.latest = LatestInputs::default();
        self.stamp_clocks = StampClocks::default();
        if let Some(fixes) = &mut self.fixes {
            fixes.forget();
        }
    }

    /// Takes transforms; fixed ones are those of `/tf_static`.
    pub(crate) fn transforms(&mut self, message: &TfMessage, fixed: bool) {
        for stamped in &message.transforms {
            if let Err(reason) = self.try_transform(stamped, fixed) {
                let topic = format!("tf, {}", stamped.child_frame_id);
                self.context.shared.reject(&topic, &reason);
            }
        }
        let pose = self.config.pose.as_ref();
        if !fixed && pose.is_some_and(|pose| pose.message == PoseMessage::Transform) {
            self.pose_of_transforms();
        }
    }

    /// Takes the frame of the vehicle in that of the poses, where it is newer than before.
    fn pose_of_transforms(&mut self) {
        let Frames { odometry, base } = &self.context.frames;
        let newest = self.context.shared.transforms().newest(odometry, base);
        match newest {
            Ok((time_s, pose)) => {
                let time_s = time_s.min(self.context.time.now_s());
                if self.latest.pose.is_none_or(|before| before.time_s < time_s) {
                    self.stand(time_s, pose_and_attitude(&pose));
                    self.context.shared.graph().accepted(TF);
                }
            }
            Err(reason) => self
                .context
                .shared
                .graph()
                .rejected(TF, &reason.to_string()),
        }
    }

    fn try_transform(&self, stamped: &TransformStamped, fixed: bool) -> Result<(), Rejection> {
        let time = &self.context.time;
        let time_s = time.local_s(nanoseconds(stamped.header.stamp)?);
        let pose = from_transform(&stamped.transform)?;
        // Before the first message of /clock there is no now.
        let now_s = match time.is_simulated() && self.clock_s.is_none() {
            true => time_s,
            false => time.now_s(),
        };
        let ahead_s = time_s - now_s;
        if ahead_s > PREDICTION_MAX_S && !fixed {
            return Err(Rejection::Ahead { ahead_s });
        }
        let (parent, child) = (&stamped.header.frame_id, &stamped.child_frame_id);
        let mut transforms = self.context.shared.transforms();
        transforms.take(parent, child, (time_s, now_s), pose, fixed);
        Ok(())
    }

    /// Takes a message of the odometry.
    pub(crate) fn odometry(&mut self, message: &Odometry, publisher: Gid) {
        let result = self.try_odometry(message, publisher);
        let (shared, topic) = (&self.context.shared, &self.config.odometry);
        match result {
            Ok(()) => shared.graph().accepted(topic),
            Err(reason) => shared.reject(topic, &reason),
        }
    }

    fn try_odometry(&mut self, message: &Odometry, publisher: Gid) -> Result<(), Rejection> {
        let has_pose = self.config.pose.is_none();
        if has_pose {
            check_frame(&message.header.frame_id, &self.context.frames.odometry)?;
        }
        check_frame(&message.child_frame_id, &self.context.frames.base)?;
        let clock = &mut self.stamp_clocks.odometry;
        let topic = &self.config.odometry;
        let time_s = self
            .context
            .time_s(&message.header, clock, topic, publisher)?;
        let standing = match has_pose {
            true => Some(pose_and_attitude(&from_pose(&message.pose.pose)?)),
            false => None,
        };
        let mut twist = message.twist.twist.clone();
        let [speed_m_s, yaw_rate_rad_s] = self.context.shared.velocity_thresholds();
        for (value, threshold) in [
            (&mut twist.linear.x, speed_m_s),
            (&mut twist.angular.z, yaw_rate_rad_s),
        ] {
            if value.abs() < threshold {
                *value = 0.0;
            }
        }
        let motors = self.context.mapping.motors(&twist)?;
        if let Some(standing) = standing {
            self.stand(time_s, standing);
        }
        if self.config.speeds == SpeedSource::Odometry {
            self.drive(stamped(time_s, motors));
        }
        Ok(())
    }

    fn drive(&mut self, motors: Stamped<MeasuredMotorSpeeds>) {
        self.latest.motors = Some(motors);
        if let Some(fixes) = &mut self.fixes {
            let MeasuredMotorSpeeds {
                traction_m_s,
                steer_m_s,
            } = motors.value;
            fixes.speeds(motors.time_s, traction_m_s, steer_m_s);
        }
    }

    /// Takes a fix of a satellite receiver.
    pub(crate) fn fix(&mut self, message: &NavSatFix, publisher: Gid) {
        let stamped = self.fix_time_s(message, publisher);
        let time_s = stamped.as_ref().map_or(f64::NAN, |time_s| *time_s);
        let result = stamped.and_then(|time_s| self.try_fix(time_s, message));
        let context = &self.context;
        let arrived_s = context.time.now_s();
        let reading = FixReading::new(arrived_s, time_s, message, result.is_ok());
        context.shared.fix(reading);
        if let Err(reason) = result {
            self.reject_fix(&reason);
        }
        self.poses_of_fixes();
    }

    fn reject_fix(&self, reason: &Rejection) {
        let topic = self.config.pose.as_ref().map_or("", |pose| &pose.topic);
        self.context.shared.reject(topic, reason);
    }

    fn fix_time_s(&mut self, message: &NavSatFix, publisher: Gid) -> Result<f64, Rejection> {
        let topic = self.config.pose.as_ref().map_or("", |pose| &pose.topic);
        let clock = &mut self.stamp_clocks.pose;
        (self.context).time_s(&message.header, clock, topic, publisher)
    }

    fn try_fix(&mut self, time_s: f64, message: &NavSatFix) -> Result<(), Rejection> {
        let (Some(config), Some(fixes)) = (&self.config.pose, &mut self.fixes) else {
            return Ok(());
        };
        let lever = match &config.antenna {
            Some(antenna) => antenna.in_base(),
            None => {
                let (base, antenna) = (&self.context.frames.base, &message.header.frame_id);
                let transforms = self.context.shared.transforms();
                let mounted = transforms.look_up(base, antenna, time_s, f64::INFINITY);
                mounted
                    .map_err(|error| Rejection::Mounting(error, "antenna"))?
                    .translation
                    .vector
            }
        };
        Ok(fixes.fix(time_s, message, lever)?)
    }

    /// Takes the poses of fixes that were waiting for other readings.
    fn poses_of_fixes(&mut self) {
        let now_s = self.context.time.now_s();
        while let Some(pose) = self.fixes.as_mut().and_then(|fixes| fixes.next(now_s)) {
            match pose {
                Ok(pose) => {
                    self.latest.pose = Some(pose);
                    let topic = self.config.pose.as_ref().map_or("", |pose| &pose.topic);
                    self.context.shared.graph().accepted(topic);
                }
                Err(reason) => self.reject_fix(&reason.into()),
            }
        }
    }

    /// Takes the heading of a topic of its own; with the covariance about the vertical, rad^2, where there is one.
    pub(crate) fn heading(
        &mut self,
        header: &Header,
        orientation: &Quaternion,
        variance: Option<f64>,
        publisher: Gid,
    ) {
        let pose = self.config.pose.as_ref();
        let Some(config) = pose.and_then(|pose| pose.heading.clone()) else {
            return;
        };
        match self.try_heading(&config, header, orientation, variance, publisher) {
            Ok(()) => self.context.shared.graph().accepted(&config.topic),
            Err(reason) => self.context.shared.reject(&config.topic, &reason),
        }
        self.poses_of_fixes();
    }

    fn try_heading(
        &mut self,
        config: &HeadingConfig,
        header: &Header,
        orientation: &Quaternion,
        variance: Option<f64>,
        publisher: Gid,
    ) -> Result<(), Rejection> {
        let Some(fixes) = &mut self.fixes else {
            return Ok(());
        };
        if variance == Some(-1.0) {
            return Err(Rejection::NoOrientation);
        }
        let max_rad = fixes.settings().heading_sigma_max_rad;
        let sigma_rad = variance.unwrap_or(0.0).sqrt();
        // A variance that is no number is not within.
        if !(..=max_rad).contains(&sigma_rad) {
            return Err(Rejection::Heading { sigma_rad, max_rad });
        }
        let clock = &mut self.stamp_clocks.heading;
        let time_s = (self.context).time_s(header, clock, &config.topic, publisher)?;
        let rotation = from_quaternion(orientation)?;
        let base_from_sensor = match config.offset_deg {
            Some(offset_deg) => {
                UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -offset_deg.to_radians())
            }
            None => {
                let mounted = self.context.mounting(&header.frame_id, time_s);
                let error = |error| Rejection::Mounting(error, "heading.offset_deg");
                mounted.map_err(error)?.inverse()
            }
        };
        let direction = base_from_sensor * Vector3::x();
        if direction.z.abs() > STEEP {
            return Err(Rejection::Steep);
        }
        // Drivers of two antennas leave roll and pitch out: only where the sensor's x axis points is true of all.
        let pointing = rotation * Vector3::x();
        let mut azimuth_rad = (-pointing.x).atan2(pointing.y);
        if config.compass {
            // Clockwise from north, read as counter-clockwise from east.
            azimuth_rad = -(azimuth_rad + FRAC_PI_2);
        }
        fixes.heading(time_s, azimuth_rad, direction);
        Ok(())
    }

    /// Takes a message of the pose's topic, with the child frame of an Odometry.
    pub(crate) fn pose(
        &mut self,
        header: &Header,
        child_frame: Option<&str>,
        pose: &message::Pose,
        publisher: Gid,
    ) {
        let result = self.try_pose(header, child_frame, pose, publisher);
        let topic = self.config.pose.as_ref().map_or("", |pose| &pose.topic);
        match result {
            Ok(()) => self.context.shared.graph().accepted(topic),
            Err(reason) => self.context.shared.reject(topic, &reason),
        }
    }

    fn try_pose(
        &mut self,
        header: &Header,
        child_frame: Option<&str>,
        pose: &message::Pose,
        publisher: Gid,
    ) -> Result<(), Rejection> {
        let frames = &self.context.frames;
        check_frame(&header.frame_id, &frames.odometry)?;
        if let Some(child_frame) = child_frame {
            check_frame(child_frame, &frames.base)?;
        }
        let standing = pose_and_attitude(&from_pose(pose)?);
        let topic = self.config.pose.as_ref().map_or("", |pose| &pose.topic);
        let clock = &mut self.stamp_clocks.pose;
        let time_s = self.context.time_s(header, clock, topic, publisher)?;
        self.stand(time_s, standing);
        Ok(())
    }

    fn stand(&mut self, time_s: f64, (pose, attitude): (Pose, Attitude)) {
        self.latest.pose = Some(stamped(time_s, pose));
        if self.config.attitude == AttitudeSource::Odometry {
            self.latest.attitude = Some(stamped(time_s, attitude));
        }
    }

    /// Takes a message of the IMU. An attitude is used even if the yaw rate beside it is rejected.
    pub(crate) fn imu(&mut self, message: &Imu, publisher: Gid) {
        let result = self.try_imu(message, publisher);
        let (shared, topic) = (&self.context.shared, &self.config.imu);
        match result {
            Ok(()) => shared.graph().accepted(topic),
            Err(reason) => shared.reject(topic, &reason),
        }
        self.poses_of_fixes();
    }

    fn try_imu(&mut self, message: &Imu, publisher: Gid) -> Result<(), Rejection> {
        let (clock, topic) = (&mut self.stamp_clocks.imu, &self.config.imu);
        let time_s = self
            .context
            .time_s(&message.header, clock, topic, publisher)?;
        let imu_from_base = self.context.mounting(&message.header.frame_id, time_s)?;
        if self.config.attitude == AttitudeSource::Imu {
            if message.orientation_covariance[0] == -1.0 {
                return Err(Rejection::NoOrientation);
            }
            let world_from_base = from_quaternion(&message.orientation)? * imu_from_base;
            let attitude = paper_attitude(&world_from_base).0;
            self.latest.attitude = Some(stamped(time_s, attitude));
            self.context.shared.graph().accepted(&self.config.imu);
            if let Some(fixes) = &mut self.fixes {
                fixes.attitude(time_s, attitude);
            }
        }
        if self.config.yaw_rate == YawRateSource::Imu {
            let yaw_rate_rad_s = yaw_rate_rad_s(message, &imu_from_base)?;
            self.latest.yaw_rate = Some(stamped(time_s, yaw_rate_rad_s));
            if let Some(fixes) = &mut self.fixes {
                fixes.yaw_rate(time_s, yaw_rate_rad_s);
            }
        }
        Ok(())
    }

    /// Takes a command that another node has sent to the drives.
    pub(crate) fn forwarded(&mut self, topic: &str, twist: &Twist) {
        let now_s = self.context.time.now_s();
        match self.context.mapping.motors(twist) {
            Ok(motors) => self.latest.forwarded = Some(stamped(now_s, motors)),
            Err(reason) => self.context.shared.reject(topic, &Rejection::from(reason)),
        }
    }

    /// Takes a message of joint states.
    pub(crate) fn joint_states(&mut self, message: &JointState, publisher: Gid) {
        match self.try_joint_states(message, publisher) {
            Ok(motors) => {
                self.drive(motors);
                let topic = &self.config.joint_states;
                self.context.shared.graph().accepted(topic);
            }
            // Joints of other parts are published on the same topic.
            Err(Rejection::Message(MessageError::Joint { .. })) => {}
            Err(reason) => {
                let topic = &self.config.joint_states;
                self.context.shared.reject(topic, &reason);
            }
        }
    }

    fn try_joint_states(
        &mut self,
        message: &JointState,
        publisher: Gid,
    ) -> Result<Stamped<MeasuredMotorSpeeds>, Rejection> {
        let motors = self.config.joints.treads(message)?.into();
        let (clock, topic) = (
            &mut self.stamp_clocks.joint_states,
            &self.config.joint_states,
        );
        let time_s = self
            .context
            .time_s(&message.header, clock, topic, publisher)?;
        Ok(stamped(time_s, motors))
    }
}

impl PortContext {
    /// Returns the mounting of a sensor: the rotation from the vehicle's axes to its own. It does not age, on whichever
    /// topic it is published.
    fn mounting(&self, sensor: &str, time_s: f64) -> Result<UnitQuaternion<f64>, TransformError> {
        let base = &self.frames.base;
        if check_frame(sensor, base).is_ok() {
            return Ok(UnitQuaternion::identity());
        }
        let transforms = self.shared.transforms();
        let mounted = transforms.look_up(sensor, base, time_s, f64::INFINITY)?;
        Ok(mounted.rotation)
    }

    /// Returns the local time of a stamp, not later than now; a stamp of zero was not set.
    fn time_s(
        &self,
        header: &Header,
        clock: &mut StampClock,
        topic: &str,
        publisher: Gid,
    ) -> Result<f64, Rejection> {
        let (stamp_ns, now_s) = (nanoseconds(header.stamp)?, self.time.now_s());
        if stamp_ns == 0 && !self.time.is_simulated() {
            return Ok(now_s);
        }
        let stamp_s = self.time.local_s(stamp_ns);
        if self.time.is_simulated() {
            // Its publisher has the same clock: a stamp that is ahead says that a message of `/clock` is under way.
            let ahead_s = stamp_s - now_s;
            return match ahead_s > STEP_MAX_S {
                true => Err(Rejection::Ahead { ahead_s }),
                false => Ok(stamp_s.min(now_s)),
            };
        }
        let corrected = clock
            .correct(publisher, stamp_s, now_s)
            .map_err(|ahead_s| Rejection::Ahead { ahead_s })?;
        if let Some(offset_s) = corrected.changed_to_s {
            let message = format!("{topic}: its stamps are corrected by {offset_s:+.2} s");
            self.shared.note("clock", message);
        }
        Ok(corrected.time_s)
    }
}

/// Returns the component of the angular velocity along the vehicle's upward axis, rad/s.
fn yaw_rate_rad_s(message: &Imu, imu_from_base: &UnitQuaternion<f64>) -> Result<f64, Rejection> {
    if message.angular_velocity_covariance[0] == -1.0 {
        return Err(Rejection::NoAngularVelocity);
    }
    let in_imu = from_vector(&message.angular_velocity, "angular_velocity")?;
    let rad_s = in_imu.norm();
    if rad_s > ROTATION_MAX_RAD_S {
        return Err(Rejection::Rotation { rad_s });
    }
    Ok(imu_from_base.inverse_transform_vector(&in_imu).z)
}

fn stamped<T>(time_s: f64, value: T) -> Stamped<T> {
    Stamped { time_s, value }
}

fn check_frame(found: &str, expected: &str) -> Result<(), Rejection> {
    let plain = |frame: &str| frame.trim_start_matches('/').to_owned();
    let (found, expected) = (plain(found), plain(expected));
    if found == expected {
        Ok(())
    } else {
        Err(Rejection::Frame { found, expected })
    }
}

#[cfg(test)]
mod tests;
