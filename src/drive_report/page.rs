//! The page of a drive: one file, made of the components of the live view.

use super::facts::DriveFacts;
use super::input::DecodedRecording;
use super::tiles::TileMap;
use anyhow::Result;
use sidehill_recording::live::components::{
    CSS, DRIVE, DRIVE_JS, FOOT, HEAD, MAP, PLOT_JS, TOP, UPLOT_JS, VIEW_JS, WORDS,
};

/// Returns the page, with a map below the drive where there is one.
///
/// # Errors
/// Figures that have no JSON.
pub(super) fn html(
    input: &DecodedRecording,
    facts: &DriveFacts,
    map: Option<&TileMap>,
) -> Result<String> {
    // No text of the recording may end the element it stands in.
    let data = |json: String| json.replace('<', "\\u003c");
    let tiles = serde_json::to_string(&map)?;
    let draw_tiles = map.map_or("", |_| include_str!("page/tiles.js"));
    let parts = [
        HEAD,
        "<style>\n",
        CSS,
        include_str!("page/report.css"),
        "</style>\n",
        TOP,
        include_str!("page/main.html"),
        MAP,
        DRIVE,
        include_str!("page/weather.html"),
        WORDS,
        FOOT,
        "<script id=\"facts\" type=\"application/json\">",
        &data(serde_json::to_string(facts)?),
        "</script>\n<script id=\"drive\" type=\"application/json\">",
        &data(input.drive.json()),
        "</script>\n<script id=\"tiles\" type=\"application/json\">",
        &data(tiles),
        "</script>\n<script>\n",
        UPLOT_JS,
        "</script>\n<script>\n",
        PLOT_JS,
        VIEW_JS,
        DRIVE_JS,
        include_str!("page/report.js"),
        draw_tiles,
        "</script>\n",
    ];
    Ok(parts.concat())
}
