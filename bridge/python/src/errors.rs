//! From this project's errors to Python's, and no panic across.

use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use sidehill::config::ConfigError;
use std::fmt::Display;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Returns a `ValueError`.
pub fn invalid(message: impl Display) -> PyErr {
    PyValueError::new_err(message.to_string())
}

/// Returns a `ValueError`, or where a file cannot be read or written, the `OSError` of the reason.
pub fn failed(error: impl Into<anyhow::Error>) -> PyErr {
    let error = error.into();
    let kind = error.chain().find_map(|cause| {
        if let Some(ConfigError::Read { reason, .. }) = cause.downcast_ref() {
            return Some(reason.kind());
        }
        cause.downcast_ref().map(std::io::Error::kind)
    });
    match kind {
        Some(kind) => std::io::Error::new(kind, format!("{error:#}")).into(),
        None => invalid(format!("{error:#}")),
    }
}

/// Returns what `work` returns, done without the interpreter's lock; a panic becomes a `RuntimeError`.
///
/// # Errors
/// Those of `work`.
pub fn guarded<T: Send>(py: Python<'_>, work: impl FnOnce() -> PyResult<T> + Send) -> PyResult<T> {
    py.detach(|| catch_unwind(AssertUnwindSafe(work)))
        .unwrap_or_else(|panic| {
            let text = panic.downcast_ref::<String>().map(String::as_str);
            let text = text.or_else(|| panic.downcast_ref::<&str>().copied());
            Err(PyRuntimeError::new_err(format!(
                "a defect in sidehill, please report it: {}",
                text.unwrap_or("panic")
            )))
        })
}
