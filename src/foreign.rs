//! What a file is by its first bytes, where it is of another format.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// Bytes by which a file is known.
const BEGIN: usize = 512;

/// Beginnings of files, and how to come by one that is read.
const BEGINNINGS: [(&[u8], &str); 10] = [
    (
        b"version https:",
        "is a pointer of Git LFS, not the file itself: `git lfs pull` in its repository fetches the file",
    ),
    (
        b"#ROSBAG V",
        "is a bag of ROS 1; `rosbags-convert --src FILE.bag --dst FOLDER` of the Python package rosbags makes a \
         bag of ROS 2 of it",
    ),
    (b"\xFF\xFE", UTF_16),
    (b"\xFE\xFF", UTF_16),
    (b"\x1F\x8B", "is compressed by gzip; unpack it first"),
    (
        b"PK\x03\x04",
        "is a ZIP archive, as a spreadsheet or a KMZ is; unpack it, or save it as CSV or GPX",
    ),
    (b"\xB5\x62", RECEIVER),
    (b"\xD3\x00", RECEIVER),
    (
        b"% program",
        "is a solution of RTKLIB; its pos2kml or RTKPLOT makes a GPX of it",
    ),
    (
        b"\x89HDF",
        "is HDF5; save the log as CSV, or the grid by `gdal_translate FILE OUT.tif`",
    ),
];
const UTF_16: &str = "is UTF-16 (\"Unicode\" in some programs); save it as UTF-8";
const RECEIVER: &str = "is raw data of a satellite receiver (UBX or RTCM); compute positions with RTKLIB and save them as GPX";

/// Root elements of XML in a format of tracks, in lower case, with its name and what GPSBabel calls it.
const TRACKS: [(&str, &str, &str); 2] = [
    ("kml", "KML", "kml"),
    ("trainingcenterdatabase", "TCX", "gtrnctr"),
];

/// Returns what a file is by its beginning, if that is nothing that is read here, and how to come by what is.
pub(crate) fn foreign(bytes: &[u8]) -> Option<String> {
    let begin = &bytes[..bytes.len().min(BEGIN)];
    if let Some((_, what)) = BEGINNINGS.iter().find(|(mark, _)| begin.starts_with(mark)) {
        return Some((*what).to_owned());
    }
    if begin.get(8..12) == Some(b".FIT") {
        return Some(track("FIT", "garmin_fit"));
    }
    if is_nmea(begin) {
        return Some(track("NMEA", "nmea"));
    }
    let text = String::from_utf8_lossy(begin).to_lowercase();
    let text = text.trim_start_matches('\u{feff}').trim_start();
    if text.starts_with('{') && text.contains("\"featurecollection\"") {
        return Some(track("GeoJSON", "geojson"));
    }
    if !text.starts_with('<') {
        return None;
    }
    // Behind declaration, document type and comments.
    let mut elements = text.split('<').skip(1);
    let root = elements.find(|element| element.starts_with(char::is_alphabetic))?;
    if root.starts_with("html") {
        return Some(
            "is a web page, as servers send it in place of a file; download the file again"
                .to_owned(),
        );
    }
    let found = TRACKS.iter().find(|(name, ..)| root.starts_with(name));
    found.map(|(_, name, format)| track(name, format))
}

fn track(name: &str, format: &str) -> String {
    format!("is {name}; `gpsbabel -i {format} -f FILE -o gpx -F OUT.gpx` makes a GPX of it")
}

/// Returns whether a text begins with a sentence as receivers write it: `$GNGGA,`.
fn is_nmea(begin: &[u8]) -> bool {
    let [b'$', address @ .., b','] = begin.get(..7).unwrap_or_default() else {
        return false;
    };
    address
        .iter()
        .all(|byte| byte.is_ascii_uppercase() || byte.is_ascii_digit())
}

/// Returns what [`foreign`] finds in a file.
///
/// # Errors
/// The file cannot be read.
pub(crate) fn foreign_file(path: &Path) -> io::Result<Option<String>> {
    let mut begin = Vec::new();
    File::open(path)?
        .take(BEGIN as u64)
        .read_to_end(&mut begin)?;
    Ok(foreign(&begin))
}

/// Returns why bytes that should be text are none, with the line from 1.
pub(crate) fn not_utf8(bytes: &[u8], error: std::str::Utf8Error) -> String {
    if bytes[..bytes.len().min(BEGIN)].contains(&0) {
        return "is not text".to_owned();
    }
    let before = &bytes[..error.valid_up_to()];
    let line = before.iter().filter(|byte| **byte == b'\n').count() + 1;
    format!("line {line}: is not UTF-8 text; save it as UTF-8")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_receivers_and_other_programs_are_known_by_their_beginning() {
        for (bytes, says) in [
            (
                &b"$GPRMC,083559.00,A,4717.11437,N,00833.91522,E,0.004,77.52,091202,,,A*57\r\n"[..],
                "-i nmea",
            ),
            (b"\xB5\x62\x01\x07\x5C\x00", "UBX"),
            (b"\x0E\x10\xD9\x07\x00\x00\x00\x00.FIT", "-i garmin_fit"),
            (
                b"\xEF\xBB\xBF<?xml version=\"1.0\"?>\n<kml id=\"a\">",
                "-i kml",
            ),
            (b"<TrainingCenterDatabase>", "-i gtrnctr"),
            (b"{\"type\": \"FeatureCollection\"}", "-i geojson"),
            (
                b"<!doctype html>\n<html lang=\"de\">",
                "download the file again",
            ),
            (b"% program   : RTKLIB ver.2.4.3\n", "pos2kml"),
            (b"PK\x03\x04\x14", "KMZ"),
        ] {
            let found = foreign(bytes).unwrap_or_default();
            assert!(found.contains(says), "{found}");
        }
        for bytes in [
            &b"<?xml version=\"1.0\"?><gpx><desc><![CDATA[<html>of Monday</html>]]></desc>"[..],
            b"<?xml version=\"1.0\"?><gpx version=\"1.1\">",
            b"$speed,limit\n",
            b"{name: a}\n",
            b"%YAML 1.2\n---\n",
            b"time_s,v_left_m_s\n",
            b"\x89MCAP0\r\n",
            b"SQLite format 3\0",
        ] {
            assert_eq!(foreign(bytes), None);
        }
    }

    #[test]
    fn text_in_another_encoding_is_named_with_its_line() {
        let reason = |bytes: Vec<u8>| {
            let error = std::str::from_utf8(&bytes).unwrap_err();
            not_utf8(&bytes, error)
        };
        assert_eq!(
            reason(b"# a\n# 5\xB0\n".to_vec()),
            "line 2: is not UTF-8 text; save it as UTF-8"
        );
        assert_eq!(reason(b"\x93\x01\x00".to_vec()), "is not text");
    }
}
