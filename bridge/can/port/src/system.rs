/// Error numbers of Linux that a CAN socket returns.
pub(super) const ENXIO: i32 = 6;
pub(super) const ENODEV: i32 = 19;
pub(super) const ENETDOWN: i32 = 100;
pub(super) const ENOBUFS: i32 = 105;

/// First and longest pause between attempts to open an interface or to restart it, s.
pub(super) const BACKOFF_S: [f64; 2] = [0.05, 2.0];
