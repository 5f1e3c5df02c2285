//! Heights on a regular grid, interpolated with a continuous normal.

use super::{GridExtent, Surface, TerrainError, esri};
use std::sync::Arc;

/// Heights at the cell centres of a regular grid, joined by bicubic Hermite patches, so that height
/// and normal are continuous; defined between the outermost cell centres.
///
/// Derivatives at a node are central differences of its neighbours, one-sided where a neighbour is
/// missing, so that every plane is reproduced exactly.
#[derive(Debug, Clone)]
pub struct GridTerrain {
    columns: usize,
    rows: usize,
    cell_m: f64,
    /// Node of the last row's first column, the southwest, in the world.
    west_m: f64,
    south_m: f64,
    /// Row by row from the north as in the file; NaN is NODATA.
    heights_m: Arc<[f64]>,
}

/// Height at a node and its derivatives by column and northward row, in cells.
#[derive(Clone, Copy)]
struct GridNode {
    value: f64,
    by_u: f64,
    by_v: f64,
    by_uv: f64,
}

impl GridTerrain {
    /// Returns the grid of an ESRI ASCII grid's text: header lines `ncols`, `nrows`, `xllcorner` or
    /// `xllcenter`, `yllcorner` or `yllcenter`, `cellsize` or equal `dx` and `dy`, optionally `NODATA_value` (-9999 if
    /// absent; NaN always marks unknown ground), in any order and case, then the heights in m, the northernmost row first.
    ///
    /// The file's axes are the world's: x is X_g (east), y is Y_g (north).
    ///
    /// # Errors
    /// Names line, token and what was expected there; or the header value that is out of range (2
    /// to 20000 rows and columns, at most 16 million cells, cell size from 0.001 to 10000 m).
    pub fn parse(text: &str) -> Result<Self, TerrainError> {
        let esri::Grid {
            columns,
            rows,
            cell_m,
            west_m,
            south_m,
            heights_m,
        } = esri::parse(text)?;
        Ok(Self {
            columns,
            rows,
            cell_m,
            west_m,
            south_m,
            heights_m: heights_m.into(),
        })
    }

    /// Returns the grid moved so that the place (`east_m`, `north_m`) of its file becomes the
    /// world's origin; heights stay.
    pub fn with_origin_at(mut self, east_m: f64, north_m: f64) -> Self {
        self.west_m -= east_m;
        self.south_m -= north_m;
        self
    }

    /// Returns what the grid spans: the rectangle of its outermost cell centres.
    pub fn extent(&self) -> GridExtent {
        GridExtent {
            west_m: self.west_m,
            east_m: self.west_m + (self.columns - 1) as f64 * self.cell_m,
            south_m: self.south_m,
            north_m: self.south_m + (self.rows - 1) as f64 * self.cell_m,
        }
    }

    /// Returns row and column in the file, from 1 in the northwest, of the cell nearest to a place.
    pub fn cell_at(&self, x_m: f64, y_m: f64) -> (usize, usize) {
        let nearest = |m: f64, count: usize| {
            (m / self.cell_m).round().clamp(0.0, (count - 1) as f64) as usize
        };
        let column = nearest(x_m - self.west_m, self.columns);
        let northward = nearest(y_m - self.south_m, self.rows);
        (self.rows - northward, column + 1)
    }

    /// Returns what looks like a fault of the survey: a single cell far above or below those around it.
    pub fn suspicion(&self) -> Option<String> {
        /// Height over the neighbours' median that no ground has, m, and in cells.
        const SPIKE_M: f64 = 10.0;
        const SPIKE_CELLS: f64 = 3.0;
        let spike_m = SPIKE_M.max(SPIKE_CELLS * self.cell_m);
        let mut spikes = Vec::new();
        let mut around = Vec::with_capacity(8);
        for row in 0..self.rows {
            for column in 0..self.columns {
                let here_m = self.heights_m[row * self.columns + column];
                around.clear();
                for r in row.saturating_sub(1)..(row + 2).min(self.rows) {
                    for c in column.saturating_sub(1)..(column + 2).min(self.columns) {
                        let height_m = self.heights_m[r * self.columns + c];
                        if (r, c) != (row, column) && !height_m.is_nan() {
                            around.push(height_m);
                        }
                    }
                }
                around.sort_by(f64::total_cmp);
                let above_m = here_m - around.get(around.len() / 2).copied().unwrap_or(here_m);
                if around.len() >= 3 && above_m.abs() > spike_m {
                    spikes.push((row + 1, column + 1, above_m));
                }
            }
        }
        let &(row, column, above_m) = spikes.first()?;
        let more = match spikes.len() {
            1 => String::new(),
            count => format!(", and {} more cells like it", count - 1),
        };
        let side = if above_m > 0.0 { "above" } else { "below" };
        Some(format!(
            "row {row}, column {column} (from 1, northwest) is {:.1} m {side} the cells around it{more}; if that is no \
             ground, replace it by the NODATA value",
            above_m.abs()
        ))
    }

    pub(super) fn surface(&self, x_m: f64, y_m: f64) -> Result<Surface, TerrainError> {
        let u = (x_m - self.west_m) / self.cell_m;
        let v = (y_m - self.south_m) / self.cell_m;
        let (u_max, v_max) = ((self.columns - 1) as f64, (self.rows - 1) as f64);
        if !((0.0..=u_max).contains(&u) && (0.0..=v_max).contains(&v)) {
            return Err(TerrainError::OutsideGrid {
                x_m,
                y_m,
                extent: self.extent(),
            });
        }
        let column = (u as usize).min(self.columns - 2);
        let northward = (v as usize).min(self.rows - 2);
        let node = |i: usize, j: usize| {
            self.node(column + i, northward + j)
                .ok_or(TerrainError::NoData {
                    x_m,
                    y_m,
                    row: self.rows - northward - j,
                    column: column + i + 1,
                })
        };
        let patch = [[node(0, 0)?, node(0, 1)?], [node(1, 0)?, node(1, 1)?]];
        let (height_m, by_u, by_v) = hermite(&patch, u - column as f64, v - northward as f64);
        Ok(Surface::from_gradient(
            height_m,
            [by_u / self.cell_m, by_v / self.cell_m],
        ))
    }

    /// Height of a node, `northward` rows from the south; `None` for NODATA and beyond the edge.
    fn height(&self, column: Option<usize>, northward: Option<usize>) -> Option<f64> {
        let (column, northward) = (column?, northward?);
        if column >= self.columns || northward >= self.rows {
            return None;
        }
        let height_m = self.heights_m[(self.rows - 1 - northward) * self.columns + column];
        (!height_m.is_nan()).then_some(height_m)
    }

    fn node(&self, column: usize, northward: usize) -> Option<GridNode> {
        let (here, there) = (Some(column), Some(northward));
        let (west, east) = (column.checked_sub(1), Some(column + 1));
        let (south, north) = (northward.checked_sub(1), Some(northward + 1));
        let value = self.height(here, there)?;
        let corners = [(east, north), (west, south), (west, north), (east, south)];
        let by_uv = match corners.map(|(c, r)| self.height(c, r)) {
            [Some(ne), Some(sw), Some(nw), Some(se)] => 0.25 * (ne + sw - nw - se),
            _ => 0.0,
        };
        Some(GridNode {
            value,
            by_u: difference(self.height(west, there), value, self.height(east, there)),
            by_v: difference(self.height(here, south), value, self.height(here, north)),
            by_uv,
        })
    }
}

fn difference(before: Option<f64>, here: f64, after: Option<f64>) -> f64 {
    match (before, after) {
        (Some(before), Some(after)) => 0.5 * (after - before),
        (None, Some(after)) => after - here,
        (Some(before), None) => here - before,
        (None, None) => 0.0,
    }
}

/// Value and both derivatives of the bicubic Hermite patch at (u, v) of the unit square.
fn hermite(patch: &[[GridNode; 2]; 2], u: f64, v: f64) -> (f64, f64, f64) {
    let (along_u, along_v) = (Basis::at(u), Basis::at(v));
    let (mut value, mut by_u, mut by_v) = (0.0, 0.0, 0.0);
    for (i, column) in patch.iter().enumerate() {
        for (j, node) in column.iter().enumerate() {
            let across = along_v.value[j] * node.value + along_v.slope[j] * node.by_v;
            let across_of_u = along_v.value[j] * node.by_u + along_v.slope[j] * node.by_uv;
            value += along_u.value[i] * across + along_u.slope[i] * across_of_u;
            by_u += along_u.value_rate[i] * across + along_u.slope_rate[i] * across_of_u;
            let across_rate =
                along_v.value_rate[j] * node.value + along_v.slope_rate[j] * node.by_v;
            let across_of_u_rate =
                along_v.value_rate[j] * node.by_u + along_v.slope_rate[j] * node.by_uv;
            by_v += along_u.value[i] * across_rate + along_u.slope[i] * across_of_u_rate;
        }
    }
    (value, by_u, by_v)
}

/// Cubic Hermite basis for the values and slopes at both ends, and its derivative.
struct Basis {
    value: [f64; 2],
    slope: [f64; 2],
    value_rate: [f64; 2],
    slope_rate: [f64; 2],
}

impl Basis {
    fn at(t: f64) -> Self {
        let rest = 1.0 - t;
        let rate = 6.0 * t * rest;
        Self {
            value: [rest * rest * (1.0 + 2.0 * t), t * t * (3.0 - 2.0 * t)],
            slope: [t * rest * rest, -t * t * rest],
            value_rate: [-rate, rate],
            slope_rate: [rest * (1.0 - 3.0 * t), t * (3.0 * t - 2.0)],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::terrain::{Terrain, tests::assert_normal_is_gradient};
    use proptest::prelude::*;
    use std::fmt::Write;

    const COLUMNS: usize = 9;
    const ROWS: usize = 7;

    /// A grid of 2 m cells whose southwest cell centre is (10, -20), filled from a function of x, y.
    fn grid_of(height: impl Fn(f64, f64) -> f64) -> GridTerrain {
        let mut text = format!(
            "NCOLS {COLUMNS}\nnrows {ROWS}\nxllcorner 9\nYLLCENTER -20\ncellsize 2\nnodata_value -1\n"
        );
        for row in 0..ROWS {
            for column in 0..COLUMNS {
                let (x, y) = (
                    10.0 + 2.0 * column as f64,
                    -20.0 + 2.0 * (ROWS - 1 - row) as f64,
                );
                write!(text, "{} ", height(x, y)).unwrap();
            }
            text.push('\n');
        }
        GridTerrain::parse(&text).unwrap()
    }

    fn hills(x: f64, y: f64) -> f64 {
        5.0 + (0.4 * x).sin() + 0.8 * (0.3 * y + 0.2 * x).cos()
    }

    #[test]
    fn the_extent_runs_between_cell_centres() {
        let extent = grid_of(hills).extent();
        let expected = GridExtent {
            west_m: 10.0,
            east_m: 26.0,
            south_m: -20.0,
            north_m: -8.0,
        };
        assert_eq!(extent, expected);
        let moved = grid_of(hills).with_origin_at(10.0, -20.0).extent();
        assert_eq!((moved.west_m, moved.north_m), (0.0, 12.0));
    }

    #[test]
    fn nodes_keep_their_heights_with_north_up() {
        let grid = grid_of(hills);
        for (x, y) in [(10.0, -20.0), (26.0, -8.0), (10.0, -8.0), (16.0, -14.0)] {
            assert!((grid.surface(x, y).unwrap().height_m - hills(x, y)).abs() < 1e-12);
        }
    }

    #[test]
    fn outside_is_an_error_that_tells_the_extent() {
        let error = grid_of(hills).surface(26.01, -10.0).unwrap_err();
        let text = error.to_string();
        assert!(
            text.contains("26.01") && text.contains("x 10 to 26 m"),
            "{text}"
        );
    }

    #[test]
    fn a_single_cell_far_from_its_neighbours_is_suspect_and_a_cliff_is_not() {
        assert_eq!(grid_of(hills).suspicion(), None);
        assert_eq!(
            grid_of(|x, _| if x > 17.0 { 80.0 } else { 5.0 }).suspicion(),
            None
        );
        let spiked = |x: f64, y: f64| {
            if x == 18.0 && y == -14.0 {
                60.0
            } else {
                hills(x, y)
            }
        };
        let text = grid_of(spiked).suspicion().unwrap();
        assert!(
            text.contains("row 4, column 5") && text.contains("above"),
            "{text}"
        );
        assert_eq!(grid_of(spiked).cell_at(18.4, -14.3), (4, 5));
    }

    #[test]
    fn a_hole_is_an_error_around_it_only() {
        let holed = |x: f64, y: f64| {
            if x == 18.0 && y == -14.0 {
                -1.0
            } else {
                hills(x, y)
            }
        };
        let grid = grid_of(holed);
        let error = grid.surface(17.0, -13.0).unwrap_err();
        assert!(
            matches!(
                error,
                TerrainError::NoData {
                    row: 4,
                    column: 5,
                    ..
                }
            ),
            "{error}"
        );
        assert!(grid.surface(15.9, -13.0).is_ok());
    }

    proptest! {
        #[test]
        fn planes_are_exact_up_to_the_edge(a in -0.5..0.5f64, b in -0.5..0.5f64,
                                           x in 10.0..26.0f64, y in -20.0..-8.0f64) {
            let surface = grid_of(|x, y| 100.0 + a * x + b * y).surface(x, y).unwrap();
            let [along_x, along_y] = surface.gradient_in_world();
            prop_assert!((surface.height_m - (100.0 + a * x + b * y)).abs() < 1e-9);
            prop_assert!((along_x - a).abs() < 1e-9 && (along_y - b).abs() < 1e-9);
        }

        #[test]
        fn the_normal_is_the_gradient(x in 10.1..25.9f64, y in -19.9..-8.1f64) {
            assert_normal_is_gradient(&Terrain::Grid(grid_of(hills)), x, y, 1e-6);
        }

        #[test]
        fn the_normal_is_continuous_across_cells(line in 1..7u8, across in 0.0..12.0f64) {
            let grid = grid_of(hills);
            let x = 10.0 + 2.0 * f64::from(line);
            let (a, b) = (grid.surface(x - 1e-9, -20.0 + across).unwrap(),
                          grid.surface(x + 1e-9, -20.0 + across).unwrap());
            prop_assert!((a.normal_in_world - b.normal_in_world).norm() < 1e-7);
        }
    }
}
