//! `sidehill replay`: feeds recorded samples to the controller.

mod args;
mod begin;
mod compare;
mod play;
mod rebuild;
mod repeat;
mod report;

use crate::console;
use crate::exit::Exit;
use crate::output;
use crate::recording::{self, damage, datum, fact, target};
use crate::simulate::Format;
use anyhow::{Context, Result, ensure};
pub use args::ReplayArgs;
use begin::Begin;
use compare::ReplayComparison;
pub(crate) use rebuild::{Rebuilt, ReplayChanges};
use serde::Serialize;
use sidehill_recording::Recording;
use std::path::Path;
use std::process::ExitCode;

/// What is printed.
#[derive(Serialize)]
struct ReplayOutcome<'a> {
    recording: &'a Path,
    controller: &'a str,
    /// Versions of the recording and of this program.
    versions: [String; 2],
    closed_loop: bool,
    changed: bool,
    /// Start of the comparison; none for the start of the recording.
    #[serde(skip_serializing_if = "Option::is_none")]
    begins: Option<Begin>,
    /// Steps missing in the recording.
    lost: u64,
    /// Why the recording could not be read to its end.
    #[serde(skip_serializing_if = "Option::is_none")]
    damaged: Option<&'a str>,
    /// Cross-track error of the recorded and of the replayed drive, m.
    cross_track_rms_m: [f64; 2],
    #[serde(flatten)]
    comparison: &'a ReplayComparison,
}

/// Replays a recording, prints the differences of the commands, and returns success if there are none or if
/// changes were requested.
///
/// # Errors
/// A recording that cannot be read or lacks its start, or an invalid setting.
pub fn run(args: &ReplayArgs) -> Result<ExitCode> {
    let (mut recording, rebuilt) = opened(args)?;
    let begin = begin(args, &recording);
    let found = match begin {
        Err(error) if args.live.live.is_some() => {
            console::complain(format_args!("{error:#}"));
            None
        }
        begin => Some(compared(args, &mut recording, &rebuilt, begin?)?),
    };
    if let Some(folder) = found.as_ref().and(args.write_case.as_ref()) {
        write_case(args, folder)?;
    }
    match (&found, args.format) {
        (Some(found), Format::Json) => console::line(&found.json),
        (Some(found), Format::Table) => console::text(&found.table),
        (None, _) => {}
    }
    show(args, &recording, &rebuilt)?;
    Ok(Exit::answer(found.is_none_or(|found| !found.failed)).into())
}

/// Replays a recording and returns, as JSON, what `--format json` prints. It serves no live view and writes no case.
///
/// # Errors
/// As [`run`].
pub fn facts(args: &ReplayArgs) -> Result<String> {
    let (mut recording, rebuilt) = opened(args)?;
    let begin = begin(args, &recording)?;
    Ok(compared(args, &mut recording, &rebuilt, begin)?.json)
}

/// What a replay found.
struct ReplayFindings {
    json: String,
    table: String,
    /// Whether commands differ that must not.
    failed: bool,
}

fn opened(args: &ReplayArgs) -> Result<(Recording, Rebuilt)> {
    let recording = Recording::read(&args.recording)?;
    let named = || args.recording.display().to_string();
    ensure!(
        !recording.cycles.is_empty(),
        "{}: there is no step of a controller in it{}",
        named(),
        damage(recording.damaged.as_deref())
    );
    if let Some(report) = &args.report {
        output::check_writable(report, args.force)?;
        output::check_apart(report, [&args.recording])?;
    }
    let rebuilt = Rebuilt::of(&recording, &args.changes()).with_context(named)?;
    Ok((recording, rebuilt))
}

/// Returns where the comparison begins.
fn begin(args: &ReplayArgs, recording: &Recording) -> Result<Begin> {
    match args.closed_loop {
        true => Ok(Begin::default()),
        false => Begin::of(recording).with_context(|| args.recording.display().to_string()),
    }
}

/// Compares the replay with what was recorded from `begin` on, and writes the report.
fn compared(
    args: &ReplayArgs,
    recording: &mut Recording,
    rebuilt: &Rebuilt,
    begin: Begin,
) -> Result<ReplayFindings> {
    let lost = lost(recording);
    let changed = args.changes().changed();
    let replayed = if args.closed_loop {
        rebuilt.drive(recording)?
    } else {
        let replayed = repeat::repeat(recording, rebuilt, &begin, changed)?;
        recording.cycles.drain(..begin.place);
        replayed
    };
    let tolerance_m_s = args.tolerance.unwrap_or(0.0);
    let comparison = ReplayComparison::of(&recording.cycles, &replayed, tolerance_m_s);
    let version = |name| {
        recording
            .header
            .facts
            .get(name)
            .cloned()
            .unwrap_or_default()
    };
    let outcome = ReplayOutcome {
        recording: &args.recording,
        controller: rebuilt.kind.name(),
        versions: [
            format!("{} {}", version(fact::VERSION), version(fact::TARGET)),
            format!("{} {}", env!("CARGO_PKG_VERSION"), target()),
        ],
        closed_loop: args.closed_loop,
        changed,
        begins: (begin.place > 0).then_some(begin),
        lost,
        damaged: recording.damaged.as_deref(),
        cross_track_rms_m: [
            compare::cross_track_rms_m(recording.cycles.iter().map(|cycle| cycle.cross_track_m)),
            compare::cross_track_rms_m(replayed.iter().map(|cycle| cycle.cross_track_m)),
        ],
        comparison: &comparison,
    };
    if let Some(file) = &args.report {
        let page = report::html(recording, rebuilt, &replayed, &comparison)?;
        output::write(file, page.as_bytes(), args.force)?;
    }
    let may_differ = (changed || args.closed_loop) && args.tolerance.is_none();
    Ok(ReplayFindings {
        json: serde_json::to_string(&outcome)?,
        table: table(&outcome),
        failed: lost > 0 || comparison.different > 0 && !may_differ,
    })
}

/// Plays the recording live, if requested.
fn show(args: &ReplayArgs, recording: &Recording, rebuilt: &Rebuilt) -> Result<()> {
    let Some(address) = args.live.address()? else {
        return Ok(());
    };
    let range_ns = play::range_ns(recording)?;
    let (live, control) = recording::playback(address, &rebuilt.config, range_ns)?;
    if let Some(datum) = datum(&recording.header) {
        live.place(&datum);
    }
    play::play(recording, range_ns[0], (live, &control))
}

/// Returns the number of steps missing between recorded ones.
fn lost(recording: &Recording) -> u64 {
    let cycles = &recording.cycles;
    let (Some(first), Some(last)) = (cycles.first(), cycles.last()) else {
        return 0;
    };
    (last.index - first.index + 1).saturating_sub(cycles.len() as u64)
}

fn table(outcome: &ReplayOutcome<'_>) -> String {
    let comparison = outcome.comparison;
    let mut out = format!(
        "recording {}\ncontroller {}{}\n",
        outcome.recording.display(),
        outcome.controller,
        match (outcome.closed_loop, outcome.changed) {
            (true, _) => ", driving a simulated vehicle",
            (false, true) => ", changed",
            (false, false) => "",
        }
    );
    let mut add = |name: &str, value: String| out.push_str(&format!("{name:24} {value}\n"));
    if outcome.versions[0] != outcome.versions[1] {
        add("recorded by", outcome.versions[0].clone());
        add("replayed by", outcome.versions[1].clone());
    }
    if let Some(reason) = outcome.damaged {
        add("read up to", reason.to_owned());
    }
    if let Some(begin) = &outcome.begins {
        let on = begin.from_m.map_or_else(String::new, |from_m| {
            format!(", {from_m:.2} m along a path given before")
        });
        add(
            "begins where armed",
            format!(
                "cycle {} at {:.3} s{on}: earlier files were deleted",
                begin.cycle, begin.time_s
            ),
        );
    }
    if outcome.lost > 0 {
        add("steps lost", outcome.lost.to_string());
    }
    add("cycles", comparison.cycles.to_string());
    add("different", comparison.different.to_string());
    if let Some(first) = &comparison.first {
        add(
            "first difference",
            format!(
                "cycle {} at {:.3} s: {}",
                first.cycle, first.time_s, first.what
            ),
        );
    }
    let m_s = |value: f64| format!("{value:.6} m/s");
    add("largest difference", m_s(comparison.largest_difference_m_s));
    add("  traction, RMS", m_s(comparison.traction_rms_m_s));
    add("  steer, RMS", m_s(comparison.steer_rms_m_s));
    let [recorded, replayed] = outcome.cross_track_rms_m.map(|rms_m| 100.0 * rms_m);
    add(
        "cross-track RMS",
        format!("{recorded:.3} cm recorded, {replayed:.3} cm replayed"),
    );
    out
}

/// Name of the recording of a test case, and of the file with its arguments.
const CASE: [&str; 2] = ["drive.mcap", "arguments"];

/// Writes a test case: the recording, and a file whose lines are the arguments that follow its name.
fn write_case(args: &ReplayArgs, folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder)
        .with_context(|| format!("{}: cannot create the folder", folder.display()))?;
    let bytes = std::fs::read(&args.recording)?;
    ensure!(
        !sidehill_recording::McapRecording::part_name(&args.recording, 1).exists(),
        "--write-case takes a recording of one file"
    );
    output::write(&folder.join(CASE[0]), &bytes, args.force)?;
    let mut lines: Vec<String> = Vec::new();
    for setting in &args.settings {
        lines.extend(["--set".to_owned(), setting.clone()]);
    }
    if let Some(kind) = args.controller {
        lines.extend(["--controller".to_owned(), kind.name().to_owned()]);
    }
    if args.closed_loop {
        lines.push("--closed-loop".to_owned());
    }
    lines.extend([
        "--tolerance".to_owned(),
        args.tolerance.unwrap_or(1e-6).to_string(),
    ]);
    let text = lines.join("\n") + "\n";
    output::write(&folder.join(CASE[1]), text.as_bytes(), args.force)
}
