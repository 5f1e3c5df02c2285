//! The report of a campaign: the distribution of the errors over all runs.

use super::summary::Figures;
use super::table::CampaignRow;
use crate::report::figures::significant;
use crate::report::page::{COLOURS, ReportPage, legend_of, section, table};
use crate::report::plot::{Line, Plot};
use maud::html;
use std::collections::BTreeMap;

/// Returns the page for the rows that the figures cover.
pub(super) fn html(campaign: &str, figures: &[Figures], rows: &[&CampaignRow]) -> String {
    let names: Vec<(&str, &str)> = figures
        .iter()
        .zip(COLOURS.iter().cycle())
        .map(|(figures, colour)| (figures.controller.as_str(), *colour))
        .collect();
    let errors: Vec<BTreeMap<u32, f64>> = names
        .iter()
        .map(|(name, _)| completed(name, rows))
        .collect();
    let lines = names.iter().zip(figures).zip(&errors);
    let lines = lines.map(|(((name, colour), figures), errors)| {
        let errors = errors.values().map(|error_m| 100.0 * error_m);
        // Runs that did not complete are worse than all others: the line ends before 100 %.
        Line::ascending(name, colour, None, errors, Some(figures.runs))
    });
    let plot = Plot {
        x_title: "share of the runs (%)".to_owned(),
        logarithmic: true,
        ..Plot::over_time("cross-track RMS (cm)", 360.0, lines.collect())
    };
    let cm = |value: Option<f64>| value.map_or("-".to_owned(), |m| significant(100.0 * m));
    let plain = |value: Option<f64>| value.map_or("-".to_owned(), significant);
    let cells: Vec<Vec<String>> = figures
        .iter()
        .map(|figures| {
            vec![
                figures.controller.clone(),
                figures.runs.to_string(),
                figures.completed.to_string(),
                cm(figures.median_m),
                cm(figures.p95_m),
                cm(figures.worst_m),
                figures
                    .worst_index
                    .map_or("-".to_owned(), |index| index.to_string()),
                plain(figures.mean_speed_m_s),
                plain(figures.tread_speed_max_m_s),
                plain(figures.time_s),
            ]
        })
        .collect();
    let page = ReportPage {
        title: &format!("Campaign {campaign}"),
        subtitle: "Cross-track RMS of many random runs; a run that was not completed counts as worse than every completed one",
        conclusions: &conclusions(figures, &names, &errors),
        summary: table(
            "figures",
            &[
                "controller",
                "runs",
                "completed",
                "median (cm)",
                "p95 (cm)",
                "worst (cm)",
                "worst run",
                "mean speed (m/s)",
                "tread max (m/s)",
                "time (s)",
            ],
            &cells,
        ),
        legend: html! {},
        body: section(
            "All runs",
            "Each controller's runs in the order of their errors: a line further to the right and below is better.",
            &legend_of(&names),
            "runs",
            &[plot],
        ),
        map: None,
    };
    page.html()
}

fn completed(controller: &str, rows: &[&CampaignRow]) -> BTreeMap<u32, f64> {
    rows.iter()
        .filter(|row| row.controller == controller && row.completed)
        .filter_map(|row| Some((row.index, row.cross_track_rms_m?)))
        .collect()
}

/// Returns the conclusions: which controller is best, in how many runs, and by how much.
fn conclusions(
    figures: &[Figures],
    names: &[(&str, &str)],
    errors: &[BTreeMap<u32, f64>],
) -> Vec<String> {
    let mut ranked: Vec<usize> = (0..figures.len())
        .filter(|i| figures[*i].median_m.is_some())
        .collect();
    ranked.sort_by(|a, b| {
        let median = |index: &usize| figures[*index].median_m.unwrap_or(f64::INFINITY);
        median(a).total_cmp(&median(b))
    });
    let Some(&best) = ranked.first() else {
        return vec!["No controller completed half of its runs.".to_owned()];
    };
    let of = &figures[best];
    let mut sentences = vec![format!(
        "{} has the smallest median, {} cm, and completed {} of {} runs.",
        of.controller,
        significant(100.0 * of.median_m.unwrap_or(f64::NAN)),
        of.completed,
        of.runs
    )];
    if let Some(&second) = ranked.get(1) {
        let both = errors[best]
            .iter()
            .filter_map(|(index, error)| Some((*error, *errors[second].get(index)?)));
        let (wins, all) = both.fold((0, 0), |(wins, all), (own, other)| {
            (wins + usize::from(own < other), all + 1)
        });
        sentences.push(format!(
            "Of {all} runs that both completed it was the better one in {wins} against {}.",
            names[second].0
        ));
    }
    let most = figures
        .iter()
        .map(|figures| figures.completed)
        .max()
        .unwrap_or(0);
    if of.completed < most {
        sentences.push("Another controller completed more runs.".to_owned());
    }
    if of.runs < 100 {
        sentences.push(format!(
            "{} runs are few: the tail (p95, worst) needs hundreds.",
            of.runs
        ));
    }
    sentences
}
