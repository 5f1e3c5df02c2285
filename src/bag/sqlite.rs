//! SQLite files of rosbag2: tables `topics` and `messages`.

use super::error::BagError;
use super::limits::{Budget, RECORD_MAX};
use super::message::{BagTopic, FileFindings, RecordedMessage, Visit};
use rusqlite::config::DbConfig;
use rusqlite::limits::Limit;
use rusqlite::{Connection, OpenFlags};
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
    let content = |reason: String| BagError::Content {
        file: name.to_owned(),
        reason,
    };
    harden(&database).map_err(failed)?;
    if let Some(computed) = computed(&database).map_err(failed)? {
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

/// Lets the schema call no function with side effects, and bounds every value.
fn harden(database: &Connection) -> rusqlite::Result<()> {
    database.set_db_config(DbConfig::SQLITE_DBCONFIG_TRUSTED_SCHEMA, false)?;
    let most = i32::try_from(RECORD_MAX).unwrap_or(i32::MAX);
    database
        .set_limit(Limit::SQLITE_LIMIT_LENGTH, most)
        .map(drop)
}

/// Returns what of `topics` and `messages` is a view or a generated column, whose rows need no bytes in the file.
fn computed(database: &Connection) -> rusqlite::Result<Option<String>> {
    for table in ["topics", "messages"] {
        let mut kinds =
            database.prepare("SELECT type FROM sqlite_schema WHERE name = ?1 COLLATE NOCASE")?;
        let mut kinds = kinds.query([table])?;
        while let Some(row) = kinds.next()? {
            let kind: String = row.get(0)?;
            if kind != "table" {
                return Ok(Some(format!("the {kind} {table}")));
            }
        }
        let mut columns = database.prepare("SELECT name, hidden FROM pragma_table_xinfo(?1)")?;
        let mut columns = columns.query([table])?;
        while let Some(row) = columns.next()? {
            if row.get::<_, i64>(1)? != 0 {
                let column: String = row.get(0)?;
                return Ok(Some(format!("the column {column} of {table}")));
            }
        }
    }
    Ok(None)
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
