//! Identification on other groups' logs, see `../data/README.md`.

use sidehill_plant::identification::{
    IdentificationSettings, SegmentErrors, Segmentation, identify_level, identify_slope, segments,
};
use sidehill_plant::log::{ColumnMap, DriveLog};
use sidehill_plant::odometry::{KinematicModel, MeanSquaredErrors, compare};
use sidehill_plant::vehicle::Vehicle;

const LENGTH_S: f64 = 2.0;

fn settings(attitude_smoothing_s: f64) -> IdentificationSettings {
    IdentificationSettings {
        segmentation: Segmentation::of_length(LENGTH_S).unwrap(),
        attitude_smoothing_s,
    }
}

fn vehicle(yaml: &str) -> Vehicle {
    serde_yaml::from_str(yaml).unwrap()
}

fn log(csv: &str, columns: &str) -> DriveLog {
    let map: ColumnMap = serde_yaml::from_str(columns).unwrap();
    DriveLog::read(csv.as_bytes(), &map).unwrap()
}

#[test]
fn a_real_vehicle_on_grass_is_predicted_where_it_was_not_fitted() {
    let log = log(
        include_str!("../data/warthog_grass/train.csv"),
        include_str!("../data/warthog_grass/columns.yaml"),
    );
    // Three quarters of the log stand still, and poses come at a fifth of the rows' rate.
    assert_eq!((log.rows().len(), log.pose_count()), (4801, 894));
    let before = vehicle(include_str!("../data/warthog_grass/vehicle.yaml"));
    let (fitted, report) = identify_level(&[log], &before, &settings(0.2)).unwrap();
    let (held_out, ideal) = (
        report.cross_validation.fitted,
        report.cross_validation.baseline,
    );
    assert_eq!(held_out.segments, report.segments);
    assert!(
        held_out.lateral_m <= 0.6 * ideal.lateral_m,
        "{held_out:?} {ideal:?}"
    );
    assert!(held_out.yaw_rad <= 0.6 * ideal.yaw_rad);
    // The tread ICRs lie outside the wheels.
    assert!(fitted.icrs.left_m < -0.6 && fitted.icrs.right_m > 0.6);
}

mod trento {
    use super::*;

    const COLUMNS: &str = include_str!("../data/trento_ramps/columns.yaml");

    fn level_vehicle() -> Vehicle {
        let logs = [
            log(
                include_str!("../data/trento_ramps/flat_left_-10.17.csv"),
                COLUMNS,
            ),
            log(
                include_str!("../data/trento_ramps/flat_left_-5.48.csv"),
                COLUMNS,
            ),
            log(
                include_str!("../data/trento_ramps/flat_left_5.48.csv"),
                COLUMNS,
            ),
            log(
                include_str!("../data/trento_ramps/flat_left_10.17.csv"),
                COLUMNS,
            ),
        ];
        let before = vehicle(include_str!("../data/trento_ramps/vehicle.yaml"));
        identify_level(&logs, &before, &settings(0.0)).unwrap().0
    }

    fn gentle_ramp() -> [DriveLog; 2] {
        [
            log(
                include_str!("../data/trento_ramps/ramp_0.150_left_-18.0.csv"),
                COLUMNS,
            ),
            log(
                include_str!("../data/trento_ramps/ramp_0.150_left_18.0.csv"),
                COLUMNS,
            ),
        ]
    }

    fn steep_ramp() -> [DriveLog; 2] {
        [
            log(
                include_str!("../data/trento_ramps/ramp_0.300_left_-18.0.csv"),
                COLUMNS,
            ),
            log(
                include_str!("../data/trento_ramps/ramp_0.300_left_18.0.csv"),
                COLUMNS,
            ),
        ]
    }

    /// Position error after a segment (root mean square, m) and J/N of whole logs, over both logs.
    fn errors(logs: &[DriveLog; 2], vehicle: &Vehicle, model: KinematicModel) -> (f64, f64) {
        let both = logs.each_ref().map(|log| {
            let pieces = segments(log, &settings(0.0).segmentation);
            let ends = SegmentErrors::of(&pieces, vehicle, model);
            let whole = MeanSquaredErrors::of(&compare(log, vehicle, model).unwrap());
            (ends.lateral_m.hypot(ends.longitudinal_m), whole.fitness())
        });
        (both[0].0.hypot(both[1].0), both[0].1 + both[1].1)
    }

    fn judge(fitted_on: &[DriveLog; 2], tested_on: &[DriveLog; 2]) {
        let level = level_vehicle();
        let (vehicle, report) = identify_slope(fitted_on, &level, &settings(0.0)).unwrap();
        let (icrhk_ends, icrhk) = errors(tested_on, &vehicle, KinematicModel::Icrhk);
        let (icrik_ends, icrik) = errors(tested_on, &vehicle, KinematicModel::Icrik);
        assert!(icrik_ends <= 0.8 * icrhk_ends, "{icrik_ends} {icrhk_ends}");
        assert!(icrik <= 0.8 * icrhk, "{icrik} {icrhk} {report:?}");
        // Fits of both ramps agree on the slide although a simulator, not the model, made the logs.
        let slide = vehicle.slide.shift_s_per_rad;
        assert!((0.2..0.26).contains(&slide), "{slide}");
    }

    #[test]
    fn the_slide_on_a_gentle_ramp_predicts_a_steep_one() {
        judge(&gentle_ramp(), &steep_ramp());
    }

    #[test]
    fn the_slide_on_a_steep_ramp_predicts_a_gentle_one() {
        judge(&steep_ramp(), &gentle_ramp());
    }
}
