use super::*;
use crate::path::Point2;
use crate::speed_profile::{SpeedLimits, speed_profile};
use crate::trajectory::Trajectory;
use sidehill_plant::contact::CentreOfMass;
use sidehill_plant::frames::{Attitude, PlanarPose};
use sidehill_plant::speeds::TreadSpeeds;
use sidehill_plant::vehicle::Vehicle;

const SPEED_M_S: f64 = 0.6;

/// A vehicle whose mass is so high that it tips over at 31 deg to the side.
fn stance() -> Stance {
    let vehicle = Vehicle {
        centre_of_mass: Some(CentreOfMass {
            right_m: 0.0,
            forward_m: 0.0,
            height_m: 1.0,
        }),
        ..Vehicle::j8()
    };
    Stance::of(&vehicle).unwrap()
}

/// A drive of 20 m along +Y_g at 0.6 m/s.
fn straight() -> Trajectory {
    let limits = SpeedLimits {
        speed_max_m_s: SPEED_M_S,
        traction_max_m_s: 1.0,
        steer_max_m_s: 1.0,
        tread_max_m_s: 2.0,
        acceleration_m_s2: 1.0,
        deceleration_m_s2: 1.0,
        steer_acceleration_m_s2: 1.0,
        lateral_acceleration_m_s2: 1.0,
        track_width_m: 2.0,
    };
    let points: Vec<crate::path::RawPoint> = (0..=40)
        .map(|i| crate::path::RawPoint {
            position: Point2 {
                x_m: 0.0,
                y_m: 0.5 * f64::from(i),
            },
            ..crate::path::RawPoint::default()
        })
        .collect();
    let path = crate::path::smooth(&points, &crate::path::Smoothing::default()).unwrap();
    speed_profile(&path.path, &limits, |_| f64::INFINITY).unwrap()
}

/// Ground along +Y_g whose right side falls off by `steep_deg` from 10 m on.
fn ramp(steep_deg: f64) -> Terrain {
    let rise = steep_deg.to_radians().tan();
    let mut grid = String::from("ncols 9\nnrows 41\nxllcorner -4.5\nyllcorner -10.5\ncellsize 1\n");
    for row in (0..41).rev() {
        let y_m = f64::from(row) - 10.0;
        let share = ((y_m - 9.0) / 2.0).clamp(0.0, 1.0);
        let heights: Vec<String> = (0..9)
            .map(|column| (-(f64::from(column) - 4.0) * share * rise).to_string())
            .collect();
        grid += &heights.join(" ");
        grid.push('\n');
    }
    Terrain::Grid(sidehill_plant::terrain::GridTerrain::parse(&grid).unwrap())
}

fn estimate(time_s: f64, y_m: f64, terrain: &Terrain) -> Estimate {
    let normal = terrain.surface(0.0, y_m).unwrap().normal_in_world;
    let pose = PlanarPose {
        y_m,
        ..PlanarPose::default()
    };
    Estimate {
        covariance: nalgebra::Matrix3::identity() * 1e-4,
        attitude: Attitude::on_plane(&normal, 0.0),
        normal_in_world: normal,
        treads: TreadSpeeds {
            left_m_s: SPEED_M_S,
            right_m_s: SPEED_M_S,
        },
        ..Estimate::standing(time_s, pose)
    }
}

/// What came of a drive along the straight: where it stopped and why, the first announcement, s before
/// the stop, and the lowest share of speed.
struct Drive {
    stopped: Option<(f64, GuardStop)>,
    announced_s: Option<f64>,
    lowest: f64,
}

/// Follows the path exactly, as fast as the guard lets it; with the map or with the plane under the vehicle alone.
fn drive(config: GuardConfig, terrain: &Terrain, map: bool) -> Drive {
    let period_s = 0.05;
    let mut guard = Guard::new(config, stance(), 0.5);
    let mut reference = Reference::new(straight());
    let (mut y_m, mut speed_m_s, mut announced, mut lowest) = (0.0, 0.0, None, 1.0_f64);
    for cycle in 0..4000 {
        let time_s = period_s * f64::from(cycle);
        let estimate = estimate(time_s, y_m, terrain);
        let around = GuardInputs {
            estimate: &estimate,
            reference: &reference,
            map: map.then_some(terrain),
            half_track_m: 1.0,
            elapsed_s: period_s,
            command: MotorSpeeds {
                traction_m_s: speed_m_s,
                steer_m_s: 0.0,
            },
        };
        let stop = guard.look(&around);
        let view = guard.view().unwrap();
        if view.ahead.is_some() {
            announced = announced.or(Some(time_s));
        }
        lowest = lowest.min(view.speed_share);
        if let Some(reason) = stop {
            return Drive {
                stopped: Some((y_m, reason)),
                announced_s: announced.map(|s| time_s - s),
                lowest,
            };
        }
        let progress = reference.advance(period_s, &estimate.pose, speed_m_s == 0.0);
        // The vehicle gains speed at 1 m/s^2.
        let allowed_m_s = guard.share() * progress.point.speed_m_s;
        speed_m_s = allowed_m_s.min(speed_m_s + period_s);
        y_m += period_s * speed_m_s;
        if progress.ended {
            break;
        }
    }
    Drive {
        stopped: None,
        announced_s: None,
        lowest,
    }
}

#[test]
fn a_steep_place_on_the_map_is_announced_and_stopped_before() {
    let config = GuardConfig::default();
    let drive = drive(config, &ramp(28.0), true);
    let (y_m, reason) = drive.stopped.unwrap();
    let GuardStop::TooSteep(place) = reason else {
        panic!("{reason:?}");
    };
    assert_eq!(place.measure, SteepMeasure::RolloverMargin);
    assert!(place.stops && (9.0..11.0).contains(&place.y_m), "{place}");
    let left_m = place.y_m - y_m;
    assert!((0.4..0.7).contains(&left_m), "{left_m}");
    assert!(drive.announced_s.unwrap() > 5.0);
    // The vehicle comes to the place slowly.
    assert!(drive.lowest < 0.5);
}

#[test]
fn a_place_of_little_margin_is_driven_over_slower() {
    let config = GuardConfig::default();
    // 19 deg leave a margin of 0.39, and the spread of headings takes nothing off it.
    let slower = drive(config, &ramp(19.5), true);
    assert!(slower.stopped.is_none());
    assert!((0.4..1.0).contains(&slower.lowest), "{}", slower.lowest);
    let untouched = drive(config, &ramp(15.0), true);
    assert!(untouched.stopped.is_none());
    assert_eq!(untouched.lowest, 1.0);
}

#[test]
fn a_vehicle_beside_its_path_is_stopped_before_ground_too_steep_there() {
    // Ground whose slope to the right grows from left to right: 0.1 for each metre.
    let mut grid = String::from("ncols 9\nnrows 41\nxllcorner -4.5\nyllcorner -10.5\ncellsize 1\n");
    let heights: Vec<String> = (0..9)
        .map(|column| (-0.05 * (f64::from(column) - 1.0).max(0.0).powi(2)).to_string())
        .collect();
    for _ in 0..41 {
        grid += &heights.join(" ");
        grid.push('\n');
    }
    let terrain = Terrain::Grid(sidehill_plant::terrain::GridTerrain::parse(&grid).unwrap());
    let reference = Reference::new(straight());
    let look = |x_m: f64, turned_rad: f64| {
        let mut guard = Guard::new(GuardConfig::default(), stance(), 0.5);
        let mut estimate = estimate(0.0, 5.0, &Terrain::Level);
        estimate.pose.x_m = x_m;
        estimate.pose.yaw_rad = turned_rad;
        guard.look(&GuardInputs {
            estimate: &estimate,
            reference: &reference,
            map: Some(&terrain),
            half_track_m: 1.0,
            elapsed_s: 0.05,
            command: MotorSpeeds::STOP,
        });
        guard.view().unwrap()
    };
    assert!(look(0.0, 0.0).ahead.is_none_or(|place| !place.stops));
    assert!(look(-1.0, 0.0).ahead.is_none_or(|place| !place.stops));
    let beside = look(2.0, 0.0).ahead.unwrap();
    assert!(beside.stops && beside.value < 0.3, "{beside}");
}

#[test]
fn ground_without_a_map_stops_where_its_own_slope_is_too_steep() {
    let drive = drive(GuardConfig::default(), &ramp(28.0), false);
    let (y_m, reason) = drive.stopped.unwrap();
    assert!(matches!(reason, GuardStop::TooSteep(_)), "{reason:?}");
    assert!((9.0..11.0).contains(&y_m), "{y_m}");
}

#[test]
fn an_attitude_beyond_its_limit_stops_at_once() {
    let config = GuardConfig {
        roll_max_deg: 8.0,
        rollover_margin_min: 0.0,
        ..GuardConfig::default()
    };
    let ground = ramp(14.0);
    let mut guard = Guard::new(config, stance(), 0.5);
    let reference = Reference::new(straight());
    let look = |guard: &mut Guard, estimate: &Estimate| {
        guard.look(&GuardInputs {
            estimate,
            reference: &reference,
            map: Some(&Terrain::Level),
            half_track_m: 1.0,
            elapsed_s: 0.05,
            command: MotorSpeeds::STOP,
        })
    };
    assert_eq!(look(&mut guard, &estimate(0.0, 5.0, &ground)), None);
    let reason = look(&mut guard, &estimate(0.05, 15.0, &ground)).unwrap();
    let GuardStop::Tilted {
        measure, value_deg, ..
    } = reason
    else {
        panic!("{reason:?}");
    };
    assert!(measure.to_string().contains("roll"), "{measure}");
    assert!((value_deg.abs() - 14.0).abs() < 1.0, "{value_deg}");
}

#[test]
fn a_known_route_names_its_first_steep_place() {
    let (config, stance) = (GuardConfig::default(), stance());
    let place = first_steep_place(&config, &stance, &straight(), &ramp(28.0)).unwrap();
    assert!((9.0..11.0).contains(&place.arc_length_m), "{place}");
    assert!(place.to_string().contains("tip-over margin"), "{place}");
    assert_eq!(
        first_steep_place(&config, &stance, &straight(), &ramp(15.0)),
        None
    );
}
