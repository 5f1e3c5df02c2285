/// Feedback that is implausible at present.
#[derive(Debug, Clone, Copy)]
pub(super) struct Discrepancy {
    pub(super) since_s: f64,
    pub(super) last_s: f64,
    /// How far the vehicle has come since then beyond what was commanded, m.
    pub(super) way_m: f64,
    /// Instant of the first such report, s.
    pub(super) first_report_s: f64,
}

impl Discrepancy {
    /// Returns a discrepancy that begins now, with a report of an instant.
    pub(super) fn new(now_s: f64, report_s: f64) -> Self {
        Self {
            since_s: now_s,
            last_s: now_s,
            way_m: 0.0,
            first_report_s: report_s,
        }
    }

    /// Goes on with a difference beyond the commands, m/s, and returns for how long there has been one, s.
    pub(super) fn grow(&mut self, now_s: f64, difference_m_s: f64) -> f64 {
        let elapsed_s = now_s - self.last_s;
        self.last_s = now_s;
        if elapsed_s > 0.0 {
            self.way_m += elapsed_s * difference_m_s;
        }
        now_s - self.since_s
    }

    /// Returns whether the vehicle has come this far, by more than a single report.
    pub(super) fn has_come(&self, way_m: f64, report_s: f64) -> bool {
        self.way_m >= way_m && report_s > self.first_report_s
    }
}
