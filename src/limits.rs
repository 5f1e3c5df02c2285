//! The largest files that are read: one place for all limits.
//!
//! They are far above what a file of its kind needs, and low enough that a wrong or malicious one cannot take the
//! machine's memory.

use std::io::Read;
use std::path::Path;

/// Control cycles of one simulated run, each of which is kept in less than a kilobyte.
pub(crate) const CYCLES: f64 = 1e6;

/// Nested brackets of a YAML text, or lists that begin in one line.
pub(crate) const YAML_DEPTH: usize = 100;

/// A kind of file that is held in memory as a whole.
struct SizeLimit {
    endings: &'static [&'static str],
    megabytes: u64,
}

/// Elevation grids of 16 million cells; logs that `check` reads; routes of half a million points; configuration, and what
/// was learned at 4096 places, 1.8 MB.
const LIMITS: [SizeLimit; 3] = [
    SizeLimit {
        endings: &["asc", "csv", "tif", "tiff"],
        megabytes: 400,
    },
    SizeLimit {
        endings: &["gpx"],
        megabytes: 64,
    },
    SizeLimit {
        endings: &[],
        megabytes: 2,
    },
];

/// Returns the bytes of a file, unless it is larger than files of its kind may be.
///
/// # Errors
/// What reading says; or [`std::io::ErrorKind::FileTooLarge`] with the limit.
pub(crate) fn read(path: &Path) -> std::io::Result<Vec<u8>> {
    let ending = path
        .extension()
        .map(|ending| ending.to_string_lossy().to_lowercase())
        .unwrap_or_default();
    let limit = LIMITS
        .iter()
        .find(|limit| limit.endings.is_empty() || limit.endings.contains(&ending.as_str()));
    let bytes_max = limit.map_or(u64::MAX, |limit| limit.megabytes * 1_000_000);
    let mut bytes = Vec::new();
    // Some files, such as devices, do not say how long they are.
    std::fs::File::open(path)?
        .take(bytes_max + 1)
        .read_to_end(&mut bytes)?;
    if bytes.len() as u64 > bytes_max {
        let kind = std::io::ErrorKind::FileTooLarge;
        let text = format!(
            "is larger than {} MB, the limit for a file that ends so; grids end in .asc or .tif, logs in .csv, \
             .mcap or .db3",
            bytes_max / 1_000_000
        );
        return Err(std::io::Error::new(kind, text));
    }
    Ok(bytes)
}

/// Returns the line, from 1, at which a YAML text is nested too deeply: by its brackets, or by lists in one line.
///
/// Brackets in texts and comments count, too; so many that are not closed are in neither.
pub(crate) fn too_deep(text: &str) -> Option<usize> {
    let lists = |line: &str| {
        let marks = line.split_ascii_whitespace();
        marks
            .take_while(|mark| matches!(*mark, "-" | "?" | ":"))
            .count()
    };
    if let Some(at) = text.lines().position(|line| lists(line) > YAML_DEPTH) {
        return Some(at + 1);
    }
    let mut depth = 0_usize;
    let mut line = 1;
    for byte in text.bytes() {
        match byte {
            b'\n' => line += 1,
            b'[' | b'{' => depth += 1,
            b']' | b'}' => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth > YAML_DEPTH {
            return Some(line);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_read_up_to_the_limit_of_its_kind() {
        let folder = tempfile::tempdir().unwrap();
        let sized = |name: &str, bytes: u64| {
            let path = folder.path().join(name);
            std::fs::File::create(&path)
                .unwrap()
                .set_len(bytes)
                .unwrap();
            read(&path)
        };
        assert_eq!(sized("a.yaml", 2_000_000).unwrap().len(), 2_000_000);
        let error = sized("b.yaml", 2_000_001).unwrap_err();
        assert_eq!(error.kind(), std::io::ErrorKind::FileTooLarge);
        assert!(error.to_string().contains("2 MB"), "{error}");
        assert!(sized("c.GPX", 2_000_001).is_ok());
        // Sparse: only what is read would take memory.
        assert!(sized("d.gpx", 3_000_000_000).is_err());
    }

    #[test]
    fn nested_brackets_are_counted() {
        assert_eq!(too_deep(&"a: [{b: [1]}]\n".repeat(500)), None);
        assert_eq!(too_deep(&format!("a: 1\nb: {}", "[".repeat(101))), Some(2));
        assert_eq!(too_deep(&format!("a: 1\n{}", "- ".repeat(101))), Some(2));
        assert_eq!(too_deep(&"- - 1\n".repeat(500)), None);
    }
}
