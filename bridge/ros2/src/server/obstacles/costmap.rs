//! A costmap as it was received.

use super::footprint::Footprint;
use nalgebra::{Isometry2, Isometry3, Point2, Vector2};
use sidehill_bridge::ros2::conversions::{MessageError, from_pose, nanoseconds};
use sidehill_bridge::ros2::message::{
    self, CostmapUpdate, Header, OccupancyGrid, OccupancyGridUpdate, Pose,
};
use sidehill_plant::frames::PlanarPose;
use sidehill_recording::Obstacles;

/// Most cells of a costmap.
const CELLS_MAX: usize = 4_000_000;
/// Finest and coarsest resolution, m.
const RESOLUTION_M: std::ops::RangeInclusive<f64> = 0.01..=1.0;
/// Most rows of cells that are shown.
const OBSTACLE_ROWS_MAX: usize = 300;

/// Why a costmap is not used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(crate) enum CostmapError {
    /// A pose or stamp in it.
    #[error("{0}")]
    Message(#[from] MessageError),
    /// Its size.
    #[error("{width} x {height} cells with {values} costs, at most {CELLS_MAX} cells are read")]
    Size {
        width: u32,
        height: u32,
        values: usize,
    },
    /// Its resolution.
    #[error("the resolution is {0} m, must be from 0.01 to 1 m")]
    Resolution(f64),
    /// Its header.
    #[error("there is no frame")]
    NoFrame,
    /// An update beyond the edge of the map, of another frame, or before the first map.
    #[error("an update does not fit the map")]
    Update,
}

/// What keeps the vehicle from a pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Blockage {
    /// A lethal cell within the footprint.
    Obstacle,
    /// The footprint reaches beyond the costmap.
    MapEnds,
}

/// Which cells block.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CellRule {
    /// Least cost of an obstacle, from 1 to 100.
    pub(crate) lethal_cost: i8,
    /// Whether unknown cells are obstacles.
    pub(crate) unknown_is_lethal: bool,
}

impl CellRule {
    fn blocks(self, cost: i8) -> bool {
        cost >= self.lethal_cost || (cost < 0 && self.unknown_is_lethal)
    }
}

/// Costs on the scale of OccupancyGrid (0 free, 100 lethal, negative unknown) in a frame.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Costmap {
    /// Frame of the map.
    pub(crate) frame: String,
    /// Stamp of the newest message, ns.
    pub(crate) stamp_ns: i64,
    resolution_m: f64,
    width: usize,
    height: usize,
    frame_from_cells: Isometry2<f64>,
    costs: Vec<i8>,
    rule: CellRule,
    blocking: BlockingCells,
}

/// The cells that block, row by row: few of all, and a check looks at them alone.
#[derive(Debug, Clone, PartialEq, Default)]
struct BlockingCells {
    /// Where each row begins among the columns, and the end of the last.
    starts: Vec<usize>,
    columns: Vec<usize>,
}

impl BlockingCells {
    fn find(&mut self, costs: &[i8], width: usize, rule: CellRule) {
        self.columns.clear();
        self.starts.clear();
        self.starts.push(0);
        for row in costs.chunks_exact(width) {
            let blocking = row
                .iter()
                .enumerate()
                .filter(|(_, cost)| rule.blocks(**cost));
            self.columns.extend(blocking.map(|(column, _)| column));
            self.starts.push(self.columns.len());
        }
    }

    /// Returns those of a row, in order.
    fn of_row(&self, row: usize) -> &[usize] {
        &self.columns[self.starts[row]..self.starts[row + 1]]
    }
}

impl Costmap {
    /// Returns the map of a nav_msgs/OccupancyGrid.
    pub(crate) fn from_grid(grid: OccupancyGrid, rule: CellRule) -> Result<Self, CostmapError> {
        let info = grid.info;
        let shape = (info.width, info.height, f64::from(info.resolution));
        Self::new(&grid.header, shape, &info.origin, (grid.data, rule))
    }

    /// Returns the map of a nav2_msgs/Costmap.
    pub(crate) fn from_costmap(
        map: message::Costmap,
        rule: CellRule,
    ) -> Result<Self, CostmapError> {
        let info = map.metadata;
        let shape = (info.size_x, info.size_y, f64::from(info.resolution));
        let costs = map.data.into_iter().map(occupancy).collect();
        Self::new(&map.header, shape, &info.origin, (costs, rule))
    }

    fn new(
        header: &Header,
        (width, height, resolution_m): (u32, u32, f64),
        origin: &Pose,
        (costs, rule): (Vec<i8>, CellRule),
    ) -> Result<Self, CostmapError> {
        let cells = (width as usize).checked_mul(height as usize);
        if cells != Some(costs.len()) || costs.is_empty() || costs.len() > CELLS_MAX {
            let values = costs.len();
            return Err(CostmapError::Size {
                width,
                height,
                values,
            });
        }
        // The message has 32 bits.
        let resolution_m = (1e6 * resolution_m).round() / 1e6;
        if !RESOLUTION_M.contains(&resolution_m) {
            return Err(CostmapError::Resolution(resolution_m));
        }
        let frame = header.frame_id.trim_start_matches('/');
        if frame.is_empty() {
            return Err(CostmapError::NoFrame);
        }
        let mut blocking = BlockingCells::default();
        blocking.find(&costs, width as usize, rule);
        Ok(Self {
            frame: frame.to_owned(),
            stamp_ns: nanoseconds(header.stamp)?,
            resolution_m,
            width: width as usize,
            height: height as usize,
            frame_from_cells: level(&from_pose(origin)?),
            costs,
            rule,
            blocking,
        })
    }

    /// Takes a map_msgs/OccupancyGridUpdate.
    pub(crate) fn update_grid(&mut self, update: OccupancyGridUpdate) -> Result<(), CostmapError> {
        let corner = [update.x, update.y].map(|at| usize::try_from(at).unwrap_or(usize::MAX));
        let size = [update.width, update.height].map(|size| size as usize);
        self.update(&update.header, corner, size, update.data)
    }

    /// Takes a nav2_msgs/CostmapUpdate.
    pub(crate) fn update_costmap(&mut self, update: CostmapUpdate) -> Result<(), CostmapError> {
        let corner = [update.x, update.y].map(|at| at as usize);
        let size = [update.size_x, update.size_y].map(|size| size as usize);
        // The message declares the costs as int8, and carries those of uint8 in them.
        let costs = update.data.into_iter().map(|cost| occupancy(cost as u8));
        self.update(&update.header, corner, size, costs.collect())
    }

    fn update(
        &mut self,
        header: &Header,
        [x, y]: [usize; 2],
        [width, height]: [usize; 2],
        costs: Vec<i8>,
    ) -> Result<(), CostmapError> {
        let stamp_ns = nanoseconds(header.stamp)?;
        // Maps and updates come on topics of their own: this one is in the map already.
        if stamp_ns < self.stamp_ns {
            return Ok(());
        }
        let fits =
            |at: usize, size: usize, whole| at.checked_add(size).is_some_and(|end| end <= whole);
        if header.frame_id.trim_start_matches('/') != self.frame
            || !fits(x, width, self.width)
            || !fits(y, height, self.height)
            || costs.len() != width * height
        {
            return Err(CostmapError::Update);
        }
        self.stamp_ns = stamp_ns;
        if width > 0 {
            for (row, costs) in costs.chunks_exact(width).enumerate() {
                let from = (y + row) * self.width + x;
                self.costs[from..from + width].copy_from_slice(costs);
            }
            self.blocking.find(&self.costs, self.width, self.rule);
        }
        Ok(())
    }

    /// Returns what is in the way of a footprint at a pose, which `frame_from_pose` takes into the frame of
    /// the map.
    ///
    /// A cell blocks where the padded footprint reaches any of it, so no obstacle in a lethal cell is
    /// missed, wherever in the cell it is.
    pub(crate) fn blockage(
        &self,
        footprint: &Footprint,
        frame_from_pose: &Isometry2<f64>,
        pose: &PlanarPose,
    ) -> Option<Blockage> {
        let place = self.place(frame_from_pose, pose);
        let [width_m, height_m] = [self.width, self.height].map(|n| n as f64 * self.resolution_m);
        let within = footprint.corners().iter().all(|[to_right, ahead]| {
            let corner = place.centre + *to_right * place.right + *ahead * place.forward;
            (0.0..=width_m).contains(&corner.x) && (0.0..=height_m).contains(&corner.y)
        });
        if !within {
            return Some(Blockage::MapEnds);
        }
        self.is_hit_at(footprint, &place)
            .then_some(Blockage::Obstacle)
    }

    /// Returns whether a footprint at a pose reaches a cell that blocks, as in [`Costmap::blockage`]; what is
    /// beyond the map does not count.
    pub(crate) fn is_hit(
        &self,
        footprint: &Footprint,
        frame_from_pose: &Isometry2<f64>,
        pose: &PlanarPose,
    ) -> bool {
        self.is_hit_at(footprint, &self.place(frame_from_pose, pose))
    }

    /// Returns the cells that block, in the frame that `frame_from_map` takes the frame of the map into. Where their
    /// rows are too many, cells are merged, and a cell blocks where any of its parts does.
    pub(crate) fn obstacles(&self, frame_from_map: &Isometry2<f64>) -> Obstacles {
        let frame_from_cells = frame_from_map * self.frame_from_cells;
        let (mut merged, mut rows) = (1, self.blocking_rows(1));
        while rows.len() > OBSTACLE_ROWS_MAX {
            merged *= 2;
            rows = self.blocking_rows(merged);
        }
        let cell_m = merged as f64 * self.resolution_m;
        let place = |column: usize, row: usize| {
            let place = Point2::new(column as f64, row as f64 + 0.5) * cell_m;
            (frame_from_cells * place).into()
        };
        let rows = rows.into_iter();
        Obstacles {
            cell_m,
            rows: rows
                .map(|(row, from, to)| [place(from, row), place(to, row)])
                .collect(),
        }
    }

    /// Returns each row of cells that block, with its first column and that after its last, of cells that are squares
    /// of so many; some of them where there are more than [`OBSTACLE_ROWS_MAX`].
    fn blocking_rows(&self, merged: usize) -> Vec<(usize, usize, usize)> {
        let mut rows = Vec::new();
        let mut blocks = vec![false; self.width.div_ceil(merged)];
        for row in 0..self.height.div_ceil(merged) {
            if rows.len() > OBSTACLE_ROWS_MAX {
                break;
            }
            blocks.fill(false);
            let within = row * merged..self.height.min((row + 1) * merged);
            for column in within.flat_map(|row| self.blocking.of_row(row)) {
                blocks[column / merged] = true;
            }
            let mut end = 0;
            for run in blocks.chunk_by(|left, right| left == right) {
                let from = end;
                end += run.len();
                if run[0] {
                    rows.push((row, from, end));
                }
            }
        }
        rows
    }

    fn place(&self, frame_from_pose: &Isometry2<f64>, pose: &PlanarPose) -> CellPose {
        let cells_from_pose = self.frame_from_cells.inverse() * frame_from_pose;
        let (sin, cos) = (cells_from_pose.rotation.angle() + pose.yaw_rad).sin_cos();
        CellPose {
            centre: cells_from_pose * Point2::new(pose.x_m, pose.y_m),
            right: Vector2::new(cos, sin),
            forward: Vector2::new(-sin, cos),
        }
    }

    fn is_hit_at(&self, footprint: &Footprint, place: &CellPose) -> bool {
        let CellPose {
            centre,
            right,
            forward,
        } = *place;
        let half_diagonal_m = self.resolution_m * std::f64::consts::FRAC_1_SQRT_2;
        let reach_m = footprint.reach_m() + half_diagonal_m;
        let span = |at_m: f64, count: usize| {
            let index = |at_m: f64| (at_m / self.resolution_m).floor().max(0.0) as usize;
            index(at_m - reach_m).min(count)..(index(at_m + reach_m) + 1).min(count)
        };
        let columns = span(centre.x, self.width);
        for row in span(centre.y, self.height) {
            let blocking = self.blocking.of_row(row);
            let first = blocking.partition_point(|column| *column < columns.start);
            let near = blocking[first..].iter();
            for &column in near.take_while(|column| columns.contains(column)) {
                let at = [column, row].map(|index| (index as f64 + 0.5) * self.resolution_m);
                let offset = Point2::from(at) - centre;
                if footprint.covers([offset.dot(&right), offset.dot(&forward)], half_diagonal_m) {
                    return true;
                }
            }
        }
        false
    }
}

/// A pose in the axes of the cells, m from their corner.
struct CellPose {
    centre: Point2<f64>,
    right: Vector2<f64>,
    forward: Vector2<f64>,
}

/// Returns a cost of Nav2's costmaps on the scale of OccupancyGrid, as Nav2 itself publishes it: 255 is
/// unknown, 254 lethal, 253 inscribed (99), the others from 0 to 98.
fn occupancy(cost: u8) -> i8 {
    match cost {
        0 => 0,
        255 => -1,
        254 => 100,
        253 => 99,
        _ => (1 + 97 * (i32::from(cost) - 1) / 251) as i8,
    }
}

/// Returns the level part of a pose.
pub(crate) fn level(pose: &Isometry3<f64>) -> Isometry2<f64> {
    let ahead = pose.rotation * nalgebra::Vector3::x();
    let at = pose.translation.vector;
    Isometry2::new(Vector2::new(at.x, at.y), ahead.y.atan2(ahead.x))
}

#[cfg(test)]
mod tests;
