//! Builds the page of `sidehill play`: one file with the simulation in it, which needs no network.
//!
//! ```text
//! sidehill-play-site SIMULATION.wasm FOLDER
//! ```
//!
//! It writes FOLDER/index.html. The page is made of the components of the live view, and of its own.

use anyhow::{Context, Result, bail};
use base64::Engine;
use flate2::Compression;
use flate2::write::GzEncoder;
use std::io::Write;
use std::path::PathBuf;
use wasm_bindgen_cli_support::Bindgen;

/// A part of the pages that show drives.
macro_rules! common {
    ($name:literal) => {
        include_str!(concat!("../../../recording/src/live/page/", $name))
    };
}

const JS: &str = include_str!("../../page/play.js");

fn main() -> Result<()> {
    let mut args = std::env::args_os().skip(1).map(PathBuf::from);
    let (Some(simulation), Some(folder), None) = (args.next(), args.next(), args.next()) else {
        bail!("usage: sidehill-play-site SIMULATION.wasm FOLDER");
    };
    let mut bindgen = Bindgen::new();
    bindgen
        .input_path(&simulation)
        .no_modules(true)?
        .typescript(false)
        .remove_name_section(true)
        .remove_producers_section(true);
    let mut output = bindgen
        .generate_output()
        .with_context(|| format!("{}", simulation.display()))?;
    let glue = output.js().to_owned();
    let mut packed = GzEncoder::new(Vec::new(), Compression::best());
    packed.write_all(&output.wasm_mut().emit_wasm())?;
    let packed = base64::engine::general_purpose::STANDARD.encode(packed.finish()?);
    let scripts = [
        common!("uplot/uPlot.iife.min.js"),
        &glue,
        &[common!("plot.js"), common!("view.js"), JS].concat(),
    ];
    // No part may end its element.
    if scripts.iter().any(|script| script.contains("</script")) {
        bail!("a script contains the end of a script");
    }
    let scripts: Vec<String> = scripts
        .iter()
        .map(|script| format!("<script>\n{script}</script>\n"))
        .collect();
    let page = [
        common!("head.html"),
        "<style>\n",
        common!("uplot/uPlot.min.css"),
        common!("page.css"),
        include_str!("../../page/play.css"),
        "</style>\n",
        common!("top.html"),
        common!("map.html"),
        include_str!("../../page/main.html"),
        common!("words.html"),
        include_str!("../../page/foot.html"),
        "<script id=\"simulation\" type=\"application/gzip;base64\">",
        &packed,
        "</script>\n",
        &scripts.concat(),
    ]
    .concat();
    std::fs::create_dir_all(&folder).with_context(|| format!("{}", folder.display()))?;
    let path = folder.join("index.html");
    std::fs::write(&path, &page).with_context(|| format!("{}", path.display()))
}
