//! Python values that come in; what is wrong with one is a `ValueError` with the argument's name.

use crate::errors::{failed, invalid};
use pyo3::PyClass;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_yaml::Mapping;
use sidehill::config::ConfigFile;
use sidehill_controller::config::ControllerKind;
use std::path::{Path, PathBuf};

/// Returns a finite number.
pub fn number(name: &str, value: &Bound<'_, PyAny>) -> PyResult<f64> {
    let number: f64 = value
        .extract()
        .map_err(|_| invalid(format!("{name}: {} is not a number", shown(value))))?;
    if number.is_finite() {
        Ok(number)
    } else {
        Err(invalid(format!("{name}: {number} is not finite")))
    }
}

/// Returns as many finite numbers as there are `fields`, from a sequence.
pub fn numbers<const N: usize>(
    name: &str,
    fields: [&str; N],
    value: &Bound<'_, PyAny>,
) -> PyResult<[f64; N]> {
    let mut out = [0.0; N];
    if value.len().ok() != Some(N) {
        return Err(invalid(format!(
            "{name}: ({}) is needed, not {}",
            fields.join(", "),
            shown(value)
        )));
    }
    for (index, (number, field)) in out.iter_mut().zip(fields).enumerate() {
        let element = value.get_item(index).map_err(|_| {
            invalid(format!(
                "{name}: a sequence is needed, not {}",
                shown(value)
            ))
        })?;
        *number = element.extract().unwrap_or(f64::NAN);
        if !number.is_finite() {
            return Err(invalid(format!(
                "{name}: {field} is {}, a finite number is needed",
                shown(&element)
            )));
        }
    }
    Ok(out)
}

/// Returns the file that `text_of` a mapping would make, for names in it relative to the working folder.
pub fn mapping(name: &str, value: &Bound<'_, PyAny>) -> PyResult<ConfigFile> {
    if value.cast::<PyDict>().is_err() {
        return Err(invalid(format!(
            "{name}: a dict is needed, not {}",
            shown(value)
        )));
    }
    Ok(ConfigFile::with_text(Path::new(name), json(value)?))
}

/// Returns the keys of a mapping, nested ones named with dots or in mappings.
pub fn keys(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Mapping> {
    mapping(name, value)?.parse().map_err(failed)
}

/// Returns an HTML table of names and values, for notebooks.
pub fn html(title: &str, rows: &Bound<'_, PyAny>) -> PyResult<String> {
    let module = rows.py().import("sidehill._html")?;
    module.getattr("table")?.call1((title, rows))?.extract()
}

/// Returns a Python value as JSON, which is YAML as well; numpy's numbers and arrays and paths included.
pub fn json(value: &Bound<'_, PyAny>) -> PyResult<String> {
    let py = value.py();
    let dump = py.import("sidehill._json")?.getattr("dump")?;
    dump.call1((value,))?.extract()
}

/// Returns what JSON says as Python's own types.
pub fn from_json<'py>(py: Python<'py>, text: &str) -> PyResult<Bound<'py, PyAny>> {
    py.import("json")?.getattr("loads")?.call1((text,))
}

/// Returns the configuration file at a path.
pub fn file(name: &str, value: &Bound<'_, PyAny>) -> PyResult<ConfigFile> {
    ConfigFile::read(&path(name, value)?).map_err(failed)
}

/// Returns a path, given as such or as a string.
pub fn path(name: &str, value: &Bound<'_, PyAny>) -> PyResult<PathBuf> {
    value
        .extract()
        .map_err(|_| invalid(format!("{name}: {} is not a path", shown(value))))
}

/// Returns the controller of that name.
pub fn kind(name: &str, value: &Bound<'_, PyAny>) -> PyResult<ControllerKind> {
    let text: Option<String> = value.extract().ok();
    text.and_then(|text| ControllerKind::from_name(&text))
        .ok_or_else(|| {
            let names: Vec<_> = ControllerKind::ALL.iter().map(|kind| kind.name()).collect();
            invalid(format!(
                "{name}: {} is not a controller, they are {}",
                shown(value),
                names.join(", ")
            ))
        })
}

/// Returns a whole number, where one is given.
pub fn whole(name: &str, value: Option<&Bound<'_, PyAny>>) -> PyResult<Option<u64>> {
    let Some(value) = value else { return Ok(None) };
    let number = value.extract().map_err(|_| {
        invalid(format!(
            "{name}: {} is not a whole number from 0 to 2^64 - 1",
            shown(value)
        ))
    })?;
    Ok(Some(number))
}

/// Returns an object of one of this module's classes.
pub fn object<'a, 'py, T: PyClass>(
    name: &str,
    value: &'a Bound<'py, PyAny>,
) -> PyResult<&'a Bound<'py, T>> {
    value.cast().map_err(|_| {
        invalid(format!(
            "{name}: a sidehill.{} is needed, not {}",
            <T as PyClass>::NAME,
            shown(value)
        ))
    })
}

/// Returns a value as an error message shows it.
pub fn shown(value: &Bound<'_, PyAny>) -> String {
    const LONGEST: usize = 60;
    let text = value
        .repr()
        .map_or_else(|_| "?".to_owned(), |text| text.to_string());
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text,
    }
}
