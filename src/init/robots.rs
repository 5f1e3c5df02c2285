//! Robots that `sidehill init` knows, from their makers' publications.

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
    /// Argo J8 of the University of Malaga: measured parameters instead of first guesses.
    J8,
    /// A rover on tracks; its measures are an example to be replaced.
    Tracks,
}

/// What a maker publishes about a robot, and what is assumed about the rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Measures {
    /// Name of the vehicle.
    pub(super) name: &'static str,
    /// Maker and model, for the files' first lines.
    pub(super) title: &'static str,
    /// Where the measures come from.
    pub(super) source: &'static str,
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
    /// Largest acceleration of a motor that is asked for, m/s^2: well below what the maker allows.
    pub(super) acceleration_m_s2: f64,
}

impl Robot {
    /// Returns its measures; none for the J8, whose own files are copied.
    pub(super) fn measures(self) -> Option<Measures> {
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
                acceleration_m_s2: 1.0,
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
                acceleration_m_s2: 1.0,
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
                acceleration_m_s2: 1.0,
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
                acceleration_m_s2: 1.0,
            }),
            Self::J8 => None,
        }
    }
}
