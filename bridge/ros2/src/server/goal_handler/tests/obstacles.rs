use super::*;
use crate::server::goal_context::ObstacleContext;
use crate::server::obstacles::{Costmap, Doubt, ObstacleSettings, StoppingSettings, Surroundings};
use sidehill_bridge::ros2::message::OccupancyGrid;
use sidehill_bridge::ros2::settings::costmap::CostmapConfig;
use sidehill_controller::tracked_point::TrackedPoint;

/// Costmaps as a reader of them has them.
pub(super) struct Costmaps {
    pub(super) settings: ObstacleSettings,
    pub(super) costmap: Option<Costmap>,
    pub(super) stamp_s: f64,
}

impl Costmaps {
    pub(super) fn new(config: CostmapConfig) -> Self {
        let stopping = StoppingSettings {
            deceleration_m_s2: 2.0,
            reaction_s: 0.18,
        };
        Self {
            settings: ObstacleSettings::new(config, stopping, &j8()),
            costmap: None,
            stamp_s: f64::NEG_INFINITY,
        }
    }

    /// A map around a place with the cells lethal that `is_lethal` says, by their centres.
    pub(super) fn publish(
        &mut self,
        [x_m, y_m]: [f64; 2],
        stamp_s: f64,
        is_lethal: impl Fn(f64, f64) -> bool,
    ) {
        const CELLS: u32 = 160;
        const RESOLUTION_M: f64 = 0.05;
        let mut grid = OccupancyGrid::default();
        grid.header.frame_id = "odom".to_owned();
        grid.info.resolution = RESOLUTION_M as f32;
        (grid.info.width, grid.info.height) = (CELLS, CELLS);
        let half_m = 0.5 * f64::from(CELLS) * RESOLUTION_M;
        // A rolling costmap moves by whole cells.
        let corner = [x_m, y_m].map(|at| ((at - half_m) / RESOLUTION_M).floor() * RESOLUTION_M);
        (grid.info.origin.position.x, grid.info.origin.position.y) = (corner[0], corner[1]);
        grid.data = (0..CELLS * CELLS)
            .map(|index| {
                let at = |index: u32, from_m: f64| from_m + (f64::from(index) + 0.5) * RESOLUTION_M;
                let cell = [at(index % CELLS, corner[0]), at(index / CELLS, corner[1])];
                if is_lethal(cell[0], cell[1]) { 100 } else { 0 }
            })
            .collect();
        self.costmap = Some(Costmap::from_grid(grid, self.settings.rule()).unwrap());
        self.stamp_s = stamp_s;
    }

    pub(super) fn context(&self, now_s: f64, transforms: &Transforms) -> ObstacleContext<'_> {
        let seen = self.costmap.as_ref().ok_or(Doubt::NoCostmap);
        ObstacleContext {
            settings: &self.settings,
            seen: seen.and_then(|costmap| {
                let times = (self.stamp_s, now_s);
                Surroundings::new(costmap, times, (transforms, "odom", 0.5), &self.settings)
            }),
        }
    }
}

impl World {
    fn with_costmap() -> Self {
        let mut world = Self::new();
        world.obstacles = Some(Costmaps::new(CostmapConfig::default()));
        world.has_progress = true;
        world
    }

    /// A wall across the path at a place along x, or none, and a cycle.
    fn see(&mut self, wall_x_m: Option<f64>) {
        let at = ([self.x_m, 0.0], self.now_s + 0.05);
        if let Some(obstacles) = &mut self.obstacles {
            obstacles.publish(at.0, at.1, |x, y| {
                wall_x_m.is_some_and(|wall| (x - wall).abs() < 0.1 && y.abs() < 0.3)
            });
        }
        self.cycle();
    }

    fn see_for(&mut self, wall_x_m: Option<f64>, time_s: f64) {
        for _ in 0..(time_s / 0.05).round() as u32 {
            self.see(wall_x_m);
        }
    }

    pub(super) fn speed_at_m_s(&self, x_m: f64) -> f64 {
        let trajectory = self.trajectory.as_ref().unwrap();
        trajectory.at(trajectory.time_at(x_m)).speed_m_s
    }
}

/// The front of the J8 is 1.06 m ahead, and padded by 0.1 m.
const FRONT_M: f64 = 1.16;

#[test]
fn an_obstacle_far_ahead_slows_the_route_down_and_a_free_way_does_not() {
    let mut world = World::with_costmap();
    world.see(None);
    world.follow();
    world.see_for(None, 0.5);
    assert_eq!(world.state, SafetyState::Driving);
    let free_m_s = world.speed_at_m_s(0.3);
    assert!((free_m_s - 0.5).abs() < 1e-6, "{free_m_s}");
    // What a speed of 0.5 m/s needs no slowing down for is not looked at.
    world.see_for(Some(2.8), 0.2);
    assert_eq!(world.speed_at_m_s(0.3), free_m_s);
    // The stop is 0.3 m before the wall: 0.3 m ahead.
    world.see_for(Some(1.9), 0.2);
    assert_eq!((world.state, world.stop), (SafetyState::Driving, None));
    let slowing = [0.1, 0.3, 0.5].map(|x_m| world.speed_at_m_s(x_m));
    assert!(
        slowing[0] < 0.48 && slowing[1] < 0.12 && slowing[2] < 0.051,
        "{slowing:?}"
    );
    world.see_for(None, 0.2);
    assert_eq!(world.speed_at_m_s(0.3), free_m_s);
    assert_eq!(world.warnings, [""; 0]);
}

#[test]
fn a_near_obstacle_stops_the_vehicle_which_goes_on_when_the_way_is_free() {
    let mut world = World::with_costmap();
    world.see(None);
    let client = world.follow();
    world.see_for(None, 0.5);
    world.see_for(Some(FRONT_M + 0.35), 0.2);
    assert_eq!(world.state, SafetyState::Latched);
    assert_eq!(world.stop, Some(StopCause::Obstacle));
    let reason = world.handler.blocked_by().unwrap();
    assert!(reason.starts_with("an obstacle is 0.2"), "{reason}");
    let (before, armed) = (world.reference, world.armed);
    world.see_for(Some(FRONT_M + 0.35), 5.0);
    assert_eq!((world.state, world.armed), (SafetyState::Latched, armed));
    // Half a second of a free way, and not before.
    world.see_for(None, 0.4);
    assert_eq!(world.state, SafetyState::Latched);
    world.see_for(None, 0.5);
    assert_eq!(world.state, SafetyState::Driving);
    assert!(world.reference > before && world.handler.blocked_by().is_none());
    assert_eq!(world.warnings.len(), 2, "{:?}", world.warnings);
    world.x_m = 10.0;
    world.see_for(None, 0.1);
    world.finish();
    world.assert_finished(client, GoalEnd::Succeeded, code::NONE);
}

#[test]
fn a_path_of_a_point_ahead_is_checked_with_the_footprint_behind_it() {
    let mut world = World::with_costmap();
    world.handler.settings.route.tracked_point = TrackedPoint {
        right_m: 0.0,
        forward_m: 2.0,
    };
    // The point is at the beginning of the path.
    world.x_m = -2.0;
    world.see(None);
    world.follow();
    world.see_for(None, 0.5);
    // 0.25 m before the front of a footprint around the point, and 2.25 m before that of the vehicle.
    world.see_for(Some(FRONT_M + 0.35), 0.2);
    assert_eq!((world.state, world.stop), (SafetyState::Driving, None));
}

#[test]
fn patience_ends_with_the_code_of_nav2_and_the_reason() {
    for (seen, wanted, words) in [
        (
            Some(Some(1.25)),
            code::PATIENCE_EXCEEDED,
            "an obstacle is 0.00 m ahead, waited 10.0",
        ),
        (
            None,
            code::CONTROLLER_TIMED_OUT,
            "there is no costmap yet, waited 10.0 s",
        ),
    ] {
        let mut world = World::with_costmap();
        let client = world.follow();
        for _ in 0..230 {
            match seen {
                Some(wall) => world.see(wall),
                None => world.cycle(),
            }
            assert_ne!(world.state, SafetyState::Driving);
        }
        world.assert_finished(client, GoalEnd::Aborted, wanted);
        let message = &world.finished[0].2.message;
        assert!(message.contains(words), "{message}");
    }
}

#[test]
fn a_stale_costmap_stops_and_a_fresh_one_lets_the_vehicle_go_on() {
    let mut world = World::with_costmap();
    world.see(None);
    world.follow();
    world.see_for(None, 0.5);
    world.cycles(18);
    assert_eq!(world.state, SafetyState::Driving);
    world.cycles(6);
    assert_eq!(world.state, SafetyState::Latched);
    assert_eq!(world.stop, Some(StopCause::CostmapUnknown));
    world.see_for(None, 1.0);
    assert_eq!(world.state, SafetyState::Driving);
}

#[test]
fn without_a_transform_the_costmap_has_no_place() {
    let mut world = World::with_costmap();
    world.see(None);
    world.follow();
    let costmaps = world.obstacles.as_mut().unwrap();
    let mut grid = OccupancyGrid::default();
    grid.header.frame_id = "lidar".to_owned();
    grid.info.resolution = 0.1;
    (grid.info.width, grid.info.height, grid.data) = (1, 1, vec![0]);
    let rule = costmaps.settings.rule();
    (costmaps.costmap, costmaps.stamp_s) = (Some(Costmap::from_grid(grid, rule).unwrap()), 1.0);
    world.cycles(4);
    let reason = world.handler.blocked_by().unwrap();
    assert!(reason.contains("lidar"), "{reason}");
}

#[test]
fn a_map_that_does_not_reach_far_enough_stops_the_vehicle_too() {
    let mut world = World::with_costmap();
    world.see(None);
    world.follow();
    world.see_for(None, 0.5);
    // The map stays where it was: 4 m ahead.
    let costmaps = world.obstacles.as_mut().unwrap();
    costmaps.publish([0.0, 0.0], 1e3, |_, _| false);
    costmaps.stamp_s = world.now_s + 0.4;
    world.x_m = 2.75;
    world.cycles(3);
    let reason = world.handler.blocked_by().unwrap();
    assert!(reason.contains("the costmap ends"), "{reason}");
}

#[test]
fn a_drive_that_ends_otherwise_while_it_waits_is_not_taken_up_again() {
    let mut world = World::with_costmap();
    world.see(None);
    let client = world.follow();
    world.see_for(None, 0.5);
    world.see(Some(FRONT_M + 0.1));
    world.end_by(Reason::DriveFault);
    world.see_for(None, 2.0);
    assert_ne!(world.state, SafetyState::Driving);
    world.assert_finished(client, GoalEnd::Aborted, code::UNKNOWN);
}
