//! Every file of `config/`, damaged in many ways: refused with the name of a file, or usable.
use crate::configured::configuration;
use proptest::prelude::*;
use sidehill::check::check;
use sidehill::config::{
    ConfigFile, LiveOdometryConfig, Overrides, RunConfig, Scenario, VehicleConfig, load_layout,
};
use sidehill::drive_log::TopicMap;
use sidehill_plant::contact::ContactVehicle;
use sidehill_plant::vehicle::Vehicle;
use std::cell::RefCell;
use std::path::{Path, PathBuf};

/// The files of `config/` in YAML.
fn files() -> Vec<PathBuf> {
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("config");
    let mut files: Vec<PathBuf> = ["bridge", "scenarios", "vehicles"]
        .iter()
        .flat_map(|folder| std::fs::read_dir(config.join(folder)).unwrap())
        .map(|entry| entry.unwrap().path())
        .filter(|path| {
            path.extension()
                .is_some_and(|extension| extension == "yaml")
        })
        .collect();
    files.sort();
    files
}

/// An edit of a text: place, length, kind and parameters.
type Edit = (prop::sample::Index, usize, u8, String, prop::sample::Index);

/// Replacements for numbers.
const NUMBERS: [&str; 14] = [
    "0",
    "-1",
    "1",
    ".nan",
    ".inf",
    "-.inf",
    "1e300",
    "-1e300",
    "1e-300",
    "4294967296",
    "-9223372036854775808",
    "\"1\"",
    "null",
    "[1, 2]",
];

fn edit() -> impl Strategy<Value = Edit> {
    (
        any::<prop::sample::Index>(),
        0..24_usize,
        0..8_u8,
        "[ -~\n]{0,6}",
        any::<prop::sample::Index>(),
    )
}

fn apply(text: &mut String, (at, length, kind, insert, choice): &Edit) {
    let lines: Vec<&str> = text.lines().collect();
    if lines.is_empty() {
        return;
    }
    if *kind < 2 {
        // Remove or duplicate a line.
        let line = at.index(lines.len());
        let mut lines = lines;
        if *kind == 0 {
            lines.remove(line);
        } else {
            lines.insert(line, lines[line]);
        }
        *text = lines.join("\n");
        return;
    }
    if *kind < 5 {
        // Replace a number.
        let starts: Vec<usize> = text
            .match_indices(|c: char| c.is_ascii_digit())
            .map(|(i, _)| i)
            .filter(|i| *i == 0 || !text[..*i].ends_with(|c: char| c.is_alphanumeric() || c == '.'))
            .collect();
        if !starts.is_empty() {
            let start = starts[at.index(starts.len())];
            let number = |c: char| c.is_ascii_digit() || c == '.';
            let end = text[start..]
                .find(|c| !number(c))
                .map_or(text.len(), |n| start + n);
            text.replace_range(start..end, NUMBERS[choice.index(NUMBERS.len())]);
        }
        return;
    }
    let start = at.index(text.len());
    let end = (start + length).min(text.len());
    if !text.is_char_boundary(start) || !text.is_char_boundary(end) {
        return;
    }
    let piece = text[start..end].to_owned();
    match kind {
        5 => text.replace_range(start..end, ""),
        6 => text.insert_str(start, &piece),
        _ => text.replace_range(start..end, insert),
    }
}

/// Uses an accepted file: nothing is NaN, and what is built from it works.
fn use_it(kind: &str, file: &ConfigFile) {
    let no_nan = |value: String| assert!(!value.contains("NaN"), "{value}");
    match kind {
        "vehicle" => {
            let vehicle: Vehicle = file.parse().unwrap();
            no_nan(format!("{vehicle:?}"));
            let again: Vehicle =
                serde_yaml::from_str(&serde_yaml::to_string(&vehicle).unwrap()).unwrap();
            assert_eq!(again, vehicle);
        }
        "contact vehicle" => no_nan(format!("{:?}", file.parse::<ContactVehicle>().unwrap())),
        "scenario" => {
            let world = Scenario::read(file.clone())
                .and_then(|scenario| scenario.prepare(&Overrides::default()))
                .unwrap();
            no_nan(format!("{:?} {:?}", world.controller, world.start));
            assert!((1e-4..=0.05).contains(&world.step_s));
            if let Ok(mut simulation) = world.simulation() {
                for _ in 0..3 {
                    if simulation.step().is_err() {
                        break;
                    }
                }
                let pose = simulation.state().pose;
                assert!(pose.x_m.is_finite() && pose.y_m.is_finite() && pose.yaw_rad.is_finite());
            }
        }
        "layout of a CAN bus" => {
            let layout = load_layout(file).unwrap();
            for message in layout.command.iter().chain(layout.from_vehicle()) {
                assert!(message.encode(0, |_| f64::NAN).is_err());
                if let Ok(frame) = message.encode(0, |_| 0.0) {
                    assert!(message.decode(&frame).is_ok());
                }
            }
        }
        "configuration of run" => {
            let config: RunConfig = file.parse().unwrap();
            no_nan(format!("{config:?}"));
            let safety = &config.safety;
            assert!(safety.feedback_timeout_s <= 1.0 && safety.command_timeout_s <= 1.0);
            assert!(safety.deceleration_m_s2 >= 0.1 && safety.speed_max_m_s <= 20.0);
            assert!(config.cycle.decision_time_s <= config.cycle.period_s);
        }
        "configuration of vehicle" => {
            no_nan(format!("{:?}", file.parse::<VehicleConfig>().unwrap()))
        }
        "configuration of odometry --live" => {
            no_nan(format!("{:?}", file.parse::<LiveOdometryConfig>().unwrap()))
        }
        "topic map" => no_nan(format!("{:?}", TopicMap::read(file).unwrap())),
        other => panic!("unknown kind: {other}"),
    }
}

/// Cases of [`damaged_files_are_refused_by_name_or_usable`].
const CASES: u32 = 2500;

#[test]
fn damaged_files_are_refused_by_name_or_usable() {
    let files = files();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("config")
        .display()
        .to_string();
    let counts = RefCell::new([0_u32; 2]);
    let mut runner = proptest::test_runner::TestRunner::new(ProptestConfig {
        cases: CASES,
        failure_persistence: None,
        ..ProptestConfig::default()
    });
    let cases = (
        any::<prop::sample::Index>(),
        prop::collection::vec(edit(), 1..5),
    );
    runner
        .run(&cases, |(which, edits)| {
            let path = &files[which.index(files.len())];
            let mut text = std::fs::read_to_string(path).unwrap();
            for edit in &edits {
                apply(&mut text, edit);
            }
            let file = ConfigFile::with_text(path, text);
            let begun = std::time::Instant::now();
            let result = check(file.clone());
            let name = path.file_name().unwrap().to_str().unwrap();
            if begun.elapsed().as_secs_f64() > 2.0 {
                println!(
                    "{name}: {:.1} s\n{}",
                    begun.elapsed().as_secs_f64(),
                    file.text()
                );
            }
            counts.borrow_mut()[usize::from(result.is_ok())] += 1;
            match result {
                Ok(kind) => use_it(kind, &file),
                Err(error) => {
                    let text = format!("{error:#}");
                    // The file itself or one that it names.
                    prop_assert!(text.contains(&folder), "no file in: {text}");
                }
            }
            Ok(())
        })
        .unwrap_or_else(|error| panic!("{error}"));
    let [refused, accepted] = counts.into_inner();
    println!("{refused} refused, {accepted} accepted");
    // Both outcomes must occur, or nothing is tested.
    assert!(refused > CASES / 10 && accepted > CASES / 10);
}

#[test]
fn controllers_know_whether_the_plant_has_inertia_but_not_how_much() {
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("config");
    let vehicle = config.join("vehicles/j8_contact.yaml");
    let identified = config.join("vehicles/j8_contact_identified.yaml");
    let folder = tempfile::tempdir().unwrap();
    let known = |name: &str, variation: &str, other_vehicle: bool| {
        let slalom = configuration("scenarios/slalom.yaml");
        let mut scenario: serde_yaml::Value = serde_yaml::from_str(&slalom).unwrap();
        scenario["contact"] = serde_yaml::from_str(&format!(
            "{{vehicle: {}, identified: {}, variation: {variation}}}",
            vehicle.display(),
            identified.display()
        ))
        .unwrap();
        scenario["plant"] = "contact".into();
        let file = folder.path().join(name);
        std::fs::write(&file, serde_yaml::to_string(&scenario).unwrap()).unwrap();
        let scenario = Scenario::read(ConfigFile::read(&file).unwrap()).unwrap();
        let overrides = Overrides {
            other_vehicle,
            ..Overrides::default()
        };
        let world = scenario.prepare(&overrides).unwrap();
        world.vehicle.contact_vehicle().inertia()
    };
    assert_eq!(known("none.yaml", "{}", false), 0.0);
    for (name, variation, other_vehicle) in [
        ("some.yaml", "{inertia: 0.6}", false),
        ("other.yaml", "{}", true),
    ] {
        let guess = known(name, variation, other_vehicle);
        assert!((guess - 1.0).abs() < 1e-12, "{name}: {guess}");
    }
}

#[test]
fn no_vehicle_without_inertia_has_tyres_that_relax() {
    let j8 = configuration("vehicles/j8.yaml");
    let read = |known: &str| {
        let axles = "[{forward_m: 1}, {forward_m: -1}]";
        let text = format!("{j8}\ncontact: {{half_width_m: 0.6, axles: {axles}, {known}}}\n");
        serde_yaml::from_str::<Vehicle>(&text)
            .map(|vehicle| vehicle.contact_vehicle().friction.relaxation_length_m)
            .map_err(|error| error.to_string())
    };
    assert_eq!(read("inertia: 0"), Ok(0.0));
    assert_eq!(read("inertia: 0.5, relaxation_length_m: 0.2"), Ok(0.2));
    assert!((read("inertia: 0.5").unwrap() - 0.03).abs() < 1e-12);
    let refused = read("inertia: 0, relaxation_length_m: 0.2").unwrap_err();
    assert!(
        refused.contains("relaxation_length_m: 0.2") && refused.contains("inertia of 0"),
        "{refused}"
    );
}
