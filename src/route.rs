//! `sidehill route`: a path from a recorded drive, or from a live one.

mod live;
pub(crate) mod thinning;

use crate::bag::{Bag, is_bag};
use crate::console;
use crate::drive_log::{LogArgs, LogReader, Positions, positions};
use crate::output;
use anyhow::{Context, Result, bail, ensure};
use sidehill_bridge::ros2::positions::PositionTopic;
use sidehill_controller::path::{GeodeticOrigin, Point2};
use sidehill_plant::bounds::Bounds;
use std::fmt::Write;
use std::path::PathBuf;
use std::time::Duration;
use thinning::Settings;

/// Arguments of `sidehill route`.
#[derive(Debug, Clone, clap::Args)]
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
    /// Standard deviation of the Gaussian along the path that smooths it, m; 0 for none.
    #[arg(long, value_name = "M", default_value_t = Settings::default().smoothing_m)]
    pub smoothing_m: f64,
    /// Points closer than this to the line between their neighbours are left out, m.
    #[arg(long, value_name = "M", default_value_t = Settings::default().tolerance_m)]
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

/// Writes the path and prints its distance from the recorded positions.
///
/// # Errors
/// Positions missing in the recording or on the topic, or a file that cannot be read or written.
pub fn run(args: &RouteArgs, ros_arguments: &[String]) -> Result<()> {
    Bounds::new(0.0, 10.0, "m").check("--smoothing-m", args.smoothing_m)?;
    Bounds::new(0.0, 1.0, "m").check("--tolerance-m", args.tolerance_m)?;
    let form = form(args)?;
    output::check_writable(&args.out, args.force)?;
    let (name, recorded) = if args.is_live() {
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
        (name, live::record(topic, end_after, ros_arguments)?)
    } else {
        ensure!(
            args.odometry.is_none() && args.fix.is_none() && args.seconds.is_none(),
            "--odometry, --fix and --seconds are for `route live`; --topic chooses a topic of a bag"
        );
        (args.from.display().to_string(), recorded(args)?)
    };
    for note in &recorded.notes {
        console::complain(format_args!("{name}: note: {note}"));
    }
    check_origin(args, form, &name, recorded.origin.is_some())?;
    let settings = Settings {
        smoothing_m: args.smoothing_m,
        tolerance_m: args.tolerance_m,
    };
    let path = thinning::path(&recorded.points_m, &settings).with_context(|| name.clone())?;
    let text = match (form, recorded.origin) {
        (Form::Gpx, Some(origin)) => gpx(&path.points_m, &origin, recorded.has_heights),
        _ => csv(&path.points_m, recorded.has_heights),
    };
    output::write(&args.out, text.as_bytes(), args.force)?;
    console::line(format_args!(
        "{}: {} points over {:.1} m, from {} positions; largest distance between recorded and written path {:.3} m",
        args.out.display(),
        path.points_m.len(),
        path.length_m,
        recorded.points_m.len(),
        path.deviation_m
    ));
    Ok(())
}

fn form(args: &RouteArgs) -> Result<Form> {
    let ending = args
        .out
        .extension()
        .map(|ending| ending.to_ascii_lowercase());
    match ending.as_deref().and_then(|ending| ending.to_str()) {
        Some("gpx") => Ok(Form::Gpx),
        Some("csv") => Ok(Form::Csv),
        _ => bail!("{}: must end with .gpx or .csv", args.out.display()),
    }
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

/// Returns the positions of a recording.
fn recorded(args: &RouteArgs) -> Result<Positions> {
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
    let reader = LogReader::new(&LogArgs {
        columns: args.columns.clone(),
        topics: None,
        max_bytes: args.max_bytes,
    })?;
    let log = reader.read(&args.from)?;
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
        <gpx version=\"1.1\" creator=\"sidehill\" xmlns=\"http://www.topografix.com/GPX/1/1\">\n<trk><trkseg>\n"
        .to_owned();
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
        let route = read_gpx(gpx(&points, &origin, true).as_bytes()).unwrap();
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
}
