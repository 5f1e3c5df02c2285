//! A map of residual slip by place and direction of travel, of bounded size.

use super::settings::MemoryConfig;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use sidehill_plant::frames::{PlanarPose, wrap_angle};
use std::f64::consts::TAU;

/// Cells at most: 300 m of way in cells of 0.3 m, with the neighbours that noise reaches.
const CELLS: usize = 4096;
/// Slots of the table, so that it stays sparse.
const SLOTS: usize = 2 * CELLS;
/// Directions of travel that are told apart.
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
    /// Residual velocity to the right and ahead, m/s, and yaw rate, rad/s.
    pub residual: [f64; 3],
    /// Visits that it comes from.
    pub visits: u32,
}

#[derive(Debug, Clone, Copy)]
struct Slot {
    cell: Cell,
    /// What earlier visits left.
    before: Vector3<f64>,
    /// Mean and number of the measurements of this visit.
    mean: Vector3<f64>,
    count: u32,
    /// Time of the last measurement, s.
    time_s: f64,
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

    /// Takes in a residual velocity (right, forward, yaw rate) that was measured at a place. A full map
    /// learns no new places.
    pub(crate) fn learn(&mut self, place: &PlanarPose, residual: &Vector3<f64>, time_s: f64) {
        let (slide, yaw) = (self.config.slide_max_m_s, self.config.yaw_rate_max_rad_s);
        let bounded = Vector3::new(
            residual.x.clamp(-slide, slide),
            residual.y.clamp(-slide, slide),
            residual.z.clamp(-yaw, yaw),
        );
        if !bounded.iter().all(|value| value.is_finite()) {
            return;
        }
        let Some(index) = self.slot(&self.key(place)) else {
            return;
        };
        let new_share = self.config.new_share;
        if self.slots[index].is_none() {
            if self.used == CELLS {
                return;
            }
            self.used += 1;
        }
        let key = self.key(place);
        let slot = self.slots[index].get_or_insert(Slot {
            cell: Cell {
                key,
                residual: [0.0; 3],
                visits: 0,
            },
            before: Vector3::zeros(),
            mean: Vector3::zeros(),
            count: 0,
            time_s: f64::NEG_INFINITY,
        });
        if !((0.0..VISIT_S).contains(&(time_s - slot.time_s))) {
            slot.before = Vector3::from(slot.cell.residual);
            slot.mean = Vector3::zeros();
            slot.count = 0;
            slot.cell.visits += 1;
        }
        slot.time_s = time_s;
        slot.count += 1;
        slot.mean += (bounded - slot.mean) / f64::from(slot.count);
        let known = if slot.cell.visits == 1 {
            slot.mean
        } else {
            (1.0 - new_share) * slot.before + new_share * slot.mean
        };
        slot.cell.residual = known.into();
    }

    /// Returns the residual velocity at a place (right, forward, yaw rate): a weighted mean of its cell and
    /// those around it, less where little is known.
    pub(crate) fn at(&self, place: &PlanarPose) -> Vector3<f64> {
        let edge = self.config.cell_m;
        let (mut sum, mut total) = (Vector3::zeros(), 0.0);
        if self.used == 0 {
            return sum;
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
                    let middle = |cell: i32| (f64::from(cell) + 0.5) * edge;
                    let away = (middle(key.x) - place.x_m).hypot(middle(key.y) - place.y_m) / edge;
                    let heading = (f64::from(key.sector) + 0.5) * TAU / f64::from(SECTORS);
                    let turned =
                        wrap_angle(place.yaw_rad - heading).abs() * f64::from(SECTORS) / TAU;
                    let weight = (1.0 - (away / 2.0).powi(2)).max(0.0)
                        * (1.5 - turned).clamp(0.0, 1.0)
                        * f64::from(slot.count.clamp(1, 5));
                    sum += weight * Vector3::from(slot.cell.residual);
                    total += weight;
                }
            }
        }
        self.config.used_share * sum / total.max(2.0)
    }

    /// Returns all cells.
    pub(crate) fn cells(&self) -> Vec<Cell> {
        let slots = self.slots.iter().flatten();
        slots.map(|slot| slot.cell).collect()
    }

    /// Takes over cells that were learned before; what does not fit or is not finite is left out.
    pub(crate) fn recall(&mut self, cells: &[Cell]) {
        for cell in cells {
            if !cell.residual.iter().all(|value| value.is_finite()) || self.used == CELLS {
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
                before: Vector3::from(cell.residual),
                mean: Vector3::from(cell.residual),
                count: 5,
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

    fn drive(map: &mut PlaceMap, start_s: f64, slide_m_s: f64) {
        for i in 0..200 {
            let place = at(0.05 * f64::from(i), 0.3);
            let time_s = start_s + 0.05 * f64::from(i);
            map.learn(&place, &Vector3::new(slide_m_s, 0.0, 0.01), time_s);
        }
    }

    #[test]
    fn what_was_measured_at_a_place_is_known_there_and_in_that_direction_only() {
        let mut map = PlaceMap::new(MemoryConfig::default());
        assert_eq!(map.at(&at(5.0, 0.3)), Vector3::zeros());
        drive(&mut map, 0.0, 0.03);
        assert!((map.at(&at(5.0, 0.3)).x - 0.03).abs() < 1e-3);
        assert_eq!(map.at(&at(5.0, 0.3 + std::f64::consts::PI)).x, 0.0);
        assert_eq!(map.at(&at(15.0, 0.3)).x, 0.0);
    }

    #[test]
    fn later_visits_replace_earlier_ones_and_all_is_bounded() {
        let mut map = PlaceMap::new(MemoryConfig::default());
        drive(&mut map, 0.0, 0.04);
        drive(&mut map, 100.0, 0.0);
        assert!((map.at(&at(5.0, 0.3)).x - 0.02).abs() < 1e-3);
        drive(&mut map, 200.0, 50.0);
        assert!(map.at(&at(5.0, 0.3)).x <= 0.1);
        drive(&mut map, 300.0, f64::NAN);
        assert!(map.at(&at(5.0, 0.3)).x.is_finite());
    }

    #[test]
    fn a_full_map_goes_on_with_the_places_it_knows() {
        let mut map = PlaceMap::new(MemoryConfig::default());
        for i in 0..20_000 {
            map.learn(&at(f64::from(i), 0.3), &Vector3::new(0.01, 0.0, 0.0), 0.0);
        }
        assert!(map.used <= CELLS && map.cells().len() == map.used);
        let mut again = PlaceMap::new(MemoryConfig::default());
        again.recall(&map.cells());
        assert_eq!(again.used, map.used);
        assert!(again.at(&at(5.5, 0.3)).x > 0.0);
    }
}
