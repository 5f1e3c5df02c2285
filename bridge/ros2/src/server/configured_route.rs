//! The route of the configuration.

use super::requested_path::RequestedPath;
use sidehill_controller::path::PendingActions;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// A path that is driven when the operator says so.
pub struct ConfiguredRoute {
    /// The path.
    pub path: RequestedPath,
    /// What is to be done along it; arc lengths are those of its poses.
    pub actions: PendingActions,
    /// Set by the operator to begin it from where the vehicle is.
    pub begin: Arc<AtomicBool>,
    /// Whether it begins once by itself, as soon as the vehicle has a pose.
    pub at_start: bool,
}
