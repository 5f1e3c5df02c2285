//! Which columns of a log mean what, in which units and frames.

use serde::{Deserialize, Serialize};

/// Where a log has its values; [`ColumnMap::default`] is the contract's columns.
///
/// As YAML, with the contract's values:
///
/// ```yaml
/// time: time_s                # s
/// tread_speed_left: v_left_m_s
/// tread_speed_right: v_right_m_s
/// tread_speed_scale: 1.0      # to m/s: a wheel's radius in m where the columns are rad/s
/// attitude: { kind: paper, roll: roll_rad, pitch: pitch_rad }
/// pose: { x: x_m, y: y_m, z: z_m, heading: { kind: paper, yaw: yaw_rad }, repeats: false }
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ColumnMap {
    /// Column of the time, s.
    pub time: String,
    /// Column of the left tread's speed.
    pub tread_speed_left: String,
    /// Column of the right tread's speed.
    pub tread_speed_right: String,
    /// Factor from these columns to m/s: the radius of a wheel in m, where they are in rad/s.
    #[serde(default = "one")]
    pub tread_speed_scale: f64,
    /// Treads that count backwards.
    #[serde(default)]
    pub reversed: Reversed,
    /// [Columns of roll and pitch](#attitude-columns).
    pub attitude: AttitudeColumns,
    /// [Columns of the pose](#pose-columns). None: the log has no poses.
    #[serde(default)]
    pub pose: Option<PoseColumns>,
    /// [Columns of the commands](#command-columns), for `identify --drives`. None: `command_traction_m_s` and
    /// `command_steer_m_s`, or `command_left_m_s` and `command_right_m_s`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub commands: Option<CommandColumns>,
}

/// Columns of the commands that the drives were given.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum CommandColumns {
    /// Speeds of the treads.
    Treads {
        /// Column of the left tread.
        left: String,
        /// Column of the right tread.
        right: String,
        /// Factor from these columns to m/s.
        #[serde(default = "one")]
        scale: f64,
    },
    /// Effective speeds of the motors, m/s, as this program's simulations write them.
    Motors {
        /// Column of the traction motor.
        traction: String,
        /// Column of the steer motor.
        steer: String,
    },
    /// A twist, m/s and rad/s.
    Twist {
        /// Column of the forward speed.
        forward: String,
        /// Column of the yaw rate, counter-clockwise positive.
        yaw_rate: String,
        /// Track width by which the base turns a twist into tread speeds.
        track_width_m: f64,
    },
}

/// Treads whose encoder counts backwards: their speeds are multiplied by -1.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reversed {
    /// None.
    #[default]
    None,
    /// The left ones.
    Left,
    /// The right ones.
    Right,
    /// All.
    Both,
}

impl Reversed {
    /// Returns the factors for the left and right speeds.
    pub fn signs(self) -> [f64; 2] {
        match self {
            Self::None => [1.0, 1.0],
            Self::Left => [-1.0, 1.0],
            Self::Right => [1.0, -1.0],
            Self::Both => [-1.0, -1.0],
        }
    }
}

/// Columns of roll and pitch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum AttitudeColumns {
    /// The paper's angles, rad: right side down and nose up are positive.
    Paper {
        /// Column of roll.
        roll: String,
        /// Column of pitch.
        pitch: String,
    },
    /// Angles of REP-103, rad: right side down and nose down are positive.
    Rep103 {
        /// Column of roll.
        roll: String,
        /// Column of pitch.
        pitch: String,
    },
    /// Quaternion `world_from_base_link` of REP-103.
    Quaternion {
        /// Column of the quaternion's x.
        x: String,
        /// Column of the quaternion's y.
        y: String,
        /// Column of the quaternion's z.
        z: String,
        /// Column of the quaternion's w.
        w: String,
    },
    /// No columns: the ground was level. Braces, as a variant without them would take any key.
    Level {},
}

/// Columns of the pose. Paper and REP-103 share the world's axes, so positions need no conversion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseColumns {
    /// Column of x, m.
    pub x: String,
    /// Column of y, m.
    pub y: String,
    /// Column of z, m.
    pub z: String,
    /// [Columns of the heading](#heading-columns).
    pub heading: HeadingColumns,
    /// Whether the log repeats a pose until there is a new one. Repetitions are then ignored.
    #[serde(default)]
    pub repeats: bool,
    /// Added to the heading: by how much its antennas are turned clockwise.
    #[serde(default)]
    pub heading_offset_deg: f64,
}

/// Columns of the heading.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum HeadingColumns {
    /// The paper's heading, rad, from Y_g counter-clockwise.
    Paper {
        /// Column of yaw.
        yaw: String,
    },
    /// Yaw of REP-103, rad, from world x counter-clockwise.
    Rep103 {
        /// Column of yaw.
        yaw: String,
    },
    /// Quaternion `world_from_base_link` of REP-103.
    Quaternion {
        /// Column of the quaternion's x.
        x: String,
        /// Column of the quaternion's y.
        y: String,
        /// Column of the quaternion's z.
        z: String,
        /// Column of the quaternion's w.
        w: String,
    },
}

fn one() -> f64 {
    1.0
}

impl Default for ColumnMap {
    fn default() -> Self {
        Self {
            time: "time_s".into(),
            tread_speed_left: "v_left_m_s".into(),
            tread_speed_right: "v_right_m_s".into(),
            tread_speed_scale: one(),
            reversed: Reversed::None,
            attitude: AttitudeColumns::Paper {
                roll: "roll_rad".into(),
                pitch: "pitch_rad".into(),
            },
            pose: Some(PoseColumns {
                x: "x_m".into(),
                y: "y_m".into(),
                z: "z_m".into(),
                heading: HeadingColumns::Paper {
                    yaw: "yaw_rad".into(),
                },
                repeats: false,
                heading_offset_deg: 0.0,
            }),
            commands: None,
        }
    }
}
