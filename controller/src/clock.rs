//! The clock: the standard library's, which in a browser has no time, and there that of the page.

#[cfg(not(target_family = "wasm"))]
pub use std::time::Instant;
#[cfg(target_family = "wasm")]
pub use web_time::Instant;
