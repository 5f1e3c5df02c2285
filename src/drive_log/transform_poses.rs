//! Poses of the vehicle from transforms between frames.

use nalgebra::{Isometry3, UnitQuaternion};
use sidehill_bridge::ros2::transforms::Transforms;
use std::collections::BTreeMap;

/// Age up to which a slower transform on the way, such as that of a localisation, holds, s.
const TOLERANCE_S: f64 = 0.5;

/// Collects transforms and returns new poses.
pub(super) struct TransformPoses {
    /// Frame of the poses; none where no poses are wanted.
    frame: Option<String>,
    base_frame: String,
    transforms: Transforms,
    /// Parents of frames, and whether they are fixed in them.
    parents: BTreeMap<String, (String, bool)>,
}

impl TransformPoses {
    pub(super) fn new(frame: Option<String>, base_frame: &str) -> Self {
        Self {
            frame,
            base_frame: base_frame.to_owned(),
            transforms: Transforms::default(),
            parents: BTreeMap::new(),
        }
    }

    /// Returns whether transforms that change are needed.
    pub(super) fn wants_moving(&self) -> bool {
        self.frame.is_some()
    }

    /// Takes a transform and returns the pose of the vehicle at its time, if it is the one that moves the vehicle:
    /// the first on the way from it that is not fixed.
    pub(super) fn take(
        &mut self,
        parent: &str,
        child: &str,
        time_ns: i64,
        pose: Isometry3<f64>,
        fixed: bool,
    ) -> Option<Isometry3<f64>> {
        let time_s = time_ns as f64 * 1e-9;
        // Nothing in a log is ahead of its clock.
        self.transforms
            .take(parent, child, (time_s, f64::INFINITY), pose, fixed);
        let entry = (parent.trim_start_matches('/').to_owned(), fixed);
        self.parents
            .insert(child.trim_start_matches('/').to_owned(), entry);
        let frame = self.frame.as_deref()?;
        if fixed || self.moving_frame()? != child.trim_start_matches('/') {
            return None;
        }
        let found = self
            .transforms
            .look_up(frame, &self.base_frame, time_s, TOLERANCE_S);
        found.ok()
    }

    fn moving_frame(&self) -> Option<&str> {
        let mut frame = self.base_frame.trim_start_matches('/');
        for _ in 0..=self.parents.len() {
            match self.parents.get(frame)? {
                (parent, true) => frame = parent,
                (_, false) => return Some(frame),
            }
        }
        None
    }

    /// Returns the rotation of a frame in another to which it is fixed; that of a frame in itself is none.
    pub(super) fn fixed_rotation(&self, target: &str, origin: &str) -> Option<UnitQuaternion<f64>> {
        let plain = |name: &str| name.trim_start_matches('/').to_owned();
        if plain(target) == plain(origin) {
            return Some(UnitQuaternion::identity());
        }
        let mut fixed = Transforms::default();
        // Only the fixed ones count, although others may connect both.
        fixed.clone_from(&self.transforms);
        fixed.forget();
        let found = fixed.look_up(target, origin, 0.0, 0.0);
        found.ok().map(|pose| pose.rotation)
    }

    /// Returns the frames as `child in parent, ...`.
    pub(super) fn frames(&self) -> String {
        let pairs: Vec<String> = self
            .parents
            .iter()
            .map(|(child, (parent, _))| format!("{child} in {parent}"))
            .collect();
        pairs.join(", ")
    }
}
