//! The legs of a drive: the lanes of a route, and the ways between them.

use anyhow::{Context, Result, bail, ensure};
use sidehill::drive::DriveRouteArgs;
use sidehill_controller::path::{Aside, Path, Point2, RouteAction};
use sidehill_plant::bounds::Bounds;
use sidehill_plant::frames::PlanarPose;
use sidehill_ros2::server::requested_path::RequestedPath;
use std::f64::consts::PI;

/// A route whose ends are closer than this is a loop, m.
const LOOP_M: f64 = 1.0;
/// Way before the place of a pause at which the rest begins, m: the vehicle joins at the nearest pose.
const BEFORE_M: f64 = 0.5;
/// Largest distance of the vehicle from the lane on which it is to begin, m.
const BESIDE_M: f64 = 1.0;
/// Largest number of lanes, and of passes.
const LANES_MAX: f64 = 1000.0;

/// A stretch that is driven as a goal.
#[derive(Clone)]
pub(super) struct RouteLeg {
    pub(super) name: String,
    pub(super) path: RequestedPath,
    pub(super) actions: Vec<RouteAction>,
    /// Where it begins and ends along all that is driven, m; the same on the way to where the drive begins.
    pub(super) begins_m: f64,
    pub(super) ends_m: f64,
}

impl RouteLeg {
    /// Returns the leg that follows others.
    fn after(
        before: &[Self],
        name: String,
        path: RequestedPath,
        actions: Vec<RouteAction>,
    ) -> Self {
        let begins_m = before.last().map_or(0.0, |leg| leg.ends_m);
        Self {
            ends_m: begins_m + path.length_m(0),
            begins_m,
            name,
            path,
            actions,
        }
    }

    pub(super) fn length_m(&self) -> f64 {
        self.path.length_m(0)
    }

    /// Returns the place along all that is driven at which so much of the leg is left, m, in whole decimetres: who begins
    /// there again passes nothing over but a millimetre.
    pub(super) fn place_m(&self, left_m: f64) -> f64 {
        let place_m = (self.ends_m - left_m).clamp(self.begins_m, self.ends_m);
        (10.0 * (place_m + 1e-3)).floor() / 10.0
    }

    /// Returns that place and the leg in words.
    pub(super) fn name_place(&self, left_m: f64) -> String {
        let (place_m, name) = (self.place_m(left_m), &self.name);
        format!("at {place_m:.1} m, {left_m:.1} m before the end of {name}")
    }

    /// Returns where so much of the leg is left.
    pub(super) fn point(&self, left_m: f64) -> Point2 {
        let pose = &self.path.poses[self.pose_before_end(left_m)];
        Point2 {
            x_m: pose.x_m,
            y_m: pose.y_m,
        }
    }

    /// Returns the way along the leg to a place on it, m along all that is driven, for a vehicle that stands beside it;
    /// nothing where it is there. With `reverses` the vehicle drives back in reverse.
    pub(super) fn way_to(
        &self,
        from_m: f64,
        (x_m, y_m): (f64, f64),
        (goal_xy_m, reverses): (f64, bool),
    ) -> Result<Option<Self>> {
        let poses = &self.path.poses;
        let mut ahead_m = vec![from_m - self.begins_m];
        for pair in poses.windows(2) {
            ahead_m.push(ahead_m[ahead_m.len() - 1] - apart_m(&pair[0], &pair[1]));
        }
        let beside_m: Vec<f64> = poses
            .iter()
            .map(|pose| (pose.x_m - x_m).hypot(pose.y_m - y_m))
            .collect();
        let nearest_m = beside_m.iter().copied().fold(f64::INFINITY, f64::min);
        ensure!(
            nearest_m <= BESIDE_M,
            "--from-m {from_m}: the vehicle stands {nearest_m:.1} m from {}, at most {BESIDE_M:.0} m are allowed: drive it \
             there by hand",
            self.name
        );
        let closest = |among: &dyn Fn(usize) -> bool| {
            let candidates = (0..poses.len()).filter(|index| among(*index));
            candidates.min_by(|a, b| ahead_m[*a].abs().total_cmp(&ahead_m[*b].abs()))
        };
        // A lane that crosses or closes itself passes the vehicle more than once.
        let passes = |index: usize| {
            let here_m = beside_m[index];
            let farther = |index: Option<usize>| {
                index
                    .and_then(|index| beside_m.get(index))
                    .is_none_or(|there_m| *there_m >= here_m)
            };
            here_m <= nearest_m + goal_xy_m
                && farther(index.checked_sub(1))
                && farther(Some(index + 1))
        };
        let ends = closest(&|_| true).zip(closest(&passes));
        let far = |(to, at): &(usize, usize)| to != at && ahead_m[*at].abs() > goal_xy_m;
        let Some((to, at)) = ends.filter(far) else {
            return Ok(None);
        };
        let (first, last) = (at.min(to), at.max(to));
        let speeds_m_s = self.path.speeds_m_s.iter().skip(first).take(last - first);
        let mut path = RequestedPath {
            poses: poses[first..=last].to_vec(),
            speeds_m_s: speeds_m_s.copied().collect(),
            ..RequestedPath::default()
        };
        if to < at {
            path.poses.reverse();
            path.speeds_m_s.reverse();
            let turned_rad = if reverses { 0.0 } else { PI };
            path.poses
                .iter_mut()
                .for_each(|pose| pose.yaw_rad += turned_rad);
        }
        Ok(Some(Self {
            name: format!("way to {from_m:.1} m"),
            path,
            actions: Vec::new(),
            begins_m: from_m,
            ends_m: from_m,
        }))
    }

    /// Returns the index of the pose at which so much is left.
    fn pose_before_end(&self, left_m: f64) -> usize {
        let poses = &self.path.poses;
        let mut behind_m = 0.0;
        let mut from = poses.len() - 1;
        while from > 0 && behind_m < left_m {
            from -= 1;
            behind_m += apart_m(&poses[from], &poses[from + 1]);
        }
        from
    }

    /// Returns the index of the pose a little before the place on at which so much is left.
    pub(super) fn rest(&self, left_m: f64) -> usize {
        self.pose_before_end(left_m + BEFORE_M)
    }
}

/// A path beside the route, and the actions along it.
#[derive(Clone)]
struct Lane {
    path: RequestedPath,
    actions: Vec<RouteAction>,
}

impl Lane {
    fn new(curve: &Path, actions: Vec<RouteAction>) -> Self {
        Self {
            path: RequestedPath::from_curve("", curve),
            actions,
        }
    }

    /// Returns the lane back the way it came.
    fn reversed(mut self) -> Self {
        let length_m = self.path.length_m(0);
        let RequestedPath {
            poses, speeds_m_s, ..
        } = &mut self.path;
        poses.reverse();
        poses.iter_mut().for_each(|pose| pose.yaw_rad += PI);
        // The speed of the last pose is none's; that of each other is of the stretch to the next.
        speeds_m_s.pop();
        speeds_m_s.reverse();
        for action in &mut self.actions {
            action.at_m = (length_m - action.at_m).max(0.0);
        }
        self
    }
}

pub(super) fn apart_m(a: &PlanarPose, b: &PlanarPose) -> f64 {
    (b.x_m - a.x_m).hypot(b.y_m - a.y_m)
}

/// Returns lanes beside a curve and the ways from one to the next, in the order in which they are driven.
pub(super) fn legs(
    args: &DriveRouteArgs,
    (curve, actions): (&Path, &[RouteAction]),
    goal_xy_m: f64,
) -> Result<Vec<RouteLeg>> {
    let count = Bounds::new(1.0, LANES_MAX, "");
    count.check("--lanes", f64::from(args.lanes))?;
    count.check("--passes", f64::from(args.passes))?;
    let lane_m = match args.lane_m {
        Some(lane_m) => Bounds::new(-100.0, 100.0, "m").check("--lane-m", lane_m)?,
        None if args.lanes == 1 => 0.0,
        None => bail!("--lanes: the distance from lane to lane is missing, as --lane-m 0.8"),
    };
    let ends_m = apart_m(&curve.at(0.0).pose(), &curve.at(curve.length_m()).pose());
    let is_loop = ends_m < LOOP_M;
    let lanes = (0..args.lanes).map(|lane| {
        let left_m = f64::from(lane) * lane_m;
        if left_m == 0.0 {
            return Ok(Lane::new(curve, actions.to_vec()));
        }
        let aside = Aside {
            left_m,
            ..Aside::NONE
        };
        let moved = curve.moved_aside(|_| aside).with_context(|| {
            format!("--lane-m: lane {} is beyond the centre of a bend", lane + 1)
        })?;
        let actions = actions.iter().map(|action| RouteAction {
            at_m: moved.moved_m(action.at_m),
            text: action.text.clone(),
        });
        Ok(Lane::new(&moved.path, actions.collect()))
    });
    let lanes: Vec<Lane> = lanes.collect::<Result<_>>()?;
    let mut legs: Vec<RouteLeg> = Vec::new();
    for pass in 0..args.passes {
        for index in 0..args.lanes {
            // Back the way it came.
            let lane = match pass % 2 {
                0 => index,
                _ => args.lanes - 1 - index,
            };
            let mut driven = lanes[lane as usize].clone();
            if !is_loop && (pass * args.lanes + index) % 2 == 1 {
                driven = driven.reversed();
            }
            if let (Some(before), Some(to)) = (legs.last(), driven.path.poses.first())
                && let Some(from) = before.path.poses.last()
                && apart_m(from, to) > goal_xy_m
            {
                let path = RequestedPath {
                    poses: across(from, to),
                    ..RequestedPath::default()
                };
                let name = format!("way to lane {}", lane + 1);
                legs.push(RouteLeg::after(&legs, name, path, Vec::new()));
            }
            let mut name = format!("lane {} of {}", lane + 1, args.lanes);
            if args.passes > 1 {
                name += &format!(", pass {} of {}", pass + 1, args.passes);
            }
            legs.push(RouteLeg::after(&legs, name, driven.path, driven.actions));
        }
    }
    Ok(legs)
}

/// Returns poses straight from one place to another.
fn across(from: &PlanarPose, to: &PlanarPose) -> Vec<PlanarPose> {
    let steps = (apart_m(from, to) / 0.1).ceil().max(1.0) as usize;
    let yaw_rad = (from.x_m - to.x_m).atan2(to.y_m - from.y_m);
    (0..=steps)
        .map(|step| step as f64 / steps as f64)
        .map(|share| PlanarPose {
            x_m: from.x_m + share * (to.x_m - from.x_m),
            y_m: from.y_m + share * (to.y_m - from.y_m),
            yaw_rad,
        })
        .collect()
}
