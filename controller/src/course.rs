//! Named analytic courses.

mod figure_eight;

pub use figure_eight::FigureEight;
