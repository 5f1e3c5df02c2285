//! `sidehill route`: a path from a recorded drive, or from a live one.

pub(crate) mod thinning;

use crate::bag::{Bag, is_bag};
use crate::config::{ConfigFile, named};
use crate::console;
use crate::drive_log::{LogArgs, LogReader, Positions, positions};
use crate::output;
use anyhow::{Context, Result, bail, ensure};
use serde::{Deserialize, Serialize};
use sidehill_bridge::ros2::position::PositionTopic;
use sidehill_controller::path::{
    GPX_NAMESPACE, GeodeticOrigin, Point2, Smoothing, SmoothingConfig,
};
use sidehill_plant::bounds::Bounds;
use sidehill_plant::vehicle::Vehicle;
use std::fmt::Write;
use std::path::PathBuf;
use std::time::Duration;
use thinning::{Making, TOLERANCE_M};

/// Arguments of `sidehill route`.
#[derive(Debug, Clone, Default, clap::Args, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RouteArgs {
    /// Recorded drive: a bag of ROS 2, or a log in CSV. `live` records from a running ROS 2 topic,
    /// takes --ros-args, and writes the path at Ctrl-C or after --seconds.
    pub from: PathBuf,
    /// File for the path: .gpx (needs fixes of a satellite receiver) or .csv.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Topic of the positions, sensor_msgs/NavSatFix or nav_msgs/Odometry, where a bag has several.
    #[arg(long, value_name = "NAME")]
    pub topic: Option<String>,
    /// With `live`: topic of the positions, nav_msgs/Odometry.
    #[arg(long, value_name = "TOPIC", conflicts_with = "fix")]
    pub odometry: Option<String>,
    /// With `live`: topic of the positions, sensor_msgs/NavSatFix.
    #[arg(long, value_name = "TOPIC")]
    pub fix: Option<String>,
    /// With `live`: time from the first position to the end of the recording, s; without it, until
    /// Ctrl-C.
    #[arg(long, value_name = "S")]
    pub seconds: Option<f64>,
    /// Columns of a CSV log, in YAML.
    #[arg(long, value_name = "FILE")]
    pub columns: Option<PathBuf>,
    /// Largest size of a log, and of what one of its files decompresses to, bytes.
    #[arg(long, value_name = "BYTES")]
    pub max_bytes: Option<u64>,
    /// Standard deviation of the positions in each direction, m: the path is as smooth as that asks
    /// for. By default estimated from the positions.
    #[arg(long, value_name = "M")]
    pub accuracy_m: Option<f64>,
    /// Standard deviation of a Gaussian along the path that smooths it beforehand, m.
    #[arg(long, value_name = "M")]
    pub smoothing_m: Option<f64>,
    /// Vehicle whose track width limits the curvature of the path; without it, to 1 1/m.
    #[arg(long, value_name = "FILE")]
    pub vehicle: Option<PathBuf>,
    /// Points closer than this to the line between their neighbours are left out, m.
    #[arg(long, value_name = "M", default_value_t = TOLERANCE_M)]
    pub tolerance_m: f64,
    /// Overwrite --out where it exists.
    #[arg(long)]
    pub force: bool,
}

impl RouteArgs {
    /// Returns whether positions come from a running ROS 2 topic.
    pub fn is_live(&self) -> bool {
        self.from.as_os_str() == "live"
    }
}

/// What the path is written as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Form {
    Gpx,
    Csv,
}

/// Writes the path of a recorded drive and prints its distance from the recorded positions.
///
/// # Errors
/// Positions missing in the recording, or a file that cannot be read or written.
pub fn run(args: &RouteArgs) -> Result<()> {
    write(args, console::complain)?.print(args);
    Ok(())
}

/// Writes the path of a recorded drive; `note` gets what changes the drive, and what is to be known of it.
///
/// # Errors
/// As [`run`].
pub fn write(args: &RouteArgs, mut note: impl FnMut(String)) -> Result<WrittenRoute> {
    let (form, making) = prepare(args)?;
    ensure!(
        args.odometry.is_none() && args.fix.is_none() && args.seconds.is_none(),
        "--odometry, --fix and --seconds are for `route live`; --topic chooses a topic of a bag"
    );
    write_path(
        args,
        form,
        &making,
        &args.from.display().to_string(),
        &recorded(args, &mut note)?,
        note,
    )
}

/// Writes the path of a running topic, whose positions `record` returns: from the first until a signal arrives, or the
/// time given is over.
///
/// # Errors
/// Those of `record`, or a file that cannot be written.
pub fn run_live(
    args: &RouteArgs,
    record: impl FnOnce(PositionTopic, Option<Duration>) -> Result<Positions>,
) -> Result<()> {
    let (form, making) = prepare(args)?;
    let topic = live_topic(args)?;
    if matches!(topic, PositionTopic::Odometry(_)) {
        check_origin(args, form, topic.name(), false)?;
    }
    let end_after = match args.seconds {
        Some(seconds) => {
            Bounds::new(0.1, 86_400.0, "s").check("--seconds", seconds)?;
            Some(Duration::from_secs_f64(seconds))
        }
        None => None,
    };
    let name = topic.name().to_owned();
    write_path(
        args,
        form,
        &making,
        &name,
        &record(topic, end_after)?,
        console::complain,
    )?
    .print(args);
    Ok(())
}

/// A path that was written to a file.
#[derive(Debug, Serialize)]
pub struct WrittenRoute {
    /// Number of its points.
    pub points: usize,
    /// Its length, m.
    pub length_m: f64,
    /// Number of the recorded positions.
    pub positions: usize,
    /// Their standard deviation in each direction, as stated or estimated, m.
    pub accuracy_m: f64,
    /// Largest distance between recorded and written path, m.
    pub deviation_m: f64,
}

impl WrittenRoute {
    fn print(&self, args: &RouteArgs) {
        console::line(format_args!(
            "{}: {} points over {:.1} m, from {} positions of an accuracy of {:.3} m; largest distance between recorded and written path {:.3} m",
            args.out.display(),
            self.points,
            self.length_m,
            self.positions,
            self.accuracy_m,
            self.deviation_m
        ));
    }
}

fn write_path(
    args: &RouteArgs,
    form: Form,
    making: &Making,
    name: &str,
    recorded: &Positions,
    mut note: impl FnMut(String),
) -> Result<WrittenRoute> {
    let mut note = |text: String| note(format!("{name}: note: {text}"));
    recorded.notes.iter().cloned().for_each(&mut note);
    check_origin(args, form, name, recorded.origin.is_some())?;
    let made = thinning::drivable(&recorded.points_m, making).with_context(|| name.to_owned())?;
    if let Some(cusps) = named(made.cusps.iter().copied()) {
        note(format!(
            "travel turns back at {cusps}: from there it is driven the other way, in reverse first"
        ));
    }
    if let Some(corners) = named(made.corners.iter().copied()) {
        note(format!(
            "the vehicle stops and turns on the spot at {corners}"
        ));
    }
    if made.taken_m > made.accuracy_m {
        note(format!(
            "its positions look {:.3} m accurate, but their path is too sharp; it is smoothed as for \
             --accuracy-m {}",
            made.accuracy_m, made.taken_m
        ));
    }
    let path = made.thinned;
    let text = match (form, &recorded.origin) {
        (Form::Gpx, Some(origin)) => gpx(&path.points_m, origin, recorded.has_heights),
        _ => csv(&path.points_m, recorded.has_heights),
    };
    output::write(&args.out, text.as_bytes(), args.force)?;
    if let (Form::Csv, Some(origin)) = (form, &recorded.origin) {
        note(format!(
            "x = 0, y = 0 is the first fix: `datum: {{latitude_deg: {:.9}, longitude_deg: {:.9}, \
             altitude_m: {:.3}}}`",
            origin.latitude_deg, origin.longitude_deg, origin.elevation_m
        ));
    }
    Ok(WrittenRoute {
        points: path.points_m.len(),
        length_m: path.length_m,
        positions: recorded.points_m.len(),
        accuracy_m: made.accuracy_m,
        deviation_m: path.deviation_m,
    })
}

/// Checks the settings and the file of the path, and returns what it is written as and made with.
fn prepare(args: &RouteArgs) -> Result<(Form, Making)> {
    Bounds::new(0.0, 10.0, "m").check("--smoothing-m", args.smoothing_m.unwrap_or(0.0))?;
    Bounds::new(0.0, 10.0, "m").check("--accuracy-m", args.accuracy_m.unwrap_or(0.0))?;
    Bounds::new(0.0, 1.0, "m").check("--tolerance-m", args.tolerance_m)?;
    let ending = args
        .out
        .extension()
        .map(|ending| ending.to_ascii_lowercase());
    let form = match ending.as_deref().and_then(|ending| ending.to_str()) {
        Some("gpx") => Form::Gpx,
        Some("csv") => Form::Csv,
        _ => bail!("{}: must end with .gpx or .csv", args.out.display()),
    };
    let limits = match &args.vehicle {
        Some(path) => {
            let icrs = ConfigFile::read(path)?.parse::<Vehicle>()?.icrs;
            SmoothingConfig::default().recorded(icrs.right_m - icrs.left_m)
        }
        None => Smoothing::default(),
    };
    output::check_writable(&args.out, args.force)?;
    output::check_apart(&args.out, [&args.from])?;
    let making = Making {
        accuracy_m: args.accuracy_m,
        smoothing_m: args.smoothing_m,
        tolerance_m: args.tolerance_m,
        max_curvature_per_m: limits.max_curvature_per_m,
    };
    Ok((form, making))
}

fn check_origin(args: &RouteArgs, form: Form, name: &str, has_origin: bool) -> Result<()> {
    ensure!(
        form == Form::Csv || has_origin,
        "{}: GPX has latitude and longitude, and {name} has none: write a .csv",
        args.out.display()
    );
    Ok(())
}

fn live_topic(args: &RouteArgs) -> Result<PositionTopic> {
    ensure!(
        args.topic.is_none() && args.columns.is_none(),
        "live: --topic and --columns are for recordings"
    );
    match (&args.odometry, &args.fix) {
        (Some(name), None) => Ok(PositionTopic::Odometry(name.clone())),
        (None, Some(name)) => Ok(PositionTopic::Fix(name.clone())),
        _ => bail!("live: name the topic with --odometry TOPIC or --fix TOPIC"),
    }
}

/// Returns the positions of a recording; `note` gets what its reader has to say.
fn recorded(args: &RouteArgs, note: impl FnMut(String)) -> Result<Positions> {
    if is_bag(&args.from) {
        if let Some(columns) = &args.columns {
            bail!(
                "{}: a bag has no columns, leave --columns out",
                columns.display()
            );
        }
        let bag = Bag::open(&args.from, args.max_bytes)?;
        let mut found = positions(&bag, args.topic.as_deref())?;
        found.notes.splice(0..0, bag.notes().iter().cloned());
        return Ok(found);
    }
    let ending = args
        .from
        .extension()
        .map(|ending| ending.to_ascii_lowercase());
    if ending.is_some_and(|ending| ending == "gpx") {
        bail!(
            "{}: is a path already; drive it with `sidehill simulate --path {0}`. `route` makes one of a bag or a log",
            args.from.display()
        );
    }
    let reader = LogReader::new(&LogArgs {
        columns: args.columns.clone(),
        topics: None,
        max_bytes: args.max_bytes,
    })?;
    let log = reader.read(&args.from, note)?;
    let poses = log.rows().iter().filter_map(|row| row.pose);
    Ok(Positions {
        points_m: poses.map(|pose| [pose.x_m, pose.y_m, pose.z_m]).collect(),
        origin: None,
        has_heights: true,
        notes: Vec::new(),
    })
}

fn csv(points_m: &[[f64; 3]], has_heights: bool) -> String {
    let mut out = if has_heights {
        "x_m,y_m,z_m\n"
    } else {
        "x_m,y_m\n"
    }
    .to_owned();
    for [x_m, y_m, z_m] in points_m {
        let _ = write!(out, "{x_m:.4},{y_m:.4}");
        if has_heights {
            let _ = write!(out, ",{z_m:.4}");
        }
        out.push('\n');
    }
    out
}

fn gpx(points_m: &[[f64; 3]], origin: &GeodeticOrigin, has_heights: bool) -> String {
    let mut out = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
        <gpx version=\"1.1\" creator=\"sidehill\" xmlns=\"http://www.topografix.com/GPX/1/1\">\n"
        .to_owned();
    // Points may be cut off: the others stay where they were.
    let _ = write!(
        out,
        "<metadata><extensions><datum xmlns=\"{GPX_NAMESPACE}\" latitude_deg=\"{:.9}\" longitude_deg=\"{:.9}\" \
         altitude_m=\"{:.3}\"/></extensions></metadata>\n<trk><trkseg>\n",
        origin.latitude_deg, origin.longitude_deg, origin.elevation_m
    );
    for [x_m, y_m, z_m] in points_m {
        let (latitude_deg, longitude_deg) = origin.unproject(Point2 {
            x_m: *x_m,
            y_m: *y_m,
        });
        // Nine decimals of a degree are 0.1 mm.
        let _ = write!(
            out,
            "<trkpt lat=\"{latitude_deg:.9}\" lon=\"{longitude_deg:.9}\">"
        );
        if has_heights {
            let _ = write!(out, "<ele>{:.3}</ele>", z_m + origin.elevation_m);
        }
        out.push_str("</trkpt>\n");
    }
    out + "</trkseg></trk>\n</gpx>\n"
}

#[cfg(test)]
mod tests {
    use super::*;
    use sidehill_controller::path::read_gpx;

    #[test]
    fn gpx_reads_back_where_it_was() {
        let origin = GeodeticOrigin {
            latitude_deg: 36.717,
            longitude_deg: -4.489,
            elevation_m: 60.0,
        };
        let points = [
            [0.0, 0.0, 0.0],
            [300.0, -400.0, 2.0],
            [-900.0, 1200.0, -3.5],
        ];
        let route = read_gpx(gpx(&points, &origin, true).as_bytes(), None).unwrap();
        for (point, expected) in route.points.iter().zip(points) {
            let found = [
                point.position.x_m,
                point.position.y_m,
                point.elevation_m.unwrap(),
            ];
            for (found, expected) in found.into_iter().zip(expected) {
                assert!((found - expected).abs() < 1e-3, "{found} {expected}");
            }
        }
    }

    #[test]
    fn gpx_without_its_first_points_is_where_it_was() {
        let origin = GeodeticOrigin {
            latitude_deg: 36.717,
            longitude_deg: -4.489,
            elevation_m: 60.0,
        };
        let text = gpx(&[[0.0; 3], [3.0, 4.0, 1.0], [6.0, 8.0, 2.0]], &origin, true);
        let first = text.find("<trkpt").unwrap();
        let second = first + 1 + text[first + 1..].find("<trkpt").unwrap();
        let cut = format!("{}{}", &text[..first], &text[second..]);
        let whole = read_gpx(text.as_bytes(), None).unwrap();
        let route = read_gpx(cut.as_bytes(), None).unwrap();
        assert_eq!(route.points[..], whole.points[1..]);
        assert!((route.points[0].position.y_m - 4.0).abs() < 1e-3);
        // The datum of a configuration counts before it; a datum without a number is refused with its line.
        let other = GeodeticOrigin {
            latitude_deg: 36.718,
            ..origin
        };
        let moved = read_gpx(cut.as_bytes(), Some(&other)).unwrap();
        assert!(moved.points[0].position.y_m < -100.0);
        let wrong = cut.replace("latitude_deg=\"", "latitude_deg=\"9");
        let error = read_gpx(wrong.as_bytes(), None).unwrap_err().to_string();
        assert!(
            error.contains("line 3") && error.contains("latitude_deg: 936.717"),
            "{error}"
        );
    }
}
