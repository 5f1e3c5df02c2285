//! Tread speeds from the velocities of joints.

use super::interpolation::{Timed, at, order};
use anyhow::{Context, Result, bail};
use sidehill_bridge::ros2::message::JointState;
use sidehill_plant::log::Reversed;
use sidehill_plant::speeds::MeasuredTreadSpeeds;
use std::collections::BTreeMap;
use std::path::Path;

/// Parts of names that tell a side: `left`, `lf`, `fl` (front left), `rl` (rear left), `bl` (back left) and so on.
const SIDES: [&[&str]; 2] = [
    &["left", "l", "lf", "fl", "rl", "lr", "bl", "lb", "ml", "lm"],
    &["right", "r", "rf", "fr", "rr", "br", "rb", "mr", "rm"],
];
/// Parts of names that tell a wheel or its drive.
const WHEELS: [&str; 6] = ["wheel", "tread", "track", "drive", "motor", "sprocket"];
/// How many times as fast as the slowest joint of a side the fastest may be on average.
const SPREAD_MAX: f64 = 3.0;
/// Slower than this all joints stand, rad/s.
const MOVING_RAD_S: f64 = 0.1;

/// Joints whose mean velocity is a tread speed.
#[derive(Clone, Copy)]
pub(super) struct WheelJoints<'a> {
    /// Topic of type JointState.
    pub(super) topic: &'a str,
    /// Left joints; none stands for those whose names say so.
    pub(super) left: &'a [String],
    /// Right joints; none stands for those whose names say so.
    pub(super) right: &'a [String],
    /// Radius of the wheels, m; none where velocities are m/s.
    pub(super) radius_m: Option<f64>,
    /// Side that counts backwards.
    pub(super) reversed: Reversed,
}

/// Velocities of the joints of a topic.
#[derive(Default)]
pub(super) struct Joints {
    joints: BTreeMap<String, Timed<f64>>,
    /// Velocities that are not finite, by joint.
    not_finite: BTreeMap<String, usize>,
}

/// Returns the parts of a name: words between other characters, capitals and digits.
fn words(name: &str) -> Vec<String> {
    let mut words: Vec<String> = vec![String::new()];
    let mut before = ' ';
    for letter in name.chars() {
        let begins = letter.is_uppercase() && before.is_lowercase();
        if !letter.is_alphabetic() || begins {
            words.push(String::new());
        }
        if let (true, Some(word)) = (letter.is_alphabetic(), words.last_mut()) {
            word.extend(letter.to_lowercase());
        }
        before = letter;
    }
    words
}

/// Returns the side that a name tells, 0 for left and 1 for right; none if it tells none or both.
fn side(name: &str) -> Option<usize> {
    let words = words(name);
    let tells = |side: &[&str]| {
        words.iter().any(|word| {
            // A word may begin or end with the side: `leftwheel`, `wheelleft`.
            let whole = side[0];
            side.contains(&word.as_str()) || word.starts_with(whole) || word.ends_with(whole)
        })
    };
    match SIDES.map(tells) {
        [true, false] => Some(0),
        [false, true] => Some(1),
        _ => None,
    }
}

fn is_wheel(name: &str) -> bool {
    let name = name.to_lowercase();
    WHEELS.iter().any(|word| name.contains(word))
}

impl Joints {
    /// Takes a message. Velocities that are not numbers are left out.
    pub(super) fn take(&mut self, time_ns: i64, state: &JointState) {
        for (index, name) in state.name.iter().enumerate() {
            if !self.joints.contains_key(name) {
                self.joints.insert(name.clone(), Vec::new());
            }
            match (self.joints.get_mut(name), state.velocity.get(index)) {
                (Some(series), Some(velocity)) if velocity.is_finite() => {
                    series.push((time_ns, *velocity));
                }
                (_, Some(_)) => *self.not_finite.entry(name.clone()).or_default() += 1,
                (_, None) => {}
            }
        }
    }

    /// Returns the tread speeds after the last message, and notes about the joints that they are of.
    ///
    /// # Errors
    /// Names the joint or key at fault, and lists the joints there are.
    pub(super) fn tread_speeds(
        mut self,
        bag: &Path,
        wheels: &WheelJoints<'_>,
    ) -> Result<(Timed<MeasuredTreadSpeeds>, Vec<String>)> {
        let topic = wheels.topic;
        let bag = bag.display();
        let there: Vec<&str> = self.joints.keys().map(String::as_str).collect();
        let there = there.join(", ");
        const KEYS: &str =
            "the keys `left` and `right` of `tread_speeds` in the topic map name the joints";
        let mut named = wheels.left.iter().chain(wheels.right);
        if let Some(joint) = named.find(|joint| !self.joints.contains_key(*joint)) {
            match wheels.radius_m {
                Some(_) => bail!("{bag}: {topic} has no joint {joint}; there are: {there}; {KEYS}"),
                None => bail!(
                    "{bag}: which joints of {topic} are wheels, and of which radius? Write a topic map (--topics \
                     FILE) with `tread_speeds: {{kind: joint_states, left: [...], right: [...], radius_m: ...}}`; \
                     the joints are: {there}"
                ),
            }
        }
        if self.joints.values().all(Vec::is_empty) {
            bail!(
                "{bag}: {topic} gives no tread speeds: its messages have no velocities; its joints are: {there}; \
                 `tread_speeds: {{kind: odometry, track_width_m: ...}}` takes them from odometry of the wheels"
            );
        }
        let by_name = [wheels.left, wheels.right].map(<[String]>::is_empty);
        let mut sides = [wheels.left, wheels.right].map(<[String]>::to_vec);
        let mut left_out = Vec::new();
        for (index, names) in sides.iter_mut().enumerate().filter(|(i, _)| by_name[*i]) {
            let of_side: Vec<String> = self
                .joints
                .keys()
                .filter(|name| side(name) == Some(index))
                .cloned()
                .collect();
            let any_wheel = of_side.iter().any(|name| is_wheel(name));
            let (meant, others) = of_side
                .into_iter()
                .partition(|name| !any_wheel || is_wheel(name));
            *names = meant;
            left_out.extend::<Vec<String>>(others);
        }
        if sides.iter().any(Vec::is_empty) {
            bail!(
                "{bag}: {topic} gives no tread speeds: the names of its joints do not tell left from right; they are: \
                 {there}; {KEYS}"
            );
        }
        if by_name == [true, true] && sides[0].len() != sides[1].len() {
            bail!(
                "{bag}: {topic} has {} joints on the left ({}) and {} on the right ({}) by their names; {KEYS}",
                sides[0].len(),
                sides[0].join(", "),
                sides[1].len(),
                sides[1].join(", ")
            );
        }
        let mut notes = Vec::new();
        if by_name.contains(&true) {
            let mut note = format!(
                "{topic}: left treads are the mean of {}, right ones of {}",
                sides[0].join(", "),
                sides[1].join(", ")
            );
            if !left_out.is_empty() {
                note.push_str(&format!(
                    "; {} are not wheels by their names",
                    left_out.join(", ")
                ));
            }
            notes.push(note);
        }
        for names in &sides {
            notes.extend(self.apart(topic, names));
        }
        for (name, count) in &self.not_finite {
            if sides.iter().any(|names| names.contains(name)) {
                notes.push(format!(
                    "{topic}: {count} velocities of {name} are not finite; what lies between the others counts there"
                ));
            }
        }
        let [left, right] = sides.map(|names| {
            let mean = self.mean(&names);
            mean.with_context(|| format!("{bag}: {topic}"))
        });
        let (left, right) = (left?, right?);
        let scale = wheels.radius_m.unwrap_or(1.0);
        let signs = wheels.reversed.signs();
        // Sides whose messages are apart meet at the left side's times.
        let between = |a: &f64, b: &f64, share: f64| a + share * (b - a);
        let pair = |(time_ns, left_rad_s): &(i64, f64)| {
            let right_rad_s = at(&right, *time_ns, between)?;
            let speeds = MeasuredTreadSpeeds {
                left_m_s: signs[0] * scale * left_rad_s,
                right_m_s: signs[1] * scale * right_rad_s,
            };
            Some((*time_ns, speeds))
        };
        let speeds: Timed<MeasuredTreadSpeeds> = left.iter().filter_map(pair).collect();
        if speeds.is_empty() {
            bail!(
                "{bag}: {topic} gives no tread speeds: no joints of both sides have velocities at the same time"
            );
        }
        Ok((speeds, notes))
    }

    /// Returns the mean velocity of joints, rad/s, at the times of the first that has any.
    fn mean(&mut self, names: &[String]) -> Result<Timed<f64>> {
        for name in names {
            let Some(series) = self.joints.get_mut(name) else {
                continue;
            };
            if series.is_empty() {
                bail!(
                    "joint {name} has no velocities; the keys `left` and `right` of `tread_speeds` in the topic map \
                     (--topics) name others"
                );
            }
            order(series);
        }
        let all: Vec<&Timed<f64>> = names
            .iter()
            .filter_map(|name| self.joints.get(name))
            .collect();
        let Some((first, others)) = all.split_first() else {
            return Ok(Vec::new());
        };
        let between = |a: &f64, b: &f64, share: f64| a + share * (b - a);
        let mean = |(time_ns, velocity): &(i64, f64)| {
            let mut sum = *velocity;
            for other in others {
                sum += at(other, *time_ns, between)?;
            }
            Some((*time_ns, sum / all.len() as f64))
        };
        Ok(first.iter().filter_map(mean).collect())
    }

    /// Returns a note where joints of one side turn at speeds that no wheels of one tread have.
    fn apart(&self, topic: &str, names: &[String]) -> Option<String> {
        let speeds = names.iter().filter_map(|name| {
            let series = self.joints.get(name).filter(|series| !series.is_empty())?;
            let sum: f64 = series.iter().map(|(_, velocity)| velocity.abs()).sum();
            Some((sum / series.len() as f64, name))
        });
        let mut speeds: Vec<(f64, &String)> = speeds.collect();
        speeds.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (slowest, fastest) = (speeds.first()?, speeds.last()?);
        (fastest.0 > (SPREAD_MAX * slowest.0).max(MOVING_RAD_S)).then(|| {
            format!(
                "{topic}: of the joints of one side {} turns at {:.3} rad/s on average and {} at {:.3} rad/s: is one of \
                 them no wheel? The keys `left` and `right` of `tread_speeds` name the joints",
                slowest.1, slowest.0, fastest.1, fastest.0
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_tell_the_side() {
        for (name, expected) in [
            ("left_wheel", Some(0)),
            ("rightWheelJoint", Some(1)),
            ("fl_wheel", Some(0)),
            ("lf_motor_joint", Some(0)),
            ("RR_wheel", Some(1)),
            ("rear_right_3", Some(1)),
            ("wheel_l1", Some(0)),
            ("base_leftwheel", Some(0)),
            ("roller", None),
            ("left_right_bar", None),
            ("pan_joint", None),
        ] {
            assert_eq!(side(name), expected, "{name}");
        }
    }
}
