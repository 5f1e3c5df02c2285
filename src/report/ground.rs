use super::contours::Heights;
use super::frame::PlotFrame;
use super::scene::Scene;
use sidehill_plant::terrain::Surface;

/// Distance between the nodes at which the ground is sampled.
const NODE_PX: f64 = 3.0;

/// The ground within the map.
pub(super) struct GroundPicture {
    pub(super) heights: Heights,
    /// Mean of the gradient.
    pub(super) gradient: [f64; 2],
    /// Largest slope, as a gradient.
    pub(super) steepest: f64,
    /// Largest slope on the path, as a gradient.
    pub(super) steepest_on_path: f64,
    /// Whether the gradient is the same everywhere.
    pub(super) even: bool,
    /// Share of the map where there is ground.
    pub(super) share: f64,
}

impl GroundPicture {
    pub(super) fn of(scene: &Scene, frame: &PlotFrame) -> Self {
        let spacing = NODE_PX * (frame.x[1] - frame.x[0]) / frame.width;
        let nodes = |length_px: f64| (length_px / NODE_PX).ceil() as usize + 1;
        let (columns, rows) = (nodes(frame.width), nodes(frame.height));
        let origin = [frame.x[0], frame.y[0]];
        let surfaces: Vec<_> = (0..rows * columns)
            .map(|node| {
                let x_m = origin[0] + spacing * (node % columns) as f64;
                let y_m = origin[1] + spacing * (node / columns) as f64;
                scene.terrain.surface(x_m, y_m).ok()
            })
            .collect();
        let known = || surfaces.iter().flatten();
        let count = known().count().max(1) as f64;
        let mut gradient = [0.0; 2];
        for surface in known() {
            let [x, y] = surface.gradient_in_world();
            gradient = [gradient[0] + x / count, gradient[1] + y / count];
        }
        let differences = known().map(|surface| {
            let [x, y] = surface.gradient_in_world();
            (x - gradient[0]).hypot(y - gradient[1])
        });
        let slope = |surface: &Surface| {
            let [x, y] = surface.gradient_in_world();
            x.hypot(y)
        };
        let steepest = known().map(slope).fold(0.0, f64::max);
        let on_path = scene
            .path
            .iter()
            .filter_map(|p| scene.terrain.surface(p[0], p[1]).ok());
        Self {
            even: differences.fold(0.0, f64::max) <= 0.01 * steepest + 1e-6,
            gradient,
            steepest_on_path: on_path.map(|surface| slope(&surface)).fold(0.0, f64::max),
            steepest,
            share: known().count() as f64 / surfaces.len() as f64,
            heights: Heights {
                origin,
                spacing,
                columns,
                values: surfaces.iter().map(|s| s.map(|s| s.height_m)).collect(),
            },
        }
    }
}
