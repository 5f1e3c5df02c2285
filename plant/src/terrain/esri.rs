//! The text of an ESRI ASCII grid.

use super::TerrainError;
use crate::bounds::{Bounds, RangeError};
use std::iter::Peekable;

/// What the text holds; heights row by row from the north, NaN where there is no data.
pub(super) struct Grid {
    pub(super) columns: usize,
    pub(super) rows: usize,
    pub(super) cell_m: f64,
    /// Centre of the southwest cell.
    pub(super) west_m: f64,
    pub(super) south_m: f64,
    pub(super) heights_m: Vec<f64>,
}

/// Returns the grid of a text; see [`super::GridTerrain::parse`].
pub(super) fn parse(text: &str) -> Result<Grid, TerrainError> {
    let text = text.trim_start_matches('\u{feff}');
    let words = text
        .lines()
        .enumerate()
        .flat_map(|(i, line)| line.split_whitespace().map(move |word| (i + 1, word)));
    let mut words = Words {
        words: words.peekable(),
        line: 1,
    };
    let header = words.header()?;
    let (columns, rows) = header.size()?;
    // Grids in degrees have cells of up to 30 arc seconds, 0.0083.
    let cell_m = Bounds::new(0.01, 1e4, "m")
        .with_note("not in degrees: `gdalwarp -t_srs EPSG:... FILE OUT` projects, as to UTM")
        .check("cellsize", header.cell.side_m()?)?;
    let count = columns * rows;
    // A height takes two characters at least, so that a false header cannot reserve memory.
    let mut heights_m = Vec::with_capacity(count.min(text.len() / 2 + 1));
    for at in 0..count {
        let height_m = words.value("a height in m, of ncols times nrows")?;
        if height_m.is_nan() || is_same(height_m, header.nodata) {
            heights_m.push(f64::NAN);
        } else if is_height(height_m) {
            heights_m.push(height_m);
        } else {
            return Err(TerrainError::GridHeight {
                row: at / columns + 1,
                column: at % columns + 1,
                height_m,
                nodata: header.nodata,
            });
        }
    }
    if let Some((line, word)) = words.words.next() {
        let expected = "the end, after ncols times nrows heights";
        return Err(syntax(line, Some(word), expected));
    }
    Ok(Grid {
        columns,
        rows,
        cell_m,
        west_m: header.west.centre_m("xllcorner or xllcenter", cell_m)?,
        south_m: header.south.centre_m("yllcorner or yllcenter", cell_m)?,
        heights_m,
    })
}

/// Heights of ground, m: from below the deepest sea to above the highest mountain.
const HEIGHTS_M: std::ops::RangeInclusive<f64> = -11_000.0..=9_000.0;
/// Numbers within that range that programs write where they know no height.
const VOIDS: [f64; 2] = [-9999.0, -999.0];

fn is_height(value: f64) -> bool {
    HEIGHTS_M.contains(&value) && !VOIDS.contains(&value)
}

/// Returns whether two texts mean one number: single precision and its decimal texts differ by as much.
fn is_same(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-5 * b.abs()
}

/// The size of a cell as the header gives it.
#[derive(Clone, Copy)]
enum GridCell {
    Side(f64),
    /// As GDAL writes cells that are, or may be, not square.
    Sides {
        dx_m: f64,
        dy_m: f64,
    },
}

impl GridCell {
    fn side_m(self) -> Result<f64, TerrainError> {
        match self {
            Self::Side(side_m) => Ok(side_m),
            Self::Sides { dx_m, dy_m } if (dx_m - dy_m).abs() <= 1e-4 * dx_m.abs() => Ok(dx_m),
            Self::Sides { dx_m, dy_m } => Err(TerrainError::GridNotSquare { dx_m, dy_m }),
        }
    }
}

#[derive(Clone, Copy)]
enum GridEdge {
    Corner(f64),
    Centre(f64),
}

impl GridEdge {
    fn centre_m(self, key: &'static str, cell_m: f64) -> Result<f64, RangeError> {
        let (place_m, to_centre_m) = match self {
            Self::Corner(place_m) => (place_m, 0.5 * cell_m),
            Self::Centre(place_m) => (place_m, 0.0),
        };
        Bounds::new(-1e9, 1e9, "m")
            .check(key, place_m)
            .map(|m| m + to_centre_m)
    }
}

struct GridHeader {
    columns: f64,
    rows: f64,
    cell: GridCell,
    west: GridEdge,
    south: GridEdge,
    nodata: f64,
}

impl GridHeader {
    fn size(&self) -> Result<(usize, usize), RangeError> {
        const SIDE: Bounds = Bounds::new(2.0, 20_000.0, "cells");
        let side = |key, value: f64| {
            SIDE.check(key, value)?;
            if value.fract() != 0.0 {
                let bounds = SIDE.with_note("a whole number");
                return Err(RangeError { key, value, bounds });
            }
            Ok(value)
        };
        let (columns, rows) = (side("ncols", self.columns)?, side("nrows", self.rows)?);
        Bounds::new(4.0, 16e6, "cells").check("ncols times nrows", columns * rows)?;
        Ok((columns as usize, rows as usize))
    }
}

const KEYS: &str = "a header key (ncols, nrows, xllcorner or xllcenter, yllcorner or yllcenter, cellsize or dx and dy, NODATA_value), each once, before the heights; `gdal_translate -of AAIGrid FILE OUT.asc` makes such a file of other grids";

/// Words of a text, each with its line from 1.
struct Words<'a, I: Iterator<Item = (usize, &'a str)>> {
    words: Peekable<I>,
    /// Line of the word read last.
    line: usize,
}

impl<'a, I: Iterator<Item = (usize, &'a str)>> Words<'a, I> {
    fn header(&mut self) -> Result<GridHeader, TerrainError> {
        let (mut columns, mut rows, mut cell, mut nodata) = (None, None, None, None);
        let (mut west, mut south, mut dx, mut dy) = (None, None, None, None);
        while let Some(&(line, word)) = self.words.peek() {
            if !word.starts_with(|c: char| c.is_ascii_alphabetic())
                || is_nan(word)
                || word.parse::<f64>().is_ok()
            {
                break;
            }
            self.words.next();
            self.line = line;
            let key = word.to_ascii_lowercase();
            let number = match key.as_str() {
                "nodata_value" => {
                    self.value("a number that marks unknown heights, such as -9999")?
                }
                _ => self.number("a finite number after the header key")?,
            };
            let repeated = match key.as_str() {
                "ncols" => columns.replace(number).is_some(),
                "nrows" => rows.replace(number).is_some(),
                "cellsize" => cell.replace(number).is_some(),
                "dx" => dx.replace(number).is_some(),
                "dy" => dy.replace(number).is_some(),
                "xllcorner" => west.replace(GridEdge::Corner(number)).is_some(),
                "xllcenter" => west.replace(GridEdge::Centre(number)).is_some(),
                "yllcorner" => south.replace(GridEdge::Corner(number)).is_some(),
                "yllcenter" => south.replace(GridEdge::Centre(number)).is_some(),
                "nodata_value" => nodata.replace(number).is_some(),
                _ => true,
            };
            if repeated {
                return Err(syntax(line, Some(word), KEYS));
            }
        }
        let cell = match (cell, dx, dy) {
            (Some(side_m), None, None) => Some(GridCell::Side(side_m)),
            (None, Some(dx_m), Some(dy_m)) => Some(GridCell::Sides { dx_m, dy_m }),
            _ => None,
        };
        let (Some(columns), Some(rows), Some(cell), Some(west), Some(south)) =
            (columns, rows, cell, west, south)
        else {
            return Err(match self.words.peek() {
                Some(&(line, word)) => syntax(line, Some(word), KEYS),
                None => syntax(self.line, None, KEYS),
            });
        };
        Ok(GridHeader {
            columns,
            rows,
            cell,
            west,
            south,
            nodata: nodata.unwrap_or(-9999.0),
        })
    }

    /// Returns the next number, which may be one of the texts for NaN.
    fn value(&mut self, expected: &'static str) -> Result<f64, TerrainError> {
        match self.words.peek() {
            Some(&(line, word)) if is_nan(word) => {
                self.words.next();
                self.line = line;
                Ok(f64::NAN)
            }
            _ => self.number(expected),
        }
    }

    fn number(&mut self, expected: &'static str) -> Result<f64, TerrainError> {
        let Some((line, word)) = self.words.next() else {
            return Err(syntax(self.line, None, expected));
        };
        self.line = line;
        match word.parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(number),
            _ => Err(syntax(line, Some(word), expected)),
        }
    }
}

/// Returns whether a word is NaN as C libraries write it.
fn is_nan(word: &str) -> bool {
    let word = word.trim_start_matches(['-', '+']).to_ascii_lowercase();
    word.starts_with("nan") || word == "1.#qnan" || word == "1.#ind"
}

fn syntax(line: usize, word: Option<&str>, expected: &'static str) -> TerrainError {
    let found = match word {
        Some(word) => format!("\"{}\"", word.chars().take(40).collect::<String>()),
        None => "the end of the text".to_owned(),
    };
    TerrainError::GridSyntax {
        line,
        found,
        expected,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = "ncols 2\nnrows 3\nXLLCORNER 100\nyllcenter 50\ncellsize 10\nNODATA_value -9\n1 2\n3 -9\n5 6\n";

    fn error_of(text: &str) -> String {
        parse(text).err().unwrap().to_string()
    }

    #[test]
    fn corner_and_centre_keys_place_the_cells() {
        let grid = parse(GOOD).unwrap();
        assert_eq!((grid.west_m, grid.south_m), (105.0, 50.0));
        assert_eq!((grid.columns, grid.rows), (2, 3));
        assert!(grid.heights_m[3].is_nan() && grid.heights_m[5] == 6.0);
    }

    #[test]
    fn heights_may_wrap_over_lines_and_nodata_may_be_left_out() {
        let text = GOOD
            .replace("NODATA_value -9\n", "")
            .replace("1 2\n3 -9\n", "1 2 3\n-9999\n");
        assert!(parse(&text).unwrap().heights_m[3].is_nan());
    }

    #[test]
    fn errors_name_line_and_word() {
        let text = error_of(&GOOD.replace("3 -9", "3 4,5"));
        assert!(
            text.contains("line 8") && text.contains("\"4,5\""),
            "{text}"
        );
        let text = error_of(&GOOD.replace("3 -9", "3 inf"));
        assert!(
            text.contains("line 8") && text.contains("\"inf\""),
            "{text}"
        );
        let text = error_of(&GOOD.replace("5 6", "5"));
        assert!(
            text.contains("line 9") && text.contains("the end of the text"),
            "{text}"
        );
        let text = error_of(&GOOD.replace("5 6", "5 6 7"));
        assert!(
            text.contains("\"7\"") && text.contains("expected the end"),
            "{text}"
        );
        let text = error_of(&GOOD.replace("cellsize", "cell"));
        assert!(
            text.contains("line 5") && text.contains("\"cell\""),
            "{text}"
        );
        let text = error_of(&GOOD.replace("cellsize 10", "cellsize 10\ndx 10\ndy 10"));
        assert!(text.contains("expected a header key"), "{text}");
        let text = error_of(&GOOD.replace("nrows 3", "ncols 3"));
        assert!(
            text.contains("line 2") && text.contains("each once"),
            "{text}"
        );
        let text = error_of(&GOOD.replace("nrows 3\n", ""));
        assert!(text.contains("line 6") && text.contains("\"1\""), "{text}");
        assert!(error_of("").contains("the end of the text"));
        for (from, to, says) in [
            ("ncols", "north: 50\nncols", "gdal_translate -of AAIGrid"),
            (
                "cellsize 10",
                "cellsize 0.008333",
                "not in degrees: `gdalwarp",
            ),
            (
                "nrows 3",
                "nrows 3\nNODATA_value null",
                "marks unknown heights, such as -9999",
            ),
        ] {
            assert!(GOOD.contains(from));
            let text = error_of(&GOOD.replacen(from, to, 1));
            assert!(text.contains(says), "{text}");
        }
    }

    #[test]
    fn gdal_writes_the_sides_of_a_cell_and_nan_for_what_it_does_not_know() {
        let sides = GOOD.replace("cellsize 10", "dx 10.000000\nDY 10.0000001");
        assert_eq!(parse(&sides).unwrap().cell_m, 10.0);
        let text = error_of(&GOOD.replace("cellsize 10", "dx 10\ndy 20"));
        assert!(
            text.contains("dy 20 m") && text.contains("gdalwarp -tr 10 10"),
            "{text}"
        );
        for nan in ["nan", "-nan", "NaN", "nan(ind)", "-1.#IND", "1.#QNAN"] {
            let grid = parse(&GOOD.replace("1 2\n3 -9", &format!("{nan} 2\n3 -9"))).unwrap();
            assert!(
                grid.heights_m[0].is_nan() && grid.heights_m[3].is_nan(),
                "{nan}"
            );
            let undeclared = GOOD.replace("NODATA_value -9", &format!("NODATA_value {nan}"));
            let grid = parse(&undeclared.replace("1 2", &format!("{nan} 2"))).unwrap();
            assert!(
                grid.heights_m[0].is_nan() && grid.heights_m[3] == -9.0,
                "{nan}"
            );
        }
        // The least number of single precision, as two programs write it.
        let least = GOOD.replace("NODATA_value -9", "NODATA_value -3.4028234663852886e+38");
        assert!(
            parse(&least.replace("3 -9", "3 -3.40282e+38"))
                .unwrap()
                .heights_m[3]
                .is_nan()
        );
    }

    #[test]
    fn a_void_that_is_not_declared_is_no_height() {
        for void in ["-32768", "-9999", "-99999", "65535", "-3.4e38", "1e20"] {
            let text = error_of(&GOOD.replace("5 6", &format!("5 {void}")));
            assert!(
                text.contains("row 3, column 2") && text.contains("NODATA value, -9"),
                "{void}: {text}"
            );
        }
    }

    #[test]
    fn false_sizes_are_refused_before_memory_is_taken() {
        for (from, to, key) in [
            ("ncols 2", "ncols 1e300", "ncols"),
            ("ncols 2", "ncols 1", "ncols"),
            ("ncols 2\nnrows 3", "ncols 2.5\nnrows 3", "ncols"),
            (
                "ncols 2\nnrows 3",
                "ncols 20000\nnrows 20000",
                "ncols times nrows",
            ),
            ("cellsize 10", "cellsize 0", "cellsize"),
            ("XLLCORNER 100", "XLLCORNER 1e12", "xllcorner"),
        ] {
            let text = error_of(&GOOD.replace(from, to));
            assert!(text.starts_with(key), "{to}: {text}");
        }
    }
}
