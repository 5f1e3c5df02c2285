//! Figures of each controller over a campaign.

use super::table::CampaignRow;
use crate::config::Campaign;
use serde::Serialize;
use sidehill_plant::statistics::quantile;
use std::fmt::Write;
use std::ops::Range;

/// Figures of one controller over all runs. A run that did not complete counts as worse than every completed
/// one, whatever its error was until then: a controller must not look good by giving up.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Figures {
    /// Controller's name.
    pub controller: String,
    /// Runs.
    pub runs: usize,
    /// Runs completed.
    pub completed: usize,
    /// Median of the cross-track RMS, m; none where half the runs were not completed.
    pub median_m: Option<f64>,
    /// 95 % quantile of the cross-track RMS, m; none where 5 % of the runs were not completed.
    pub p95_m: Option<f64>,
    /// Largest cross-track RMS of a completed run, m.
    pub worst_m: Option<f64>,
    /// That run's index.
    pub worst_index: Option<u32>,
    /// Median of the steer's total variation over completed runs, m/s.
    pub steer_total_variation_m_s: Option<f64>,
    /// Median of the mean speed over completed runs, m/s.
    pub mean_speed_m_s: Option<f64>,
    /// Median of the time over completed runs, s.
    pub time_s: Option<f64>,
    /// Largest speed of a tread in a completed run, m/s.
    pub tread_speed_max_m_s: Option<f64>,
    /// Indices of runs that were not completed, ascending.
    pub not_completed: Vec<u32>,
}

/// Returns the figures of the campaign's controllers over those of `rows` that belong to `runs`.
pub fn of(rows: &[CampaignRow], campaign: &Campaign, runs: &Range<u32>) -> Vec<Figures> {
    let names = campaign.controllers.iter().map(|kind| kind.name());
    names
        .map(|name| {
            let own = rows
                .iter()
                .filter(|row| row.controller == name && runs.contains(&row.index));
            figures(name, &own.collect::<Vec<_>>())
        })
        .collect()
}

fn figures(controller: &str, rows: &[&CampaignRow]) -> Figures {
    let done = || rows.iter().filter(|row| row.completed);
    let mut errors: Vec<(f64, u32)> = done()
        .filter_map(|row| Some((row.cross_track_rms_m?, row.index)))
        .collect();
    errors.sort_by(|a, b| a.0.total_cmp(&b.0));
    let of_done = |figure: fn(&CampaignRow) -> Option<f64>, share| {
        let mut values: Vec<f64> = done().filter_map(|row| figure(row)).collect();
        values.sort_by(f64::total_cmp);
        quantile(&values, share)
    };
    let mut not_completed: Vec<u32> = rows
        .iter()
        .filter(|row| !row.completed)
        .map(|row| row.index)
        .collect();
    not_completed.sort_unstable();
    // Over all runs: one that did not complete is worse than any that did.
    let mut ascending: Vec<f64> = errors.iter().map(|(error, _)| *error).collect();
    ascending.resize(rows.len(), f64::INFINITY);
    let of_all = |share| quantile(&ascending, share).filter(|error| error.is_finite());
    Figures {
        controller: controller.to_owned(),
        runs: rows.len(),
        completed: done().count(),
        median_m: of_all(0.5),
        p95_m: of_all(0.95),
        worst_m: errors.last().map(|(error, _)| *error),
        worst_index: errors.last().map(|(_, index)| *index),
        steer_total_variation_m_s: of_done(|row| row.steer_total_variation_m_s, 0.5),
        mean_speed_m_s: of_done(|row| row.mean_speed_m_s, 0.5),
        time_s: of_done(|row| row.time_s, 0.5),
        tread_speed_max_m_s: of_done(|row| row.tread_speed_max_m_s, 1.0),
        not_completed,
    }
}

/// Returns the figures as a text table.
pub fn table(figures: &[Figures], campaign: &Campaign, runs: &Range<u32>) -> String {
    let mut out = String::new();
    let first = match runs.start {
        0 => String::new(),
        start => format!(" from run {start} on"),
    };
    let _ = writeln!(
        out,
        "campaign {}: cross-track RMS of {} runs{first}, cm",
        campaign.name,
        runs.len()
    );
    let _ = writeln!(
        out,
        "\n{:14} {:>6} {:>11} {:>8} {:>8} {:>8} {:>9} {:>9} {:>9} {:>9} {:>9}",
        "controller",
        "runs",
        "completed",
        "median",
        "p95",
        "worst",
        "in run",
        "steer TV",
        "mean m/s",
        "tread max",
        "time s"
    );
    let cm = |value: Option<f64>| value.map_or("-".to_owned(), |m| format!("{:.2}", 100.0 * m));
    let plain = |value: Option<f64>, decimals| {
        value.map_or("-".to_owned(), |value| format!("{value:.decimals$}"))
    };
    for f in figures {
        let _ = writeln!(
            out,
            "{:14} {:>6} {:>9.1} % {:>8} {:>8} {:>8} {:>9} {:>9} {:>9} {:>9} {:>9}",
            f.controller,
            f.runs,
            100.0 * f.completed as f64 / f.runs.max(1) as f64,
            cm(f.median_m),
            cm(f.p95_m),
            cm(f.worst_m),
            f.worst_index
                .map_or("-".to_owned(), |index| index.to_string()),
            plain(f.steer_total_variation_m_s, 1),
            plain(f.mean_speed_m_s, 2),
            plain(f.tread_speed_max_m_s, 2),
            plain(f.time_s, 1),
        );
    }
    for f in figures.iter().filter(|f| !f.not_completed.is_empty()) {
        /// As many as fit on a line or two.
        const SHOWN: usize = 20;
        let shown: Vec<String> = f
            .not_completed
            .iter()
            .take(SHOWN)
            .map(u32::to_string)
            .collect();
        let more = f.not_completed.len().saturating_sub(SHOWN);
        let _ = writeln!(
            out,
            "{} did not complete runs {}{}",
            f.controller,
            shown.join(", "),
            if more > 0 {
                format!(" and {more} more")
            } else {
                String::new()
            }
        );
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::table::CampaignTable;
    use super::*;
    use crate::config::ConfigFile;
    use std::path::Path;

    fn campaign(seed: u64) -> Campaign {
        let text = format!(
            "{{name: small, seed: {seed}, runs: 20, controllers: [icrik-mpc, pure-pursuit], \
             scenario: ../scenarios/slalom.yaml, draws: [{{key: start.right_m, uniform: [0, 1]}}]}}"
        );
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/campaigns/small.yaml");
        Campaign::read(&ConfigFile::with_text(&path, text)).unwrap()
    }

    const HEADER: &str = "campaign,index,seed,controller,start.right_m,completed,ended_by,\
        cross_track_rms_m,cross_track_p95_m,cross_track_max_m,along_track_rms_m,heading_rms_rad,\
        steer_total_variation_m_s,goal_error_m,constraint_violations,fallbacks,\
        mean_speed_m_s,time_s,tread_speed_max_m_s,cross_track_bound_held,\
        cross_track_ahead_bound_held\n";

    /// Twenty runs of icrik-mpc with errors of 1 to 20 cm, the 7th given up early; one of pure pursuit
    /// that never started.
    fn csv(campaign: &Campaign) -> String {
        let f = campaign.fingerprint().unwrap();
        let mut text = HEADER.replace("        ", "");
        for i in (0..20).rev() {
            let (cm, completed) = (i + 1, i != 6);
            let reason = if completed { "" } else { "\"lost, here\"" };
            text += &format!(
                "{f},{i},9,icrik-mpc,0.5,{completed},{reason},0.{cm:02},1,1,1,1,{cm},0,0,0,0.{cm:02},{cm},1.{cm:02},0.95,0.95\n"
            );
        }
        text + &format!("{f},0,9,pure-pursuit,0.5,false,bad,,,,,,,,,,,,,,\n")
    }

    fn rows(campaign: &Campaign) -> Vec<CampaignRow> {
        let table = CampaignTable::of(campaign).unwrap();
        table.rows(csv(campaign).as_bytes()).unwrap()
    }

    #[test]
    fn quantiles_count_a_run_not_completed_as_the_worst() {
        let campaign = campaign(1);
        let rows = rows(&campaign);
        let [own, other] = &of(&rows, &campaign, &(0..20))[..] else {
            panic!("two controllers")
        };
        // Completed: 1 to 6 and 8 to 20 cm; the 10th of 20 is 11 cm, the 19th 20 cm.
        assert_eq!((own.runs, own.completed), (20, 19));
        assert_eq!(own.median_m, Some(0.11));
        assert_eq!(own.p95_m, Some(0.20));
        assert_eq!((own.worst_m, own.worst_index), (Some(0.20), Some(19)));
        assert_eq!(own.steer_total_variation_m_s, Some(11.0));
        // The 10th of 19 completed ones, and the largest of all.
        assert_eq!((own.mean_speed_m_s, own.time_s), (Some(0.11), Some(11.0)));
        assert_eq!(own.tread_speed_max_m_s, Some(1.20));
        assert_eq!(own.not_completed, [6]);
        assert_eq!((other.runs, other.completed), (1, 0));
        assert_eq!((other.median_m, other.worst_index), (None, None));
        let table = table(&[own.clone(), other.clone()], &campaign, &(0..20));
        assert!(
            table.contains("95.0 %") && table.contains("runs 6"),
            "{table}"
        );
    }

    #[test]
    fn rows_beyond_the_runs_asked_for_do_not_count() {
        let campaign = campaign(1);
        let rows = rows(&campaign);
        let own = &of(&rows, &campaign, &(0..5))[0];
        assert_eq!((own.runs, own.median_m), (5, Some(0.03)));
        let own = &of(&rows, &campaign, &(5..10))[0];
        assert_eq!((own.runs, own.worst_index), (5, Some(9)));
    }

    #[test]
    fn results_of_another_fingerprint_are_refused() {
        let other = CampaignTable::of(&campaign(2)).unwrap();
        let error = other.rows(csv(&campaign(1)).as_bytes()).unwrap_err();
        assert!(error.to_string().contains("fingerprint"), "{error}");
    }
}
