//! The CSV of a run.

use super::*;

/// The CSV of a run, read back.
struct Table {
    headers: csv::StringRecord,
    records: Vec<csv::StringRecord>,
}

impl Table {
    fn of(run: &Run) -> Self {
        let mut bytes = Vec::new();
        write_csv(run, &mut bytes).unwrap();
        let mut reader = csv::Reader::from_reader(bytes.as_slice());
        Self {
            headers: reader.headers().unwrap().clone(),
            records: reader.records().map(Result::unwrap).collect(),
        }
    }

    fn text(&self, row: usize, name: &str) -> &str {
        let mut headers = self.headers.iter();
        &self.records[row][headers.position(|header| header == name).unwrap()]
    }

    fn number(&self, row: usize, name: &str) -> f64 {
        self.text(row, name).parse().unwrap()
    }
}

#[test]
fn a_csv_reads_back_bit_for_bit() {
    let mut run = run("icrik-mpc", rows(100));
    run.rows[3].cross_track_m = f64::NAN;
    run.rows[4].status = Status::Stopping(StopReason::OffPath { cross_track_m: 2.5 });
    let table = Table::of(&run);
    assert_eq!(table.records.len(), run.rows.len());
    for (i, row) in run.rows.iter().enumerate() {
        let number = |name: &str| table.number(i, name).to_bits();
        assert_eq!(number("time_s"), row.time_s.to_bits());
        assert_eq!(number("y_m"), row.pose.y_m.to_bits());
        assert_eq!(number("pitch_rad"), row.attitude.pitch_rad.to_bits());
        assert_eq!(table.text(i, "estimate_yaw_rad"), "");
        assert_eq!(number("reference_x_m"), row.reference.x_m.to_bits());
        assert_eq!(number("cross_track_m"), row.cross_track_m.to_bits());
        assert_eq!(number("command_steer_m_s"), row.command.steer_m_s.to_bits());
        assert_eq!(number("icr_right_m"), row.icrs.right_m.to_bits());
        assert_eq!(number("solve_us"), row.solve_us.to_bits());
    }
    assert_eq!(table.text(3, "status"), "tracking");
    assert_eq!(table.text(4, "status"), "stopping");
    assert!(table.text(4, "reason").contains("2.50 m off the path"));
}

#[test]
fn learned_parameters_are_in_csv_and_report_with_their_intervals() {
    let mut run = run("contact-mpc", rows(20));
    let learned = |friction: f64| ContactEstimate {
        parameters: ParameterVector::repeat(friction.ln()),
        sigma: ParameterVector::repeat(0.1),
        prior_sigma: ParameterVector::from_fn(|i, _| if i == 0 { 1.0 } else { 0.1 }),
    };
    for row in &mut run.rows[5..] {
        row.contact = Some(learned(0.8));
    }
    let table = Table::of(&run);
    assert_eq!(table.text(4, "learned_friction"), "");
    let number = |name: &str| table.number(9, name);
    assert!((number("learned_friction") - 0.8).abs() < 1e-12);
    assert!((number("learned_friction_low") - 0.8 * (-0.196_f64).exp()).abs() < 1e-12);
    assert!((number("learned_friction_high") - 0.8 * 0.196_f64.exp()).abs() < 1e-12);
    let unobserved = table.text(9, "learned_unobserved");
    assert!(!unobserved.contains("friction"), "{unobserved}");
    assert!(unobserved.contains("slip_scale_m_s"), "{unobserved}");
    let page = page(&plane(), &[run]);
    assert!(page.contains("slip_scale_m_s") && page.contains(">configuration<"));
}

#[test]
fn a_csv_without_rows_has_its_header() {
    let mut bytes = Vec::new();
    write_csv(&run("icrik-mpc", Vec::new()), &mut bytes).unwrap();
    let text = String::from_utf8(bytes).unwrap();
    assert!(text.starts_with("time_s,x_m,") && text.lines().count() == 1);
}
