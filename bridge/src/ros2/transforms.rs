//! Transforms between frames from `/tf` and `/tf_static`, interpolated in time.

use nalgebra::Isometry3;
use std::collections::{BTreeMap, VecDeque};

/// Why a transform is not available.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TransformError {
    /// The frames are not connected.
    #[error("there is no transform between {target} and {origin}")]
    Unknown {
        /// Target frame.
        target: String,
        /// Origin frame.
        origin: String,
    },
    /// A transform between them is too old.
    #[error("the newest transform of {child} is {age_s:.2} s old")]
    Old {
        /// Its child frame.
        child: String,
        /// Its age, s.
        age_s: f64,
    },
}

/// Transforms kept of each frame, s.
const KEPT_S: f64 = 10.0;
/// Frames on the way to the root; more is a loop.
const DEPTH_MAX: usize = 64;

/// A frame in its parent's.
#[derive(Debug, Clone)]
struct Edge {
    parent: String,
    /// In the order of time; a single one that holds for all times where it is fixed.
    poses: VecDeque<(f64, Isometry3<f64>)>,
    fixed: bool,
}

/// The known frames.
#[derive(Debug, Clone, Default)]
pub struct Transforms {
    edges: BTreeMap<String, Edge>,
}

impl Transforms {
    /// Takes the pose of a frame in its parent's at `time_s`, received at `now_s`; a fixed one holds for all times.
    ///
    /// A pose ahead of the clock is a prediction: a message for an earlier time supersedes it.
    pub fn take(
        &mut self,
        parent: &str,
        child: &str,
        (time_s, now_s): (f64, f64),
        pose: Isometry3<f64>,
        fixed: bool,
    ) {
        let (parent, child) = (plain(parent), plain(child));
        if parent.is_empty() || child.is_empty() || parent == child || !time_s.is_finite() {
            return;
        }
        let edge = self.edges.entry(child.to_owned()).or_insert_with(|| Edge {
            parent: parent.to_owned(),
            poses: VecDeque::new(),
            fixed,
        });
        if edge.parent != parent || edge.fixed || fixed {
            *edge = Edge {
                parent: parent.to_owned(),
                poses: VecDeque::new(),
                fixed,
            };
        }
        let after = edge.poses.partition_point(|(at_s, _)| *at_s <= time_s);
        edge.poses.insert(after, (time_s, pose));
        let held = |(at_s, _): &(f64, _)| *at_s <= time_s.max(now_s);
        edge.poses.truncate(edge.poses.partition_point(held));
        let newest_s = edge
            .poses
            .back()
            .map_or(time_s, |(at_s, _)| at_s.min(now_s));
        while edge.poses.len() > 1 && edge.poses[0].0 < newest_s - KEPT_S {
            edge.poses.pop_front();
        }
    }

    /// Forgets all transforms that are not fixed, as after a jump of the clock.
    pub fn forget(&mut self) {
        self.edges.retain(|_, edge| edge.fixed);
    }

    /// Returns the newest pose of `origin` in `target` that all transforms between them say, and its time, s.
    ///
    /// # Errors
    /// [`TransformError`]; one of frames between which nothing ever moves counts as unknown.
    pub fn newest(
        &self,
        target: &str,
        origin: &str,
    ) -> Result<(f64, Isometry3<f64>), TransformError> {
        // Checks that they are connected.
        self.look_up(target, origin, f64::NEG_INFINITY, 0.0)?;
        let (ups, downs) = (self.way_up(plain(origin)), self.way_up(plain(target)));
        let moving = |frame: &&str| -> Option<f64> {
            let edge = self.edges.get(*frame).filter(|edge| !edge.fixed)?;
            edge.poses.back().map(|(time_s, _)| *time_s)
        };
        let only = |way: &[&'_ str], other: &[&str]| -> f64 {
            way.iter()
                .take_while(|frame| !other.contains(frame))
                .filter_map(moving)
                .fold(f64::INFINITY, f64::min)
        };
        let time_s = only(&ups, &downs).min(only(&downs, &ups));
        if !time_s.is_finite() {
            return Err(TransformError::Unknown {
                target: plain(target).to_owned(),
                origin: plain(origin).to_owned(),
            });
        }
        Ok((time_s, self.look_up(target, origin, time_s, 0.0)?))
    }

    /// Returns the pose of `origin` in `target` at `time_s`; where that is later than the newest transform,
    /// the newest if it is at most `tolerance_s` older.
    ///
    /// # Errors
    /// [`TransformError`].
    pub fn look_up(
        &self,
        target: &str,
        origin: &str,
        time_s: f64,
        tolerance_s: f64,
    ) -> Result<Isometry3<f64>, TransformError> {
        let (target, origin) = (plain(target), plain(origin));
        let (ups, downs) = (self.way_up(origin), self.way_up(target));
        let unknown = || TransformError::Unknown {
            target: target.to_owned(),
            origin: origin.to_owned(),
        };
        // Up from the origin until a frame that is above the target too, then down to it.
        let meeting = ups
            .iter()
            .find(|frame| downs.contains(frame))
            .ok_or_else(unknown)?;
        let along = |way: &[&str]| {
            way.iter()
                .take_while(|frame| *frame != meeting)
                .try_fold(Isometry3::identity(), |below, frame| {
                    Ok(self.edges[*frame].at(frame, time_s, tolerance_s)? * below)
                })
        };
        Ok(along(&downs)?.inverse() * along(&ups)?)
    }

    /// Returns a frame and those above it.
    fn way_up<'a>(&'a self, frame: &'a str) -> Vec<&'a str> {
        let mut way = vec![frame];
        while way.len() < DEPTH_MAX
            && let Some(edge) = way.last().and_then(|frame| self.edges.get(*frame))
        {
            way.push(&edge.parent);
        }
        way
    }
}

impl Edge {
    fn at(
        &self,
        child: &str,
        time_s: f64,
        tolerance_s: f64,
    ) -> Result<Isometry3<f64>, TransformError> {
        let after = self.poses.partition_point(|(at_s, _)| *at_s <= time_s);
        let (before, next) = (
            after.checked_sub(1).and_then(|index| self.poses.get(index)),
            self.poses.get(after),
        );
        match (before, next) {
            (Some((_, pose)), _) if self.fixed => Ok(*pose),
            (Some((before_s, a)), Some((next_s, b))) => {
                let ratio = (time_s - before_s) / (next_s - before_s);
                Ok(a.lerp_slerp(b, ratio))
            }
            // Stamps ahead of the clock are usual for a localisation.
            (None, Some((_, pose))) => Ok(*pose),
            (Some((before_s, pose)), None) => {
                let age_s = time_s - before_s;
                if (..=tolerance_s).contains(&age_s) {
                    Ok(*pose)
                } else {
                    Err(TransformError::Old {
                        child: child.to_owned(),
                        age_s,
                    })
                }
            }
            (None, None) => Err(TransformError::Old {
                child: child.to_owned(),
                age_s: f64::INFINITY,
            }),
        }
    }
}

fn plain(frame: &str) -> &str {
    frame.trim_start_matches('/')
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Translation3, UnitQuaternion, Vector3};

    fn pose(x: f64, yaw: f64) -> Isometry3<f64> {
        Isometry3::from_parts(
            Translation3::new(x, 0.0, 0.0),
            UnitQuaternion::from_euler_angles(0.0, 0.0, yaw),
        )
    }

    fn known() -> Transforms {
        let mut known = Transforms::default();
        known.take("map", "odom", (1.0, 2.0), pose(1.0, 0.0), false);
        known.take("map", "odom", (2.0, 2.0), pose(3.0, 1.0), false);
        known.take("odom", "base_link", (2.0, 2.0), pose(5.0, 0.0), false);
        known.take("base_link", "imu", (0.0, 2.0), pose(0.2, 3.0), true);
        known
    }

    #[test]
    fn between_two_stamps_is_interpolated_both_ways() {
        let known = known();
        let between = known.look_up("map", "odom", 1.5, 0.0).unwrap();
        assert!((between.translation.x - 2.0).abs() < 1e-12);
        assert!((between.rotation.angle() - 0.5).abs() < 1e-12);
        let back = known.look_up("odom", "/map", 1.5, 0.0).unwrap();
        let there = back * between;
        assert!(there.translation.vector.norm() < 1e-12 && there.rotation.angle() < 1e-12);
    }

    #[test]
    fn chains_are_followed_and_fixed_frames_hold_for_all_times() {
        let known = known();
        let imu = known.look_up("odom", "imu", 2.0, 0.1).unwrap();
        assert!((imu.translation.vector - Vector3::new(5.2, 0.0, 0.0)).norm() < 1e-12);
        assert!(known.look_up("imu", "base_link", 1e6, 0.0).is_ok());
        let same = known.look_up("nowhere", "nowhere", 0.0, 0.0).unwrap();
        assert_eq!(same, Isometry3::identity());
    }

    #[test]
    fn what_is_unknown_or_old_is_named() {
        let known = known();
        let error = known.look_up("mars", "odom", 1.5, 1.0).unwrap_err();
        assert!(error.to_string().contains("mars"), "{error}");
        assert!(known.look_up("map", "odom", 2.4, 0.5).is_ok());
        let error = known.look_up("map", "odom", 3.0, 0.5).unwrap_err();
        assert!(error.to_string().contains("odom is 1.00 s old"), "{error}");
        let mut known = known;
        known.forget();
        assert!(known.look_up("map", "odom", 1.5, 1.0).is_err());
        assert!(known.look_up("imu", "base_link", 1.5, 1.0).is_ok());
    }

    #[test]
    fn a_later_message_supersedes_a_pose_ahead_of_the_clock() {
        for ahead_s in [0.3, 5.0, 9.0, 3600.0, 1e9] {
            let mut known = Transforms::default();
            for step in 0..=20 {
                let now_s = 0.05 * f64::from(step);
                known.take("map", "odom", (now_s, now_s), pose(1.0, 0.0), false);
                if step == 10 {
                    known.take(
                        "map",
                        "odom",
                        (now_s + ahead_s, now_s),
                        pose(9.0, 0.0),
                        false,
                    );
                }
            }
            let now = known.look_up("map", "odom", 1.02, 0.1).unwrap();
            assert_eq!(now.translation.x, 1.0, "{ahead_s}");
        }
        // A localisation that stamps ahead of the clock is interpolated all the same.
        let mut known = Transforms::default();
        for step in 0..=20 {
            let now_s = 0.1 * f64::from(step);
            let x_m = f64::from(step);
            known.take("map", "odom", (now_s + 0.5, now_s), pose(x_m, 0.0), false);
        }
        let between = known.look_up("map", "odom", 2.05, 0.0).unwrap();
        assert!((between.translation.x - 15.5).abs() < 1e-9, "{between}");
    }

    #[test]
    fn a_loop_is_no_endless_way() {
        let mut known = Transforms::default();
        known.take("a", "b", (0.0, 0.0), pose(1.0, 0.0), false);
        known.take("b", "a", (0.0, 0.0), pose(1.0, 0.0), false);
        assert!(known.look_up("c", "a", 0.0, 0.0).is_err());
    }
}
