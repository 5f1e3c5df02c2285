use maud::{Markup, html};
use sidehill_controller::guard::GuardConfig;
use sidehill_controller::mpc::limits::InputLimits;
use sidehill_plant::terrain::Terrain;

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
    /// Half width of the rectangle of the wheels' contact points, m.
    pub base_half_width_m: f64,
    /// Half length of it, m.
    pub base_half_length_m: f64,
    /// Control period, s.
    pub period_s: f64,
}

/// Appearance of a run.
pub(super) struct Style {
    pub(super) name: String,
    pub(super) colour: &'static str,
}

/// Width of every drawing; the page scales them.
pub(super) const DRAWING_WIDTH_PX: f64 = 960.0;

pub(super) fn swatch(style: &Style) -> Markup {
    html! { span.swatch style={ "background:" (style.colour) } {} }
}
