use super::*;
use crate::contact::{ContactModel, ContactVehicle};
use crate::extension::{Extension, ExtensionGains};
use crate::log::DriveLog;
use crate::terrain::Terrain;
use crate::vehicle::IcrMotion;
use crate::vehicle::Vehicle;

/// What somebody knows beforehand who has measured the vehicle's base only.
fn before() -> Vehicle {
    let mut vehicle = Vehicle::j8();
    vehicle.encoder_scale.left = 1.0;
    vehicle.encoder_scale.right = 1.0;
    vehicle.icrs.left_m = -0.7;
    vehicle.icrs.right_m = 0.7;
    vehicle.icrs.forward_m = 0.0;
    vehicle.slide.shift_s_per_rad = 0.5;
    vehicle.slide.aggravated_s_per_rad = 0.5;
    vehicle
}

fn settings(length_s: f64) -> IdentificationSettings {
    IdentificationSettings {
        segmentation: Segmentation::of_length(length_s).unwrap(),
        attitude_smoothing_s: 0.2,
    }
}

fn level_log(seed: u64, noise: &LogNoise) -> DriveLog {
    driven(
        Terrain::Level,
        &Procedure::of_the_paper().level,
        noise,
        seed,
    )
}

fn slope_log(seed: u64, noise: &LogNoise) -> DriveLog {
    let procedure = Procedure::of_the_paper();
    let terrain = procedure.slope_terrain().unwrap();
    driven(terrain, &procedure.slope, noise, 1000 + seed)
}

fn driven(terrain: Terrain, legs: &[Leg], noise: &LogNoise, seed: u64) -> DriveLog {
    let by_icrik = ProcedureDrive {
        motion: Box::new(IcrMotion {
            vehicle: Vehicle::j8(),
            inclined: true,
        }),
        encoder_scale: Vehicle::j8().encoder_scale,
        terrain,
        legs,
    };
    drive(by_icrik, noise, seed).unwrap()
}

const TRUTH: [f64; 7] = [1.004, 1.011, -0.980, 1.073, 0.206, 1.222, 4.965];
const LENGTH_S: f64 = 8.0;

fn identify(level: &DriveLog, slope: &DriveLog) -> (Vehicle, Vec<FittedParameter>) {
    let settings = settings(LENGTH_S);
    let level = std::slice::from_ref(level);
    let (vehicle, first) = identify_level(level, &before(), &settings).unwrap();
    let slope = std::slice::from_ref(slope);
    let (vehicle, second) = identify_slope(slope, &vehicle, &settings).unwrap();
    assert_eq!(first.warnings, []);
    assert_eq!(second.warnings, []);
    assert!(
        first.cross_validation.fitted.lateral_m < 0.2 * first.cross_validation.baseline.lateral_m
    );
    (vehicle, [first.estimates, second.estimates].concat())
}

#[test]
fn table_one_comes_back_from_noisy_logs_of_twenty_seeds() {
    let noise = LogNoise::usual();
    let tolerances = [0.01, 0.01, 0.02, 0.02, 0.02, 0.1, 0.1];
    let mut inside = 0;
    for seed in 0..20 {
        let (_, estimates) = identify(&level_log(seed, &noise), &slope_log(seed, &noise));
        for ((estimate, truth), tolerance) in estimates.iter().zip(TRUTH).zip(tolerances) {
            let error = estimate.value - truth;
            assert!(
                error.abs() <= tolerance * truth.abs(),
                "seed {seed}: {estimate:?}"
            );
            inside += u32::from(error.abs() <= estimate.half_width.unwrap());
        }
    }
    // 95 % of 140 intervals hold the truth, give or take three standard deviations.
    assert!((125..=140).contains(&inside), "{inside}");
}

#[test]
fn poses_that_jump_are_outliers() {
    let noise = LogNoise::usual();
    let spoil = |log: &DriveLog| {
        let mut rows = log.rows().to_vec();
        for (index, row) in rows.iter_mut().enumerate() {
            if let Some(pose) = row.pose.as_mut().filter(|_| index % 34 == 0) {
                pose.x_m += 1.5;
                pose.yaw_rad -= 0.5;
            }
        }
        DriveLog::new(rows).unwrap()
    };
    let level = spoil(&level_log(1, &noise));
    let (_, report) =
        identify_level(std::slice::from_ref(&level), &before(), &settings(LENGTH_S)).unwrap();
    assert!((0.05..0.08).contains(&report.outlier_share), "{report:?}");
    for (estimate, truth) in report.estimates.iter().zip(TRUTH) {
        let error = (estimate.value / truth - 1.0).abs();
        assert!(error < 0.02, "{estimate:?}");
    }
}

#[test]
fn turning_on_the_spot_alone_cannot_tell_speeds_from_icrs() {
    let turning = Procedure::of_the_paper().slope;
    let on_level = ProcedureDrive {
        motion: Box::new(IcrMotion {
            vehicle: Vehicle::j8(),
            inclined: true,
        }),
        encoder_scale: Vehicle::j8().encoder_scale,
        terrain: Terrain::Level,
        legs: &turning,
    };
    let log = drive(on_level, &LogNoise::usual(), 0).unwrap();
    let (_, report) = identify_level(&[log], &before(), &settings(4.0)).unwrap();
    let named = report.warnings.iter().any(|warning| match warning {
        Warning::NotToldApart { names, .. } => names.contains(&"correction_left"),
        _ => false,
    });
    assert!(named, "{report:?}");
}

#[test]
fn standing_still_and_gaps_are_left_out() {
    let noise = LogNoise::usual();
    let rows = level_log(0, &noise).rows().to_vec();
    let (end, dt_s) = (rows[rows.len() - 1], 0.05);
    let mut longer = rows.clone();
    // A minute of standing, then the same drive again after a gap, from another place.
    for i in 1..1200 {
        longer.push(crate::log::LogRow {
            time_s: end.time_s + dt_s * f64::from(i),
            speeds: Default::default(),
            ..end
        });
    }
    longer.extend(rows.iter().map(|row| crate::log::LogRow {
        time_s: row.time_s + end.time_s + 1000.0,
        ..*row
    }));
    let cut = Segmentation::of_length(LENGTH_S).unwrap();
    let (short, long) = (DriveLog::new(rows).unwrap(), DriveLog::new(longer).unwrap());
    let (once, twice) = (segments(&short, &cut).len(), segments(&long, &cut).len());
    // The segment in which the first drive ends is completed by standing.
    assert!((2 * once..=2 * once + 1).contains(&twice), "{once} {twice}");
    let standing =
        DriveLog::new(long.rows()[short.rows().len()..short.rows().len() + 1190].to_vec());
    let error = identify_level(&[standing.unwrap()], &before(), &settings(LENGTH_S)).unwrap_err();
    assert!(
        matches!(error, IdentificationError::TooFewSegments { found: 0, .. }),
        "{error}"
    );
}

#[test]
fn the_contact_vehicle_is_identified_near_table_one_on_the_level() {
    let contact: ContactVehicle =
        serde_yaml::from_str(include_str!("../../../config/vehicles/j8_contact.yaml")).unwrap();
    let procedure = Procedure::of_the_paper();
    let log = |terrain, legs| {
        let setup = ProcedureDrive {
            motion: Box::new(ContactModel::new(contact.clone())),
            encoder_scale: Vehicle::j8().encoder_scale,
            terrain,
            legs,
        };
        drive(setup, &LogNoise::usual(), 0).unwrap()
    };
    let (vehicle, estimates) = identify(
        &log(Terrain::Level, &procedure.level),
        &log(procedure.slope_terrain().unwrap(), &procedure.slope),
    );
    for (estimate, truth) in estimates.iter().zip(TRUTH).take(5) {
        let error = (estimate.value / truth - 1.0).abs();
        assert!(error < 0.05, "{estimate:?}");
    }
    assert!((1.0..2.0).contains(&vehicle.slide.shift_s_per_rad));
}

/// Level, slope and across logs of the procedure with a contact vehicle.
pub(super) fn contact_logs(contact: &ContactVehicle, seed: u64) -> [DriveLog; 3] {
    contact_logs_of(&Procedure::of_the_paper(), contact, seed)
}

/// Returns the logs of a contact vehicle that is driven as `procedure` says.
pub(super) fn contact_logs_of(
    procedure: &Procedure,
    contact: &ContactVehicle,
    seed: u64,
) -> [DriveLog; 3] {
    let slope = || procedure.slope_terrain().unwrap();
    [
        (Terrain::Level, &procedure.level, seed),
        (slope(), &procedure.slope, seed + 1),
        (slope(), &procedure.across, seed + 2),
    ]
    .map(|(terrain, legs, seed)| {
        let setup = ProcedureDrive {
            motion: Box::new(ContactModel::new(contact.clone())),
            encoder_scale: Vehicle::j8().encoder_scale,
            terrain,
            legs,
        };
        drive(setup, &LogNoise::usual(), seed).unwrap()
    })
}

#[test]
fn logs_of_icrik_support_nothing_beyond_it() {
    let noise = LogNoise::usual();
    let procedure = Procedure::of_the_paper();
    for seed in 0..2 {
        let slope = [
            slope_log(seed, &noise),
            driven(
                procedure.slope_terrain().unwrap(),
                &procedure.across,
                &noise,
                seed,
            ),
        ];
        let level = [level_log(seed, &noise)];
        let (extension, report) =
            identify_extension(&level, &slope, &Vehicle::j8(), &settings(LENGTH_S)).unwrap();
        assert_eq!(extension, None, "{report:?}");
    }
}

#[test]
fn straight_lines_on_a_slope_tell_the_creep_of_friction_from_the_slide() {
    let contact: ContactVehicle =
        serde_yaml::from_str(include_str!("../../../config/vehicles/j8_contact.yaml")).unwrap();
    let [level, slope, across] = contact_logs(&contact, 1);
    let (extension, report) = identify_extension(
        &[level],
        &[slope, across],
        &Vehicle::j8(),
        &settings(LENGTH_S),
    )
    .unwrap();
    let extension = extension.unwrap();
    // Slip scale over coefficient of friction: 0.02 / 0.9 = 0.022 m/s/rad, and a little more where the
    // vehicle gathers speed.
    let creep = extension.gains.creep_m_s_per_rad;
    assert!((0.015..0.04).contains(&creep), "{report:?}");
    assert!((1.0..1.6).contains(&extension.slide.shift_s_per_rad));
}

#[test]
fn a_term_that_no_vehicle_file_may_have_is_named_and_left_out() {
    let noise = LogNoise::usual();
    let procedure = Procedure::of_the_paper();
    let j8 = Vehicle::j8();
    let truth = Vehicle {
        extension: Some(Extension {
            gains: ExtensionGains {
                // At most 5 in a file.
                creep_per_rad: 8.0,
                ..ExtensionGains::default()
            },
            icrs: j8.icrs,
            slide: j8.slide,
            encoder_scale: j8.encoder_scale,
        }),
        ..j8.clone()
    };
    let log = |terrain: Terrain, legs: &[Leg], seed| {
        let setup = ProcedureDrive {
            motion: Box::new(IcrMotion {
                vehicle: truth.clone(),
                inclined: true,
            }),
            encoder_scale: j8.encoder_scale,
            terrain,
            legs,
        };
        drive(setup, &noise, seed).unwrap()
    };
    let slope = || procedure.slope_terrain().unwrap();
    let level = [log(Terrain::Level, &procedure.level, 1)];
    let slope = [
        log(slope(), &procedure.slope, 2),
        log(slope(), &procedure.across, 3),
    ];
    let (extension, report) = identify_extension(&level, &slope, &j8, &settings(LENGTH_S)).unwrap();
    let creep = report
        .terms
        .iter()
        .find(|term| term.term == Term::CreepShare);
    let Some(Verdict::OutOfRange { reason }) = creep.map(|creep| creep.verdict) else {
        panic!("{report:?}");
    };
    assert_eq!(reason.key, "extension.creep_per_rad");
    assert!((reason.value - 8.0).abs() < 0.5, "{reason}");
    let fitted = Vehicle { extension, ..j8 };
    fitted.validated().unwrap();
}
