use crate::config::ConfigError;
use std::path::PathBuf;

/// Why a bag cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum BagError {
    /// A file or folder cannot be opened or read.
    #[error("{file}: {reason}", file = .file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// Why not.
        reason: std::io::Error,
    },
    /// A file is damaged, or its content does not match its name.
    #[error("{file}: {reason}", file = .file.display())]
    Content {
        /// The file.
        file: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// Its `metadata.yaml` is invalid.
    #[error(transparent)]
    Metadata(#[from] ConfigError),
    /// A folder contains no bag.
    #[error(
        "{folder}: not a bag: it has neither metadata.yaml nor a file that ends with .mcap or .db3",
        folder = .folder.display()
    )]
    NoFiles {
        /// The folder.
        folder: PathBuf,
    },
    /// It is empty.
    #[error("{bag}: the bag holds no message{between}{notes}", bag = .bag.display(),
            between = if .notes.is_empty() { "" } else { "; " })]
    NoMessages {
        /// The bag.
        bag: PathBuf,
        /// What else is known about it.
        notes: String,
    },
    /// A message is not of the type of its topic.
    #[error("{bag}, topic {topic}, message {number}: {reason}", bag = .bag.display())]
    Message {
        /// The bag.
        bag: PathBuf,
        /// The topic.
        topic: String,
        /// Message of the topic, counted from 1.
        number: usize,
        /// What is wrong with it.
        reason: String,
    },
}
