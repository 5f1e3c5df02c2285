//! Identification of a vehicle's ICR parameters from logs, in the paper's two stages (section III-B).
//!
//! Level logs give c_l, c_r and the horizontal ICRs; logs on a slope then give lambda_1 and lambda_2.
//! Both minimise J of equation (13) over segments of a stated length, dead-reckoned by (11), (4)-(10)
//! and (12). Beyond the paper:
//!
//! - Each segment's start pose is estimated with the parameters. A measured start pose would put its
//!   noise into every later error of the segment and bias the parameters. For given parameters the
//!   best start has a closed form except for its yaw, so it is eliminated inside the residual.
//! - Poses far off weigh less (Cauchy's loss, by iteratively reweighted least squares).
//! - Segments without motion, or across a gap in the log, are left out.
//! - Every parameter gets a standard deviation from the scatter between segments (the "sandwich" of
//!   clustered residuals), since errors within a segment are correlated.
//! - [`identify_level_determined`] and [`identify_slope_determined`] keep the start values of parameters whose
//!   interval is wide.
//! - Parameters that the data cannot distinguish are named, from the eigenvalues of the scaled normal matrix.
//! - Beyond both stages, [`identify_extension`] says which terms of the extended model the logs support.
//! - [`identify_contact`] fits the physical parameters of a vehicle on wheels with friction.
//! - [`identify_drives`] finds how the motors respond to commands.
//! - Each stage is fitted again without a fifth of its segments and judged on that fifth.

mod contact;
#[cfg(test)]
mod contact_tests;
mod determined;
mod drives;
mod fit;
mod least_squares;
mod problem;
mod procedure;
mod segments;
mod stages;
mod statistics;
mod terms;
#[cfg(test)]
mod tests;

pub use contact::{ContactParameterEstimate, ContactReport, identify_contact};
pub use drives::{DriveResponseError, Finding, MotorResponse, MotorResponses, identify_drives};
pub use fit::{
    CrossValidation, FittedParameter, IdentificationError, IdentificationSettings, StageReport,
    Warning,
};
pub use procedure::{Leg, LogNoise, Procedure, ProcedureDrive, ProcedureError, drive, drive_plant};
pub use segments::{Segment, SegmentErrors, Segmentation, segments};
pub use stages::{
    identify_level, identify_level_determined, identify_slope, identify_slope_determined,
};
pub use terms::{ExtensionReport, Term, TermReport, Verdict, identify_extension};
