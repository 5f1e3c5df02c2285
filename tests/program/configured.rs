//! Files of `config/` for use in another folder.

use crate::program::repository;

/// Returns the text of a file of a folder in `config/`, with the names of files in its other folders made absolute.
pub fn configuration(name: &str) -> String {
    let config = repository("config");
    std::fs::read_to_string(config.join(name))
        .unwrap()
        .replace("../", &format!("{}/", config.display()))
}
