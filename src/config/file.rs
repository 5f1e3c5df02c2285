use super::geotiff;
use super::hints::{
    control_character, decoded_xml, indented_by_tab, key_of_value, keys_named, other_kind,
    syntax_hint, type_hint,
};
use super::keys::Keys;
use super::overlay::overlay;
use super::removed;
use crate::foreign::{foreign, not_utf8};
use crate::limits;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Why a YAML file without a key is refused.
pub(crate) const NO_KEYS: &str = "has no keys, as `name: field` is one: it is empty or not YAML; `sidehill init` writes \
                                  files to begin with";

/// An error of a configuration file, with its name.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("{file}: {reason}{}", whose_name_stands_in(.named_by.as_deref()))]
    Read {
        /// Name of the file.
        file: String,
        /// Why.
        reason: std::io::Error,
        /// The file that names it; none if the command line does.
        named_by: Option<String>,
    },
    /// Its content is invalid; the message names key, value and range.
    #[error("{file}: {message}")]
    Content {
        /// Name of the file.
        file: String,
        /// Key, value and range.
        message: String,
    },
}

fn whose_name_stands_in(file: Option<&str>) -> String {
    file.map_or_else(String::new, |file| format!(" (named by {file})"))
}

/// Files compiled into the program, by their names in its repository.
const BUILT_IN: [(&str, &str); 5] = [
    (
        "config/conditions/realistic.yaml",
        include_str!("../../config/conditions/realistic.yaml"),
    ),
    (
        "config/scenarios/figure_eight.yaml",
        include_str!("../../config/scenarios/figure_eight.yaml"),
    ),
    (
        "config/vehicles/j8.yaml",
        include_str!("../../config/vehicles/j8.yaml"),
    ),
    (
        CONTACT_VEHICLE,
        include_str!("../../config/vehicles/j8_contact.yaml"),
    ),
    (
        CONTACT_IDENTIFIED,
        include_str!("../../config/vehicles/j8_contact_identified.yaml"),
    ),
];

/// The scenario that runs when none is named.
pub const DEFAULT_SCENARIO: &str = "config/scenarios/figure_eight.yaml";

/// The vehicle of `--plant contact` if the scenario names none.
pub const CONTACT_VEHICLE: &str = "config/vehicles/j8_contact.yaml";
/// Its identified parameters, which the controllers use.
pub const CONTACT_IDENTIFIED: &str = "config/vehicles/j8_contact_identified.yaml";

/// A file's name and text; names inside it are relative to it.
#[derive(Debug, Clone)]
pub struct ConfigFile {
    path: PathBuf,
    origin: Origin,
    text: String,
}

/// Where the files named in a file come from.
#[derive(Debug, Clone)]
enum Origin {
    Disk,
    BuiltIn,
    Bundle {
        files: Bundle,
        /// Whether missing files are those compiled into the program, instead of files on disk.
        built_in: bool,
    },
}

/// Files by their paths. Missing ones are read from disk and added, so that another machine can use the same files.
pub type Bundle = Arc<Mutex<BTreeMap<PathBuf, String>>>;

impl ConfigFile {
    /// Reads a file from disk.
    ///
    /// # Errors
    /// [`ConfigError::Read`] with its name.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let failed = |reason| ConfigError::Read {
            file: path.display().to_string(),
            reason,
            named_by: None,
        };
        if path.is_dir() {
            return Err(ConfigError::Content {
                file: path.display().to_string(),
                message: "is a folder; name the files in it, as in FOLDER/*.yaml".to_owned(),
            });
        }
        let bytes = limits::read(path).map_err(failed)?;
        let has_ending = |endings: &[&str]| {
            let found = path.extension().unwrap_or_default();
            endings
                .iter()
                .any(|ending| found.eq_ignore_ascii_case(ending))
        };
        let content = |message| ConfigError::Content {
            file: path.display().to_string(),
            message,
        };
        // GPX may be UTF-16.
        if has_ending(&["gpx"]) {
            let text = decoded_xml(&bytes).map_err(content)?;
            return Ok(Self::with_text(path, text));
        }
        if let Some(reason) = foreign(&bytes) {
            return Err(content(reason));
        }
        if has_ending(&["tif", "tiff"]) {
            let text = geotiff::to_esri(&bytes).map_err(content)?;
            return Ok(Self::with_text(path, text));
        }
        let text = match String::from_utf8(bytes) {
            Ok(text) => text,
            // Editors of CAN databases and data sheets write Windows-1252. Only comments, names and units have such letters,
            // which nothing reads.
            Err(error) if has_ending(&["dbc", "eds", "dcf"]) => {
                String::from_utf8_lossy(error.as_bytes()).into_owned()
            }
            Err(error) => return Err(content(not_utf8(error.as_bytes(), error.utf8_error()))),
        };
        Ok(Self::with_text(path, text))
    }

    /// Returns a file with this text; a byte order mark is removed.
    pub fn with_text(path: &Path, text: String) -> Self {
        Self {
            path: path.to_owned(),
            origin: Origin::Disk,
            text: match text.strip_prefix('\u{feff}') {
                Some(rest) => rest.to_owned(),
                None => text,
            },
        }
    }

    /// Returns a file compiled into the program.
    ///
    /// # Errors
    /// [`ConfigError::Read`] where there is no such file.
    pub fn built_in(name: &str) -> Result<Self, ConfigError> {
        BUILT_IN
            .iter()
            .find(|(built_in, _)| *built_in == name)
            .map(|(name, text)| Self {
                path: PathBuf::from(name),
                origin: Origin::BuiltIn,
                text: (*text).to_owned(),
            })
            .ok_or_else(|| ConfigError::Read {
                file: format!("{name} (built in)"),
                reason: std::io::ErrorKind::NotFound.into(),
                named_by: None,
            })
    }

    /// Returns the path of a file that this one names, relative to itself.
    pub fn path_of(&self, name: &Path) -> PathBuf {
        let folder = self.path.parent().unwrap_or(Path::new(""));
        normalised(&folder.join(name))
    }

    /// Returns the file that this one names, relative to itself.
    ///
    /// # Errors
    /// [`ConfigError::Read`] with the whole name.
    pub fn sibling(&self, name: &Path) -> Result<Self, ConfigError> {
        let path = self.path_of(name);
        let found = match &self.origin {
            Origin::Disk => Self::read(&path),
            Origin::BuiltIn => Self::built_in(&path.to_string_lossy()),
            Origin::Bundle { files, built_in } => Self::bundled(&path, files, *built_in),
        };
        found.map_err(|error| match error {
            ConfigError::Read { file, reason, .. } => ConfigError::Read {
                file,
                reason,
                named_by: Some(self.name()),
            },
            content => content,
        })
    }

    fn bundled(path: &Path, files: &Bundle, built_in: bool) -> Result<Self, ConfigError> {
        let mut held = files.lock().unwrap_or_else(PoisonError::into_inner);
        let text = match held.get(path) {
            Some(text) => text.clone(),
            None if built_in => Self::built_in(&path.to_string_lossy())?.text,
            None => Self::read(path)?.text,
        };
        held.insert(path.to_owned(), text.clone());
        Ok(Self {
            path: path.to_owned(),
            origin: Origin::Bundle {
                files: files.clone(),
                built_in,
            },
            text,
        })
    }

    /// Returns this file, with the files it names read from, and added to, a bundle.
    pub fn with_bundle(self, files: Bundle) -> Self {
        let built_in = matches!(self.origin, Origin::BuiltIn);
        Self {
            origin: Origin::Bundle { files, built_in },
            ..self
        }
    }

    /// Returns this file with the texts of files that it names, by their names in it.
    pub fn with_files(self, texts: BTreeMap<PathBuf, String>) -> Self {
        if texts.is_empty() {
            return self;
        }
        let bundle = match &self.origin {
            Origin::Bundle { files, .. } => files.clone(),
            Origin::Disk | Origin::BuiltIn => Bundle::default(),
        };
        let named = texts.into_iter();
        let named = named.map(|(name, text)| (self.path_of(&name), text));
        bundle
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .extend(named);
        match self.origin {
            Origin::Bundle { .. } => self,
            Origin::Disk | Origin::BuiltIn => self.with_bundle(bundle),
        }
    }

    /// Returns another file that the command line names.
    ///
    /// # Errors
    /// [`ConfigError::Read`] with its name.
    pub fn beside(&self, path: &Path) -> Result<Self, ConfigError> {
        match &self.origin {
            Origin::Bundle { files, .. } => Self::bundled(path, files, false),
            Origin::Disk | Origin::BuiltIn => Self::read(path),
        }
    }

    /// Returns the name for messages.
    pub fn name(&self) -> String {
        if matches!(self.origin, Origin::BuiltIn) {
            format!("{} (built in)", self.path.display())
        } else {
            self.path.display().to_string()
        }
    }

    /// Returns the path as given.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the file extension in lower case.
    pub fn ending(&self) -> Option<String> {
        let ending = self.path.extension()?;
        Some(ending.to_string_lossy().to_lowercase())
    }

    /// Returns the text.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Returns this file with `keys` replacing its own; `controller` is merged key by key.
    ///
    /// # Errors
    /// [`ConfigError::Content`] where the text is not a YAML mapping.
    pub fn with_keys(&self, keys: &serde_yaml::Mapping) -> Result<Self, ConfigError> {
        let mut all: serde_yaml::Mapping = self.parse()?;
        overlay(&mut all, keys);
        let text = serde_yaml::to_string(&all).map_err(|error| self.error(error))?;
        Ok(Self {
            text,
            ..self.clone()
        })
    }

    /// Reads the text as YAML.
    ///
    /// # Errors
    /// [`ConfigError::Content`] with file, line, key, value and range.
    pub fn parse<T: DeserializeOwned>(&self) -> Result<T, ConfigError> {
        if let Some(line) = limits::too_deep(&self.text) {
            return Err(self.error(format!(
                "line {line}: brackets or lists are nested more than {} deep",
                limits::YAML_DEPTH
            )));
        }
        serde_yaml::from_str(&self.text).map_err(|error| {
            let keys = Keys::of(&self.text);
            if keys.complete && keys.keys.is_empty() {
                return self.content(NO_KEYS.to_owned());
            }
            if let Some(twice) = keys.duplicate() {
                let (first, second) = twice.lines;
                return self.error(format!(
                    "{}: the key occurs twice, in lines {first} and {second}; remove one",
                    twice.key
                ));
            }
            if let Some(line) = error.location().map(|at| at.line())
                && let Some(tab) = indented_by_tab(&self.text, line)
            {
                return self.error(format!(
                    "line {tab}: begins with a tab; YAML is indented with spaces"
                ));
            }
            let message = error.to_string();
            if message.contains("control characters")
                && let Some(line) = control_character(&self.text)
            {
                return self.error(format!(
                    "line {line}: has a character that is not visible and not allowed; remove it"
                ));
            }
            let hint = removed::hint(&keys, &message)
                .or_else(|| syntax_hint(&message))
                .or_else(|| other_kind(&self.text, &message))
                .or_else(|| key_of_value(&keys, &message));
            self.error(format!(
                "{}{}{}",
                message,
                hint.unwrap_or_default(),
                type_hint(&message)
            ))
        })
    }

    /// Returns an error about this file's content. If the message names a key but no line, the key's line is added.
    pub fn error(&self, message: impl ToString) -> ConfigError {
        let mut message = message.to_string();
        if !message.contains("line ")
            && let Some(line) = Keys::of(&self.text).line_of(&keys_named(&message))
        {
            message += &format!(" (line {line})");
        }
        self.content(message)
    }

    fn content(&self, message: String) -> ConfigError {
        ConfigError::Content {
            file: self.name(),
            message,
        }
    }
}

/// Returns a value as YAML.
///
/// # Errors
/// Why it cannot be written as YAML.
pub fn to_yaml(value: &impl Serialize) -> Result<String, serde_yaml::Error> {
    serde_yaml::to_string(value)
}

/// Returns a path without `.` and with each `..` resolved against the folder before it.
fn normalised(path: &Path) -> PathBuf {
    let mut out = PathBuf::new();
    for component in path.components() {
        match component {
            Component::CurDir => {}
            Component::ParentDir
                if matches!(out.components().next_back(), Some(Component::Normal(_))) =>
            {
                out.pop();
            }
            other => out.push(other),
        }
    }
    out
}
