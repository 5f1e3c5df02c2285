//! Tread speeds from the velocities of joints.

use anyhow::{Result, bail};
use sidehill_bridge::ros2::message::JointState;
use std::collections::BTreeSet;
use std::path::Path;

/// Joints whose mean velocity is a tread speed.
#[derive(Clone, Copy)]
pub(super) struct WheelJoints<'a> {
    /// Topic of type JointState.
    pub(super) topic: &'a str,
    /// Left joints; none stands for those with "left" in their names.
    pub(super) left: &'a [String],
    /// Right joints; none stands for those with "right" in their names.
    pub(super) right: &'a [String],
    /// Radius of the wheels, m; none where velocities are m/s.
    pub(super) radius_m: Option<f64>,
}

/// Names of joints seen in the messages of a topic.
#[derive(Default)]
pub(super) struct Joints {
    seen: BTreeSet<String>,
    seen_with_velocity: BTreeSet<String>,
}

impl Joints {
    /// Returns the mean velocity of the named joints, or of those with `side` in their names, in rad/s; nothing
    /// where the message has none of them.
    pub(super) fn mean_velocity(
        &mut self,
        state: &JointState,
        names: &[String],
        side: &str,
    ) -> Result<Option<f64>> {
        let (mut sum, mut count) = (0.0, 0);
        for (index, name) in state.name.iter().enumerate() {
            if !self.seen.contains(name) {
                self.seen.insert(name.clone());
            }
            let meant = if names.is_empty() {
                name.to_lowercase().contains(side)
            } else {
                names.contains(name)
            };
            let Some(velocity) = state.velocity.get(index).filter(|_| meant) else {
                continue;
            };
            if !velocity.is_finite() {
                bail!("the velocity of joint {name} is {velocity}");
            }
            if !self.seen_with_velocity.contains(name) {
                self.seen_with_velocity.insert(name.clone());
            }
            sum += velocity;
            count += 1;
        }
        Ok((count > 0).then(|| sum / f64::from(count)))
    }

    /// Checks what was found after the last message; `has_speeds` says whether any message gave tread speeds.
    ///
    /// # Errors
    /// Names the joint or key at fault, and lists the joints there are.
    pub(super) fn check(
        &self,
        bag: &Path,
        wheels: &WheelJoints<'_>,
        has_speeds: bool,
    ) -> Result<()> {
        let WheelJoints {
            topic,
            left,
            right,
            radius_m,
        } = wheels;
        let bag = bag.display();
        let list = |names: &BTreeSet<String>| {
            let names: Vec<&str> = names.iter().map(String::as_str).collect();
            names.join(", ")
        };
        let mut named = left.iter().chain(*right);
        if let Some(joint) = named.find(|joint| !self.seen.contains(*joint)) {
            match radius_m {
                Some(_) => bail!(
                    "{bag}: {topic} has no joint {joint}; there are: {}. The keys `left` and `right` of \
                     `tread_speeds` in the topic map name the joints",
                    list(&self.seen)
                ),
                None => bail!(
                    "{bag}: which joints of {topic} are wheels, and of which radius? Write a topic map (--topics \
                     FILE) with `tread_speeds: {{kind: joint_states, left: [...], right: [...], radius_m: ...}}`; \
                     the joints are: {}",
                    list(&self.seen)
                ),
            }
        }
        if !has_speeds {
            let why = if self.seen_with_velocity.is_empty() {
                "its messages have no velocities"
            } else {
                "no message has joints of both sides"
            };
            bail!(
                "{bag}: {topic} gives no tread speeds: {why}; its joints are: {}. The keys `left` and `right` of \
                 `tread_speeds` in the topic map name the joints",
                list(&self.seen)
            );
        }
        Ok(())
    }
}
