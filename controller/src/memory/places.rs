//! A map of what is known by place and heading, of bounded size.

use super::Evidence;
use super::settings::MemoryConfig;
use serde::{Deserialize, Serialize};
use sidehill_plant::frames::PlanarPose;
use std::f64::consts::TAU;

/// Cells at most: 200 m of way in cells of 0.2 m, with the neighbours that each measurement reaches.
pub(crate) const CELLS: usize = 4096;
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
    /// What was seen there.
    pub evidence: Evidence,
    /// Visits that it comes from.
    pub visits: u32,
}

#[derive(Debug, Clone, Copy)]
struct Slot {
    cell: Cell,
    /// What this visit has shown so far.
    visit: Evidence,
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

    /// Takes in what was seen at a place, shared out among the cells around it. A full map learns no new
    /// places.
    pub(crate) fn learn(&mut self, place: &PlanarPose, seen: &Evidence, time_s: f64) {
        if !seen.is_finite() {
            return;
        }
        for (key, share) in self.around(place) {
            if let Some(slot) = self.visit(&key, time_s) {
                slot.visit.add(share, seen);
            }
        }
    }

    /// Returns the slot of a cell that is driven over, a new one where there is room; a visit begins where
    /// it was not measured for a while.
    fn visit(&mut self, key: &Key, time_s: f64) -> Option<&mut Slot> {
        let index = self.slot(key)?;
        if self.slots[index].is_none() {
            if self.used == CELLS {
                return None;
            }
            self.used += 1;
            self.slots[index] = Some(Slot {
                cell: Cell {
                    key: *key,
                    evidence: Evidence::default(),
                    visits: 0,
                },
                visit: Evidence::default(),
                time_s: f64::NEG_INFINITY,
            });
        }
        let config = self.config;
        let slot = self.slots[index].as_mut()?;
        if !slot.visited_at(time_s) {
            slot.cell.evidence = slot.cell.evidence.after(&slot.visit, &config);
            slot.visit = Evidence::default();
            slot.cell.visits = slot.cell.visits.saturating_add(1);
        }
        slot.time_s = time_s;
        Some(slot)
    }

    /// Returns what the visits that are over have shown of a place.
    pub(crate) fn known(&self, place: &PlanarPose, time_s: f64) -> Evidence {
        let mut known = Evidence::default();
        if self.used == 0 {
            return known;
        }
        for (key, share) in self.around(place) {
            let slot = self.slot(&key).and_then(|index| self.slots[index].as_ref());
            let Some(slot) = slot else { continue };
            let cell = &slot.cell.evidence;
            if slot.visited_at(time_s) {
                known.add(share, cell);
            } else {
                known.add(share, &cell.after(&slot.visit, &self.config));
            }
        }
        known
    }

    /// Returns all cells.
    pub(crate) fn cells(&self) -> impl Iterator<Item = Cell> + '_ {
        self.slots.iter().flatten().map(|slot| Cell {
            evidence: slot.cell.evidence.after(&slot.visit, &self.config),
            ..slot.cell
        })
    }

    /// Takes over cells that were learned before; what does not fit or is not finite is left out.
    pub(crate) fn recall(&mut self, cells: &[Cell]) {
        for cell in cells {
            if !cell.evidence.is_finite() || self.used == CELLS {
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
                visit: Evidence::default(),
                time_s: f64::NEG_INFINITY,
            });
        }
    }

    /// Returns the eight cells whose middles are nearest to a place and its heading, and their shares of it,
    /// linear in each.
    fn around(&self, place: &PlanarPose) -> impl Iterator<Item = (Key, f64)> + use<> {
        let split = |at: f64| {
            let low = (at - 0.5).floor();
            (low as i32, at - 0.5 - low)
        };
        let edge = self.config.cell_m;
        let (x, x_share) = split(place.x_m / edge);
        let (y, y_share) = split(place.y_m / edge);
        let turn = place.yaw_rad.rem_euclid(TAU) / TAU * f64::from(SECTORS);
        let (sector, turn_share) = split(turn);
        (0..8).map(move |corner| {
            let one = |bit: i32| corner >> bit & 1;
            let part = |bit: i32, share: f64| if one(bit) == 1 { share } else { 1.0 - share };
            let key = Key {
                x: x + one(0),
                y: y + one(1),
                sector: (sector + one(2)).rem_euclid(SECTORS),
            };
            (
                key,
                part(0, x_share) * part(1, y_share) * part(2, turn_share),
            )
        })
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
    use nalgebra::Vector3;
    use sidehill_plant::slip_gains::SlipGains;

    fn at(x_m: f64, yaw_rad: f64) -> PlanarPose {
        PlanarPose {
            x_m,
            y_m: 0.1,
            yaw_rad,
        }
    }

    fn seen(slip_right: f64, error_m: f64) -> Evidence {
        let way_m = 0.05;
        Evidence {
            way_m,
            slip: [slip_right * way_m, 0.0, 0.0],
            terms_m: [0.1 * way_m, 0.0, 0.0, 0.0, 0.0],
            error_way_m: way_m,
            error_m2: error_m * way_m,
            ..Evidence::default()
        }
    }

    fn drive(map: &mut PlaceMap, start_s: f64, evidence: &Evidence) {
        for i in 0..200 {
            let place = at(0.05 * f64::from(i), 0.3);
            map.learn(&place, evidence, start_s + 0.05 * f64::from(i));
        }
    }

    #[test]
    fn the_next_visit_knows_the_slip_there_and_in_that_heading_only() {
        let mut map = PlaceMap::new(MemoryConfig::default());
        drive(&mut map, 0.0, &seen(0.1, 0.0));
        let slip = |map: &PlaceMap, x_m, yaw_rad, time_s, gains: &SlipGains| {
            map.known(&at(x_m, yaw_rad), time_s).slip_per_m(gains)
        };
        let none = SlipGains::zeros();
        // The visit to the last places is not over.
        assert_eq!(slip(&map, 9.9, 0.3, 10.0, &none), Vector3::zeros());
        let there = slip(&map, 5.0, 0.3, 100.0, &none);
        assert!((there.x - 0.1).abs() < 0.03 && there.y == 0.0, "{there}");
        let opposite = 0.3 + std::f64::consts::PI;
        assert_eq!(slip(&map, 5.0, opposite, 100.0, &none), Vector3::zeros());
        assert_eq!(slip(&map, 15.0, 0.3, 100.0, &none), Vector3::zeros());
        // Gains that explain it leave nothing.
        let mut gains = none;
        gains[(0, 0)] = 1.0;
        assert!(slip(&map, 5.0, 0.3, 100.0, &gains).norm() < 1e-12);
    }

    #[test]
    fn a_visit_counts_more_than_those_before_and_noise_averages_out() {
        let mut map = PlaceMap::new(MemoryConfig::default());
        let mut now = 0.0;
        let mut drive = |slip: f64| {
            drive(&mut map, 100.0 * now, &seen(slip, 0.0));
            now += 1.0;
            let known = map.known(&at(5.0, 0.3), 100.0 * now - 50.0);
            known.slip_per_m(&SlipGains::zeros()).x / known.share()
        };
        for _ in 0..10 {
            drive(0.1);
        }
        let noisy = drive(0.2);
        assert!((0.1..0.14).contains(&noisy), "{noisy}");
        let mut last = 0.0;
        for _ in 0..20 {
            last = drive(0.0);
        }
        assert!(last.abs() < 0.01, "{last}");
    }

    #[test]
    fn aims_add_up_within_bounds_and_are_forgotten() {
        let config = MemoryConfig::default();
        let mut map = PlaceMap::new(config);
        let mut aims_m = [0.0; 40];
        for (visit, aim_m) in aims_m.iter_mut().enumerate() {
            let error_m = if visit < 5 { 0.06 } else { 0.0 };
            drive(&mut map, 100.0 * visit as f64, &seen(0.0, error_m));
            let known = map.known(&at(5.0, 0.3), 100.0 * visit as f64 + 50.0);
            *aim_m = known.aim_right_m();
        }
        assert!((-0.048..-0.03).contains(&aims_m[0]), "{aims_m:?}");
        assert!(aims_m[1] < 1.5 * aims_m[0], "{aims_m:?}");
        assert!(aims_m[4] < -0.85 * config.aim_max_m, "{aims_m:?}");
        assert!(aims_m.iter().all(|aim_m| aim_m.abs() <= config.aim_max_m));
        assert!(aims_m[39].abs() < 0.4 * config.aim_max_m, "{aims_m:?}");
        drive(&mut map, 5000.0, &seen(f64::NAN, 0.0));
        let known = map.known(&at(5.0, 0.3), 5050.0);
        assert!(known.slip_per_m(&SlipGains::zeros()).x.is_finite());
    }

    #[test]
    fn a_full_map_goes_on_with_the_places_it_knows() {
        let mut map = PlaceMap::new(MemoryConfig::default());
        for i in 0..20_000 {
            map.learn(&at(f64::from(i), 0.3), &seen(0.1, 0.0), 0.0);
        }
        assert!(map.used <= CELLS && map.cells().count() == map.used);
        let mut again = PlaceMap::new(MemoryConfig::default());
        let cells: Vec<Cell> = map.cells().collect();
        again.recall(&cells);
        assert_eq!(again.used, map.used);
        assert!(again.known(&at(5.0, 0.3), 0.0).way_m > 0.0);
    }
}
