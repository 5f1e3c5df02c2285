//! What a controller or a simulation was told, so that it can be pickled and compared.

use crate::errors::invalid;
use pyo3::prelude::*;
use sidehill_plant::fingerprint::fnv_1a;
use std::fmt::Debug;

/// Calls that are kept; an object that drives on for ever keeps none.
const KEPT: usize = 10_000;

/// Calls in their order.
#[derive(Clone)]
pub struct History<T> {
    /// None once there were too many.
    kept: Option<Vec<T>>,
    count: u64,
    fingerprint: u64,
}

impl<T: Debug> History<T> {
    /// Returns that of an object that was told nothing.
    pub fn new() -> Self {
        Self {
            kept: Some(Vec::new()),
            count: 0,
            fingerprint: 0,
        }
    }

    /// Adds a call.
    pub fn push(&mut self, call: T) {
        self.count += 1;
        self.fingerprint = fnv_1a(format!("{:x}{call:?}", self.fingerprint).as_bytes());
        self.kept = self.kept.take().filter(|kept| kept.len() < KEPT);
        if let Some(kept) = &mut self.kept {
            kept.push(call);
        }
    }

    /// Returns the calls.
    ///
    /// # Errors
    /// There were too many, so that they are not kept.
    pub fn calls(&self, class: &str) -> PyResult<&[T]> {
        self.kept.as_deref().ok_or_else(|| {
            invalid(format!(
                "a {class} can be pickled up to {KEPT} calls, this one had {}; copy.copy copies it",
                self.count
            ))
        })
    }

    /// Returns their number and a fingerprint of them, which are equal where the calls are.
    pub fn summary(&self) -> (u64, u64) {
        (self.count, self.fingerprint)
    }

    /// Returns how many there were.
    pub fn count(&self) -> u64 {
        self.count
    }
}
