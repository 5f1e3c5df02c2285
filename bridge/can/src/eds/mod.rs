//! Electronic data sheets of drives (EDS) and their configured kind (DCF), as CiA 306 has them: which objects a drive
//! has, and whether a layout fits them.
//!
//! No crate is used: those there are bring a CANopen stack of their own, and leave out access and limits.

mod fit;

use crate::cia402::NodeId;
use crate::config::ObjectType;
use std::collections::BTreeMap;

/// Most subindices of an object.
const SUBS_MAX: i64 = 254;

/// What a maker says of a drive.
#[derive(Debug, Clone, PartialEq)]
pub struct Eds {
    /// Vendor and product number, as in object 0x1018.
    pub identity: [Option<u32>; 2],
    /// By index and subindex.
    objects: BTreeMap<(u16, u8), EdsObject>,
}

/// An object, as far as a layout has to do with it.
#[derive(Debug, Clone, Default, PartialEq)]
struct EdsObject {
    /// None for one that does not fit into four bytes.
    kind: Option<ObjectType>,
    writable: bool,
    mappable: bool,
    /// Least and greatest value.
    limits: [Option<i64>; 2],
    /// Of a DCF the parameter's value, else the default.
    value: Option<i64>,
}

/// Why a file is no data sheet.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum EdsError {
    /// A line that is neither a section nor a key with a value.
    #[error(
        "{file}: line {line}: `{text}` is no `key=value`; correct it, or get the file from the maker again"
    )]
    Line {
        /// The file.
        file: String,
        /// Where, from 1 on.
        line: usize,
        /// What is there.
        text: String,
    },
    /// A value that is no number.
    #[error("{file}: line {line}: {key}: `{text}` is no number, as 12, 0x1F or $NODEID+0x200 are")]
    Number {
        /// The file.
        file: String,
        /// Where, from 1 on.
        line: usize,
        /// The key.
        key: &'static str,
        /// What is there.
        text: String,
    },
    /// No section is that of an object.
    #[error(
        "{file}: has no section of an object, as [6040] is: an EDS or DCF file of the drive is expected"
    )]
    NoObjects {
        /// The file.
        file: String,
    },
}

/// EdsSection of a section in small letters, with their line and value.
type EdsSection = BTreeMap<String, (usize, String)>;

impl Eds {
    /// Reads the text of a data sheet for a drive that has this number.
    ///
    /// Unknown sections and keys, and objects of strings and other long types, are allowed.
    ///
    /// # Errors
    /// [`EdsError`] with file and line.
    pub fn parse(file: &str, text: &str, node: NodeId) -> Result<Self, EdsError> {
        let sections = sections(file, text)?;
        let reader = EdsReader { file, node };
        let mut objects = BTreeMap::new();
        for (name, keys) in &sections {
            let Some((index, sub)) = address(name) else {
                continue;
            };
            let object = reader.object(keys)?;
            let compact = reader.number(keys, "CompactSubObj")?.unwrap_or(0);
            if sub.is_some() || compact <= 0 {
                objects.insert((index, sub.unwrap_or(0)), object);
                continue;
            }
            let count = compact.min(SUBS_MAX);
            let counted = EdsObject {
                kind: Some(ObjectType::U8),
                value: Some(count),
                ..EdsObject::default()
            };
            objects.insert((index, 0), counted);
            let values = sections.get(&format!("{index:04x}value"));
            for sub in 1..=count as u8 {
                let mut object = object.clone();
                if let Some((line, text)) = values.and_then(|keys| keys.get(&sub.to_string())) {
                    object.value = reader.parse("value", *line, text)?;
                }
                objects.insert((index, sub), object);
            }
        }
        if objects.is_empty() {
            return Err(EdsError::NoObjects {
                file: file.to_owned(),
            });
        }
        let device = sections.get("deviceinfo");
        let info = |key| match device {
            Some(keys) => reader.number(keys, key),
            None => Ok(None),
        };
        let bits = |value: Option<i64>| value.and_then(|value| u32::try_from(value).ok());
        Ok(Self {
            identity: [bits(info("VendorNumber")?), bits(info("ProductNumber")?)],
            objects,
        })
    }
}

/// Returns the sections of a file by their names in small letters.
fn sections(file: &str, text: &str) -> Result<BTreeMap<String, EdsSection>, EdsError> {
    let mut sections = BTreeMap::<String, EdsSection>::new();
    let mut name = String::new();
    for (i, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with(';') || line.starts_with('#') {
            continue;
        }
        if let Some(section) = line.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
            name = section.0.trim().to_ascii_lowercase();
            sections.entry(name.clone()).or_default();
            continue;
        }
        match line.split_once('=') {
            Some((key, value)) => {
                let key = key.trim().to_ascii_lowercase();
                let keys = sections.entry(name.clone()).or_default();
                keys.insert(key, (i + 1, value.trim().to_owned()));
            }
            // Comments and lists have lines of many kinds.
            None if address(&name).is_none() => {}
            None => {
                return Err(EdsError::Line {
                    file: file.to_owned(),
                    line: i + 1,
                    text: line.chars().take(60).collect(),
                });
            }
        }
    }
    Ok(sections)
}

/// Returns index and subindex of a section of an object, such as `1400` and `1400sub5`.
fn address(section: &str) -> Option<(u16, Option<u8>)> {
    let (index, sub) = match section.split_once("sub") {
        Some((index, sub)) => (index, Some(u8::from_str_radix(sub, 16).ok()?)),
        None => (section, None),
    };
    let index = (index.len() == 4).then(|| u16::from_str_radix(index, 16).ok());
    Some((index??, sub))
}

/// Reads the values of keys.
struct EdsReader<'a> {
    file: &'a str,
    node: NodeId,
}

impl EdsReader<'_> {
    fn object(&self, keys: &EdsSection) -> Result<EdsObject, EdsError> {
        let kind = match self.number(keys, "DataType")? {
            Some(0x1 | 0x5) => Some(ObjectType::U8),
            Some(0x2) => Some(ObjectType::I8),
            Some(0x3) => Some(ObjectType::I16),
            Some(0x4) => Some(ObjectType::I32),
            Some(0x6) => Some(ObjectType::U16),
            Some(0x7) => Some(ObjectType::U32),
            _ => None,
        };
        let access = keys.get("accesstype").map(|(_, text)| text.as_str());
        let access = access.unwrap_or_default().to_ascii_lowercase();
        // Those of other types are texts.
        let value = |key| match kind {
            Some(kind) => {
                let value = self.number(keys, key)?;
                Ok::<_, EdsError>(value.map(|value| as_signed(kind, value)))
            }
            None => Ok(None),
        };
        Ok(EdsObject {
            kind,
            writable: matches!(&access[..], "wo" | "rw" | "rwr" | "rww"),
            mappable: self.number(keys, "PDOMapping")? == Some(1),
            limits: [value("LowLimit")?, value("HighLimit")?],
            value: match value("ParameterValue")? {
                Some(value) => Some(value),
                None => value("DefaultValue")?,
            },
        })
    }

    /// Returns a number; none where the key is missing or empty.
    fn number(&self, keys: &EdsSection, key: &'static str) -> Result<Option<i64>, EdsError> {
        match keys.get(&key.to_ascii_lowercase()) {
            Some((line, text)) => self.parse(key, *line, text),
            None => Ok(None),
        }
    }

    fn parse(&self, key: &'static str, line: usize, text: &str) -> Result<Option<i64>, EdsError> {
        // What follows a semicolon is a comment.
        let text = text.split(';').next().unwrap_or_default().trim();
        if text.is_empty() {
            return Ok(None);
        }
        let mut parts = text.split('+').map(|part| {
            let part = part.trim().to_ascii_lowercase();
            let digits = part.trim_start_matches('-');
            let value = match digits.strip_prefix("0x") {
                _ if digits == "$nodeid" => Some(i64::from(self.node.get())),
                Some(hex) => i64::from_str_radix(hex, 16).ok(),
                None => digits.parse().ok(),
            };
            let negative = part.len() - digits.len() == 1;
            value.map(|value: i64| if negative { -value } else { value })
        });
        let sum = parts.try_fold(0_i64, |sum, part| sum.checked_add(part?));
        sum.map(Some).ok_or_else(|| EdsError::Number {
            file: self.file.to_owned(),
            line,
            key,
            text: text.chars().take(60).collect(),
        })
    }
}

/// Returns a value of a signed type that is written by its bits, as 0xFFFF is for -1.
fn as_signed(kind: ObjectType, value: i64) -> i64 {
    let bits = match kind {
        ObjectType::I8 => 8,
        ObjectType::I16 => 16,
        ObjectType::I32 => 32,
        ObjectType::U8 | ObjectType::U16 | ObjectType::U32 => return value,
    };
    let is_negative = (1 << (bits - 1)..1 << bits).contains(&value);
    if is_negative {
        value - (1 << bits)
    } else {
        value
    }
}

#[cfg(test)]
mod tests;
