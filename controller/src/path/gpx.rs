//! Routes from GPX text.

use super::point::finite;
use super::{PathError, Point2, RawPoint};
use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::{Bounds, RangeError};
use sidehill_plant::number::likely_mistake;
use sidehill_plant::statistics::median;
use std::io::Read;

/// The points of a route in the world: X_g east, Y_g north, Z_g up.
#[derive(Debug, Clone, PartialEq)]
pub struct Route {
    /// The points in the order they are driven.
    pub points: Vec<RawPoint>,
    /// What is to be done at points: the index of each, from 0, in ascending order, and the text.
    pub actions: Vec<(usize, String)>,
    /// Where the world's origin is, for a route given in latitude and longitude.
    pub origin: Option<GeodeticOrigin>,
    /// What was done with the file and changes what is driven, a line each.
    pub notes: Vec<String>,
}

/// Where the local tangent plane of a GPX route touches the WGS 84 ellipsoid: the world's origin.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RawDatum", into = "RawDatum")]
pub struct GeodeticOrigin {
    /// Latitude, deg, north positive.
    pub latitude_deg: f64,
    /// Longitude, deg, east positive.
    pub longitude_deg: f64,
    /// Height, m, as recorded; 0 where the first point has none.
    pub elevation_m: f64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawDatum {
    /// Latitude, north positive.
    latitude_deg: f64,
    /// Longitude, east positive.
    longitude_deg: f64,
    /// Height that is z = 0, as recorded.
    #[serde(default)]
    altitude_m: f64,
}

impl TryFrom<RawDatum> for GeodeticOrigin {
    type Error = RangeError;

    fn try_from(raw: RawDatum) -> Result<Self, RangeError> {
        let within =
            |limit: f64, unit, key, value| Bounds::new(-limit, limit, unit).check(key, value);
        Ok(Self {
            latitude_deg: within(90.0, "deg", "latitude_deg", raw.latitude_deg)?,
            longitude_deg: within(180.0, "deg", "longitude_deg", raw.longitude_deg)?,
            elevation_m: within(1e5, "m", "altitude_m", raw.altitude_m)?,
        })
    }
}

impl From<GeodeticOrigin> for RawDatum {
    fn from(origin: GeodeticOrigin) -> Self {
        Self {
            latitude_deg: origin.latitude_deg,
            longitude_deg: origin.longitude_deg,
            altitude_m: origin.elevation_m,
        }
    }
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

    /// Returns what a page needs to name places: the coefficients of 1, x, y, x^2, x y and y^2 in latitude and longitude,
    /// deg and m. Within 10 km they are true to 5 cm.
    pub fn expansion(&self) -> [[f64; 2]; 6] {
        /// Length of the steps, m.
        const STEP_M: f64 = 3000.0;
        let at = |x: f64, y: f64| {
            let (x_m, y_m) = (x * STEP_M, y * STEP_M);
            let (latitude_deg, longitude_deg) = self.unproject(Point2 { x_m, y_m });
            [latitude_deg, longitude_deg]
        };
        let here = at(0.0, 0.0);
        let (right, left, up, down) = (at(1.0, 0.0), at(-1.0, 0.0), at(0.0, 1.0), at(0.0, -1.0));
        let (same, other) = (
            [at(1.0, 1.0), at(-1.0, -1.0)],
            [at(1.0, -1.0), at(-1.0, 1.0)],
        );
        let each = |of: &dyn Fn(usize) -> f64| [of(0), of(1)];
        let square_m2 = STEP_M * STEP_M;
        [
            here,
            each(&|k| (right[k] - left[k]) / (2.0 * STEP_M)),
            each(&|k| (up[k] - down[k]) / (2.0 * STEP_M)),
            each(&|k| (right[k] - 2.0 * here[k] + left[k]) / (2.0 * square_m2)),
            each(&|k| (same[0][k] + same[1][k] - other[0][k] - other[1][k]) / (4.0 * square_m2)),
            each(&|k| (up[k] - 2.0 * here[k] + down[k]) / (2.0 * square_m2)),
        ]
    }
}

/// Farthest a route may be from its datum, m: a tangent plane is true to 1e-6 as far as that.
const DATUM_DISTANCE_MAX_M: f64 = 1e4;
/// Gap between segments that may be a missed point, m; or this many times the usual distance of points.
const GAP_M: f64 = 2.0;
const GAP_STEPS: f64 = 3.0;
/// Distance beyond which a point is not of the same place on earth as the one before, m.
const LEAP_M: f64 = 1e4;
/// A stray point is at least this far from both its neighbours, m, and this many times as far as they are from each
/// other.
const STRAY_M: f64 = 20.0;
const STRAY_TIMES: f64 = 10.0;

/// Namespace of the element `datum` that a GPX file may have as an extension: the origin of the world in which the route
/// was recorded, so that its first points can be cut off without moving the others.
pub const GPX_NAMESPACE: &str = "urn:sidehill:gpx:1";

/// Returns the points of all tracks of a GPX text, or of its routes where it has no track, in the local tangent plane
/// (east, north) at `datum`, or else at the file's own [datum](GPX_NAMESPACE), or at the first point.
///
/// Segments that follow each other without a gap are joined, which a note says, as it does of a long way without points
/// in a track. Heights are the recorded ones minus
/// the datum's, not the tangent plane's, so that the ground does not fall away with the curvature of the earth.
///
/// # Errors
/// [`PathError::Gpx`] with the line for text that is not GPX or has no point, for segments with a gap between them,
/// and for points that cannot be meant; [`PathError::Read`] where reading fails.
pub fn read_gpx(mut reader: impl Read, datum: Option<&GeodeticOrigin>) -> Result<Route, PathError> {
    let mut text = String::new();
    reader
        .read_to_string(&mut text)
        .map_err(|error| PathError::Read(error.to_string()))?;
    let text = text.trim_start_matches('\u{feff}');
    if !text.trim_start().starts_with('<') {
        return Err(fault(
            1,
            "this is not XML, so no GPX; a CSV file must be named .csv",
        ));
    }
    let document = roxmltree::Document::parse(text).map_err(|error| {
        let remedy = match error {
            roxmltree::Error::DtdDetected => {
                "; remove its line <!DOCTYPE ...>, which a GPX does not need"
            }
            _ => "",
        };
        fault(error.pos().row, format!("{error}{remedy}"))
    })?;
    let root = document.root_element();
    if root.tag_name().name() != "gpx" {
        let name = root.tag_name().name();
        return Err(fault(
            1,
            format!("the root element is `{name}`, must be gpx; save or convert the file as GPX"),
        ));
    }
    let mut segments = segments(&document, "trkseg", "trkpt")?;
    let recorded = !segments.is_empty();
    if !recorded {
        segments = self::segments(&document, "rte", "rtept")?;
    }
    let places: Vec<&GpxPoint> = segments.iter().flatten().collect();
    let first = places.first().ok_or_else(|| {
        fault(
            1,
            "there is no point of a track (trkpt) or of a route (rtept); waypoints are no path",
        )
    })?;
    let lost = |place: &&&GpxPoint| place.latitude_deg == 0.0 && place.longitude_deg == 0.0;
    let elsewhere = |place: &&GpxPoint| place.latitude_deg.hypot(place.longitude_deg) > 0.1;
    if let Some(place) = places.iter().find(lost)
        && places.iter().any(elsewhere)
    {
        return Err(fault(
            place.line,
            "latitude 0, longitude 0 is what receivers write without a fix; remove the point",
        ));
    }
    let own = match datum {
        Some(_) => None,
        None => own_datum(&document)?,
    };
    let origin = datum.copied().or(own).unwrap_or(GeodeticOrigin {
        latitude_deg: first.latitude_deg,
        longitude_deg: first.longitude_deg,
        elevation_m: first.elevation_m.unwrap_or(0.0),
    });
    let points: Vec<RawPoint> = places.iter().map(|point| point.in_plane(&origin)).collect();
    let away_m = points[0].position.distance_m(&Point2::default());
    if away_m > DATUM_DISTANCE_MAX_M {
        return Err(fault(
            first.line,
            format!(
                "this point is {:.0} km from the datum, at most {:.0} km are allowed; are latitude and longitude \
                 exchanged, or is the datum that of another place?",
                away_m / 1e3,
                DATUM_DISTANCE_MAX_M / 1e3
            ),
        ));
    }
    check_legs(&places, &points)?;
    let mut notes = Vec::new();
    let mut nodes = document.descendants();
    if recorded && nodes.any(|node| node.has_tag_name_of("rtept")) {
        notes.push("of its tracks and routes only the tracks are driven".to_owned());
    }
    let usual_m = usual_leg_m(&segments, &points);
    notes.extend(joined(&segments, &places, &points, usual_m)?);
    if recorded {
        notes.extend(straight(&places, &points, usual_m));
    }
    Ok(Route {
        points,
        actions: Vec::new(),
        origin: Some(origin),
        notes,
    })
}

/// Returns the datum that the file itself has.
fn own_datum(document: &roxmltree::Document) -> Result<Option<GeodeticOrigin>, PathError> {
    let mut all = document.descendants();
    let Some(node) = all.find(|node| node.has_tag_name((GPX_NAMESPACE, "datum"))) else {
        return Ok(None);
    };
    let line = document.text_pos_at(node.range().start).row;
    let number = |name: &str| {
        let value = node.attribute(name).and_then(finite);
        value.ok_or_else(|| fault(line, format!("the datum has no number as `{name}`")))
    };
    let raw = RawDatum {
        latitude_deg: number("latitude_deg")?,
        longitude_deg: number("longitude_deg")?,
        altitude_m: number("altitude_m")?,
    };
    let datum = raw.try_into();
    datum
        .map(Some)
        .map_err(|error: RangeError| fault(line, error.to_string()))
}

struct GpxPoint {
    line: u32,
    latitude_deg: f64,
    longitude_deg: f64,
    elevation_m: Option<f64>,
}

impl GpxPoint {
    fn in_plane(&self, origin: &GeodeticOrigin) -> RawPoint {
        RawPoint {
            position: origin.project(self.latitude_deg, self.longitude_deg),
            elevation_m: self.elevation_m.map(|z_m| z_m - origin.elevation_m),
            ..RawPoint::default()
        }
    }
}

/// Refuses points that cannot be meant: on another part of the earth, or far from both neighbours.
fn check_legs(places: &[&GpxPoint], points: &[RawPoint]) -> Result<(), PathError> {
    let leg_m = |a: usize, b: usize| points[a].position.distance_m(&points[b].position);
    for (at, place) in places.iter().enumerate().skip(1) {
        let before_m = leg_m(at - 1, at);
        // Beyond the horizon the plane's distances are too short, but long enough to be seen.
        if before_m > LEAP_M {
            return Err(fault(
                place.line,
                format!(
                    "this point is {:.0} km from the one before; are latitude and longitude exchanged, or was the \
                     fix lost?",
                    before_m / 1e3
                ),
            ));
        }
        if at + 1 < points.len() {
            let (after_m, across_m) = (leg_m(at, at + 1), leg_m(at - 1, at + 1));
            if before_m.min(after_m) > STRAY_M.max(STRAY_TIMES * across_m) {
                return Err(fault(
                    place.line,
                    format!(
                        "this point is {before_m:.0} m and {after_m:.0} m from its neighbours, which are \
                         {across_m:.1} m apart; remove it if it is a stray fix"
                    ),
                ));
            }
        }
    }
    Ok(())
}

/// Returns the index of the first point of each segment but the first.
fn begins(segments: &[Vec<GpxPoint>]) -> Vec<usize> {
    let lengths = segments.iter().map(Vec::len);
    let mut begins: Vec<usize> = lengths
        .scan(0, |end, length| {
            *end += length;
            Some(*end)
        })
        .collect();
    begins.pop();
    begins
}

/// Returns the distance from the point before, m.
fn leg_m(points: &[RawPoint], at: usize) -> f64 {
    points[at - 1].position.distance_m(&points[at].position)
}

/// Returns the median distance of points within a segment, m.
fn usual_leg_m(segments: &[Vec<GpxPoint>], points: &[RawPoint]) -> f64 {
    let begins = begins(segments);
    let within = (1..points.len()).filter(|at| begins.binary_search(at).is_err());
    median(within.map(|at| leg_m(points, at)).collect()).unwrap_or(0.0)
}

/// Returns the note about the longest way between two points of a track that nobody can have recorded.
fn straight(places: &[&GpxPoint], points: &[RawPoint], usual_m: f64) -> Option<String> {
    let legs = (1..points.len()).map(|at| (at, leg_m(points, at)));
    let (at, longest_m) = legs.max_by(|a, b| a.1.total_cmp(&b.1))?;
    (longest_m > STRAY_M.max(STRAY_TIMES * usual_m)).then(|| {
        format!(
            "line {} of the GPX: the point is {longest_m:.1} m from the one before, where {usual_m:.1} m are usual: \
             what lies between counts as straight",
            places[at].line
        )
    })
}

/// Returns the note about segments that were joined.
fn joined(
    segments: &[Vec<GpxPoint>],
    places: &[&GpxPoint],
    points: &[RawPoint],
    usual_m: f64,
) -> Result<Option<String>, PathError> {
    let begins = begins(segments);
    let leg_m = |at: usize| leg_m(points, at);
    for &at in &begins {
        let gap_m = leg_m(at);
        if gap_m > GAP_M.max(GAP_STEPS * usual_m) {
            return Err(fault(
                places[at].line,
                format!(
                    "a segment begins here, {gap_m:.1} m from the end of the one before; nobody recorded the way \
                     between them. Keep one segment a file, or join them by points that can be driven"
                ),
            ));
        }
    }
    let widest_m = begins.iter().map(|&at| leg_m(at)).fold(0.0, f64::max);
    Ok((!begins.is_empty()).then(|| {
        format!(
            "{} segments follow each other with at most {widest_m:.2} m between them and were joined",
            segments.len()
        )
    }))
}

/// Returns the points of each element `parent` that has any.
fn segments(
    document: &roxmltree::Document,
    parent: &str,
    point: &str,
) -> Result<Vec<Vec<GpxPoint>>, PathError> {
    let mut lines = Lines::default();
    let mut segments = Vec::new();
    for node in document
        .descendants()
        .filter(|node| node.has_tag_name_of(parent))
    {
        let points = node
            .descendants()
            .filter(|node| node.has_tag_name_of(point));
        let points = points
            .map(|node| place(&node, lines.line(document, node.range().start)))
            .collect::<Result<Vec<GpxPoint>, PathError>>()?;
        if !points.is_empty() {
            segments.push(points);
        }
    }
    Ok(segments)
}

/// A tag by its name in any namespace.
trait Named {
    fn has_tag_name_of(&self, name: &str) -> bool;
}

impl Named for roxmltree::Node<'_, '_> {
    fn has_tag_name_of(&self, name: &str) -> bool {
        self.tag_name().name() == name
    }
}

/// Counts lines as far as asked for, in ascending order, so that the text is passed once.
struct Lines {
    at: usize,
    line: u32,
}

impl Default for Lines {
    fn default() -> Self {
        Self { at: 0, line: 1 }
    }
}

impl Lines {
    fn line(&mut self, document: &roxmltree::Document, at: usize) -> u32 {
        let passed = document
            .input_text()
            .as_bytes()
            .get(self.at..at)
            .unwrap_or_default();
        self.line += passed.iter().filter(|&&byte| byte == b'\n').count() as u32;
        self.at = self.at.max(at);
        self.line
    }
}

fn fault(line: u32, what: impl Into<String>) -> PathError {
    PathError::Gpx {
        line,
        what: what.into(),
    }
}

fn place(node: &roxmltree::Node, line: u32) -> Result<GpxPoint, PathError> {
    let number = |name: &str, text: &str, limit: f64| {
        finite(text)
            .filter(|value| value.abs() <= limit)
            .ok_or_else(|| {
                // A longitude does not fit where a latitude stands.
                let exchanged =
                    name == "lat" && finite(text).is_some_and(|value| value.abs() <= 180.0);
                let hint = if exchanged {
                    "; are lat and lon exchanged?"
                } else {
                    likely_mistake(text)
                };
                fault(
                    line,
                    format!("{name}: `{text}` is not a number within +-{limit}{hint}"),
                )
            })
    };
    let attribute = |name: &str, limit: f64| {
        let text = node
            .attribute(name)
            .ok_or_else(|| fault(line, format!("a point has no `{name}`")))?;
        number(name, text, limit)
    };
    let elevation = node
        .children()
        .find(|child| child.has_tag_name_of("ele"))
        .and_then(|child| child.text())
        // `<ele/>` and NaN are an elevation that is not known.
        .filter(|text| !text.trim().is_empty() && !text.trim().eq_ignore_ascii_case("nan"));
    Ok(GpxPoint {
        line,
        latitude_deg: attribute("lat", 90.0)?,
        longitude_deg: attribute("lon", 180.0)?,
        elevation_m: elevation.map(|text| number("ele", text, 1e5)).transpose()?,
    })
}
