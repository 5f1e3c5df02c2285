//! The guide: its commands are run as they stand there, in their order, in one folder.

use crate::guide_blocks::{Block, blocks_of, text_of};
use crate::{sidehill, succeed};

/// Returns the blocks of all pages in the order in which the guide's first page links them.
fn blocks() -> Vec<Block> {
    let first = text_of("README.md");
    let links = first
        .split("](")
        .skip(1)
        .filter_map(|rest| rest.split(')').next());
    let pages = links.filter(|link| link.ends_with(".md") && !link.contains('/'));
    pages.flat_map(blocks_of).collect()
}

#[test]
fn every_command_of_the_guide_runs() {
    let scratch = tempfile::tempdir().unwrap();
    let mut count = 0;
    for block in blocks().iter().filter(|block| block.needs.is_empty()) {
        block.succeed(scratch.path());
        count += 1;
    }
    assert!(count >= 15, "only {count} blocks were found");
}

#[test]
fn what_the_guide_does_not_run_here_says_why_and_is_accepted() {
    let blocks = blocks();
    let elsewhere: Vec<_> = blocks.iter().filter(|b| !b.needs.is_empty()).collect();
    assert!(elsewhere.len() >= 4);
    for block in elsewhere {
        let (page, needs) = (&block.page, &block.needs);
        let says = match needs.as_str() {
            "can" => "`.ci/vcan`",
            "ros2" | "goal" | "record" | "look" | "level" | "identify" | "drive" | "after" => {
                "`.ci/ros2`"
            }
            "robot" => "Needs the robot; no test runs it",
            other => panic!("{page}: what is `sh {other}`?"),
        };
        assert!(block.before.contains(says), "{page}: {}", block.before);
        for line in block.script.lines() {
            let line = line.trim_end_matches('&');
            let Some(arguments) = line.strip_prefix("sidehill ") else {
                continue;
            };
            let words = arguments.split_whitespace();
            let own: Vec<&str> = words.take_while(|word| *word != "--ros-args").collect();
            succeed(sidehill().args(own).arg("--help"));
        }
    }
}
