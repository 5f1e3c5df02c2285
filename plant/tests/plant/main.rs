//! The models against the paper and against logs of real vehicles.

// The lints' exceptions for tests do not reach helper functions.
#![allow(clippy::unwrap_used, clippy::panic)]

mod drive;
mod paper;
mod third_party;
