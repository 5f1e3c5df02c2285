//! Several posts in a corridor, all seen from the start: passed wherever a course leaves room, never touched.

use super::obstacle_runs::{Post, Random, Run, Setting, arc, drive};
use super::program::Slippery;
use super::*;
use sidehill_bridge::ros2::settings::costmap::CostmapConfig;

const LENGTH_M: f64 = 20.0;

/// Two to four posts beside and on an arc, in a corridor of a random width.
fn gauntlet(seed: u64) -> (Setting, Vec<Post>, f64) {
    let mut random = Random(seed);
    let setting = Setting {
        path: arc(random.within(-0.15, 0.15), LENGTH_M),
        speed_m_s: random.within(0.3, 0.8),
        slope_deg: random.within(0.0, 15.0),
        uphill_deg: random.within(-180.0, 180.0),
        contact: seed.is_multiple_of(2),
        slippery: None,
    };
    let corridor_m = random.within(0.5, 1.0);
    let posts = (0..2 + (3.0 * random.next()) as usize)
        .map(|_| {
            let index = random.within(45.0, 150.0) as usize;
            let radius_m = random.within(0.05, 0.4);
            let beside_m = radius_m + random.within(0.1, 0.8);
            let side = if random.next() < 0.5 { -1.0 } else { 1.0 };
            setting.post(index, side * beside_m, radius_m)
        })
        .collect();
    (setting, posts, corridor_m)
}

/// Whether a plain course leaves room: one of straight stretches of 0.25 m, each along the path or at 0.2 rad
/// to it, from the path back to the path within the corridor, that keeps `room_m` from all posts.
fn leaves_room(setting: &Setting, posts: &[Post], corridor_m: f64, room_m: f64) -> bool {
    const ASIDE_M: f64 = 0.05;
    const WAY_M: f64 = 0.25;
    let poses = &setting.path.poses;
    let reach = (corridor_m / ASIDE_M + 1e-9) as i32;
    let pose = |way_m: f64, aside: f64, turn: f64| {
        let place = 10.0 * way_m;
        let index = (place as usize).min(poses.len() - 2);
        let share = place - index as f64;
        let (a, b) = (&poses[index], &poses[index + 1]);
        let between = |a: f64, b: f64| a + share * (b - a);
        let yaw_rad = between(a.yaw_rad, b.yaw_rad);
        PlanarPose {
            x_m: between(a.x_m, b.x_m) - aside * ASIDE_M * yaw_rad.cos(),
            y_m: between(a.y_m, b.y_m) - aside * ASIDE_M * yaw_rad.sin(),
            yaw_rad: yaw_rad + turn * ASIDE_M.atan2(WAY_M),
        }
    };
    // Places aside and the turns there that can be reached.
    let mut reached = vec![(0_i32, 0_i32)];
    for stretch in 0..(LENGTH_M / WAY_M) as u32 {
        let way_m = f64::from(stretch) * WAY_M;
        let mut next = Vec::new();
        for (aside, turn) in reached {
            for new in (turn - 1).max(-1)..=(turn + 1).min(1) {
                let to = (aside + new, new);
                let free = || {
                    [0.5, 1.0].into_iter().all(|share| {
                        let aside = f64::from(aside) + share * f64::from(new);
                        let at = pose(way_m + share * WAY_M, aside, f64::from(new));
                        posts.iter().all(|post| post.gap_m(&at) >= room_m)
                    })
                };
                if to.0.abs() <= reach && !next.contains(&to) && free() {
                    next.push(to);
                }
            }
        }
        reached = next;
    }
    reached.contains(&(0, 0))
}

/// Padding and room of a detour, and the edge of the cells.
const ROOM_M: f64 = 0.1 + 0.1 + 0.07;

fn reached(run: &Run) -> bool {
    matches!(run.end, Some((GoalEnd::Succeeded, _)))
}

/// Returns how many of those with room were reached, and how many were not.
fn drive_gauntlets(seeds: impl Iterator<Item = u64>) -> [usize; 2] {
    let (mut with_room, mut without) = ([0, 0], [0, 0]);
    let (mut changed, mut least_gap_m) = (0, f64::INFINITY);
    for seed in seeds {
        let (setting, posts, corridor_m) = gauntlet(seed);
        let room = leaves_room(&setting, &posts, corridor_m, ROOM_M);
        let config = CostmapConfig {
            corridor_m,
            ..CostmapConfig::default()
        };
        let run = drive(setting, posts, config);
        assert!(run.least_gap_m > 0.0, "seed {seed}: {run:?}");
        if room != reached(&run) || run.stops > 0 && room {
            println!("seed {seed}: room {room}, corridor {corridor_m:.2} m, {run:?}");
        }
        least_gap_m = least_gap_m.min(run.least_gap_m);
        changed += usize::from(run.passed > 0);
        let counts = if room { &mut with_room } else { &mut without };
        counts[usize::from(reached(&run))] += 1;
    }
    println!(
        "with room {} reached and {} aborted, without {} and {}, {changed} with a change of course, least gap \
         {least_gap_m:.3} m",
        with_room[1], with_room[0], without[1], without[0]
    );
    [with_room[1], with_room[0]]
}

#[test]
fn posts_are_passed_where_a_course_leaves_room() {
    let has_room = |seed: &u64| {
        let (setting, posts, corridor_m) = gauntlet(*seed);
        leaves_room(&setting, &posts, corridor_m, ROOM_M)
    };
    let reached = drive_gauntlets((0..).filter(has_room).take(4));
    assert_eq!(reached, [4, 0]);
}

/// `cargo test --release -p sidehill-bridge --lib _runs -- --ignored --nocapture`.
#[test]
#[ignore = "takes minutes: four of them are always run"]
fn posts_are_passed_in_two_hundred_random_runs() {
    drive_gauntlets(3000..3200);
}

/// Ground that slides by a share of the speed towards a post with so much room beside the vehicle, m.
fn slide(right_share: f64, room_m: f64) -> Run {
    let setting = Setting {
        path: arc(0.0, 12.0),
        speed_m_s: 0.5,
        slope_deg: 0.0,
        uphill_deg: 0.0,
        contact: false,
        slippery: Some(Slippery {
            from_m: 4.0,
            to_m: 6.0,
            right_share,
        }),
    };
    let post = setting.post(60, j8().base_half_width_m + room_m + 0.2, 0.2);
    let config = CostmapConfig {
        corridor_m: 0.7,
        ..CostmapConfig::default()
    };
    drive(setting, vec![post], config)
}

#[test]
fn a_vehicle_that_slides_towards_a_post_is_steered_back_or_stops() {
    let run = slide(0.1, 0.3);
    assert!(reached(&run) && run.stops == 0, "{run:?}");
    let run = slide(0.3, 0.3);
    assert!(run.stops > 0 && run.least_gap_m > 0.0, "{run:?}");
    assert!(run.passed <= 2, "{run:?}");
}

/// `cargo test --release -p sidehill-bridge --lib slides -- --ignored --nocapture`.
#[test]
#[ignore = "a table"]
fn slides() {
    for room_m in [0.15, 0.22, 0.3, 0.4] {
        for right_share in [0.05, 0.1, 0.2, 0.3, 0.5] {
            let run = slide(right_share, room_m);
            println!("room {room_m} m, slide {right_share}: {run:?}");
        }
    }
}
