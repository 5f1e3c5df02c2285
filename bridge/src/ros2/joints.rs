//! Tread speeds as velocities of joints.

use crate::ros2::conversions::MessageError;
use crate::ros2::message::{Float64MultiArray, Header, JointState};
use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::Bounds;
use sidehill_plant::speeds::MeasuredTreadSpeeds;
use sidehill_plant::vehicle::RangeError;

/// The joints of the treads.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TreadJoints {
    /// Name of the left joint.
    pub left: String,
    /// Name of the right joint.
    pub right: String,
    /// Tread speed divided by joint velocity: the radius of a wheel.
    pub radius_m: f64,
}

impl Default for TreadJoints {
    /// Joints whose velocity is the tread's speed.
    fn default() -> Self {
        Self {
            left: "left_tread_joint".to_owned(),
            right: "right_tread_joint".to_owned(),
            radius_m: 1.0,
        }
    }
}

impl TreadJoints {
    /// Checks the range.
    ///
    /// # Errors
    /// [`RangeError`].
    pub fn validate(&self) -> Result<(), RangeError> {
        let (key, value) = ("joints.radius_m", self.radius_m);
        Bounds::new(0.01, 10.0, "m").check(key, value).map(drop)
    }

    /// Returns the tread speeds of a message; the order of its joints does not matter.
    ///
    /// # Errors
    /// A joint that is missing, has no velocity, or one that is not finite.
    pub fn treads(&self, message: &JointState) -> Result<MeasuredTreadSpeeds, MessageError> {
        let speed_m_s = |joint: &str| {
            let index = message.name.iter().position(|name| name == joint);
            let velocity = index.and_then(|index| message.velocity.get(index));
            let velocity = velocity.ok_or_else(|| MessageError::Joint {
                joint: joint.to_owned(),
            })?;
            self.speed_m_s(*velocity)
        };
        Ok(MeasuredTreadSpeeds {
            left_m_s: speed_m_s(&self.left)?,
            right_m_s: speed_m_s(&self.right)?,
        })
    }

    /// Returns tread speeds as velocities of the joints and their angles.
    pub fn joint_state(
        &self,
        header: Header,
        treads: MeasuredTreadSpeeds,
        angles_rad: [f64; 2],
    ) -> JointState {
        JointState {
            header,
            name: vec![self.left.clone(), self.right.clone()],
            position: angles_rad.to_vec(),
            velocity: self.velocities_rad_s(treads).to_vec(),
            effort: Vec::new(),
        }
    }

    /// Returns the tread speeds that an array of both joint velocities, left and right, commands.
    ///
    /// # Errors
    /// Fewer than two numbers, or one that is not finite.
    pub fn commanded(
        &self,
        message: &Float64MultiArray,
    ) -> Result<MeasuredTreadSpeeds, MessageError> {
        let [left, right] = message.data[..] else {
            return Err(MessageError::Length {
                length: message.data.len(),
                needed: 2,
            });
        };
        Ok(MeasuredTreadSpeeds {
            left_m_s: self.speed_m_s(left)?,
            right_m_s: self.speed_m_s(right)?,
        })
    }

    /// Returns the array that commands tread speeds.
    pub fn command(&self, treads: MeasuredTreadSpeeds) -> Float64MultiArray {
        Float64MultiArray {
            data: self.velocities_rad_s(treads).to_vec(),
            ..Float64MultiArray::default()
        }
    }

    fn velocities_rad_s(&self, treads: MeasuredTreadSpeeds) -> [f64; 2] {
        [treads.left_m_s, treads.right_m_s].map(|speed_m_s| speed_m_s / self.radius_m)
    }

    fn speed_m_s(&self, velocity_rad_s: f64) -> Result<f64, MessageError> {
        if !velocity_rad_s.is_finite() {
            return Err(MessageError::NotFinite { field: "velocity" });
        }
        Ok(velocity_rad_s * self.radius_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn joints_carry_both_treads(left in -2.0..2.0f64, right in -2.0..2.0f64, radius in 0.05..1.0f64) {
            let joints = TreadJoints { radius_m: radius, ..TreadJoints::default() };
            let treads = MeasuredTreadSpeeds { left_m_s: left, right_m_s: right };
            let mut state = joints.joint_state(Header::default(), treads, [0.0; 2]);
            state.name.reverse();
            state.velocity.reverse();
            for back in [joints.treads(&state), joints.commanded(&joints.command(treads))] {
                let back = back.unwrap();
                prop_assert!((back.left_m_s - left).abs() < 1e-12);
                prop_assert!((back.right_m_s - right).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn missing_joints_and_short_arrays_are_refused() {
        let joints = TreadJoints::default();
        assert!(joints.treads(&JointState::default()).is_err());
        assert!(joints.commanded(&Float64MultiArray::default()).is_err());
    }
}
