//! Routes from CSV and GPX text.

use super::{Direction, PathError, Point2, RawPoint};
use std::io::Read;

/// Where the local tangent plane of a GPX route touches the WGS 84 ellipsoid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GeodeticOrigin {
    /// Latitude, deg, north positive.
    pub latitude_deg: f64,
    /// Longitude, deg, east positive.
    pub longitude_deg: f64,
    /// Height, m, as recorded; 0 where the first point has none.
    pub elevation_m: f64,
}

impl GeodeticOrigin {
    /// Returns where a place of the ellipsoid is in the plane: x east, y north, m.
    ///
    /// Heights do not count: a few metres would scale the plane by less than 1e-6.
    pub fn project(&self, latitude_deg: f64, longitude_deg: f64) -> Point2 {
        let (x_m, y_m, _) = map_3d::geodetic2enu(
            latitude_deg.to_radians(),
            longitude_deg.to_radians(),
            0.0,
            self.latitude_deg.to_radians(),
            self.longitude_deg.to_radians(),
            0.0,
            map_3d::Ellipsoid::WGS84,
        );
        Point2 { x_m, y_m }
    }

    /// Returns latitude and longitude, deg, of a point of the plane: the inverse of [`Self::project`].
    pub fn unproject(&self, point: Point2) -> (f64, f64) {
        let place = |up_m: f64| {
            map_3d::enu2geodetic(
                point.x_m,
                point.y_m,
                up_m,
                self.latitude_deg.to_radians(),
                self.longitude_deg.to_radians(),
                0.0,
                map_3d::Ellipsoid::WGS84,
            )
        };
        // The ellipsoid falls away below the plane by the height found there.
        let (_, _, above_m) = place(0.0);
        let (latitude_rad, longitude_rad, _) = place(-above_m);
        (latitude_rad.to_degrees(), longitude_rad.to_degrees())
    }
}

/// The points of a route in the world: X_g east, Y_g north, Z_g up.
#[derive(Debug, Clone, PartialEq)]
pub struct Route {
    /// The points in the order they are driven.
    pub points: Vec<RawPoint>,
    /// Where the world's origin is, for a route given in latitude and longitude.
    pub origin: Option<GeodeticOrigin>,
}

/// Returns the points of a CSV with the columns `x_m`, `y_m` and, if wanted, `z_m` and `direction`
/// (`forward` or `reverse`: the way to drive from this point to the next; empty: as before), in any
/// order.
///
/// # Errors
/// [`PathError::Csv`] with the line for text that is not such a table, [`PathError::Empty`] where
/// there is no row, [`PathError::Read`] if reading fails.
pub fn read_csv(reader: impl Read) -> Result<Route, PathError> {
    let mut table = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .comment(Some(b'#'))
        .from_reader(reader);
    let header: csv::StringRecord = table
        .headers()
        .map_err(csv_error)?
        .iter()
        // Some programs begin a file with a byte order mark.
        .map(|name| name.trim_start_matches('\u{feff}'))
        .collect();
    let columns = Columns::of(&header)?;
    let mut points = Vec::new();
    for record in table.records() {
        points.push(columns.point(&record.map_err(csv_error)?)?);
    }
    if points.is_empty() {
        return Err(PathError::Empty);
    }
    Ok(Route {
        points,
        origin: None,
    })
}

/// Returns what may be wrong with a table whose header has such a column.
fn likely_cause(name: &str) -> &'static str {
    let name = name.to_lowercase();
    if name.contains(';') || name.contains('\t') {
        "; separate fields by commas and write decimals with a point"
    } else if name.parse::<f64>().is_ok() {
        "; the first line must name the columns"
    } else if name.starts_with("lat") || name.starts_with("lon") {
        "; give latitude and longitude as GPX"
    } else {
        ""
    }
}

/// Where in a record of the table each column is.
struct Columns {
    x: usize,
    y: usize,
    z: Option<usize>,
    direction: Option<usize>,
}

impl Columns {
    fn of(headers: &csv::StringRecord) -> Result<Self, PathError> {
        let at_line_1 = |what: String| PathError::Csv { line: 1, what };
        let allowed = ["x_m", "y_m", "z_m", "direction"];
        if let Some(name) = headers.iter().find(|name| !allowed.contains(name)) {
            return Err(at_line_1(format!(
                "column `{name}` is unknown, must be one of x_m, y_m, z_m, direction{}",
                likely_cause(name)
            )));
        }
        let twice = allowed
            .iter()
            .find(|name| headers.iter().filter(|header| header == *name).count() > 1);
        if let Some(name) = twice {
            return Err(at_line_1(format!("column `{name}` occurs twice")));
        }
        let find = |name: &str| headers.iter().position(|header| header == name);
        let need =
            |name: &str| find(name).ok_or_else(|| at_line_1(format!("column `{name}` is missing")));
        Ok(Self {
            x: need("x_m")?,
            y: need("y_m")?,
            z: find("z_m"),
            direction: find("direction"),
        })
    }

    fn point(&self, record: &csv::StringRecord) -> Result<RawPoint, PathError> {
        let line = record.position().map_or(0, csv::Position::line);
        let number = |column: usize, name: &str| {
            let text = record.get(column).unwrap_or_default();
            finite(text).ok_or_else(|| PathError::Csv {
                line,
                what: format!("{name}: `{text}` is not a finite number"),
            })
        };
        let direction = match self.direction.and_then(|column| record.get(column)) {
            None | Some("") => None,
            Some("forward") => Some(Direction::Forward),
            Some("reverse") => Some(Direction::Reverse),
            Some(text) => {
                return Err(PathError::Csv {
                    line,
                    what: format!("direction: `{text}` is unknown, must be forward or reverse"),
                });
            }
        };
        Ok(RawPoint {
            position: Point2 {
                x_m: number(self.x, "x_m")?,
                y_m: number(self.y, "y_m")?,
            },
            elevation_m: self.z.map(|column| number(column, "z_m")).transpose()?,
            direction,
        })
    }
}

/// Returns the points of all tracks of a GPX text, or of its routes where it has no track, in the
/// local tangent plane (east, north) at the first point.
///
/// Track segments follow each other. Heights are the recorded ones minus the first, not the
/// tangent plane's, so that the ground does not fall away with the curvature of the earth.
///
/// # Errors
/// [`PathError::Gpx`] with the line for text that is not GPX or has no point, [`PathError::Read`] where
/// reading fails.
pub fn read_gpx(mut reader: impl Read) -> Result<Route, PathError> {
    let mut text = String::new();
    reader
        .read_to_string(&mut text)
        .map_err(|error| PathError::Read(error.to_string()))?;
    let text = text.trim_start_matches('\u{feff}');
    if !text.trim_start().starts_with('<') {
        return Err(PathError::Gpx {
            line: 1,
            what: "this is not XML; a CSV file must be named .csv".to_owned(),
        });
    }
    let document = roxmltree::Document::parse(text).map_err(|error| PathError::Gpx {
        line: error.pos().row,
        what: error.to_string(),
    })?;
    let root = document.root_element();
    if root.tag_name().name() != "gpx" {
        return Err(PathError::Gpx {
            line: 1,
            what: format!(
                "the root element is `{}`, must be gpx",
                root.tag_name().name()
            ),
        });
    }
    let places = |name: &'static str| {
        root.descendants()
            .filter(move |node| node.tag_name().name() == name)
            .map(|node| place(&document, node))
            .collect::<Result<Vec<GpxPoint>, PathError>>()
    };
    let mut found = places("trkpt")?;
    if found.is_empty() {
        found = places("rtept")?;
    }
    let first = found.first().ok_or_else(|| PathError::Gpx {
        line: 1,
        what: "there is no point of a track (trkpt) or of a route (rtept); waypoints are no path"
            .to_owned(),
    })?;
    let origin = GeodeticOrigin {
        latitude_deg: first.latitude_deg,
        longitude_deg: first.longitude_deg,
        elevation_m: first.elevation_m.unwrap_or(0.0),
    };
    Ok(Route {
        points: found.iter().map(|point| point.in_plane(&origin)).collect(),
        origin: Some(origin),
    })
}

struct GpxPoint {
    latitude_deg: f64,
    longitude_deg: f64,
    elevation_m: Option<f64>,
}

impl GpxPoint {
    fn in_plane(&self, origin: &GeodeticOrigin) -> RawPoint {
        RawPoint {
            position: origin.project(self.latitude_deg, self.longitude_deg),
            elevation_m: self.elevation_m.map(|z_m| z_m - origin.elevation_m),
            direction: None,
        }
    }
}

fn place(document: &roxmltree::Document, node: roxmltree::Node) -> Result<GpxPoint, PathError> {
    // Counts the lines from the beginning, so only for an error.
    let line = || document.text_pos_at(node.range().start).row;
    let number = |name: &str, text: &str, limit: f64| {
        finite(text)
            .filter(|value| value.abs() <= limit)
            .ok_or_else(|| PathError::Gpx {
                line: line(),
                what: format!("{name}: `{text}` is not a number within +-{limit}"),
            })
    };
    let attribute = |name: &str, limit: f64| {
        let text = node.attribute(name).ok_or_else(|| PathError::Gpx {
            line: line(),
            what: format!("a point has no `{name}`"),
        })?;
        number(name, text, limit)
    };
    let elevation = node
        .children()
        .find(|child| child.tag_name().name() == "ele")
        .map(|child| child.text().unwrap_or_default());
    Ok(GpxPoint {
        latitude_deg: attribute("lat", 90.0)?,
        longitude_deg: attribute("lon", 180.0)?,
        elevation_m: elevation.map(|text| number("ele", text, 1e5)).transpose()?,
    })
}

fn finite(text: &str) -> Option<f64> {
    text.trim()
        .parse()
        .ok()
        .filter(|value: &f64| value.is_finite())
}

fn csv_error(error: csv::Error) -> PathError {
    match error.kind() {
        csv::ErrorKind::Io(io) => PathError::Read(io.to_string()),
        csv::ErrorKind::UnequalLengths {
            pos,
            expected_len,
            len,
        } => PathError::Csv {
            line: pos.as_ref().map_or(0, csv::Position::line),
            what: format!(
                "{len} fields, but the header names {expected_len}; fields are separated by commas, so \
                 write decimals with a point (12.5, not 12,5)"
            ),
        },
        _ => PathError::Csv {
            line: error.position().map_or(1, csv::Position::line),
            what: error.to_string(),
        },
    }
}
