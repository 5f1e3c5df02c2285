//! The page of a drive: one file, made of the components of the live view.

use super::facts::DriveFacts;
use super::input::Input;
use anyhow::Result;
use sidehill_recording::live::components::{
    CSS, DRIVE, DRIVE_JS, FOOT, HEAD, MAP, PLOT_JS, TOP, UPLOT_JS, VIEW_JS, WORDS,
};

/// Returns the page.
///
/// # Errors
/// Figures that have no JSON.
pub(super) fn html(input: &Input, facts: &DriveFacts) -> Result<String> {
    // No text of the recording may end the element it stands in.
    let data = |json: String| json.replace('<', "\\u003c");
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
        "</script>\n<script>\n",
        UPLOT_JS,
        "</script>\n<script>\n",
        PLOT_JS,
        VIEW_JS,
        DRIVE_JS,
        include_str!("page/report.js"),
        "</script>\n",
    ];
    Ok(parts.concat())
}
