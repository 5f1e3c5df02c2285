//! SQLite files of rosbag2: tables `topics` and `messages`.

use super::error::BagError;
use super::message::{Message, Outcome, Topic, Visit};
use rusqlite::{Connection, OpenFlags};
use std::collections::BTreeMap;
use std::path::Path;

/// Calls `visit` for each message of the file `at`, ordered by time; errors call the file `name`.
pub(super) fn read(at: &Path, name: &Path, visit: Visit<'_>) -> Result<Outcome, BagError> {
    let failed = |error: rusqlite::Error| BagError::Content {
        file: name.to_owned(),
        reason: explained(&error),
    };
    // SQLite would say no more than "unable to open database file".
    std::fs::File::open(at).map_err(|reason| BagError::Read {
        file: name.to_owned(),
        reason,
    })?;
    let database = Connection::open_with_flags(
        at,
        OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX,
    )
    .map_err(failed)?;
    let mut query = database
        .prepare("SELECT id, name, type, serialization_format FROM topics")
        .map_err(failed)?;
    let topics = query
        .query_map([], |row| {
            let topic = Topic {
                name: row.get(1)?,
                message_type: row.get(2)?,
                encoding: row.get(3)?,
            };
            Ok((row.get(0)?, topic))
        })
        .and_then(Iterator::collect::<Result<BTreeMap<i64, Topic>, _>>)
        .map_err(failed)?;
    let mut query = database
        .prepare("SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id")
        .map_err(failed)?;
    let mut rows = query.query([]).map_err(failed)?;
    while let Some(row) = rows.next().map_err(failed)? {
        let id: i64 = row.get(0).map_err(failed)?;
        let topic = topics.get(&id).ok_or_else(|| BagError::Content {
            file: name.to_owned(),
            reason: format!("a message is of topic {id}, which is not in the table topics"),
        })?;
        let data = row.get_ref(2).map_err(failed)?;
        visit(Message {
            topic,
            received_ns: row.get(1).map_err(failed)?,
            data: data.as_blob().map_err(|error| failed(error.into()))?,
        })?;
    }
    Ok(Outcome {
        topics: topics.into_values().collect(),
        cut_off: None,
    })
}

fn explained(error: &rusqlite::Error) -> String {
    use rusqlite::ErrorCode::{DatabaseCorrupt, NotADatabase, ReadOnly};
    let hint = match error.sqlite_error_code() {
        Some(NotADatabase) => ": not a bag, or a compressed one whose name lacks .zstd",
        Some(DatabaseCorrupt) => {
            ": the file is damaged or cut off; `sqlite3 FILE .recover` writes what is left of it"
        }
        Some(ReadOnly) => {
            ": its recorder was interrupted; open it once with `sqlite3 FILE .tables`, which finishes what it left"
        }
        _ if error.to_string().contains("no such table") => ": not a bag of rosbag2",
        _ => "",
    };
    format!("{error}{hint}")
}
