use super::*;
use crate::server::test_data::j8;
use std::f64::consts::FRAC_PI_2;

const RULE: CellRule = CellRule {
    lethal_cost: 100,
    unknown_is_lethal: false,
};

/// A map of 10 m x 10 m around the origin of odom, with cells of 0.1 m.
fn grid() -> OccupancyGrid {
    let mut grid = OccupancyGrid::default();
    grid.header.frame_id = "odom".to_owned();
    grid.header.stamp.sec = 5;
    grid.info.resolution = 0.1;
    (grid.info.width, grid.info.height) = (100, 100);
    (grid.info.origin.position.x, grid.info.origin.position.y) = (-5.0, -5.0);
    grid.data = vec![0; 10_000];
    grid
}

fn at(x_m: f64, y_m: f64, yaw_rad: f64) -> PlanarPose {
    PlanarPose { x_m, y_m, yaw_rad }
}

fn blockage(map: &Costmap, pose: PlanarPose) -> Option<Blockage> {
    let footprint = Footprint::new(&[], 0.0, &j8());
    map.blockage(&footprint, &Isometry2::identity(), &pose)
}

#[test]
fn the_footprint_turns_with_the_vehicle() {
    let mut grid = grid();
    // The cell whose corners are 1.0 and 1.1 m in x and 0 and 0.1 m in y.
    grid.data[50 * 100 + 60] = 100;
    let map = Costmap::from_grid(grid, RULE).unwrap();
    // Half a metre wide to the right, and a metre long forward: along x it reaches the cell.
    assert_eq!(blockage(&map, at(0.0, 0.0, 0.0)), None);
    let along_x = at(0.0, 0.0, -FRAC_PI_2);
    assert_eq!(blockage(&map, along_x), Some(Blockage::Obstacle));
    // An obstacle at any place of the cell is seen.
    assert_eq!(blockage(&map, at(0.45, 0.0, 0.0)), Some(Blockage::Obstacle));
    assert_eq!(blockage(&map, at(0.3, 0.0, 0.0)), None);
    let edge = at(4.5, 0.0, 0.0);
    assert_eq!(blockage(&map, edge), Some(Blockage::MapEnds));
}

#[test]
fn what_counts_as_an_obstacle_is_configured() {
    for (cost, rule, seen) in [
        (99, RULE, false),
        (-1, RULE, false),
        (
            99,
            CellRule {
                lethal_cost: 99,
                ..RULE
            },
            true,
        ),
        (
            -1,
            CellRule {
                unknown_is_lethal: true,
                ..RULE
            },
            true,
        ),
    ] {
        let mut grid = grid();
        grid.data[50 * 100 + 50] = cost;
        let map = Costmap::from_grid(grid, rule).unwrap();
        let found = blockage(&map, at(0.0, 0.0, 0.0));
        assert_eq!(found.is_some(), seen, "{cost}, {rule:?}");
    }
}

#[test]
fn the_costs_of_nav2_become_those_of_a_grid() {
    assert_eq!(
        [0, 1, 252, 253, 254, 255].map(occupancy),
        [0, 1, 98, 99, 100, -1]
    );
    let mut message = message::Costmap::default();
    message.header.frame_id = "/odom".to_owned();
    message.metadata.resolution = 0.05;
    (message.metadata.size_x, message.metadata.size_y) = (2, 1);
    message.data = vec![254, 255];
    let mut map = Costmap::from_costmap(message, RULE).unwrap();
    assert_eq!(
        (map.costs.as_slice(), map.frame.as_str()),
        (&[100, -1][..], "odom")
    );
    assert_eq!(map.resolution_m, 0.05);
    let mut update = CostmapUpdate::default();
    update.header.frame_id = "odom".to_owned();
    (update.x, update.size_x, update.size_y) = (1, 1, 1);
    update.data = vec![254_u8 as i8];
    map.update_costmap(update).unwrap();
    assert_eq!(map.costs, [100, 100]);
}

#[test]
fn an_update_puts_an_obstacle_into_the_way_and_takes_it_out() {
    let mut map = Costmap::from_grid(grid(), RULE).unwrap();
    let here = at(0.0, 0.0, 0.0);
    assert_eq!(blockage(&map, here), None);
    for (sec, cost, seen) in [(6, 100, Some(Blockage::Obstacle)), (7, 99, None)] {
        let mut update = OccupancyGridUpdate::default();
        update.header.frame_id = "odom".to_owned();
        update.header.stamp.sec = sec;
        (update.x, update.y, update.width, update.height) = (50, 50, 1, 1);
        update.data = vec![cost];
        map.update_grid(update).unwrap();
        assert_eq!(blockage(&map, here), seen);
    }
}

#[test]
fn an_update_changes_its_part_and_an_old_one_nothing() {
    let mut map = Costmap::from_grid(grid(), RULE).unwrap();
    let mut update = OccupancyGridUpdate::default();
    update.header.frame_id = "odom".to_owned();
    update.header.stamp.sec = 6;
    (update.x, update.y, update.width, update.height) = (98, 99, 2, 1);
    update.data = vec![7, 8];
    map.update_grid(update.clone()).unwrap();
    assert_eq!(
        (map.costs[9998], map.costs[9999], map.stamp_ns),
        (7, 8, 6_000_000_000)
    );
    let mut old = update.clone();
    old.header.stamp.sec = 5;
    old.data = vec![1, 1];
    map.update_grid(old).unwrap();
    assert_eq!(map.costs[9998], 7);
    for change in [
        |update: &mut OccupancyGridUpdate| update.x = 99,
        |update: &mut OccupancyGridUpdate| update.y = -1,
        |update: &mut OccupancyGridUpdate| update.data.push(0),
        |update: &mut OccupancyGridUpdate| update.header.frame_id = "map".to_owned(),
    ] {
        let mut wrong = update.clone();
        change(&mut wrong);
        assert_eq!(map.update_grid(wrong), Err(CostmapError::Update));
    }
}

#[test]
fn a_map_that_cannot_be_read_is_refused_with_the_reason() {
    let reason = |change: fn(&mut OccupancyGrid)| {
        let mut grid = grid();
        change(&mut grid);
        Costmap::from_grid(grid, RULE).unwrap_err().to_string()
    };
    assert!(reason(|grid| grid.info.width = 99).contains("99 x 100 cells with 10000 costs"));
    assert!(reason(|grid| grid.info.resolution = 0.0).contains("resolution is 0 m"));
    assert!(reason(|grid| grid.info.resolution = f32::NAN).contains("resolution"));
    assert!(reason(|grid| grid.header.frame_id.clear()).contains("frame"));
    assert!(reason(|grid| grid.info.origin.position.x = f64::NAN).contains("position"));
}

#[test]
fn obstacles_are_rows_of_cells_that_block() {
    let mut grid = grid();
    // Three cells from 1.0 to 1.3 m in x, and one beside them after a free one, from 0 to 0.1 m in y.
    for column in [60, 61, 62, 64] {
        grid.data[50 * 100 + column] = 100;
    }
    let map = Costmap::from_grid(grid, RULE).unwrap();
    let close = |found: &Obstacles, expected: &[[[f64; 2]; 2]]| {
        assert_eq!(found.rows.len(), expected.len(), "{found:?}");
        let pairs = found.rows.iter().flatten().zip(expected.iter().flatten());
        for (place, expected) in pairs {
            assert!((place[0] - expected[0]).hypot(place[1] - expected[1]) < 1e-9);
        }
    };
    let found = map.obstacles(&Isometry2::identity());
    assert_eq!(found.cell_m, 0.1);
    close(
        &found,
        &[[[1.0, 0.05], [1.3, 0.05]], [[1.4, 0.05], [1.5, 0.05]]],
    );
    // In a frame in which that of the map is 2 m ahead, turned to the left.
    let turned = Isometry2::new(Vector2::new(2.0, 0.0), FRAC_PI_2);
    close(
        &map.obstacles(&turned),
        &[[[1.95, 1.0], [1.95, 1.3]], [[1.95, 1.4], [1.95, 1.5]]],
    );
}

#[test]
fn many_obstacles_are_merged_and_none_is_left_out() {
    let mut grid = grid();
    // A chequered ground.
    for (i, cost) in grid.data.iter_mut().enumerate() {
        *cost = if (i + i / 100) % 2 == 0 { 100 } else { 0 };
    }
    let map = Costmap::from_grid(grid, RULE).unwrap();
    let found = map.obstacles(&Isometry2::identity());
    assert!(found.rows.len() <= OBSTACLE_ROWS_MAX);
    assert_eq!((found.cell_m, found.rows.len()), (0.2, 50));
    assert!(found.rows.iter().all(|[from, to]| to[0] - from[0] > 9.99));
}
