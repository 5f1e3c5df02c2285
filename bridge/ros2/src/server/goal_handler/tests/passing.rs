use super::*;
use sidehill_bridge::ros2::settings::costmap::CostmapConfig;

const CORRIDOR_M: f64 = 0.7;

impl World {
    fn in_a_corridor(pivots: PivotSettings) -> Self {
        let mut world = Self::with(pivots);
        let config = CostmapConfig {
            corridor_m: CORRIDOR_M,
            ..CostmapConfig::default()
        };
        world.obstacles = Some(obstacles::Costmaps::new(config));
        world.has_progress = true;
        world
    }

    /// A post at a place, or none, for a time.
    fn see_post(&mut self, post: Option<[f64; 2]>, time_s: f64) {
        for _ in 0..(time_s / 0.05).round() as u32 {
            let at = ([self.x_m, 0.0], self.now_s + 0.05);
            if let Some(costmaps) = &mut self.obstacles {
                costmaps.publish(at.0, at.1, |x, y| {
                    post.is_some_and(|[post_x, post_y]| (x - post_x).hypot(y - post_y) < 0.1)
                });
            }
            self.cycle();
        }
    }

    /// Distance of the route from the path, to the left, where it has come some way along x.
    fn left_m(&self, x_m: f64) -> f64 {
        let trajectory = self.trajectory.as_ref().unwrap();
        let step_s = trajectory.duration_s() / 2000.0;
        let places = (0..=2000).map(|i| trajectory.at(f64::from(i) * step_s).position);
        let near = |place: &sidehill_controller::path::Point2| (place.x_m - x_m).abs();
        let place = places.min_by(|a, b| near(a).total_cmp(&near(b)));
        place.unwrap().y_m
    }
}

#[test]
fn the_route_goes_past_an_obstacle_once_and_back_to_the_path() {
    let mut world = World::in_a_corridor(PivotSettings::default());
    world.see_post(None, 0.1);
    let client = world.follow();
    world.see_post(None, 0.5);
    assert_eq!(world.state, SafetyState::Driving);
    assert!(world.left_m(5.0).abs() < 1e-9);
    let before = world.reference;
    // To the right of the path.
    world.see_post(Some([3.7, -0.6]), 1.0);
    assert_eq!((world.state, world.stop), (SafetyState::Driving, None));
    assert_eq!(world.warnings.len(), 1, "{:?}", world.warnings);
    assert!(world.warnings[0].contains("to the left of the path"));
    // Once for the course, and never more: it stays while it is free.
    assert!(world.reference > before && world.reference <= before + 3);
    let aside_m = world.left_m(3.7);
    assert!((0.2..CORRIDOR_M).contains(&aside_m), "{aside_m}");
    assert!(world.left_m(0.2).abs() < 1e-3 && world.left_m(9.9).abs() < 1e-3);
    let speed_m_s = world.speed_at_m_s(3.7);
    assert!(speed_m_s > 0.4, "{speed_m_s}");
    world.x_m = 10.0;
    world.see_post(None, 0.1);
    world.finish();
    world.assert_finished(client, GoalEnd::Succeeded, code::NONE);
}

#[test]
fn a_vehicle_that_waits_goes_on_when_the_obstacle_leaves_room_beside() {
    let mut world = World::in_a_corridor(PivotSettings::default());
    world.see_post(None, 0.1);
    world.follow();
    world.see_post(None, 0.5);
    // In the middle, near: no course past it.
    world.see_post(Some([1.4, 0.0]), 0.5);
    assert_eq!(
        (world.state, world.stop),
        (SafetyState::Latched, Some(StopCause::Obstacle))
    );
    // It moves aside and away, but not out of the path.
    world.see_post(Some([3.5, 0.65]), 1.5);
    assert_eq!((world.state, world.stop), (SafetyState::Driving, None));
    assert!(world.left_m(3.5) < -0.1);
}

#[test]
fn speeds_change_on_the_course_that_is_driven() {
    let mut world = World::in_a_corridor(PivotSettings::default());
    world.see_post(None, 0.1);
    world.follow();
    world.see_post(Some([3.7, -0.6]), 1.0);
    let aside_m = world.left_m(3.7);
    world.handler.set_desired_speed(0.2);
    world.see_post(Some([3.7, -0.6]), 0.2);
    assert!((world.speed_at_m_s(3.7) - 0.2).abs() < 0.01);
    assert!((world.left_m(3.7) - aside_m).abs() < 1e-3);
}

/// Half a turn on the spot of the J8 at 15 deg: the model slides it by half a metre, downhill.
#[test]
fn a_turn_on_the_spot_is_checked_with_its_slide() {
    let pivots = PivotSettings {
        at_start: true,
        at_goal: false,
    };
    for (slope_deg, blocked) in [(0.0_f64, false), (15.0, true)] {
        let mut world = World::in_a_corridor(pivots);
        // It looks back, on a slope that falls to its right, which is +y.
        world.yaw_rad = -ALONG_X;
        world.attitude = Attitude::from_slope(slope_deg.to_radians(), FRAC_PI_2);
        // A wall beside the circle of the padded corners, 1.32 m.
        let wall_m = 1.55;
        for _ in 0..20 {
            let stamp_s = world.now_s + 0.05;
            if let Some(costmaps) = &mut world.obstacles {
                costmaps.publish([0.0, 0.0], stamp_s, |_, y| y.abs() > wall_m);
            }
            world.cycle();
            if world.reference == 0 && world.now_s > 1.2 && world.handler.goal().is_none() {
                world.begin(path());
                world.build();
            }
        }
        let waits = world.handler.blocked_by();
        assert_eq!(waits.is_some(), blocked, "{slope_deg} deg: {waits:?}");
    }
}
