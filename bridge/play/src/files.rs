//! Shipped files that scenarios name.

macro_rules! shipped {
    ($($path:literal),* $(,)?) => {
        /// Paths in the repository, and texts.
        pub const FILES: &[(&str, &str)] = &[$(($path, include_str!(concat!("../../../", $path)))),*];
    };
}

shipped!(
    "config/conditions/realistic.yaml",
    "config/vehicles/family/eight.yaml",
    "config/vehicles/family/eight_guess.yaml",
    "config/vehicles/family/four_large.yaml",
    "config/vehicles/family/four_large_guess.yaml",
    "config/vehicles/family/four_small.yaml",
    "config/vehicles/family/four_small_guess.yaml",
    "config/vehicles/family/six.yaml",
    "config/vehicles/family/six_guess.yaml",
    "config/vehicles/family/tracks.yaml",
    "config/vehicles/family/tracks_guess.yaml",
    "config/vehicles/j8.yaml",
    "config/vehicles/j8_contact.yaml",
    "config/vehicles/j8_contact_identified.yaml",
    "config/vehicles/j8_loaded_contact.yaml",
    "config/vehicles/lazaro.yaml",
);

/// Returns the text of a file by its path in the repository.
pub fn shipped(path: &str) -> Option<&'static str> {
    let found = FILES.iter().find(|(name, _)| *name == path);
    found.map(|(_, text)| *text)
}
