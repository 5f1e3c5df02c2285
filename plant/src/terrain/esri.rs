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
    let cell_m = Bounds::new(1e-3, 1e4, "m").check("cellsize", header.cell_m)?;
    let count = columns * rows;
    // A height takes two characters at least, so that a false header cannot reserve memory.
    let mut heights_m = Vec::with_capacity(count.min(text.len() / 2 + 1));
    for _ in 0..count {
        let height_m = words.number("a height in m, of ncols times nrows")?;
        let is_data = height_m != header.nodata;
        heights_m.push(if is_data { height_m } else { f64::NAN });
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

#[derive(Clone, Copy)]
enum Edge {
    Corner(f64),
    Centre(f64),
}

impl Edge {
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

struct Header {
    columns: f64,
    rows: f64,
    cell_m: f64,
    west: Edge,
    south: Edge,
    nodata: f64,
}

impl Header {
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

const KEYS: &str = "a header key (ncols, nrows, xllcorner or xllcenter, yllcorner or yllcenter, cellsize, NODATA_value), each once, before the heights";

/// Words of a text, each with its line from 1.
struct Words<'a, I: Iterator<Item = (usize, &'a str)>> {
    words: Peekable<I>,
    /// Line of the word read last.
    line: usize,
}

impl<'a, I: Iterator<Item = (usize, &'a str)>> Words<'a, I> {
    fn header(&mut self) -> Result<Header, TerrainError> {
        let (mut columns, mut rows, mut cell, mut nodata) = (None, None, None, None);
        let (mut west, mut south) = (None, None);
        while let Some(&(line, word)) = self.words.peek() {
            if !word.starts_with(|c: char| c.is_ascii_alphabetic()) {
                break;
            }
            self.words.next();
            self.line = line;
            let number = self.number("a finite number after the header key")?;
            let repeated = match word.to_ascii_lowercase().as_str() {
                "ncols" => columns.replace(number).is_some(),
                "nrows" => rows.replace(number).is_some(),
                "cellsize" => cell.replace(number).is_some(),
                "xllcorner" => west.replace(Edge::Corner(number)).is_some(),
                "xllcenter" => west.replace(Edge::Centre(number)).is_some(),
                "yllcorner" => south.replace(Edge::Corner(number)).is_some(),
                "yllcenter" => south.replace(Edge::Centre(number)).is_some(),
                "nodata_value" => nodata.replace(number).is_some(),
                _ => true,
            };
            if repeated {
                return Err(syntax(line, Some(word), KEYS));
            }
        }
        let (Some(columns), Some(rows), Some(cell_m), Some(west), Some(south)) =
            (columns, rows, cell, west, south)
        else {
            return Err(match self.words.peek() {
                Some(&(line, word)) => syntax(line, Some(word), KEYS),
                None => syntax(self.line, None, KEYS),
            });
        };
        Ok(Header {
            columns,
            rows,
            cell_m,
            west,
            south,
            nodata: nodata.unwrap_or(-9999.0),
        })
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
        let text = error_of(&GOOD.replace("3 -9", "3 nan"));
        assert!(
            text.contains("line 8") && text.contains("\"nan\""),
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
        let text = error_of(&GOOD.replace("cellsize", "dx"));
        assert!(text.contains("line 5") && text.contains("\"dx\""), "{text}");
        let text = error_of(&GOOD.replace("nrows 3", "ncols 3"));
        assert!(
            text.contains("line 2") && text.contains("each once"),
            "{text}"
        );
        let text = error_of(&GOOD.replace("nrows 3\n", ""));
        assert!(text.contains("line 6") && text.contains("\"1\""), "{text}");
        assert!(error_of("").contains("the end of the text"));
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
