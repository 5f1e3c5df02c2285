//! Which files a bag has, and how each is stored.

use super::error::BagError;
use super::limits::Budget;
use super::message::{FileFindings, RecordedMessage, Visit};
use super::{compression, mcap, sqlite};
use crate::config::ConfigFile;
use crate::foreign::foreign_file;
use serde::Deserialize;
use std::fs::File;
use std::io::{BufReader, Read, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// How messages are stored in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Storage {
    Mcap,
    Sqlite,
}

impl Storage {
    /// Returns the kind of a file by its name: `.mcap`, `.db3`, or either followed by `.zstd`.
    pub(super) fn of_name(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_string_lossy().to_lowercase();
        let plain = name.strip_suffix(".zstd").unwrap_or(&name);
        match plain.rsplit_once('.')?.1 {
            "mcap" => Some(Self::Mcap),
            "db3" => Some(Self::Sqlite),
            _ => None,
        }
    }
}

/// One file of a bag.
#[derive(Debug)]
pub(super) struct BagFile {
    /// The file as it was named.
    pub(super) path: PathBuf,
    storage: Storage,
    /// The decompressed file, if the whole file was compressed.
    plain: Option<NamedTempFile>,
    /// What it may hold.
    budget: Budget,
}

impl BagFile {
    fn new(path: PathBuf, max_bytes: Option<u64>) -> Result<Self, BagError> {
        let content = |reason: &str| BagError::Content {
            file: path.clone(),
            reason: reason.to_owned(),
        };
        let storage = Storage::of_name(&path)
            .ok_or_else(|| content("not a file of a bag, which ends with .mcap or .db3"))?;
        let unreadable = |reason| BagError::Read {
            file: path.clone(),
            reason,
        };
        if let Some(reason) = foreign_file(&path).map_err(unreadable)? {
            return Err(content(&reason));
        }
        let size = std::fs::metadata(&path).map_err(unreadable)?.len();
        let budget = Budget::of(size, max_bytes);
        let plain = match path.extension() {
            Some(ending) if ending.eq_ignore_ascii_case("zstd") && !is_blank(&path) => {
                Some(decompressed(&path, &budget)?)
            }
            _ => None,
        };
        Ok(Self {
            path,
            storage,
            plain,
            budget,
        })
    }

    /// Returns why nothing was ever written to the file, if that is so.
    pub(super) fn blank(&self) -> bool {
        is_blank(&self.path)
    }

    /// Calls `visit` for each message.
    pub(super) fn read(&self, visit: Visit<'_>) -> Result<FileFindings, BagError> {
        let (mut messages, mut chunks) = (self.budget, self.budget);
        let mut decompress = |message: RecordedMessage<'_>| {
            if !message.data.starts_with(compression::ZSTD) {
                return visit(message);
            }
            let (data, cut_off) = compression::zstd(message.data, &mut messages);
            if let Some(reason) = cut_off {
                return Err(BagError::Content {
                    file: self.path.clone(),
                    reason: format!("a message of {}: {reason}", message.topic.name),
                });
            }
            visit(RecordedMessage {
                data: &data,
                ..message
            })
        };
        let at = self
            .plain
            .as_ref()
            .map_or(self.path.as_path(), NamedTempFile::path);
        match self.storage {
            Storage::Mcap => {
                let file = File::open(at).map_err(|reason| self.unreadable(reason))?;
                mcap::read(
                    BufReader::new(file),
                    &self.path,
                    &mut chunks,
                    &mut decompress,
                )
            }
            Storage::Sqlite => sqlite::read(at, &self.path, &mut chunks, &mut decompress),
        }
    }

    fn unreadable(&self, reason: std::io::Error) -> BagError {
        BagError::Read {
            file: self.path.clone(),
            reason,
        }
    }
}

/// Returns whether a file holds nothing or only zeros, which a power cut leaves of a file that was just begun.
fn is_blank(path: &Path) -> bool {
    let mut begin = Vec::new();
    let read = File::open(path).and_then(|file| file.take(64).read_to_end(&mut begin));
    read.is_ok() && begin.iter().all(|byte| *byte == 0)
}

fn decompressed(path: &Path, budget: &Budget) -> Result<NamedTempFile, BagError> {
    let read = |reason| BagError::Read {
        file: path.to_owned(),
        reason,
    };
    let mut plain = NamedTempFile::new().map_err(read)?;
    let compressed = File::open(path).map_err(read)?;
    compression::zstd_file(compressed, &mut plain, budget).map_err(|reason| BagError::Content {
        file: path.to_owned(),
        reason,
    })?;
    plain.flush().map_err(read)?;
    Ok(plain)
}

/// The fields used of `metadata.yaml`; everything else is in the files themselves as well.
#[derive(Debug, Deserialize)]
struct Metadata {
    rosbag2_bagfile_information: Information,
}

#[derive(Debug, Deserialize)]
struct Information {
    relative_file_paths: Vec<PathBuf>,
    #[serde(default)]
    compression_format: String,
    #[serde(default)]
    compression_mode: String,
}

/// Returns the files of a bag in the order of recording, a file or those of a folder, and notes.
pub(super) fn find(
    path: &Path,
    max_bytes: Option<u64>,
) -> Result<(Vec<BagFile>, Vec<String>), BagError> {
    let read = |reason| BagError::Read {
        file: path.to_owned(),
        reason,
    };
    if !std::fs::metadata(path).map_err(read)?.is_dir() {
        return Ok((vec![BagFile::new(path.to_owned(), max_bytes)?], Vec::new()));
    }
    let metadata = path.join("metadata.yaml");
    if !metadata.exists() {
        return Ok((by_name(path, max_bytes)?, Vec::new()));
    }
    if is_blank(&metadata) {
        let note = "metadata.yaml is empty: the recorder was interrupted; the files are read in the order of their \
                    numbers";
        return Ok((by_name(path, max_bytes)?, vec![note.to_owned()]));
    }
    let content = |reason: String| BagError::Content {
        file: metadata.clone(),
        reason,
    };
    let found: Metadata = ConfigFile::read(&metadata)?.parse()?;
    let information = found.rosbag2_bagfile_information;
    if information.relative_file_paths.is_empty() {
        return Err(content("relative_file_paths names no file".to_owned()));
    }
    let format = information.compression_format.as_str();
    if !information.compression_mode.is_empty()
        && !information.compression_mode.eq_ignore_ascii_case("none")
        && format != "zstd"
    {
        return Err(content(format!(
            "compression_format: {format:?} is not read, only zstd"
        )));
    }
    let files = information.relative_file_paths.into_iter();
    let files = files.map(|file| {
        let named = path.join(&file);
        if !named.exists() {
            return Err(content(format!(
                "names {}, which is not in the folder; rename the file so, or delete metadata.yaml: then the files are \
                 read in the order of their numbers",
                file.display()
            )));
        }
        BagFile::new(named, max_bytes)
    });
    Ok((files.collect::<Result<_, _>>()?, Vec::new()))
}

/// Returns the files of a folder whose recorder was killed before it wrote `metadata.yaml`.
fn by_name(folder: &Path, max_bytes: Option<u64>) -> Result<Vec<BagFile>, BagError> {
    let read = |reason| BagError::Read {
        file: folder.to_owned(),
        reason,
    };
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(read)? {
        let path = entry.map_err(read)?.path();
        if Storage::of_name(&path).is_some() {
            paths.push(path);
        }
    }
    if paths.is_empty() {
        return Err(BagError::NoFiles {
            folder: folder.to_owned(),
        });
    }
    // bag_2 before bag_10: by the number behind the last underscore, where there is one.
    let number = |path: &PathBuf| -> Option<u64> {
        let stem = path.file_name()?.to_string_lossy().into_owned();
        let stem = stem.split('.').next()?;
        stem.rsplit_once('_')?.1.parse().ok()
    };
    paths.sort_by_key(|path| (number(path), path.clone()));
    paths
        .into_iter()
        .map(|path| BagFile::new(path, max_bytes))
        .collect()
}
