//! What the live page shows, of a whole drive: for a page that needs no server.

use super::outgoing::TopicMessage;
use super::page::{Kept, Page};
use crate::messages::Topic;
use sidehill_bridge::ros2::message::Path;
use sidehill_bridge::ros2::message::cdr::from_cdr;

/// Parts of the live page, of which the pages of reports are made as well.
pub mod components {
    /// Head of the document, without its style.
    pub const HEAD: &str = include_str!("page/head.html");
    /// Style.
    pub const CSS: &str = concat!(
        include_str!("page/uplot/uPlot.min.css"),
        include_str!("page/page.css")
    );
    /// Begin of the body: state and reason in large type.
    pub const TOP: &str = include_str!("page/top.html");
    /// Section: the map.
    pub const MAP: &str = include_str!("page/map.html");
    /// Sections: figures over time, drives, what was learned, events.
    pub const DRIVE: &str = include_str!("page/drive.html");
    /// Section: what the words mean.
    pub const WORDS: &str = include_str!("page/words.html");
    /// End of the body: the time shown.
    pub const FOOT: &str = include_str!("page/foot.html");
    /// Script: uPlot, which draws the plots.
    pub const UPLOT_JS: &str = include_str!("page/uplot/uPlot.iife.min.js");
    /// Script: numbers, colours, plots.
    pub const PLOT_JS: &str = include_str!("page/plot.js");
    /// Script: plots over time, and the map.
    pub const VIEW_JS: &str = include_str!("page/view.js");
    /// Script: what plots and sections of a drive show.
    pub const DRIVE_JS: &str = include_str!("page/drive.js");

    /// Returns the address of a picture that the page itself holds.
    pub fn data_uri(media_type: &str, bytes: &[u8]) -> String {
        let bytes = data_encoding::BASE64.encode(bytes);
        format!("data:{media_type};base64,{bytes}")
    }
}

/// Frames of a drive, at most: two megabytes.
const FRAMES: u64 = 9000;
/// Shortest time between two frames, ns: that of the live page.
const FRAME_NS: u64 = 200_000_000;
/// Views of the obstacles of a drive, at most, besides those at changes of state.
const OBSTACLES: u64 = 200;
/// Events of a drive, at most: the newest.
const EVENTS: usize = 2000;

/// A drive as the live page shows it, from its first message to its last.
pub struct WholeDrive(pub(super) Page);

impl WholeDrive {
    /// Returns a drive that lasts so long, ns, and has no message yet.
    pub fn new(duration_ns: u64) -> Self {
        Self(Page::keeping(Kept {
            frame_ns: FRAME_NS.max(duration_ns.div_ceil(FRAMES)),
            // The last interval is begun, not whole.
            frames: FRAMES as usize + 2,
            events: EVENTS,
            obstacles_ns: duration_ns / OBSTACLES,
            obstacles: OBSTACLES as usize + EVENTS,
        }))
    }

    /// Takes a message; messages come in the order of their times.
    pub fn take(&mut self, topic: Topic, time_ns: u64, message: &[u8]) {
        // At the end of a goal there is no path any more: the map keeps that which was driven.
        let no_path = |path: Path| path.poses.is_empty();
        if topic == Topic::Path && from_cdr(message).is_ok_and(no_path) {
            return;
        }
        self.0.take(&TopicMessage {
            topic,
            time_ns,
            message: message.into(),
        });
    }

    /// Returns the drive as JSON: `columns` names the entries of each of `frames`, `states` the values of the column
    /// `state`; `events` have time, level, name and text; `obstacles` have the time from which on they were known, the side
    /// of a cell, and x, y, x, y of the ends of each row of cells; `parts` are path, vehicle, diagnostics and status at the
    /// end.
    pub fn json(&self) -> String {
        self.0.json()
    }
}
