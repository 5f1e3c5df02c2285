//! `sidehill icr` against an independent implementation, see `plant/tests/data/README.md`.

use crate::{assert_says, repository, sidehill, stderr, text};
use std::io::Write;
use std::process::{Output, Stdio};

const INPUTS: [&str; 4] = ["roll_rad", "pitch_rad", "v_left_m_s", "v_right_m_s"];

/// Returns the output of `sidehill icr` for `input`.
fn icr(vehicle: &str, input: &str) -> Output {
    let mut child = sidehill()
        .args(["icr", "--vehicle"])
        .arg(repository(&format!("config/vehicles/{vehicle}.yaml")))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // In its own thread, because the pipes cannot hold all lines.
    let mut stdin = child.stdin.take().unwrap();
    let input = input.to_owned();
    let writer = std::thread::spawn(move || stdin.write_all(input.as_bytes()));
    let output = child.wait_with_output().unwrap();
    // The pipe is closed if the program has ended early.
    let _ = writer.join().unwrap();
    output
}

#[test]
fn both_vehicles_meet_the_reference_vectors() {
    let reference = text("plant/tests/data/icrik_vectors.csv");
    let mut table = csv::Reader::from_reader(reference.as_bytes());
    let header = table.headers().unwrap().clone();
    let rows: Vec<csv::StringRecord> = table.records().map(Result::unwrap).collect();
    let at = |name: &str| header.iter().position(|column| column == name).unwrap();
    let mut compared = 0;
    for vehicle in ["j8", "lazaro"] {
        let own: Vec<_> = rows
            .iter()
            .filter(|row| &row[at("vehicle")] == vehicle)
            .collect();
        let mut input = INPUTS.join(",") + "\n";
        for row in &own {
            input += &(INPUTS.map(|name| &row[at(name)]).join(",") + "\n");
        }
        let output = icr(vehicle, &input);
        assert!(output.status.success(), "{}", stderr(&output));
        let mut answers = csv::Reader::from_reader(output.stdout.as_slice());
        assert_eq!(answers.headers().unwrap(), &header);
        let answers: Vec<csv::StringRecord> = answers.records().map(Result::unwrap).collect();
        assert_eq!(answers.len(), own.len());
        for (answer, row) in answers.iter().zip(own) {
            assert_eq!(&answer[0], vehicle);
            for column in 1..header.len() {
                let number = |record: &csv::StringRecord| record[column].parse::<f64>().unwrap();
                let (got, expected) = (number(answer), number(row));
                assert!(
                    (got - expected).abs() < 1e-9,
                    "{}: {got} for {row:?}",
                    &header[column]
                );
            }
            compared += 1;
        }
    }
    assert_eq!(compared, 480);
}

#[test]
fn a_bad_line_is_named() {
    for (line, says) in [
        ("0.1,2.0,0.3,0.3", &["line 3", "pitch_rad", "2"][..]),
        ("0.1,0.0,fast,0.3", &["line 3", "v_left_m_s", "fast"]),
        ("0.1,0.0,0.3", &["line 3"]),
        ("0.1,0.0,NaN,0.3", &["line 3", "v_left_m_s", "NaN"]),
    ] {
        let output = icr(
            "j8",
            &format!("{}\n0,0,0.1,0.2\n{line}\n", INPUTS.join(",")),
        );
        assert!(!output.status.success());
        assert_says(&stderr(&output), says);
    }
}

#[test]
fn a_missing_column_is_named() {
    let output = icr("j8", "roll_rad,pitch_rad,v_left_m_s\n0,0,0.1\n");
    assert!(!output.status.success());
    assert_says(&stderr(&output), &["v_right_m_s"]);
}
