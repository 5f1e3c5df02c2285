//! Which terms beyond ICRHK logs of real vehicles support, see `../data/drive/README.md` and
//! `../data/norlab/README.md`.

use sidehill_plant::extension::Extension;
use sidehill_plant::identification::{
    ExtensionReport, IdentificationSettings, SegmentErrors, Segmentation, Term, Verdict,
    identify_extension, identify_level, segments,
};
use sidehill_plant::log::{ColumnMap, DriveLog};
use sidehill_plant::odometry::KinematicModel;
use sidehill_plant::vehicle::Vehicle;

fn settings() -> IdentificationSettings {
    IdentificationSettings {
        segmentation: Segmentation::of_length(1.5).unwrap(),
        attitude_smoothing_s: 0.2,
    }
}

fn log(csv: &str) -> DriveLog {
    let map: ColumnMap = serde_yaml::from_str(include_str!("../data/drive/columns.yaml")).unwrap();
    DriveLog::read(csv.as_bytes(), &map).unwrap()
}

fn husky() -> (DriveLog, Vehicle) {
    (
        log(include_str!("../data/drive/husky_2023/turning.csv")),
        serde_yaml::from_str(include_str!("../data/drive/husky_2023/vehicle.yaml")).unwrap(),
    )
}

fn warthog() -> (DriveLog, Vehicle) {
    (
        log(include_str!("../data/drive/warthog_2023/turning.csv")),
        serde_yaml::from_str(include_str!("../data/drive/warthog_2023/vehicle.yaml")).unwrap(),
    )
}

fn asphalt() -> (DriveLog, Vehicle) {
    (
        log(include_str!(
            "../data/drive/warthog_asphalt_2024_level/turning.csv"
        )),
        serde_yaml::from_str(include_str!(
            "../data/drive/warthog_asphalt_2024_level/vehicle.yaml"
        ))
        .unwrap(),
    )
}

fn marmotte() -> (DriveLog, Vehicle) {
    let map: ColumnMap = serde_yaml::from_str(include_str!("../data/norlab/columns.yaml")).unwrap();
    let csv = include_str!("../data/norlab/marmotte_snow.csv");
    (
        DriveLog::read(csv.as_bytes(), &map).unwrap(),
        serde_yaml::from_str(include_str!("../data/norlab/vehicle.yaml")).unwrap(),
    )
}

fn identify((log, vehicle): &(DriveLog, Vehicle)) -> (Option<Extension>, ExtensionReport) {
    let logs = std::slice::from_ref(log);
    identify_extension(logs, logs, vehicle, &settings()).unwrap()
}

fn position(errors: SegmentErrors) -> f64 {
    errors.lateral_m.hypot(errors.longitudinal_m)
}

fn supported(report: &ExtensionReport) -> Vec<Term> {
    let in_model = |verdict| matches!(verdict, Verdict::Supported { .. });
    let terms = report.terms.iter().filter(|t| in_model(t.verdict));
    terms.map(|t| t.term).collect()
}

#[test]
fn a_real_vehicle_slides_downhill_in_turns_slips_outward_and_loses_speed() {
    let (extension, report) = identify(&husky());
    let terms = supported(&report);
    for term in [Term::Slide, Term::OutwardSlip, Term::TurnLoss] {
        assert!(terms.contains(&term), "{report:?}");
    }
    assert!(position(report.icrik.unwrap()) < 0.95 * position(report.icrhk));
    assert!(position(report.extended) < 0.85 * position(report.icrhk));
    // With the loss in turns in a term of its own, the factors are those of wheels that roll.
    let correction = extension.unwrap().encoder_scale;
    assert!((0.95..1.2).contains(&correction.left) && (0.95..1.2).contains(&correction.right));
}

#[test]
fn at_speed_slip_outward_is_the_largest_term() {
    let (extension, report) = identify(&warthog());
    let first = report.terms.first().unwrap();
    assert_eq!(first.term, Term::OutwardSlip);
    assert!(first.improvement > 0.3, "{report:?}");
    assert!(position(report.extended) < 0.67 * position(report.icrhk));
    let kappa_s = extension.unwrap().gains.outward_slip_s;
    assert!((0.2..0.5).contains(&kappa_s), "{kappa_s}");
}

#[test]
fn level_asphalt_supports_no_term_of_the_slope() {
    let (_, report) = identify(&asphalt());
    assert!(
        !supported(&report).into_iter().any(Term::needs_slope),
        "{report:?}"
    );
}

/// Returns the windows of a log in its two halves.
fn halves(log: &DriveLog) -> [DriveLog; 2] {
    let rows = log.rows();
    // Between windows, where time jumps.
    let middle = (rows.len() / 2..)
        .find(|i| rows[*i].time_s - rows[i - 1].time_s > 5.0)
        .unwrap();
    [&rows[..middle], &rows[middle..]].map(|rows| DriveLog::new(rows.to_vec()).unwrap())
}

/// Returns position errors at the ends of the segments of each half, dead-reckoned by what the other half says:
/// of ICRHK and of the extended model.
fn errors_of_other_halves((log, vehicle): &(DriveLog, Vehicle)) -> Vec<(f64, f64)> {
    let halves = halves(log);
    let mut errors = Vec::new();
    for (fitted_on, judged_on) in [(0, 1), (1, 0)] {
        let logs = std::slice::from_ref(&halves[fitted_on]);
        let (level, _) = identify_level(logs, vehicle, &settings()).unwrap();
        let (extension, _) = identify_extension(logs, logs, &level, &settings()).unwrap();
        let fitted = Vehicle { extension, ..level };
        for piece in segments(&halves[judged_on], &settings().segmentation) {
            let error = |model| position(SegmentErrors::of(&[piece], &fitted, model));
            errors.push((
                error(KinematicModel::Icrhk),
                error(KinematicModel::Extended),
            ));
        }
    }
    errors
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    values.sum::<f64>() / count
}

#[test]
fn what_one_half_of_a_log_says_predicts_the_other_better_than_icrhk() {
    let errors = errors_of_other_halves(&warthog());
    let share = mean(errors.iter().map(|e| e.1)) / mean(errors.iter().map(|e| e.0));
    let squares = mean(errors.iter().map(|e| e.1 * e.1)) / mean(errors.iter().map(|e| e.0 * e.0));
    println!("mean {share}, RMS {}", squares.sqrt());
    assert!(share < 0.55, "{share}");
    // Half of the squares is that of one window, in which the poses move into the turn.
    assert!(squares.sqrt() < 0.62, "{squares}");
}

#[test]
fn one_half_of_a_log_of_the_husky_predicts_the_other() {
    let errors = errors_of_other_halves(&husky());
    let squares = mean(errors.iter().map(|e| e.1 * e.1)) / mean(errors.iter().map(|e| e.0 * e.0));
    println!("RMS {}", squares.sqrt());
    assert!(squares.sqrt() < 0.85, "{squares}");
}

#[test]
fn one_half_of_a_log_of_tracks_on_snow_predicts_the_other() {
    let (log, vehicle) = marmotte();
    let errors = errors_of_other_halves(&(log.clone(), vehicle.clone()));
    let ideal: Vec<_> = segments(&log, &settings().segmentation)
        .into_iter()
        .map(|s| {
            position(SegmentErrors::of(
                &[s],
                &vehicle,
                KinematicModel::DifferentialDrive,
            ))
        })
        .collect();
    let icrhk = mean(errors.iter().map(|e| e.0));
    let extended = mean(errors.iter().map(|e| e.1));
    let share = icrhk / mean(ideal.iter().copied());
    println!(
        "ICRHK {share} of differential drive, extended {} of ICRHK",
        extended / icrhk
    );
    assert!(share < 0.65, "{share}");
    assert!(extended < 0.96 * icrhk, "{extended} {icrhk}");
}
