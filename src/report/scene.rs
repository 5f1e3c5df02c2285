use sidehill_controller::guard::GuardConfig;
use sidehill_controller::mpc::limits::InputLimits;
use sidehill_controller::path::GeodeticOrigin;
use sidehill_plant::terrain::Terrain;
use sidehill_plant::vehicle::Vehicle;

/// Properties shared by all runs of a report.
#[derive(Debug, Clone)]
pub struct Scene<'a> {
    /// Heading of the page.
    pub title: String,
    /// Line below it.
    pub subtitle: String,
    /// Path to follow, X_g and Y_g, m.
    pub path: Vec<[f64; 2]>,
    /// Ground.
    pub terrain: &'a Terrain,
    /// Steepness guard, where it is on.
    pub guard: Option<&'a GuardConfig>,
    /// Limits of the commands.
    pub limits: &'a InputLimits,
    /// Place on earth of x = 0, y = 0, where it has one.
    pub datum: Option<GeodeticOrigin>,
    /// Whether the controllers got the true state: no errors, delays or gaps.
    pub perfect_sensors: bool,
    /// What drives.
    pub vehicle: &'a Vehicle,
    /// Control period, s.
    pub period_s: f64,
}

/// Appearance of a run.
pub(super) struct Style {
    pub(super) name: String,
    pub(super) colour: &'static str,
}
