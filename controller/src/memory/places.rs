//! A map of where to aim, by place and heading, of bounded size.

use super::settings::MemoryConfig;
use serde::{Deserialize, Serialize};
use sidehill_plant::frames::{PlanarPose, wrap_angle};
use std::f64::consts::TAU;

/// Cells at most: 300 m of way in cells of 0.3 m, with the neighbours that noise reaches.
const CELLS: usize = 4096;
/// Slots of the table, so that it stays sparse.
const SLOTS: usize = 2 * CELLS;
/// Number of directions of travel that are distinguished.
const SECTORS: i32 = 8;
/// Time without a measurement after which the next belongs to a new visit, s.
const VISIT_S: f64 = 5.0;

/// Where a cell is, and which way it is driven over.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Key {
    /// X_g in cells.
    pub x: i32,
    /// Y_g in cells.
    pub y: i32,
    /// Heading in eighths of a turn, from 0.
    pub sector: i32,
}

/// What is known of a place.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cell {
    /// Where it is.
    pub key: Key,
    /// How far to the right of the path the vehicle aims there, m.
    pub aim_right_m: f64,
    /// Visits that it comes from.
    pub visits: u32,
}

#[derive(Debug, Clone, Copy)]
struct Slot {
    cell: Cell,
    /// Aim when this visit began, which holds until it is over, m to the right.
    before_m: f64,
    /// Mean error of this visit, m to the right, and the number of measurements.
    error_m: f64,
    errors: u32,
    /// Time of the last measurement, s.
    time_s: f64,
}

impl Slot {
    fn visited_at(&self, time_s: f64) -> bool {
        (0.0..VISIT_S).contains(&(time_s - self.time_s))
    }
}

/// The map; nothing is allocated after [`PlaceMap::new`].
#[derive(Debug, Clone)]
pub(crate) struct PlaceMap {
    config: MemoryConfig,
    slots: Vec<Option<Slot>>,
    used: usize,
}

impl PlaceMap {
    pub(crate) fn new(config: MemoryConfig) -> Self {
        Self {
            config,
            slots: vec![None; SLOTS],
            used: 0,
        }
    }

    /// Takes in how far to the right of its path the vehicle was at a place of it. A full map learns no new
    /// places.
    pub(crate) fn learn(&mut self, place: &PlanarPose, right_m: f64, time_s: f64) {
        let MemoryConfig {
            error_share,
            kept_share,
            aim_max_m,
            ..
        } = self.config;
        if !right_m.is_finite() {
            return;
        }
        let Some(slot) = self.visit(place, time_s) else {
            return;
        };
        slot.errors += 1;
        slot.error_m += (right_m - slot.error_m) / f64::from(slot.errors);
        let aim_m = kept_share * slot.before_m - error_share * slot.error_m;
        slot.cell.aim_right_m = aim_m.clamp(-aim_max_m, aim_max_m);
    }

    /// Returns the slot of a place that is driven over, a new one where there is room; a visit begins where
    /// it was not measured for a while.
    fn visit(&mut self, place: &PlanarPose, time_s: f64) -> Option<&mut Slot> {
        let key = self.key(place);
        let index = self.slot(&key)?;
        let under_way = self.slots[index].is_some_and(|slot| slot.visited_at(time_s));
        if !under_way {
            let before_m = self.aim_right_m(place, time_s);
            let visits = match &self.slots[index] {
                Some(slot) => slot.cell.visits.saturating_add(1),
                None if self.used == CELLS => return None,
                None => {
                    self.used += 1;
                    1
                }
            };
            self.slots[index] = Some(Slot {
                cell: Cell {
                    key,
                    aim_right_m: before_m,
                    visits,
                },
                before_m,
                error_m: 0.0,
                errors: 0,
                time_s,
            });
        }
        let slot = self.slots[index].as_mut()?;
        slot.time_s = time_s;
        Some(slot)
    }

    /// Returns how far to the right of a place of the path to aim, by the visits that are over, m: a weighted
    /// mean of its cell and those around it, less where little is known.
    pub(crate) fn aim_right_m(&self, place: &PlanarPose, time_s: f64) -> f64 {
        let edge = self.config.cell_m;
        let (mut sum_m, mut total) = (0.0, 0.0);
        if self.used == 0 {
            return 0.0;
        }
        let centre = self.key(place);
        for dx in -2..=2 {
            for dy in -2..=2 {
                for turn in -1..=1 {
                    let key = Key {
                        x: centre.x + dx,
                        y: centre.y + dy,
                        sector: (centre.sector + turn).rem_euclid(SECTORS),
                    };
                    let Some(slot) = self.slot(&key).and_then(|index| self.slots[index].as_ref())
                    else {
                        continue;
                    };
                    let visited = slot.visited_at(time_s);
                    if visited && slot.cell.visits == 1 {
                        continue;
                    }
                    let aim_m = if visited {
                        slot.before_m
                    } else {
                        slot.cell.aim_right_m
                    };
                    let middle = |cell: i32| (f64::from(cell) + 0.5) * edge;
                    let away = (middle(key.x) - place.x_m).hypot(middle(key.y) - place.y_m) / edge;
                    let heading = (f64::from(key.sector) + 0.5) * TAU / f64::from(SECTORS);
                    let turned =
                        wrap_angle(place.yaw_rad - heading).abs() * f64::from(SECTORS) / TAU;
                    let weight =
                        (1.0 - (away / 2.0).powi(2)).max(0.0) * (1.5 - turned).clamp(0.0, 1.0);
                    sum_m += weight * aim_m;
                    total += weight;
                }
            }
        }
        sum_m / total.max(1.0)
    }

    /// Returns all cells.
    pub(crate) fn cells(&self) -> Vec<Cell> {
        let slots = self.slots.iter().flatten();
        slots.map(|slot| slot.cell).collect()
    }

    /// Takes over cells that were learned before; what does not fit or is not finite is left out.
    pub(crate) fn recall(&mut self, cells: &[Cell]) {
        for cell in cells {
            if !cell.aim_right_m.is_finite() || self.used == CELLS {
                continue;
            }
            let Some(index) = self.slot(&cell.key) else {
                continue;
            };
            if self.slots[index].is_none() {
                self.used += 1;
            }
            self.slots[index] = Some(Slot {
                cell: *cell,
                before_m: cell.aim_right_m,
                error_m: 0.0,
                errors: 0,
                time_s: f64::NEG_INFINITY,
            });
        }
    }

    fn key(&self, place: &PlanarPose) -> Key {
        let cell = |at_m: f64| (at_m / self.config.cell_m).floor() as i32;
        let turn = place.yaw_rad.rem_euclid(TAU) / TAU * f64::from(SECTORS);
        Key {
            x: cell(place.x_m),
            y: cell(place.y_m),
            sector: (turn as i32).min(SECTORS - 1),
        }
    }

    /// Returns the slot of a key: its own, or the free one where it would be; none where neither is near.
    fn slot(&self, key: &Key) -> Option<usize> {
        /// Slots looked at for a key.
        const PROBES: usize = 32;
        let hash = (key.x as u32)
            .wrapping_mul(0x9E37_79B1)
            .wrapping_add((key.y as u32).wrapping_mul(0x85EB_CA77))
            .wrapping_add((key.sector as u32).wrapping_mul(0xC2B2_AE3D));
        let begin = (hash ^ (hash >> 15)) as usize;
        (0..PROBES)
            .map(|probe| (begin + probe) % SLOTS)
            .find(|&index| match &self.slots[index] {
                None => true,
                Some(slot) => slot.cell.key == *key,
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x_m: f64, yaw_rad: f64) -> PlanarPose {
        PlanarPose {
            x_m,
            y_m: 0.1,
            yaw_rad,
        }
    }

    fn drive(map: &mut PlaceMap, start_s: f64, right_m: f64) {
        for i in 0..200 {
            let place = at(0.05 * f64::from(i), 0.3);
            map.learn(&place, right_m, start_s + 0.05 * f64::from(i));
        }
    }

    #[test]
    fn the_next_visit_aims_against_the_error_there_and_in_that_heading_only() {
        let mut map = PlaceMap::new(MemoryConfig::default());
        drive(&mut map, 0.0, 0.05);
        // The visit to the last places is not over.
        assert_eq!(map.aim_right_m(&at(9.9, 0.3), 10.0), 0.0);
        let aim_m = |map: &PlaceMap, x_m, yaw_rad| map.aim_right_m(&at(x_m, yaw_rad), 100.0);
        assert!((aim_m(&map, 5.0, 0.3) + 0.04).abs() < 1e-3);
        assert_eq!(aim_m(&map, 5.0, 0.3 + std::f64::consts::PI), 0.0);
        assert_eq!(aim_m(&map, 15.0, 0.3), 0.0);
    }

    #[test]
    fn visits_add_up_within_bounds_and_are_forgotten() {
        let config = MemoryConfig::default();
        let mut map = PlaceMap::new(config);
        let mut aims_m = [0.0; 40];
        for (visit, aim_m) in aims_m.iter_mut().enumerate() {
            let right_m = if visit < 5 { 0.06 } else { 0.0 };
            drive(&mut map, 100.0 * visit as f64, right_m);
            *aim_m = map.aim_right_m(&at(5.0, 0.3), 100.0 * visit as f64 + 50.0);
        }
        assert!(aims_m[1] < 1.5 * aims_m[0], "{aims_m:?}");
        assert!((aims_m[4] + config.aim_max_m).abs() < 1e-3, "{aims_m:?}");
        assert!(aims_m[39].abs() < 0.4 * config.aim_max_m, "{aims_m:?}");
        drive(&mut map, 5000.0, f64::NAN);
        assert!(map.aim_right_m(&at(5.0, 0.3), 5050.0).is_finite());
    }

    #[test]
    fn a_full_map_goes_on_with_the_places_it_knows() {
        let mut map = PlaceMap::new(MemoryConfig::default());
        for i in 0..20_000 {
            map.learn(&at(f64::from(i), 0.3), 0.05, 0.0);
        }
        assert!(map.used <= CELLS && map.cells().len() == map.used);
        let mut again = PlaceMap::new(MemoryConfig::default());
        again.recall(&map.cells());
        assert_eq!(again.used, map.used);
        assert!(again.aim_right_m(&at(5.0, 0.3), 0.0) < 0.0);
    }
}
