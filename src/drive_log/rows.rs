//! Rows of a log from sources with different times.

use super::Chosen;
use super::interpolation::seconds;
use super::series::{self, Series};
use crate::bag::Bag;
use anyhow::{Context, Result, bail};
use sidehill_plant::log::{DriveLog, GAP_MAX_S};

/// Returns the log of a bag and notes about what was left out.
///
/// There is a row at each time of a tread speed and of a pose; the other sources are interpolated to it. Times
/// count from the first row, so that they keep their nanoseconds.
pub(super) fn log(bag: &Bag, chosen: &Chosen) -> Result<(DriveLog, Vec<String>)> {
    rows(
        &bag.path().display().to_string(),
        series::read(bag, chosen)?,
    )
}

/// Returns the log of sources that were read from the file of that name, and notes.
pub(super) fn rows(name: &str, series: Series) -> Result<(DriveLog, Vec<String>)> {
    let Series { sources, mut notes } = series;
    let (rows, left_out) = sources.rows(seconds);
    if rows.len() < 2 {
        let spans = [
            ("tread speeds", span(&sources.tread_speeds)),
            ("attitude", sources.attitudes.as_deref().and_then(span)),
            ("poses", span(&sources.poses)),
        ];
        let spans: Vec<String> = spans
            .into_iter()
            .filter_map(|(source, span)| {
                let (from_s, to_s) = span?;
                Some(format!("{source} from {from_s:.3} to {to_s:.3} s"))
            })
            .collect();
        bail!(
            "{}: tread speeds and attitude have no times in common ({}); with `time: received` in the topic map \
             (--topics) the time of recording counts instead of the stamps",
            name,
            spans.join(", ")
        );
    }
    if left_out > 0 {
        notes.push(format!(
            "{left_out} of {} rows are left out: another source is silent there for more than {GAP_MAX_S} s",
            left_out + rows.len()
        ));
    }
    let rows = rows.into_iter().map(|(_, row)| row).collect();
    let log = DriveLog::new(rows).with_context(|| name.to_owned())?;
    Ok((log, notes))
}

fn span<T>(values: &[(i64, T)]) -> Option<(f64, f64)> {
    let seconds = |(time_ns, _): &(i64, T)| *time_ns as f64 * 1e-9;
    Some((seconds(values.first()?), seconds(values.last()?)))
}
