//! Robots that `sidehill init` knows, from their makers' publications, and any other by its measures.

use sidehill_plant::bounds::Bounds;
use sidehill_plant::vehicle::RangeError;

/// Which robot a set of files is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Robot {
    /// Clearpath Husky A200.
    #[default]
    Husky,
    /// Clearpath Jackal J100.
    Jackal,
    /// Clearpath Warthog W200 on wheels.
    Warthog,
    /// AgileX Scout 2.0.
    Scout,
    /// AgileX Scout Mini on off-road wheels.
    ScoutMini,
    /// AgileX Bunker, on tracks.
    Bunker,
    /// Husarion Panther on its wheels WH01.
    Panther,
    /// Argo J8 of the University of Malaga: measured parameters instead of first guesses.
    J8,
    /// A rover on tracks; its measures are an example to be replaced.
    Tracks,
}

/// What a maker publishes about a robot, and what is assumed about the rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Measures<'a> {
    /// Name of the vehicle.
    pub(super) name: &'a str,
    /// Maker and model, for the files' first lines.
    pub(super) title: &'a str,
    /// Where the measures come from.
    pub(super) source: &'a str,
    /// Mass without payload, kg.
    pub(super) mass_kg: f64,
    /// Distance between the middles of left and right wheels or tracks, m.
    pub(super) track_m: f64,
    /// Distance between the first and the last axle, m; of tracks their length on the ground.
    pub(super) wheelbase_m: f64,
    /// Axles; tracks are made of many small ones.
    pub(super) axles: usize,
    /// Radius of wheels or sprockets, m.
    pub(super) radius_m: f64,
    /// Assumed height of the centre of mass above the ground, m.
    pub(super) centre_of_mass_height_m: f64,
    /// The maker's `wheel_separation_multiplier`, where there is one: the distance of the tread ICRs
    /// over that of the wheels on level ground.
    pub(super) separation_multiplier: Option<f64>,
    /// Largest speed of a tread, m/s; where it is not given, speeds are those of the defaults.
    pub(super) speed_m_s: Option<f64>,
}

/// Measures of a robot that is not known.
#[derive(Debug, Clone, clap::Args)]
#[group(requires_all = ["length", "width", "wheel_radius", "mass", "speed"])]
pub struct OwnRobot {
    /// Distance between the first and the last axle, m; of tracks their length on the ground. With all of --length,
    /// --width, --wheel-radius, --mass and --speed the set is for a robot of these measures.
    #[arg(long, required = false, value_name = "M", conflicts_with = "vehicle")]
    pub length: f64,
    /// Distance between the middles of the left and the right wheels or tracks, m.
    #[arg(long, required = false, value_name = "M")]
    pub width: f64,
    /// Radius of the wheels or sprockets, m.
    #[arg(long, required = false, value_name = "M")]
    pub wheel_radius: f64,
    /// Mass with payload, kg.
    #[arg(long, required = false, value_name = "KG")]
    pub mass: f64,
    /// Largest speed of the wheels, m/s.
    #[arg(long, required = false, value_name = "M/S")]
    pub speed: f64,
    /// Name of the robot, of letters, digits, - and _; rover without it.
    #[arg(long, value_parser = robot_name)]
    pub name: Option<String>,
    /// Axles, evenly spaced along the length.
    #[arg(skip = 2_usize)]
    pub axles: usize,
}

/// Returns the name of a robot: letters, digits, - and _, so that it is a YAML text and a file's name as it is.
///
/// # Errors
/// What it must be.
pub fn robot_name(text: &str) -> Result<String, String> {
    let allowed = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    match text.starts_with(|c: char| c.is_ascii_alphabetic()) && text.chars().all(allowed) {
        true => Ok(text.to_owned()),
        false => Err("must begin with a letter and have letters, digits, - and _ only".to_owned()),
    }
}

impl OwnRobot {
    /// Returns its measures, with assumptions for the rest.
    ///
    /// # Errors
    /// [`RangeError`] with the argument out of its range.
    pub(super) fn measures(&self) -> Result<Measures<'_>, RangeError> {
        let name = self.name.as_deref().unwrap_or("rover");
        Ok(Measures {
            name,
            title: name,
            source: "the arguments of sidehill init",
            mass_kg: Bounds::new(0.5, 50_000.0, "kg").check("--mass", self.mass)?,
            track_m: Bounds::new(0.05, 10.0, "m").check("--width", self.width)?,
            wheelbase_m: Bounds::new(0.05, 10.0, "m").check("--length", self.length)?,
            axles: self.axles,
            radius_m: Bounds::new(0.01, 2.0, "m").check("--wheel-radius", self.wheel_radius)?,
            // As of the known robots.
            centre_of_mass_height_m: 1.25 * self.wheel_radius,
            separation_multiplier: None,
            speed_m_s: Some(Bounds::new(0.1, 10.0, "m/s").check("--speed", self.speed)?),
        })
    }
}

impl Robot {
    /// Returns its measures; none for the J8, whose own files are copied.
    pub(super) fn measures(self) -> Option<Measures<'static>> {
        match self {
            Self::Husky => Some(Measures {
                name: "husky",
                title: "Clearpath Husky A200",
                source: "clearpath_common, clearpath_control/config/a200/control.yaml (wheel separation and its \
                         multiplier, radius, speed); Husky A200 data sheet (wheelbase, mass)",
                mass_kg: 50.0,
                track_m: 0.555,
                wheelbase_m: 0.512,
                axles: 2,
                radius_m: 0.1651,
                centre_of_mass_height_m: 0.2,
                separation_multiplier: Some(1.875),
                speed_m_s: None,
            }),
            Self::Jackal => Some(Measures {
                name: "jackal",
                title: "Clearpath Jackal J100",
                source: "clearpath_common, clearpath_control/config/j100/control.yaml (wheel separation and its \
                         multiplier, radius, speed); Jackal J100 data sheet (wheelbase, mass)",
                mass_kg: 17.0,
                track_m: 0.37559,
                wheelbase_m: 0.262,
                axles: 2,
                radius_m: 0.098,
                centre_of_mass_height_m: 0.12,
                separation_multiplier: Some(1.5),
                speed_m_s: None,
            }),
            Self::Warthog => Some(Measures {
                name: "warthog",
                title: "Clearpath Warthog W200 on wheels",
                source: "warthog_description (wheelbase, track, wheel radius); Warthog W200 data sheet (mass)",
                mass_kg: 280.0,
                track_m: 1.1369,
                wheelbase_m: 0.9148,
                axles: 2,
                radius_m: 0.3,
                centre_of_mass_height_m: 0.4,
                separation_multiplier: None,
                speed_m_s: None,
            }),
            Self::Scout => Some(Measures {
                name: "scout",
                title: "AgileX Scout 2.0",
                source: "agilexrobotics/ugv_gazebo_sim, scout_v2.xacro (wheelbase, track, wheel radius); ugv_sdk, \
                         robot_limits.hpp (speed); the mass is assumed",
                mass_kg: 68.0,
                track_m: 0.58306,
                wheelbase_m: 0.498,
                axles: 2,
                radius_m: 0.16459,
                centre_of_mass_height_m: 0.2,
                separation_multiplier: None,
                speed_m_s: Some(1.5),
            }),
            Self::ScoutMini => Some(Measures {
                name: "scout_mini",
                title: "AgileX Scout Mini on off-road wheels",
                source: "agilexrobotics/scout_ros, scout_mini.urdf.xacro (wheelbase, track); ugv_sdk, robot_limits.hpp \
                         (speed); mass and wheel radius are assumed",
                mass_kg: 23.0,
                track_m: 0.416503,
                wheelbase_m: 0.463951,
                axles: 2,
                radius_m: 0.0875,
                centre_of_mass_height_m: 0.12,
                separation_multiplier: None,
                speed_m_s: Some(3.0),
            }),
            Self::Bunker => Some(Measures {
                name: "bunker",
                title: "AgileX Bunker",
                source: "agilexrobotics/ugv_gazebo_sim, bunker.xacro (track and length on the ground, from the places of the \
                         lower rollers); bunker_ros, bunker_params.hpp (speed); mass and sprocket radius are assumed",
                mass_kg: 140.0,
                track_m: 0.555,
                wheelbase_m: 0.5215,
                axles: 8,
                radius_m: 0.067,
                centre_of_mass_height_m: 0.2,
                separation_multiplier: None,
                speed_m_s: Some(1.5),
            }),
            Self::Panther => Some(Measures {
                name: "panther",
                title: "Husarion Panther on wheels WH01",
                source: "husarion_ugv_ros, WH01_controller.yaml (wheel separation and its multiplier, radius, speed), \
                         panther_macro.urdf.xacro (wheelbase), base.urdf.xacro and WH01.yaml (mass)",
                mass_kg: 55.0,
                track_m: 0.697,
                wheelbase_m: 0.44,
                axles: 2,
                radius_m: 0.1825,
                centre_of_mass_height_m: 0.2,
                separation_multiplier: Some(1.5),
                speed_m_s: Some(2.0),
            }),
            Self::Tracks => Some(Measures {
                name: "tracks",
                title: "A rover on tracks",
                source: "an example: replace all measures by those of your vehicle",
                mass_kg: 150.0,
                track_m: 0.606,
                wheelbase_m: 0.8,
                axles: 8,
                radius_m: 0.0856,
                centre_of_mass_height_m: 0.25,
                separation_multiplier: None,
                speed_m_s: None,
            }),
            Self::J8 => None,
        }
    }
}
