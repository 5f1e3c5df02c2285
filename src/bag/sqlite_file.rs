//! Files of SQLite, as far as rows of tables need them: pages, B-trees, records, and the write-ahead log beside them.
//!
//! [The format](https://www.sqlite.org/fileformat2.html) is fixed. Nothing here interprets SQL but the names of
//! columns, and nothing in the file is run.

use super::limits::RECORD_MAX;
use crate::log_file::Size;
use std::collections::HashMap;
use std::fs::File;
use std::io::{BufReader, ErrorKind, Read};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

const MAGIC: &[u8] = b"SQLite format 3\0";
const HEADER: usize = 100;
const INTERIOR: u8 = 5;
const LEAF: u8 = 13;

/// A database that is only read.
pub(super) struct SqliteFile {
    file: File,
    log: Option<Log>,
    page_size: usize,
    /// Bytes of a page that hold content.
    usable: usize,
    pages: u64,
}

/// What was committed but not yet moved into the database.
struct Log {
    file: File,
    /// Where the newest version of a page begins.
    places: HashMap<u32, u64>,
    /// Pages of the database after the last commit.
    pages: u32,
}

/// A table.
pub(super) struct StoredTable {
    root: u32,
    columns: Vec<String>,
}

/// Where a row is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct RowPlace {
    page: u32,
    cell: u16,
}

impl RowPlace {
    /// Returns whether both rows are in one page.
    pub(super) fn same_page(self, other: Self) -> bool {
        self.page == other.page
    }
}

/// A row.
pub(super) struct StoredRow<'a> {
    database: &'a SqliteFile,
    /// Its number, which a column of type INTEGER PRIMARY KEY shows.
    pub(super) number: i64,
    length: u64,
    /// The part of its record that is in its page.
    local: &'a [u8],
    overflow: u32,
}

/// A value of a row.
pub(super) enum StoredValue<'a> {
    Null,
    Integer(i64),
    Real,
    Text(&'a [u8]),
    Blob(&'a [u8]),
}

impl SqliteFile {
    /// Opens a file.
    ///
    /// # Errors
    /// Why it cannot be read.
    pub(super) fn open(at: &Path) -> Result<Self, String> {
        let file = File::open(at).map_err(|error| error.to_string())?;
        let mut header = [0; HEADER];
        match file.read_exact_at(&mut header, 0) {
            Err(error) if error.kind() != ErrorKind::UnexpectedEof => return Err(error.to_string()),
            _ if !header.starts_with(MAGIC) => {
                return Err(
                    "file is not a database: not a bag, or a compressed one whose name lacks .zstd"
                        .to_owned(),
                );
            }
            result => result.map_err(|_| damaged("its header is cut off"))?,
        }
        let page_size = match u16::from_be_bytes([header[16], header[17]]) {
            1 => 1 << 16,
            size if size >= 512 && size.is_power_of_two() => usize::from(size),
            size => return Err(damaged(format_args!("its pages have {size} bytes"))),
        };
        let usable = page_size - usize::from(header[20]);
        if usable < 480 {
            return Err(damaged("its pages have no room"));
        }
        if !matches!(header[56..60], [0, 0, 0, 0 | 1]) {
            return Err("its text is UTF-16, which no bag of rosbag2 has".to_owned());
        }
        if is_hot_journal(&beside(at, "-journal")) {
            return Err(
                "its recorder was interrupted; open it once with `sqlite3 FILE .tables`, which finishes what it left"
                    .to_owned(),
            );
        }
        let log = Log::open(&beside(at, "-wal"), page_size).map_err(|error| error.to_string())?;
        let size = file.metadata().map_err(|error| error.to_string())?.len();
        let pages = log
            .as_ref()
            .map_or(size / page_size as u64, |log| u64::from(log.pages));
        Ok(Self {
            file,
            log,
            page_size,
            usable,
            pages,
        })
    }

    /// Returns the table of that name; none if there is none.
    ///
    /// # Errors
    /// Its rows are computed, or the file is damaged.
    pub(super) fn table(&self, name: &str) -> Result<Option<StoredTable>, String> {
        let mut found = None;
        // Columns: type, name, table, root page, SQL.
        self.rows(1, &mut |_, row| {
            let record = row.record()?;
            let text = |column| match value(&record, column) {
                Some(StoredValue::Text(text)) => String::from_utf8_lossy(text).into_owned(),
                _ => String::new(),
            };
            if !text(1).eq_ignore_ascii_case(name) {
                return Ok(());
            }
            let computed = |what: String| {
                Err(format!(
                    "{what} is computed by the file instead of stored in it, which no bag of rosbag2 does; it is not read"
                ))
            };
            let root = match value(&record, 3) {
                Some(StoredValue::Integer(root)) => u32::try_from(root).unwrap_or(0),
                _ => 0,
            };
            if text(0) != "table" || root == 0 {
                return computed(format!("the {} {name}", text(0)));
            }
            let columns = columns(&text(4)).ok_or_else(|| damaged("a table has no columns"))?;
            if let Some((column, _)) = columns.iter().find(|(_, computed)| *computed) {
                return computed(format!("the column {column} of {name}"));
            }
            let columns = columns.into_iter().map(|(column, _)| column).collect();
            found = Some(StoredTable { root, columns });
            Ok(())
        })?;
        Ok(found)
    }

    /// Calls `visit` for each row of a table, in the order of their numbers.
    ///
    /// # Errors
    /// The file is damaged, or the first error of `visit`.
    pub(super) fn visit(
        &self,
        table: &StoredTable,
        visit: &mut dyn FnMut(RowPlace, &StoredRow<'_>) -> Result<(), String>,
    ) -> Result<(), String> {
        self.rows(table.root, visit)
    }

    fn rows(
        &self,
        root: u32,
        visit: &mut dyn FnMut(RowPlace, &StoredRow<'_>) -> Result<(), String>,
    ) -> Result<(), String> {
        let (mut waiting, mut visited) = (vec![root], 0);
        while let Some(number) = waiting.pop() {
            visited += 1;
            if visited > self.pages {
                return Err(damaged("its pages form a circle"));
            }
            let page = self.page(number)?;
            let start = if number == 1 { HEADER } else { 0 };
            let cells = be16(&page, start + 3)?;
            match page.get(start) {
                Some(&LEAF) => {
                    for cell in 0..cells {
                        let place = RowPlace { page: number, cell };
                        visit(place, &self.row(&page, place)?)?;
                    }
                }
                Some(&INTERIOR) => {
                    waiting.push(be32(&page, start + 8)?);
                    for cell in (0..cells).rev() {
                        let at = be16(&page, start + 12 + 2 * usize::from(cell))?;
                        waiting.push(be32(&page, at.into())?);
                    }
                    // Pages that wait are pages of this tree: no more than the file has.
                    if waiting.len() as u64 > self.pages {
                        return Err(damaged("its pages form a circle"));
                    }
                }
                _ => return Err(damaged(format_args!("page {number} is not of a table"))),
            }
        }
        Ok(())
    }

    /// Returns the row at a place of the page with these bytes.
    ///
    /// # Errors
    /// The file is damaged.
    pub(super) fn row<'a>(
        &'a self,
        page: &'a [u8],
        place: RowPlace,
    ) -> Result<StoredRow<'a>, String> {
        let start = if place.page == 1 { HEADER } else { 0 };
        let mut at = usize::from(be16(page, start + 8 + 2 * usize::from(place.cell))?);
        let short = || damaged(format_args!("a row of page {} is cut off", place.page));
        let length = varint(page, &mut at).ok_or_else(short)?;
        let number = varint(page, &mut at).ok_or_else(short)? as i64;
        let usable = self.usable as u64;
        let in_page = if length <= usable - 35 {
            length
        } else {
            let least = (usable - 12) * 32 / 255 - 23;
            let most = least + (length - least) % (usable - 4);
            if most <= usable - 35 { most } else { least }
        };
        let end = at + in_page as usize;
        let local = page.get(at..end).ok_or_else(short)?;
        let overflow = if in_page < length {
            be32(page, end)?
        } else {
            0
        };
        Ok(StoredRow {
            database: self,
            number,
            length,
            local,
            overflow,
        })
    }

    /// Returns the bytes of the page that a row is in.
    ///
    /// # Errors
    /// The file is damaged or cannot be read.
    pub(super) fn page_of(&self, place: RowPlace) -> Result<Vec<u8>, String> {
        self.page(place.page)
    }

    fn page(&self, number: u32) -> Result<Vec<u8>, String> {
        if number == 0 || u64::from(number) > self.pages {
            return Err(damaged(format_args!("it has no page {number}")));
        }
        let logged = self.log.as_ref();
        let logged = logged.and_then(|log| Some((&log.file, *log.places.get(&number)?)));
        let own = (&self.file, u64::from(number - 1) * self.page_size as u64);
        let (file, at) = logged.unwrap_or(own);
        let mut bytes = vec![0; self.page_size];
        file.read_exact_at(&mut bytes, at)
            .map_err(|error| damaged(format_args!("page {number}: {error}")))?;
        Ok(bytes)
    }
}

impl StoredTable {
    /// Returns the number of a column.
    pub(super) fn column(&self, name: &str) -> Option<usize> {
        let mut names = self.columns.iter();
        names.position(|column| column.eq_ignore_ascii_case(name))
    }
}

impl StoredValue<'_> {
    /// Returns what kind of value it is.
    pub(super) fn kind(&self) -> &'static str {
        match self {
            Self::Null => "nothing",
            Self::Integer(_) => "a whole number",
            Self::Real => "a number",
            Self::Text(_) => "a text",
            Self::Blob(_) => "a blob",
        }
    }
}

impl StoredRow<'_> {
    /// Calls `take` with the value of a column, for which the rest of the row is read only where the page lacks it.
    ///
    /// # Errors
    /// The file is damaged.
    pub(super) fn with<T>(
        &self,
        column: usize,
        take: impl Fn(StoredValue<'_>) -> T,
    ) -> Result<T, String> {
        if let Some(value) = value(self.local, column) {
            return Ok(take(value));
        }
        let record = self.record()?;
        value(&record, column)
            .map(take)
            .ok_or_else(|| damaged("a row is cut off"))
    }

    /// Returns the whole record.
    ///
    /// # Errors
    /// The file is damaged, or the row is larger than any message.
    pub(super) fn record(&self) -> Result<Vec<u8>, String> {
        if self.length > RECORD_MAX {
            return Err(format!("a row is larger than {}", Size(RECORD_MAX)));
        }
        let mut record = self.local.to_vec();
        let mut next = self.overflow;
        while (record.len() as u64) < self.length {
            let page = self.database.page(next)?;
            next = be32(&page, 0)?;
            let left = self.length as usize - record.len();
            let content = page.get(4..self.database.usable).unwrap_or_default();
            record.extend(&content[..left.min(content.len())]);
        }
        Ok(record)
    }
}

/// Returns a value of a record; none where the bytes do not reach to its end.
pub(super) fn value(record: &[u8], column: usize) -> Option<StoredValue<'_>> {
    let mut at = 0;
    let header = usize::try_from(varint(record, &mut at)?).ok()?;
    let mut start = header;
    for number in 0.. {
        if at >= header {
            // A column that was added later than the row.
            return Some(StoredValue::Null);
        }
        let kind = varint(record, &mut at)?;
        let size = match kind {
            0 | 8 | 9 => 0,
            1..=4 => kind,
            5 => 6,
            6 | 7 => 8,
            10 | 11 => return None,
            _ => (kind - 12) / 2,
        };
        let end = start.checked_add(usize::try_from(size).ok()?)?;
        if number < column {
            start = end;
            continue;
        }
        let bytes = record.get(start..end)?;
        return Some(match kind {
            0 => StoredValue::Null,
            7 => StoredValue::Real,
            8 | 9 => StoredValue::Integer(kind as i64 - 8),
            1..=6 => {
                let sign = if bytes[0] < 0x80 { 0 } else { -1 };
                let add = |value: i64, byte: &u8| value << 8 | i64::from(*byte);
                StoredValue::Integer(bytes.iter().fold(sign, add))
            }
            _ if kind % 2 == 0 => StoredValue::Blob(bytes),
            _ => StoredValue::Text(bytes),
        });
    }
    None
}

impl Log {
    /// Reads the log of a database; none where it has none, or nothing in it was committed.
    fn open(at: &Path, page_size: usize) -> std::io::Result<Option<Self>> {
        let file = match File::open(at) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            file => file?,
        };
        let mut source = BufReader::new(&file);
        let mut header = [0; 32];
        if !whole(&mut source, &mut header)? {
            return Ok(None);
        }
        let word = |bytes: &[u8], at: usize| be32(bytes, at).unwrap_or(0);
        let magic = word(&header, 0);
        let sums = |sums, bytes: &[u8]| checksum(sums, bytes, magic & 1 == 1);
        let mut sum = sums([0; 2], &header[..24]);
        if magic & !1 != 0x377f_0682
            || word(&header, 8) as usize != page_size
            || sum != [word(&header, 24), word(&header, 28)]
        {
            return Ok(None);
        }
        let (mut places, mut waiting, mut pages) = (HashMap::new(), Vec::new(), 0);
        let mut frame = vec![0; 24 + page_size];
        let mut at = header.len() as u64;
        // Frames of an earlier use follow the last one, with other salts.
        while whole(&mut source, &mut frame)? && frame[8..16] == header[16..24] {
            sum = sums(sums(sum, &frame[..8]), &frame[24..]);
            if sum != [word(&frame, 16), word(&frame, 20)] {
                break;
            }
            waiting.push((word(&frame, 0), at + 24));
            let committed = word(&frame, 4);
            if committed != 0 {
                pages = committed;
                places.extend(waiting.drain(..));
            }
            at += frame.len() as u64;
        }
        Ok((pages > 0).then_some(Self {
            file,
            places,
            pages,
        }))
    }
}

/// Fills a buffer; false where the source ends before.
fn whole(source: &mut impl Read, buffer: &mut [u8]) -> std::io::Result<bool> {
    match source.read_exact(buffer) {
        Err(error) if error.kind() == ErrorKind::UnexpectedEof => Ok(false),
        result => result.map(|()| true),
    }
}

/// Returns the checksum of a log after `bytes`, words of either order.
fn checksum(sums: [u32; 2], bytes: &[u8], big_endian: bool) -> [u32; 2] {
    let word = |bytes: &[u8]| {
        let bytes = [bytes[0], bytes[1], bytes[2], bytes[3]];
        if big_endian {
            u32::from_be_bytes(bytes)
        } else {
            u32::from_le_bytes(bytes)
        }
    };
    bytes.chunks_exact(8).fold(sums, |[first, second], pair| {
        let first = first.wrapping_add(word(&pair[..4])).wrapping_add(second);
        let second = second.wrapping_add(word(&pair[4..])).wrapping_add(first);
        [first, second]
    })
}

/// Returns whether a journal holds pages that must be put back first.
fn is_hot_journal(at: &Path) -> bool {
    let mut start = [0; 8];
    let read = File::open(at).and_then(|mut file| file.read_exact(&mut start));
    read.is_ok() && start == [0xd9, 0xd5, 0x05, 0xf9, 0x20, 0xa1, 0x63, 0xd7]
}

/// Returns the name of a file that SQLite keeps beside a database.
fn beside(at: &Path, ending: &str) -> PathBuf {
    let mut name = at.as_os_str().to_owned();
    name.push(ending);
    name.into()
}

fn damaged(what: impl std::fmt::Display) -> String {
    format!(
        "{what}: the file is damaged or cut off; `sqlite3 FILE .recover` writes what is left of it"
    )
}

fn be16(bytes: &[u8], at: usize) -> Result<u16, String> {
    let bytes = bytes.get(at..).and_then(|bytes| bytes.first_chunk());
    let bytes = bytes.ok_or_else(|| damaged("a page is too short"))?;
    Ok(u16::from_be_bytes(*bytes))
}

fn be32(bytes: &[u8], at: usize) -> Result<u32, String> {
    let bytes = bytes.get(at..).and_then(|bytes| bytes.first_chunk());
    let bytes = bytes.ok_or_else(|| damaged("a page is too short"))?;
    Ok(u32::from_be_bytes(*bytes))
}

/// Returns a number of variable length, and moves on to what follows it.
fn varint(bytes: &[u8], at: &mut usize) -> Option<u64> {
    let mut number = 0;
    for count in 1..=9 {
        let byte = u64::from(*bytes.get(*at)?);
        *at += 1;
        if count == 9 {
            return Some(number << 8 | byte);
        }
        number = number << 7 | byte & 0x7f;
        if byte < 0x80 {
            return Some(number);
        }
    }
    None
}

/// Returns the names of the columns of a table, and whether each is computed; none for what makes no table of rows
/// with numbers.
fn columns(sql: &str) -> Option<Vec<(String, bool)>> {
    let words = words(sql);
    let begin = words.iter().position(|word| word.is('('))?;
    let mut columns = Vec::new();
    let mut definition: Vec<&Word> = Vec::new();
    let mut depth = 1;
    for (number, word) in words.iter().enumerate().skip(begin + 1) {
        depth += i32::from(word.is('(')) - i32::from(word.is(')'));
        if depth == 0 || depth == 1 && word.is(',') {
            let [name, rest @ ..] = &definition[..] else {
                return None;
            };
            let constraints = ["CONSTRAINT", "PRIMARY", "UNIQUE", "CHECK", "FOREIGN"];
            if !constraints.iter().any(|keyword| name.says(keyword)) {
                let computed = rest.iter().any(|word| word.says("AS"));
                columns.push((name.text.clone(), computed));
            }
            definition.clear();
            if depth == 0 {
                let without = words[number..].iter().any(|word| word.says("WITHOUT"));
                return (!without).then_some(columns);
            }
        } else if depth == 1 {
            definition.push(word);
        }
    }
    None
}

/// A word or sign of SQL.
struct Word {
    text: String,
    quoted: bool,
}

impl Word {
    fn is(&self, sign: char) -> bool {
        !self.quoted && self.text.chars().eq([sign])
    }

    fn says(&self, keyword: &str) -> bool {
        !self.quoted && self.text.eq_ignore_ascii_case(keyword)
    }
}

/// Returns the words and signs of SQL, without comments.
fn words(sql: &str) -> Vec<Word> {
    let mut words = Vec::new();
    let mut rest = sql;
    while let Some(first) = rest.chars().next() {
        let after = &rest[first.len_utf8()..];
        let up_to = |end: &str| after.split_once(end).map_or((after, ""), |parts| parts);
        let quote = match first {
            '\'' | '"' | '`' => Some(first),
            '[' => Some(']'),
            _ => None,
        };
        if let Some(quote) = quote {
            let (mut text, mut left) = (String::new(), after);
            loop {
                let (part, behind) = left.split_once(quote).unwrap_or((left, ""));
                text.push_str(part);
                left = behind;
                // A quote that is doubled stands for itself.
                match behind.strip_prefix(quote) {
                    Some(behind) if quote != ']' => {
                        text.push(quote);
                        left = behind;
                    }
                    _ => break,
                }
            }
            words.push(Word { text, quoted: true });
            rest = left;
        } else if rest.starts_with("--") {
            rest = up_to("\n").1;
        } else if rest.starts_with("/*") {
            rest = up_to("*/").1;
        } else {
            let is_word = |sign: char| sign.is_alphanumeric() || "_$.".contains(sign);
            let length = match rest.find(|sign| !is_word(sign)) {
                Some(0) => first.len_utf8(),
                length => length.unwrap_or(rest.len()),
            };
            let (text, left) = rest.split_at(length);
            if !first.is_whitespace() {
                words.push(Word {
                    text: text.to_owned(),
                    quoted: false,
                });
            }
            rest = left;
        }
    }
    words
}
