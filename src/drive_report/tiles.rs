//! A map below the drive: raster tiles of an MBTiles file, placed in the plane of the recording.

use super::input::DecodedRecording;
use crate::foreign::foreign_file;
use crate::sqlite::{computed, explained, open};
use anyhow::{Context, Error, Result, bail};
use rusqlite::{Connection, OptionalExtension};
use serde::Serialize;
use sidehill_controller::path::{GeodeticOrigin, Point2};
use sidehill_recording::live::components::data_uri;
use std::f64::consts::PI;
use std::ops::RangeInclusive;
use std::path::Path;

/// Tiles of a page, and the bytes of their pictures, at most.
const TILES_MAX: u64 = 24;
const BYTES_MAX: u64 = 1_500_000;
/// Zooms that are looked for. A tile of the coarsest is up to 10 km wide: as far, the plane is true.
const ZOOMS: RangeInclusive<u8> = 12..=24;
/// What the map shows of the surroundings, on each side: a share of the extent, and m.
const AROUND: f64 = 0.3;
const AROUND_M: f64 = 10.0;
/// What a file is that can be read.
const EXPECTED: &str = "an MBTiles file with the table `tiles`, or with `map` and `images`";
/// Letters of what is said of the source, at most.
const SOURCE_MAX: usize = 300;

/// A map below a drive.
#[derive(Debug, Serialize)]
pub(super) struct TileMap {
    /// Who has made it, maybe with tags of HTML; else its name.
    source: String,
    tiles: Vec<PlacedTile>,
}

/// A picture with its place.
#[derive(Debug, Serialize)]
struct PlacedTile {
    /// Where its upper left, upper right and lower left corners are, x and y, m.
    corners: [[f64; 2]; 3],
    /// As data URI.
    picture: String,
}

/// The tiles of a zoom in a rectangle; rows are counted from the north.
#[derive(Debug, Clone, PartialEq, Eq)]
struct TileRange {
    zoom: u8,
    columns: RangeInclusive<u32>,
    rows: RangeInclusive<u32>,
}

impl TileMap {
    /// Returns the tiles of a file that lie below a drive, of the zoom that shows most of it.
    ///
    /// # Errors
    /// A recording without a place on earth; a file that cannot be read, is no MBTiles file, has no tile there, too large
    /// ones, or others than PNG, JPEG and WebP.
    pub(super) fn of(input: &DecodedRecording, file: &Path) -> Result<Self> {
        let datum = input.place_on_earth()?;
        let extent = input
            .extent
            .with_context(|| format!("{}: it has neither path nor pose", input.name))?;
        let map = Self::read(file, datum, extent);
        map.map_err(|error| match error.downcast_ref() {
            Some(error) => Error::msg(explained(error, EXPECTED)),
            None => error,
        })
        .with_context(|| file.display().to_string())
    }

    fn read(file: &Path, datum: &GeodeticOrigin, extent: [Point2; 2]) -> Result<Self> {
        if let Some(reason) = foreign_file(file)? {
            bail!(reason);
        }
        let database = open(file, BYTES_MAX)?;
        let table = table(&database)?;
        let format = metadata(&database, "format")?.unwrap_or_default();
        if format.contains("pbf") || format.contains("vector") {
            bail!(
                "its tiles are vectors ({format}), which are not drawn; write raster tiles, as QGIS does by `Generate XYZ \
                 tiles (MBTiles)`"
            );
        }
        let range = best(&database, table, datum, extent)?;
        let name = match metadata(&database, "attribution")? {
            Some(text) => Some(text),
            None => metadata(&database, "name")?,
        };
        let tiles = range.pictures(&database, table)?.into_iter();
        let tiles = tiles.map(|(column, row, picture)| {
            let name = || format!("tile {column}/{row} of zoom {}", range.zoom);
            let media_type = media_type(&picture).with_context(name)?;
            Ok(PlacedTile {
                corners: corners(datum, range.zoom, column, row),
                picture: data_uri(media_type, &picture),
            })
        });
        Ok(Self {
            source: name.unwrap_or_default().chars().take(SOURCE_MAX).collect(),
            tiles: tiles.collect::<Result<_>>()?,
        })
    }
}

/// Returns what to select tiles from: the table itself or, where it is a view, the tables that it is a view of in files that
/// hold equal pictures once. No view is asked, for it may compute without end.
fn table(database: &Connection) -> Result<&'static str> {
    let (table, held): (_, &[_]) = match computed(database, &["tiles"])? {
        None => ("tiles", &["metadata"]),
        Some(_) => (
            "(SELECT * FROM map JOIN images USING (tile_id))",
            &["metadata", "map", "images"],
        ),
    };
    match computed(database, held)? {
        None => Ok(table),
        Some(computed) => bail!(
            "{computed} is computed by the file instead of stored in it; only the table `tiles`, or a view of `map` and \
             `images`, is read"
        ),
    }
}

fn metadata(database: &Connection, name: &str) -> Result<Option<String>> {
    let value = "SELECT value FROM metadata WHERE name = ?1";
    let value = database.query_row(value, [name], |row| row.get(0));
    Ok(value
        .optional()?
        .filter(|value: &String| !value.trim().is_empty()))
}

/// Returns the tiles that show most of an extent and its surroundings: the zoom whose resolution times the share that is
/// there is largest.
fn best(
    database: &Connection,
    table: &str,
    datum: &GeodeticOrigin,
    [low, high]: [Point2; 2],
) -> Result<TileRange> {
    let side_m = (high.x_m - low.x_m).max(high.y_m - low.y_m);
    let half_m = (0.5 + AROUND) * side_m + AROUND_M;
    let at = |right: f64, up: f64| {
        datum.unproject(Point2 {
            x_m: 0.5 * (low.x_m + high.x_m) + right * half_m,
            y_m: 0.5 * (low.y_m + high.y_m) + up * half_m,
        })
    };
    let mut best: Option<(f64, TileRange)> = None;
    let mut too_large = false;
    for zoom in ZOOMS {
        let range = TileRange::around(zoom, at(-1.0, 1.0), at(1.0, -1.0));
        let (found, bytes) = range.size(database, table)?;
        if found == 0 || range.count() > TILES_MAX || found > TILES_MAX {
            continue;
        }
        too_large |= bytes > BYTES_MAX;
        let shows = 2_f64.powi(i32::from(zoom)) * found as f64 / range.count() as f64;
        if bytes <= BYTES_MAX && best.as_ref().is_none_or(|(most, _)| shows > *most) {
            best = Some((shows, range));
        }
    }
    match best {
        Some((_, range)) => Ok(range),
        None if too_large => bail!(
            "its tiles at the drive have more than {:.1} MB; write them as JPEG or WebP of 256 pixels, or with coarser zooms",
            BYTES_MAX as f64 / 1e6
        ),
        None => {
            let (latitude_deg, longitude_deg) = at(0.0, 0.0);
            bail!(
                "it has no tile of zoom {} to {} at the drive, latitude {latitude_deg:.5}, longitude {longitude_deg:.5}; {}",
                ZOOMS.start(),
                ZOOMS.end(),
                area(database, table)?
            )
        }
    }
}

/// Returns what is covered by the finest zoom of a file, in words.
fn area(database: &Connection, table: &str) -> Result<String> {
    let ends = format!(
        "SELECT zoom_level, min(tile_column), max(tile_column), min(tile_row), max(tile_row) FROM {table} \
         GROUP BY zoom_level ORDER BY zoom_level DESC LIMIT 1"
    );
    let ends = database.query_row(&ends, [], |row| {
        Ok((
            row.get::<_, u8>(0)?,
            [row.get::<_, f64>(1)?, row.get(2)?],
            [row.get::<_, f64>(3)?, row.get(4)?],
        ))
    });
    let Some((zoom, [west, east], [south, north])) = ends.optional()? else {
        return Ok("it has no tile at all".to_owned());
    };
    let rows = 2_f64.powi(i32::from(zoom));
    let (top_deg, left_deg) = place(zoom, west, rows - 1.0 - north);
    let (bottom_deg, right_deg) = place(zoom, east + 1.0, rows - south);
    Ok(format!(
        "its zoom {zoom} covers latitude {bottom_deg:.5} to {top_deg:.5}, longitude {left_deg:.5} to {right_deg:.5}"
    ))
}

impl TileRange {
    /// Returns the tiles between an upper left and a lower right place: latitude, longitude, deg.
    fn around(zoom: u8, upper_left: (f64, f64), lower_right: (f64, f64)) -> Self {
        let [[left, top], [right, bottom]] =
            [upper_left, lower_right].map(|(latitude_deg, longitude_deg)| {
                tile(zoom, latitude_deg, longitude_deg).map(|at| at.floor() as u32)
            });
        Self {
            zoom,
            columns: left..=right,
            rows: top..=bottom,
        }
    }

    fn count(&self) -> u64 {
        let length =
            |range: &RangeInclusive<u32>| u64::from(range.end().saturating_sub(*range.start())) + 1;
        length(&self.columns) * length(&self.rows)
    }

    /// Parameters of a query: zoom, columns and rows as they are stored, from the south.
    fn stored(&self) -> [i64; 5] {
        let last = (1_i64 << self.zoom) - 1;
        let south = |row: &u32| last - i64::from(*row);
        [
            i64::from(self.zoom),
            i64::from(*self.columns.start()),
            i64::from(*self.columns.end()),
            south(self.rows.end()),
            south(self.rows.start()),
        ]
    }

    /// Returns how many of the tiles there are, and the bytes of their pictures.
    fn size(&self, database: &Connection, table: &str) -> Result<(u64, u64)> {
        let size = format!(
            "SELECT count(*), coalesce(sum(length(tile_data)), 0) FROM {table} WHERE {WITHIN}"
        );
        let [found, bytes] = database.query_row(&size, self.stored(), |row| {
            Ok([row.get::<_, i64>(0)?, row.get(1)?].map(i64::unsigned_abs))
        })?;
        Ok((found, bytes))
    }

    /// Returns column, row and picture of each tile.
    fn pictures(&self, database: &Connection, table: &str) -> Result<Vec<(u32, u32, Vec<u8>)>> {
        let last = (1_u32 << self.zoom) - 1;
        let pictures =
            format!("SELECT tile_column, tile_row, tile_data FROM {table} WHERE {WITHIN}");
        let mut pictures = database.prepare(&pictures)?;
        let pictures = pictures.query_map(self.stored(), |row| {
            let row_from_south: u32 = row.get(1)?;
            Ok((row.get(0)?, last - row_from_south, row.get(2)?))
        })?;
        Ok(pictures.collect::<Result<_, _>>()?)
    }
}

const WITHIN: &str =
    "zoom_level = ?1 AND tile_column BETWEEN ?2 AND ?3 AND tile_row BETWEEN ?4 AND ?5";

/// Returns column and row, counted from the west and from the north, with the place within the tile: Web Mercator,
/// EPSG:3857.
fn tile(zoom: u8, latitude_deg: f64, longitude_deg: f64) -> [f64; 2] {
    let tiles = 2_f64.powi(i32::from(zoom));
    let north = latitude_deg.to_radians().tan().asinh();
    [
        tiles * (longitude_deg + 180.0) / 360.0,
        tiles * 0.5 * (1.0 - north / PI),
    ]
}

/// Returns latitude and longitude, deg: the inverse of [`tile`].
fn place(zoom: u8, column: f64, row: f64) -> (f64, f64) {
    let tiles = 2_f64.powi(i32::from(zoom));
    let north = PI * (1.0 - 2.0 * row / tiles);
    (
        north.sinh().atan().to_degrees(),
        360.0 * column / tiles - 180.0,
    )
}

/// Returns where the upper left, upper right and lower left corners of a tile are in the plane, m, to a millimetre. A
/// picture between them has its fourth corner less than half a pixel of 256 from its place.
fn corners(datum: &GeodeticOrigin, zoom: u8, column: u32, row: u32) -> [[f64; 2]; 3] {
    [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|[right, down]| {
        let (latitude_deg, longitude_deg) =
            place(zoom, f64::from(column) + right, f64::from(row) + down);
        let at = datum.project(latitude_deg, longitude_deg);
        [at.x_m, at.y_m].map(|m| (m * 1e3).round() / 1e3)
    })
}

/// Returns the media type of a whole picture.
///
/// # Errors
/// Bytes of another format, or that are cut off.
fn media_type(bytes: &[u8]) -> Result<&'static str> {
    let length = |at: &[u8; 4]| u64::from(u32::from_le_bytes(*at)) + 8;
    let (media_type, whole) = match bytes {
        [0x89, b'P', b'N', b'G', ..] => ("image/png", bytes.ends_with(b"IEND\xAE\x42\x60\x82")),
        [0xFF, 0xD8, 0xFF, ..] => ("image/jpeg", bytes.ends_with(b"\xFF\xD9")),
        [
            b'R',
            b'I',
            b'F',
            b'F',
            a,
            b,
            c,
            d,
            b'W',
            b'E',
            b'B',
            b'P',
            ..,
        ] => (
            "image/webp",
            length(&[*a, *b, *c, *d]) <= bytes.len() as u64,
        ),
        _ => bail!("it is neither PNG nor JPEG nor WebP"),
    };
    if !whole {
        bail!("its picture is cut off; write the file again");
    }
    Ok(media_type)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;
    use tempfile::{TempDir, tempdir};

    const DATUM: GeodeticOrigin = GeodeticOrigin {
        latitude_deg: 36.717,
        longitude_deg: -4.489,
        elevation_m: 0.0,
    };
    /// Begin and end of a picture; nothing here draws it.
    const PNG: &[u8] = b"\x89PNG\r\n\x1A\n....IEND\xAE\x42\x60\x82";
    const TABLES: &str = "CREATE TABLE metadata(name TEXT, value TEXT); \
        CREATE TABLE tiles(zoom_level INTEGER, tile_column INTEGER, tile_row INTEGER, tile_data BLOB);";

    /// Writes a file, and returns it with a function that reads it for a drive of 10 m at the datum.
    fn file(statements: &str) -> (TempDir, PathBuf) {
        let folder = tempdir().unwrap();
        let path = folder.path().join("field.mbtiles");
        let database = Connection::open(&path).unwrap();
        database.execute_batch(statements).unwrap();
        (folder, path)
    }

    /// Adds the tile of a place, moved by columns to the east and rows to the south.
    fn add(path: &Path, zoom: u8, moved: [f64; 2], picture: &[u8]) {
        let [column, row] = tile(zoom, DATUM.latitude_deg, DATUM.longitude_deg).map(f64::floor);
        let south = 2_f64.powi(zoom.into()) - 1.0 - (row + moved[1]);
        let stored = (zoom, column + moved[0], south, picture);
        let insert = "INSERT INTO tiles VALUES (?1, ?2, ?3, ?4)";
        let database = Connection::open(path).unwrap();
        database.execute(insert, stored).unwrap();
    }

    fn read(path: &Path) -> Result<TileMap> {
        let drive = |x_m| Point2 { x_m, y_m: 0.0 };
        TileMap::read(path, &DATUM, [drive(-5.0), drive(5.0)])
    }

    fn error(path: &Path) -> String {
        format!("{:#}", read(path).unwrap_err())
    }

    #[test]
    fn tiles_are_where_others_have_them() {
        // mercantile 1.2: bounds(486, 332, 10).
        let (north, west) = place(10, 486.0, 332.0);
        let (south, east) = place(10, 487.0, 333.0);
        for (found, expected) in [
            (west, -9.140625),
            (south, 53.12040528310657),
            (east, -8.7890625),
            (north, 53.33087298301705),
        ] {
            assert!((found - expected).abs() < 1e-12, "{found}, not {expected}");
        }
        // Google Maps, "Map and Tile Coordinates": pixels of 256 tiles along a side of Chicago.
        let chicago = tile(8, 41.85, -87.65);
        assert!(
            (chicago[0] - 65.67111111111113).abs() < 1e-12,
            "{chicago:?}"
        );
        assert!(
            (chicago[1] - 95.17492654697409).abs() < 1e-12,
            "{chicago:?}"
        );
    }

    #[test]
    fn a_picture_between_three_corners_is_less_than_half_a_pixel_off() {
        for latitude_deg in [0.0, 45.0, -60.0, 78.0] {
            let datum = GeodeticOrigin {
                latitude_deg,
                ..DATUM
            };
            for zoom in ZOOMS {
                let [column, row] =
                    tile(zoom, latitude_deg, datum.longitude_deg).map(|at| at.floor() as u32);
                let [upper_left, right, left] = corners(&datum, zoom, column, row);
                let pixel_m = (right[0] - upper_left[0]) / 256.0;
                for (share_right, share_down) in [(1.0, 1.0), (0.5, 0.5), (0.0, 0.5)] {
                    let (latitude_deg, longitude_deg) = place(
                        zoom,
                        f64::from(column) + share_right,
                        f64::from(row) + share_down,
                    );
                    let there = datum.project(latitude_deg, longitude_deg);
                    let drawn = [0, 1].map(|axis| {
                        let origin = upper_left[axis];
                        origin
                            + share_right * (right[axis] - origin)
                            + share_down * (left[axis] - origin)
                    });
                    let off_m = (drawn[0] - there.x_m).hypot(drawn[1] - there.y_m);
                    assert!(
                        off_m < 0.5 * pixel_m,
                        "{latitude_deg}, zoom {zoom}: {off_m} m of {pixel_m} m"
                    );
                }
            }
        }
    }

    #[test]
    fn the_zoom_that_shows_most_is_drawn() {
        let (_folder, path) = file(TABLES);
        let zooms = |path: &Path| {
            let range = best(
                &Connection::open(path).unwrap(),
                "tiles",
                &DATUM,
                [Point2::default(); 2],
            );
            range.unwrap().zoom
        };
        add(&path, 12, [0.0, 0.0], PNG);
        assert_eq!(zooms(&path), 12);
        // One of the many tiles at the drive: still finer, also where the others are missing.
        add(&path, 20, [0.0, 0.0], PNG);
        assert_eq!(zooms(&path), 20);
        add(&path, 19, [40.0, 0.0], PNG);
        assert_eq!(zooms(&path), 20);
        let map = read(&path).unwrap();
        let [tile] = &map.tiles[..] else {
            panic!("{map:?}")
        };
        // The origin lies in the tile: right of and below its first corner.
        let [[west, north], [east, _], [_, south]] = tile.corners;
        assert!(
            west < 0.0 && east > 0.0 && south < 0.0 && north > 0.0,
            "{tile:?}"
        );
        assert!(
            tile.picture
                .starts_with("data:image/png;base64,iVBORw0KGgo"),
            "{tile:?}"
        );
        // More than a page may hold is drawn coarser.
        add(
            &path,
            20,
            [1.0, 0.0],
            &[PNG, &vec![0; 1_500_000], PNG].concat(),
        );
        assert_eq!(zooms(&path), 12);
    }

    #[test]
    fn a_source_is_named_once() {
        let attribution = format!(
            "{TABLES} INSERT INTO metadata VALUES ('name', 'Field'), ('attribution', '© Survey');"
        );
        let (_folder, path) = file(&attribution);
        add(&path, 20, [0.0, 0.0], PNG);
        assert_eq!(read(&path).unwrap().source, "© Survey");
    }

    #[test]
    fn pictures_held_once_are_read_without_the_view() {
        let (_folder, path) = file(TABLES);
        add(&path, 20, [0.0, 0.0], PNG);
        let split = "CREATE TABLE images(tile_data BLOB, tile_id TEXT); INSERT INTO images SELECT tile_data, 'a' FROM tiles; \
                     CREATE TABLE map AS SELECT zoom_level, tile_column, tile_row, 'a' AS tile_id FROM tiles; \
                     DROP TABLE tiles; CREATE VIEW tiles AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) \
                     SELECT i AS zoom_level, i AS tile_column, i AS tile_row, x'00' AS tile_data FROM n;";
        Connection::open(&path)
            .unwrap()
            .execute_batch(split)
            .unwrap();
        assert_eq!(read(&path).unwrap().tiles.len(), 1);
        let endless = "DROP TABLE map; CREATE VIEW map AS SELECT *, 'a' AS tile_id FROM tiles;";
        Connection::open(&path)
            .unwrap()
            .execute_batch(endless)
            .unwrap();
        let found = error(&path);
        assert!(found.contains("the view map is computed"), "{found}");
    }

    #[test]
    fn files_that_cannot_be_drawn_name_the_cause() {
        let (_folder, path) = file(TABLES);
        assert!(error(&path).contains("no tile at all"));
        // A degree to the north.
        add(&path, 18, [0.0, -900.0], PNG);
        let found = error(&path);
        assert!(
            found.contains("at the drive, latitude 36.71700, longitude -4.48900"),
            "{found}"
        );
        assert!(found.contains("zoom 18 covers latitude 37.7"), "{found}");

        for (picture, cause) in [
            (&PNG[..12], "cut off"),
            (b"\xFF\xD8\xFF\xE0....".as_slice(), "cut off"),
            (b"RIFF\xFF\0\0\0WEBPVP8 ", "cut off"),
            (b"\x1F\x8B\x08", "neither PNG nor JPEG nor WebP"),
            (&[0x89; 1_500_001], "1.5 MB"),
        ] {
            let (_folder, path) = file(TABLES);
            add(&path, 20, [0.0, 0.0], picture);
            let found = error(&path);
            assert!(found.contains(cause), "{cause}: {found}");
        }
        let vectors = format!("{TABLES} INSERT INTO metadata VALUES ('format', 'pbf')");
        let (_folder, path) = file(&vectors);
        assert!(error(&path).contains("vectors (pbf)"));
    }
}
