//! Where on earth x = 0, y = 0 of a recording was.

use super::fact;
use crate::config::{ConfigFile, read_route};
use serde::Deserialize;
use sidehill_controller::path::GeodeticOrigin;
use sidehill_recording::Header;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

/// What configurations of `run` and scenarios say of their place on earth.
#[derive(Deserialize)]
struct OnEarth {
    datum: Option<GeodeticOrigin>,
    route: Option<RouteOnEarth>,
}

#[derive(Deserialize)]
struct RouteOnEarth {
    file: PathBuf,
}

/// Returns where x = 0, y = 0 was: the datum of the recorded configuration, or that of its GPX route; none where neither
/// is there.
pub(crate) fn datum(header: &Header) -> Option<GeodeticOrigin> {
    let name = Path::new(header.facts.get(fact::CONFIG)?);
    let text = header.files.get(name)?;
    let bundle = Arc::new(Mutex::new(header.files.clone()));
    let file = ConfigFile::with_text(name, text.clone()).with_bundle(bundle);
    let stated: OnEarth = file.parse().ok()?;
    let route = match header.facts.get(fact::PATH) {
        Some(path) => file.beside(Path::new(path)).ok(),
        None => stated
            .route
            .and_then(|route| file.sibling(&route.file).ok()),
    };
    let of_route = || read_route(&route?, None).ok()?.origin;
    stated.datum.or_else(of_route)
}
