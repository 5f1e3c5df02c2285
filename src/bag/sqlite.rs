//! SQLite files of rosbag2: tables `topics` and `messages`.

use super::error::BagError;
use super::limits::{Budget, RECORD_MAX};
use super::message::{BagTopic, FileFindings, RecordedMessage, Visit};
use crate::sqlite::{computed, explained, open};
use std::collections::BTreeMap;
use std::path::Path;

/// Calls `visit` for each message of the file `at`, ordered by time; errors call the file `name`.
pub(super) fn read(
    at: &Path,
    name: &Path,
    budget: &mut Budget,
    visit: Visit<'_>,
) -> Result<FileFindings, BagError> {
    let failed = |error: rusqlite::Error| BagError::Content {
        file: name.to_owned(),
        reason: explained(
            &error,
            "a bag of rosbag2, or a compressed one whose name lacks .zstd",
        ),
    };
    // SQLite would say no more than "unable to open database file".
    std::fs::File::open(at).map_err(|reason| BagError::Read {
        file: name.to_owned(),
        reason,
    })?;
    let database = open(at, RECORD_MAX).map_err(failed)?;
    let content = |reason: String| BagError::Content {
        file: name.to_owned(),
        reason,
    };
    if let Some(computed) = computed(&database, &["topics", "messages"]).map_err(failed)? {
        return Err(content(format!(
            "{computed} is computed by the file instead of stored in it, which no bag of rosbag2 does; it is not read"
        )));
    }
    let mut query = database
        .prepare("SELECT id, name, type, serialization_format FROM topics")
        .map_err(failed)?;
    let topics = query
        .query_map([], |row| {
            let topic = BagTopic {
                name: row.get(1)?,
                message_type: row.get(2)?,
                encoding: row.get(3)?,
            };
            Ok((row.get(0)?, topic))
        })
        .and_then(Iterator::collect::<Result<BTreeMap<i64, BagTopic>, _>>)
        .map_err(failed)?;
    let mut query = database
        .prepare("SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id")
        .map_err(failed)?;
    let mut rows = query.query([]).map_err(failed)?;
    while let Some(row) = rows.next().map_err(failed)? {
        let id: i64 = row.get(0).map_err(failed)?;
        let topic = topics.get(&id).ok_or_else(|| {
            content(format!(
                "a message is of topic {id}, which is not in the table topics"
            ))
        })?;
        let data = row.get_ref(2).map_err(failed)?;
        let data = data.as_blob().map_err(|error| failed(error.into()))?;
        budget.take(data.len() as u64).map_err(content)?;
        visit(RecordedMessage {
            topic,
            received_ns: row.get(1).map_err(failed)?,
            data,
        })?;
    }
    Ok(FileFindings {
        topics: topics.into_values().collect(),
        cut_off: None,
    })
}
