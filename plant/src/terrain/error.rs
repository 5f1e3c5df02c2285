//! Why a terrain cannot be made, or has no ground at a place.

use crate::bounds::RangeError;
use crate::number::likely_mistake;
use std::fmt;

/// Why a terrain cannot be made, or has no ground at a place.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TerrainError {
    /// Ground was requested at coordinates that are not finite.
    #[error("place x {x_m} m, y {y_m} m is not finite")]
    PlaceNotFinite {
        /// X_g, m.
        x_m: f64,
        /// Y_g, m.
        y_m: f64,
    },
    /// The place is not between the grid's outermost nodes.
    #[error("place x {x_m:.3} m, y {y_m:.3} m is outside the elevation grid, which spans {extent}")]
    OutsideGrid {
        /// X_g, m.
        x_m: f64,
        /// Y_g, m.
        y_m: f64,
        /// What the grid spans, in the world.
        extent: GridExtent,
    },
    /// A node around the place holds NODATA.
    #[error(
        "no elevation at x {x_m:.3} m, y {y_m:.3} m: the grid has NODATA in row {row}, column {column} (from 1, northwest)"
    )]
    NoData {
        /// X_g, m.
        x_m: f64,
        /// Y_g, m.
        y_m: f64,
        /// Row in the file, from 1 in the north.
        row: usize,
        /// Column in the file, from 1 in the west.
        column: usize,
    },
    /// The place is too far from the route for its elevation to say anything.
    #[error("place x {x_m:.3} m, y {y_m:.3} m is more than {distance_max_m} m from the route")]
    OffRoute {
        /// X_g, m.
        x_m: f64,
        /// Y_g, m.
        y_m: f64,
        /// Largest distance from the route, m.
        distance_max_m: f64,
    },
    /// The text of an elevation grid could not be read.
    #[error(
        "elevation grid, line {line}: found {found}, expected {expected}{}",
        likely_mistake(.found.trim_matches('"'))
    )]
    GridSyntax {
        /// Line, from 1.
        line: usize,
        /// The token found, quoted, or "the end".
        found: String,
        /// What should be there.
        expected: &'static str,
    },
    /// The cells of an elevation grid are not square.
    #[error(
        "elevation grid: its cells are dx {dx_m} m by dy {dy_m} m, must be square; resample it, as in `gdalwarp -tr {dx_m} {dx_m}`"
    )]
    GridNotSquare {
        /// Width of a cell, m.
        dx_m: f64,
        /// Height of a cell, m.
        dy_m: f64,
    },
    /// A cell of an elevation grid holds what is no height of ground.
    #[error(
        "elevation grid, row {row}, column {column} (from 1, northwest): {height_m} is no height in m; if it marks unknown ground, replace it by the file's NODATA value, {nodata}"
    )]
    GridHeight {
        /// Row in the file, from 1 in the north.
        row: usize,
        /// Column in the file, from 1 in the west.
        column: usize,
        /// What the cell holds.
        height_m: f64,
        /// The value that marks unknown ground.
        nodata: f64,
    },
    /// The elevation of a route jumps.
    #[error(
        "the elevation jumps by {step_m:.1} m between the points {before} and {index} (from 0), which are {distance_m:.1} m apart, at x {x_m:.1} m, y {y_m:.1} m; correct or remove the elevation that is wrong", before = index - 1
    )]
    RouteStep {
        /// Index of the point behind the jump, from 0.
        index: usize,
        /// Its X_g, m.
        x_m: f64,
        /// Its Y_g, m.
        y_m: f64,
        /// Difference of the elevations, m.
        step_m: f64,
        /// Horizontal distance of the points, m.
        distance_m: f64,
    },
    /// A route point is not finite.
    #[error("route point {index} (from 0) is not finite: x {x_m} m, y {y_m} m, z {z_m} m")]
    RoutePointNotFinite {
        /// Index from 0.
        index: usize,
        /// X_g, m.
        x_m: f64,
        /// Y_g, m.
        y_m: f64,
        /// Z_g, m.
        z_m: f64,
    },
    /// The route's horizontal length is too short or too long.
    #[error(
        "route of {points} points is {length_m} m long, must be from {length_min_m} to {length_max_m} m"
    )]
    RouteLength {
        /// Points given.
        points: usize,
        /// Horizontal length, m.
        length_m: f64,
        /// Shortest length allowed, m.
        length_min_m: f64,
        /// Longest length allowed, m.
        length_max_m: f64,
    },
    /// A parameter is out of its range.
    #[error(transparent)]
    Parameter(#[from] RangeError),
}

/// What a grid spans, in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridExtent {
    /// Smallest X_g, m.
    pub west_m: f64,
    /// Largest X_g, m.
    pub east_m: f64,
    /// Smallest Y_g, m.
    pub south_m: f64,
    /// Largest Y_g, m.
    pub north_m: f64,
}

impl fmt::Display for GridExtent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "x {} to {} m, y {} to {} m",
            self.west_m, self.east_m, self.south_m, self.north_m
        )
    }
}
