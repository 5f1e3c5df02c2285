//! SQLite files of rosbag2: tables `topics` and `messages`.

use super::error::BagError;
use super::limits::Budget;
use super::message::{Message, Outcome, Topic, Visit};
use super::sqlite_file::{RowPlace, SqliteFile, StoredRow, StoredTable, StoredValue, value};
use std::collections::BTreeMap;
use std::path::Path;

/// Calls `visit` for each message of the file `at`, ordered by time; errors call the file `name`.
pub(super) fn read(
    at: &Path,
    name: &Path,
    budget: &mut Budget,
    visit: Visit<'_>,
) -> Result<Outcome, BagError> {
    let content = |reason: String| BagError::Content {
        file: name.to_owned(),
        reason,
    };
    std::fs::File::open(at).map_err(|reason| BagError::Read {
        file: name.to_owned(),
        reason,
    })?;
    let database = SqliteFile::open(at).map_err(content)?;
    let topics = topics(&database).map_err(content)?;
    let (table, [topic_id, timestamp, data]) =
        table(&database, "messages", ["topic_id", "timestamp", "data"]).map_err(content)?;
    // Instant, number and place of each message.
    let mut order: Vec<(i64, i64, RowPlace)> = Vec::new();
    database
        .visit(&table, &mut |place, row| {
            order.push((row.with(timestamp, integer)??, row.number, place));
            Ok(())
        })
        .map_err(content)?;
    order.sort_unstable();
    let mut page: Option<(RowPlace, Vec<u8>)> = None;
    for (received_ns, _, place) in order {
        let bytes = match page.take() {
            Some((last, bytes)) if last.same_page(place) => bytes,
            _ => database.page_of(place).map_err(content)?,
        };
        let row = database.row(&bytes, place).map_err(content)?;
        let record = row.record().map_err(content)?;
        let id = row.with(topic_id, integer).flatten().map_err(content)?;
        let topic = topics.get(&id).ok_or_else(|| {
            content(format!(
                "a message is of topic {id}, which is not in the table topics"
            ))
        })?;
        let data = match value(&record, data) {
            Some(StoredValue::Blob(data)) => data,
            other => {
                let kind = other.map_or("cut off", |value| value.kind());
                return Err(content(format!("the data of a message are {kind}")));
            }
        };
        budget.take(data.len() as u64).map_err(content)?;
        visit(Message {
            topic,
            received_ns,
            data,
        })?;
        page = Some((place, bytes));
    }
    Ok(Outcome {
        topics: topics.into_values().collect(),
        cut_off: None,
    })
}

fn topics(database: &SqliteFile) -> Result<BTreeMap<i64, Topic>, String> {
    let columns = ["id", "name", "type", "serialization_format"];
    let (table, [id, name, message_type, encoding]) = table(database, "topics", columns)?;
    let mut topics = BTreeMap::new();
    database.visit(&table, &mut |_, row| {
        // A column of type INTEGER PRIMARY KEY is stored as the number of the row only.
        let id = row.with(id, |value| match value {
            StoredValue::Null => Ok(row.number),
            value => integer(value),
        })??;
        let topic = Topic {
            name: text(row, name)?,
            message_type: text(row, message_type)?,
            encoding: text(row, encoding)?,
        };
        topics.insert(id, topic);
        Ok(())
    })?;
    Ok(topics)
}

/// Returns a table and the numbers of columns.
fn table<const N: usize>(
    database: &SqliteFile,
    name: &str,
    columns: [&str; N],
) -> Result<(StoredTable, [usize; N]), String> {
    let lacks = |what: String| format!("no such {what}: not a bag of rosbag2");
    let table = database.table(name)?;
    let table = table.ok_or_else(|| lacks(format!("table: {name}")))?;
    let mut numbers = [0; N];
    for (number, column) in numbers.iter_mut().zip(columns) {
        let found = table.column(column);
        *number = found.ok_or_else(|| lacks(format!("column: {column} of {name}")))?;
    }
    Ok((table, numbers))
}

fn integer(value: StoredValue<'_>) -> Result<i64, String> {
    match value {
        StoredValue::Integer(number) => Ok(number),
        other => Err(format!(
            "the time or topic of a message is {}",
            other.kind()
        )),
    }
}

fn text(row: &StoredRow<'_>, column: usize) -> Result<String, String> {
    row.with(column, |value| match value {
        StoredValue::Text(bytes) => {
            String::from_utf8(bytes.to_vec()).map_err(|_| "a text is not UTF-8".to_owned())
        }
        other => Err(format!("the name or type of a topic is {}", other.kind())),
    })?
}
