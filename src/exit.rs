//! The exit statuses of both programs, by cause; docs/cli.md says which command has which.

use sidehill_bridge::control_loop::RunEnding;
use std::process::ExitCode;
use strum::VariantArray;

/// How a program ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, VariantArray)]
pub enum Exit {
    /// It did what was asked.
    Done = 0,
    /// It did its work, and the answer is no: a run was not completed, a file is invalid, a limit is exceeded.
    Not = 1,
    /// It could not work: wrong arguments, a file or a device that is missing or wrong. It is also that of clap.
    Failed = 2,
    /// A signal ended a drive before the end of its course.
    Signal = 3,
    /// The process was suspended and resumed during a drive.
    Suspended = 4,
    /// SIGINT, SIGTERM or SIGHUP ended other work, by the convention of shells.
    Interrupted = 130,
}

impl Exit {
    /// Returns the exit where an answer is yes, or no.
    pub fn answer(yes: bool) -> Self {
        match yes {
            true => Self::Done,
            false => Self::Not,
        }
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}

impl From<RunEnding> for Exit {
    fn from(ending: RunEnding) -> Self {
        match ending {
            RunEnding::Finished | RunEnding::TimeOver | RunEnding::ShutDown => Self::Done,
            RunEnding::TimeOverStopped => Self::Not,
            RunEnding::Interrupted => Self::Signal,
            RunEnding::Suspended => Self::Suspended,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_manual_lists_all_statuses() {
        let manual = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/cli.md");
        let text = std::fs::read_to_string(manual).unwrap();
        let (_, section) = text.split_once("## Exit statuses\n").unwrap();
        let (section, _) = section.split_once("\n## ").unwrap();
        let first = |line: &str| {
            line.trim_start_matches("| ")
                .split(' ')
                .next()?
                .parse()
                .ok()
        };
        let listed: Vec<u8> = section.lines().filter_map(first).collect();
        let all: Vec<u8> = Exit::VARIANTS.iter().map(|exit| *exit as u8).collect();
        assert_eq!(listed, all);
    }

    #[test]
    fn only_a_run_that_did_what_it_was_asked_for_exits_with_0() {
        for (ending, name, code) in [
            (RunEnding::Finished, "finished", 0),
            (RunEnding::TimeOver, "time_over", 0),
            (RunEnding::TimeOverStopped, "stopped", 1),
            (RunEnding::Interrupted, "signal", 3),
            (RunEnding::ShutDown, "signal", 0),
            (RunEnding::Suspended, "suspended", 4),
        ] {
            let printed = serde_json::to_value(ending).unwrap();
            assert_eq!(
                (printed.as_str(), Exit::from(ending) as u8),
                (Some(name), code)
            );
        }
    }
}
