use super::*;
use crate::config::CanConfig;
use crate::database::Database;

fn keys() -> [DriveKeys; 2] {
    let yaml = include_str!("../../../../config/bridge/cia402.yaml");
    let dbc = include_str!("../../../../config/bridge/cia402.dbc");
    let config: CanConfig = serde_yaml::from_str(yaml).unwrap();
    DriveKeys::of(&Layout::new(&config, &Database::parse("dbc", dbc).unwrap()).unwrap())
}

/// A motor that really needs `command` and `feedback` units for 1 m/s, with a lag of 0.1 s.
struct Motor {
    command: f64,
    feedback: f64,
    counts_per_m: f64,
}

const RIGHT: Motor = Motor {
    command: 940.0,
    feedback: 940.0,
    // 4096 in a turn of the motor: 940 turns a minute at 1 m/s.
    counts_per_m: 4096.0 * 940.0 / 60.0,
};

/// Turns the motor for 4 s under a layout with these keys; returns the trial and the true way of the tread, m.
fn turned(motor: &Motor, keys: &DriveKeys) -> (MotorTrial, f64) {
    let (mut speed_m_s, mut way_m) = (0.0, 0.0);
    let mut samples = Vec::new();
    for cycle in 0..100 {
        let time_s = 0.05 * f64::from(cycle);
        let command_m_s = match time_s {
            ..4.0 => (0.05 * time_s).min(0.05),
            _ => 0.0,
        };
        samples.push(TrialSample {
            time_s,
            command_m_s,
            speed_m_s: speed_m_s * motor.feedback / keys.feedback_per_unit,
            other_m_s: 0.0,
        });
        let asked = command_m_s * keys.command_per_unit / motor.command;
        speed_m_s += 0.4 * (asked - speed_m_s);
        way_m += 0.05 * speed_m_s;
    }
    let trial = MotorTrial {
        samples,
        seen: match way_m {
            0.0.. => Seen::Forward,
            _ => Seen::Backward,
        },
        measured_m: None,
        encoder: Some(EncoderCount {
            counts: way_m * motor.counts_per_m,
            per_turn: Some(4096.0),
        }),
    };
    (trial, way_m)
}

fn verdict(motor: &Motor) -> CommissioningVerdict {
    let keys = keys();
    let trials = [turned(motor, &keys[0]).0, turned(&RIGHT, &keys[1]).0];
    judge(&keys, &trials)
}

fn to(verdict: &CommissioningVerdict, key: &str) -> Option<f64> {
    let mut found = verdict.corrections.iter();
    let found = found.find(|correction| correction.key.ends_with(key));
    found.map(|correction| correction.to)
}

const COMMAND: &str = "drives[0].command.target_velocity.per_unit";
const FEEDBACK: &str = "drives[0].feedback.actual_velocity.per_unit";

#[test]
fn a_layout_that_is_right_stays_as_it_is() {
    let verdict = verdict(&RIGHT);
    assert!(verdict.is_right(), "{:?}", verdict.motors);
    assert!(verdict.corrections.is_empty());
    let motor = &verdict.motors[0];
    assert!((motor.gain.unwrap() - 1.0).abs() < 0.05, "{motor:?}");
    assert!((motor.counts_per_m.unwrap() / RIGHT.counts_per_m - 1.0).abs() < 0.02);
}

#[test]
fn wrong_signs_are_told_by_what_was_seen_and_what_is_reported() {
    for (command, feedback, words, corrected) in [
        (
            -940.0,
            -940.0,
            "the traction motor turns backwards: set cia402.drives[0].command.target_velocity.per_unit to -940 and \
             cia402.drives[0].feedback.actual_velocity.per_unit to -940",
            (Some(-940.0), Some(-940.0)),
        ),
        (
            -940.0,
            940.0,
            "the traction motor turns backwards, as it reports: set cia402.drives[0].command.target_velocity.per_unit to -940",
            (Some(-940.0), None),
        ),
        (
            940.0,
            -940.0,
            "the traction motor turns forward, but reports backward: set \
             cia402.drives[0].feedback.actual_velocity.per_unit to -940",
            (None, Some(-940.0)),
        ),
    ] {
        let verdict = verdict(&Motor {
            command,
            feedback,
            ..RIGHT
        });
        assert_eq!(verdict.motors[0].complaints, [words]);
        assert!(verdict.motors[1].complaints.is_empty());
        assert_eq!((to(&verdict, COMMAND), to(&verdict, FEEDBACK)), corrected);
        // With the corrected keys the next trial finds nothing.
        let mut keys = keys();
        keys[0].command_per_unit = corrected.0.unwrap_or(940.0);
        keys[0].feedback_per_unit = corrected.1.unwrap_or(940.0);
        let motor = Motor {
            command,
            feedback,
            ..RIGHT
        };
        let trials = [turned(&motor, &keys[0]).0, turned(&RIGHT, &keys[1]).0];
        assert!(judge(&keys, &trials).is_right());
    }
}

#[test]
fn a_unit_is_told_against_the_other_motor_or_by_a_measured_way() {
    let mut keys = keys();
    keys[0].feedback_per_unit = 9.4;
    let right = turned(&RIGHT, &keys[1]).0;
    let verdict = judge(&keys, &[turned(&RIGHT, &keys[0]).0, right.clone()]);
    assert_eq!(
        (to(&verdict, COMMAND), to(&verdict, FEEDBACK)),
        (None, Some(940.0))
    );
    let said = &verdict.motors[0].complaints[0];
    assert!(said.contains("a unit and a hundredth of it?"), "{said}");
    assert!(
        said.contains("only its report is scaled unlike the other's"),
        "{said}"
    );

    keys[0].feedback_per_unit = 940.0;
    keys[0].command_per_unit = 9400.0;
    let verdict = judge(&keys, &[turned(&RIGHT, &keys[0]).0, right.clone()]);
    assert_eq!(
        (to(&verdict, COMMAND), to(&verdict, FEEDBACK)),
        (Some(940.0), None)
    );

    // Both keys are another than the other's: only a measured way tells which is wrong.
    keys[0].feedback_per_unit = 500.0;
    keys[0].command_per_unit = 250.0;
    let motor = Motor {
        command: 250.0,
        feedback: 250.0,
        counts_per_m: 4096.0 * 250.0 / 60.0,
    };
    keys[0].rotation_rad_s = Some(26.18);
    let (mut trial, way_m) = turned(&motor, &keys[0]);
    let verdict = judge(&keys, &[trial.clone(), right.clone()]);
    assert!(verdict.corrections.is_empty());
    assert!(verdict.motors[0].complaints[0].contains("measure the way"));
    trial.measured_m = Some(way_m * 1.02);
    let verdict = judge(&keys, &[trial, right]);
    assert_eq!(to(&verdict, COMMAND), None);
    let feedback = to(&verdict, FEEDBACK).unwrap();
    assert!((feedback / 250.0 - 1.0).abs() < 0.05, "{feedback}");
}

#[test]
fn a_trial_that_was_cut_short_corrects_a_scale_to_the_others_or_not_at_all() {
    let mut keys = keys();
    let right = turned(&RIGHT, &keys[1]).0;
    for (feedback_per_unit, feedback, corrected) in [(9.4, 940.0, Some(940.0)), (9.4, 2000.0, None)]
    {
        keys[0].feedback_per_unit = feedback_per_unit;
        let motor = Motor { feedback, ..RIGHT };
        let mut trial = turned(&motor, &keys[0]).0;
        // The safety has ended it after 0.3 s; the reports are late by so much that the ratio is rough.
        trial.samples.truncate(10);
        for (i, sample) in trial.samples.iter_mut().enumerate() {
            sample.speed_m_s *= 1.2;
            if i > 6 {
                sample.command_m_s = 0.0;
            }
        }
        let verdict = judge(&keys, &[trial, right.clone()]);
        assert_eq!(to(&verdict, FEEDBACK), corrected, "{:?}", verdict.motors[0]);
        let said = verdict.motors[0].complaints.join("; ");
        assert_eq!(
            said.contains("stopped too soon"),
            corrected.is_none(),
            "{said}"
        );
    }
}

#[test]
fn encoders_are_compared_with_their_resolution_and_with_each_other() {
    let keys = keys();
    let motor = Motor {
        counts_per_m: 4.0 * RIGHT.counts_per_m,
        ..RIGHT
    };
    let said = verdict(&motor).motors[0].complaints.join("; ");
    assert!(
        said.contains("object 0x608F says 4096 (encoder lines and their four edges?)"),
        "{said}"
    );
    // Where the drives do not tell their resolutions.
    let mut trials = [turned(&motor, &keys[0]).0, turned(&RIGHT, &keys[1]).0];
    for trial in &mut trials {
        trial.encoder = trial.encoder.map(|encoder| EncoderCount {
            per_turn: None,
            ..encoder
        });
    }
    let said = judge(&keys, &trials).motors[0].complaints.join("; ");
    assert!(
        said.contains("counts 4.000 times what the other counts"),
        "{said}"
    );
}

#[test]
fn a_drive_that_was_told_another_resolution_is_known_by_the_other_and_the_way() {
    // It makes a quarter of each speed and reports that it makes all of it.
    let keys = keys();
    let (mut trial, way_m) = turned(&RIGHT, &keys[0]);
    trial.encoder = Some(EncoderCount {
        counts: 0.25 * way_m * RIGHT.counts_per_m,
        per_turn: Some(1024.0),
    });
    let right = turned(&RIGHT, &keys[1]).0;
    let verdict = judge(&keys, &[trial.clone(), right.clone()]);
    let [said] = &verdict.motors[0].complaints[..] else {
        panic!("{:?}", verdict.motors[0]);
    };
    assert!(
        said.contains("has 1024 counts in a turn by object 0x608F, the other 4096 (encoder lines"),
        "{said}"
    );
    trial.measured_m = Some(0.25 * way_m);
    let verdict = judge(&keys, &[trial.clone(), right.clone()]);
    assert!(verdict.corrections.is_empty());
    let [said] = &verdict.motors[0].complaints[..] else {
        panic!("{:?}", verdict.motors[0]);
    };
    assert!(said.contains("set its object 0x608F:01 to 4096"), "{said}");
    // Encoders that differ in truth.
    trial.measured_m = Some(way_m);
    let motors = judge(&keys, &[trial, right]).motors;
    assert!(motors[0].complaints.is_empty(), "{:?}", motors[0]);
}

#[test]
fn what_did_not_move_or_moved_otherwise_is_told() {
    let keys = keys();
    let right = turned(&RIGHT, &keys[1]).0;
    let complaint = |change: &dyn Fn(&mut MotorTrial)| {
        let mut trial = turned(&RIGHT, &keys[0]).0;
        trial.encoder = None;
        change(&mut trial);
        let verdict = judge(&keys, &[trial, right.clone()]);
        assert!(verdict.corrections.is_empty());
        verdict.motors[0].complaints.join("; ")
    };
    let stands = |trial: &mut MotorTrial| {
        for (i, sample) in trial.samples.iter_mut().enumerate() {
            // A count of noise.
            sample.speed_m_s = 1e-4 * f64::from(i as u32 % 2);
        }
    };
    let said = complaint(&|trial| {
        stands(trial);
        trial.seen = Seen::Nothing;
    });
    assert!(said.contains("does not turn: check its brake"), "{said}");
    let said = complaint(&|trial| stands(trial));
    assert!(
        said.contains("turns, but its report shows no speed"),
        "{said}"
    );
    let said = complaint(&|trial| {
        stands(trial);
        trial.samples[50].other_m_s = 0.05;
    });
    assert!(
        said.contains("the report of the other drive shows it"),
        "{said}"
    );
    let said = complaint(&|trial| trial.samples[50].other_m_s = 0.05);
    assert!(said.contains("is not the only one"), "{said}");
    let said = complaint(&|trial| trial.seen = Seen::Nothing);
    assert!(said.contains("nobody saw it move"), "{said}");
    let said = complaint(&|trial| trial.seen = Seen::Otherwise);
    assert!(
        said.contains("moves as the steer motor should, but not"),
        "{said}"
    );
    let said = complaint(&|trial| trial.samples.truncate(1));
    assert!(said.contains("hold the key for 3 s or longer"), "{said}");
    let mut both = [turned(&RIGHT, &keys[0]).0, right.clone()];
    both.iter_mut()
        .for_each(|trial| trial.seen = Seen::Otherwise);
    let verdict = judge(&keys, &both);
    let exchanged = |motor: &MotorVerdict| motor.complaints[0].contains("exchange their nodes");
    assert!(verdict.motors.iter().all(exchanged));
}

#[test]
fn the_keys_of_a_layout_are_those_of_its_file() {
    let [traction, steer] = keys();
    assert_eq!(traction.command, format!("cia402.{COMMAND}"));
    assert_eq!(
        steer.signal,
        "cia402.drives[1].feedback.actual_velocity.signal"
    );
    assert_eq!(
        (traction.command_per_unit, steer.feedback_per_unit),
        (940.0, 940.0)
    );
    let yaml = include_str!("../../../../config/bridge/can.yaml");
    let dbc = include_str!("../../../../config/bridge/j8.dbc");
    let config: CanConfig = serde_yaml::from_str(yaml).unwrap();
    let layout = Layout::new(&config, &Database::parse("dbc", dbc).unwrap()).unwrap();
    let [traction, steer] = DriveKeys::of(&layout);
    assert_eq!(traction.command, "command[0].traction.per_unit");
    assert_eq!(steer.feedback, "feedback.steer.speed.per_unit");
}
