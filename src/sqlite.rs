//! SQLite files that others have made: opened so that they cannot do harm, with errors that a user understands.

use rusqlite::config::DbConfig;
use rusqlite::limits::Limit;
use rusqlite::{Connection, OpenFlags};
use std::path::Path;

/// Opens a file to be read. Its schema can call no function with side effects, and a value of more than `value_max` bytes
/// is an error.
pub(crate) fn open(at: &Path, value_max: u64) -> rusqlite::Result<Connection> {
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let database = Connection::open_with_flags(at, flags)?;
    database.set_db_config(DbConfig::SQLITE_DBCONFIG_TRUSTED_SCHEMA, false)?;
    let most = i32::try_from(value_max).unwrap_or(i32::MAX);
    database.set_limit(Limit::SQLITE_LIMIT_LENGTH, most)?;
    Ok(database)
}

/// Returns what of these tables is a view or a generated column, whose rows need no bytes in the file.
pub(crate) fn computed(database: &Connection, tables: &[&str]) -> rusqlite::Result<Option<String>> {
    for table in tables {
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

/// Returns an error with its remedy; `expected` is what the file was taken for.
pub(crate) fn explained(error: &rusqlite::Error, expected: &str) -> String {
    use rusqlite::ErrorCode::{DatabaseCorrupt, NotADatabase, ReadOnly};
    let hint = match error.sqlite_error_code() {
        Some(NotADatabase) => format!(": not {expected}"),
        Some(DatabaseCorrupt) => {
            ": the file is damaged or cut off; `sqlite3 FILE .recover` writes what is left of it".to_owned()
        }
        Some(ReadOnly) => {
            ": what wrote it was interrupted; open it once with `sqlite3 FILE .tables`, which finishes what it left".to_owned()
        }
        _ if error.to_string().contains("no such table") => format!(": not {expected}"),
        _ => String::new(),
    };
    match error {
        // A column that is not there; the query itself says nothing to a user.
        rusqlite::Error::SqlInputError { msg, .. } => format!("{msg}: not {expected}"),
        error => format!("{error}{hint}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_database_lacks_is_named_without_the_query() {
        let database = Connection::open_in_memory().unwrap();
        database.execute_batch("CREATE TABLE tiles (a)").unwrap();
        for (query, lacks) in [
            (
                "SELECT tile_row FROM tiles",
                "no such column: tile_row: not a map",
            ),
            ("SELECT a FROM images", "no such table: images: not a map"),
        ] {
            let error = database.prepare(query).unwrap_err();
            assert_eq!(explained(&error, "a map"), lacks);
        }
    }
}
