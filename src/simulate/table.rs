//! The figures of all runs as a table.

use super::files::named;
use crate::config::Prepared;
use crate::record::Summary;
use std::fmt::Write;

/// Returns the figures as a text table.
pub(super) fn table(
    prepared: &Prepared,
    conditions: Option<&str>,
    summaries: &[&Summary],
) -> String {
    let mut out = String::new();
    let _ = writeln!(
        out,
        "scenario {}, plant {}, vehicle {}, seed {}{}",
        prepared.name,
        prepared.plant.kind().name(),
        prepared.vehicle.name,
        prepared.seed,
        named(conditions)
    );
    if !prepared.route_note.is_empty() {
        let _ = writeln!(out, "{}", prepared.route_note);
    }
    let _ = writeln!(
        out,
        "\n{:14} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9} {:>6} {:>9} {:>9}",
        "controller",
        "cross RMS",
        "cross p95",
        "cross max",
        "along RMS",
        "steer TV",
        "goal err",
        "mean",
        "tread max",
        "time",
        "iters",
        "cycle p50",
        "cycle p99"
    );
    let _ = writeln!(
        out,
        "{:14} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9} {:>6} {:>9} {:>9}",
        "", "cm", "cm", "cm", "cm", "m/s", "cm", "m/s", "m/s", "s", "", "us", "us"
    );
    for s in summaries {
        let _ = writeln!(
            out,
            "{:14} {:>9.3} {:>9.3} {:>9.3} {:>9.3} {:>9.2} {:>9.2} {:>9.3} {:>9.3} {:>9.1} {:>6.1} {:>9.0} {:>9.0}",
            s.controller,
            100.0 * s.cross_track_rms_m,
            100.0 * s.cross_track_p95_m,
            100.0 * s.cross_track_max_m,
            100.0 * s.along_track_rms_m,
            s.steer_total_variation_m_s,
            100.0 * s.goal_error_m,
            s.mean_speed_m_s,
            s.tread_speed_max_m_s,
            s.time_s,
            s.qp_iterations_mean,
            s.cycle_us.p50,
            s.cycle_us.p99
        );
    }
    for s in summaries {
        if let Some(reason) = &s.ended_by {
            let _ = writeln!(out, "{} did not complete: {reason}", s.controller);
        }
        if s.fallbacks + s.deadline_misses + s.constraint_violations > 0 {
            let _ = writeln!(
                out,
                "{}: {} fallbacks, {} deadline misses, {} constraint violations",
                s.controller, s.fallbacks, s.deadline_misses, s.constraint_violations
            );
        }
    }
    out
}
