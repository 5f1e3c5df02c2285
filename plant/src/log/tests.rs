use super::*;
use crate::frames::{RosAttitude, ros_quaternion};

const CONTRACT: &str = "time_s,v_left_m_s,v_right_m_s,roll_rad,pitch_rad,x_m,y_m,z_m,yaw_rad\n\
    0.0, 0.1, 0.2, 0.01, 0.02, 1, 2, 3, 0.5\n\
    0.1, 0.3, 0.4, 0.03, 0.04, , , ,\n\
    0.2, 0.5, 0.6, 0.05, 0.06, 4, 5, 6, 0.7\n";

fn read(text: &str, map: &ColumnMap) -> Result<DriveLog, LogError> {
    DriveLog::read(text.as_bytes(), map)
}

#[test]
fn the_contract_reads_with_poses_on_some_rows_or_none() {
    let log = read(CONTRACT, &ColumnMap::default()).unwrap();
    assert_eq!(log.rows().len(), 3);
    assert_eq!(log.pose_count(), 2);
    assert_eq!(log.rows()[1].pose, None);
    assert_eq!(log.rows()[2].pose.unwrap().z_m, 6.0);
    assert_eq!(log.rows()[1].speeds.right_m_s, 0.4);
    let bare = "time_s,v_left_m_s,v_right_m_s,roll_rad,pitch_rad\n0,1,1,0,0\n1,1,1,0,0\n";
    assert_eq!(read(bare, &ColumnMap::default()).unwrap().pose_count(), 0);
}

#[test]
fn a_log_that_would_fill_the_memory_is_refused() {
    let read = |rows_max| {
        DriveLog::read_rows(CONTRACT.as_bytes(), &ColumnMap::default(), rows_max).map(drop)
    };
    assert_eq!(read(3), Ok(()));
    assert_eq!(read(2), Err(LogError::TooLong { rows_max: 2 }));
}

#[test]
fn errors_name_row_and_column() {
    let error = |from: &str, to: &str| {
        assert!(CONTRACT.contains(from));
        read(&CONTRACT.replacen(from, to, 1), &ColumnMap::default())
            .unwrap_err()
            .to_string()
    };
    assert!(error("0.3, 0.4", "0.3, fast").contains("row 2, column v_right_m_s: \"fast\""));
    assert!(error("0.2, 0.5", "0.05, 0.5").contains("row 3: time 0.05 s goes back from 0.1 s"));
    assert!(error("0.2, 0.5", "nan, 0.5").contains("row 3, column time_s"));
    assert!(error("0.05, 0.06", "0.05, 2.06").contains("row 3: pitch_rad: 2.06"));
    assert!(error("4, 5, 6, 0.7", "4, , 6, 0.7").contains("row 3: the pose is not complete"));
    assert!(error("roll_rad", "roll").contains("no column roll_rad; there are: time_s"));
    assert!(error("0.1, 0.2", "NaN, 0.2").contains("row 1: v_left_m_s: NaN"));
}

#[test]
fn third_party_columns_are_converted() {
    let attitude = Attitude {
        roll_rad: 0.2,
        pitch_rad: -0.3,
    };
    let q = ros_quaternion(&attitude, 0.8);
    let row =
        |time_s: f64, x_m: f64| format!("{time_s},2,4,{x_m},0,0,{},{},{},{}\n", q.i, q.j, q.k, q.w);
    let text = format!(
        "t,wl,wr,x,y,z,qx,qy,qz,qw\n{}{}{}",
        row(0.0, 1.0),
        row(0.05, 1.0),
        row(0.1, 1.5)
    );
    let map: ColumnMap = serde_yaml::from_str(
        "{time: t, tread_speed_left: wl, tread_speed_right: wr, tread_speed_scale: 0.3,
          attitude: {kind: quaternion, x: qx, y: qy, z: qz, w: qw},
          pose: {x: x, y: y, z: z, heading: {kind: quaternion, x: qx, y: qy, z: qz, w: qw}, repeats: true}}",
    )
    .unwrap();
    let log = read(&text, &map).unwrap();
    let rows = log.rows();
    assert!((rows[0].speeds.right_m_s - 1.2).abs() < 1e-12);
    assert!((rows[0].attitude.pitch_rad + 0.3).abs() < 1e-9);
    assert!((rows[0].pose.unwrap().yaw_rad - 0.8).abs() < 1e-9);
    assert!(rows[1].pose.is_none() && rows[2].pose.is_some());
}

#[test]
fn rep_103_angles_go_through_a_rotation() {
    let attitude = Attitude {
        roll_rad: 0.3,
        pitch_rad: 0.25,
    };
    let ros = RosAttitude::from_paper(&attitude, 0.0);
    let text = format!(
        "t,l,r,roll,pitch,x,y,z,yaw\n0,1,1,{0},{1},0,0,0,1.5\n1,1,1,{0},{1},1,1,1,1.6\n",
        ros.roll_rad, ros.pitch_rad
    );
    let map: ColumnMap = serde_yaml::from_str(
        "{time: t, tread_speed_left: l, tread_speed_right: r, attitude: {kind: rep103, roll: roll, pitch: pitch},
          pose: {x: x, y: y, z: z, heading: {kind: rep103, yaw: yaw}}}",
    )
    .unwrap();
    let row = read(&text, &map).unwrap().rows()[0];
    assert!((row.attitude.roll_rad - 0.3).abs() < 1e-9);
    assert!((row.attitude.pitch_rad - 0.25).abs() < 1e-9);
    let yaw_rad = row.pose.unwrap().yaw_rad;
    assert!((yaw_rad - (1.5 - std::f64::consts::FRAC_PI_2)).abs() < 1e-9);
}

#[test]
fn smoothing_keeps_a_ramp_and_removes_noise() {
    let rows = (0..200).map(|i| {
        let time_s = 0.05 * f64::from(i);
        let noise = if i % 2 == 0 { 0.005 } else { -0.005 };
        LogRow {
            time_s,
            speeds: MeasuredTreadSpeeds::default(),
            attitude: Attitude {
                roll_rad: 0.01 * time_s,
                pitch_rad: noise,
            },
            pose: None,
        }
    });
    let log = DriveLog::new(rows.collect()).unwrap();
    let smooth = log.with_smooth_attitude(0.2);
    for (before, after) in log.rows().iter().zip(smooth.rows()).skip(15).take(170) {
        assert!((before.attitude.roll_rad - after.attitude.roll_rad).abs() < 1e-9);
        assert!(after.attitude.pitch_rad.abs() < 5e-5, "{after:?}");
    }
}

#[test]
fn rows_with_one_sensor_each_are_resampled() {
    // Speeds that grow with time at 50 Hz, roll that does at 25 Hz, poses at 10 Hz, as PlotJuggler exports them.
    let mut lines: Vec<(f64, String)> = Vec::new();
    for i in 0..=100 {
        let time_s = 0.02 * f64::from(i);
        lines.push((
            time_s,
            format!("{time_s},{},{},,,,,,", 0.1 * time_s, 0.2 * time_s),
        ));
        if i % 2 == 0 {
            let time_s = time_s + 0.001;
            lines.push((time_s, format!("{time_s},,,{},0,,,,", 0.05 * time_s)));
        }
        if i % 5 == 0 {
            let time_s = time_s + 0.003;
            lines.push((time_s, format!("{time_s},,,,,{time_s},0,0,0")));
        }
    }
    lines.sort_by(|a, b| a.0.total_cmp(&b.0));
    let header = CONTRACT.lines().next().unwrap();
    let rows: Vec<&str> = lines.iter().map(|(_, line)| line.as_str()).collect();
    let log = read(
        &format!("{header}\n{}\n", rows.join("\n")),
        &ColumnMap::default(),
    )
    .unwrap();
    assert!(
        log.rows().len() > 110 && log.pose_count() == 20,
        "{}",
        log.rows().len()
    );
    for row in log.rows() {
        assert!(
            (row.speeds.right_m_s - 0.2 * row.time_s).abs() < 1e-9,
            "{row:?}"
        );
        assert!(
            (row.attitude.roll_rad - 0.05 * row.time_s).abs() < 1e-9,
            "{row:?}"
        );
        assert!(
            row.pose
                .is_none_or(|pose| (pose.x_m - row.time_s).abs() < 1e-9)
        );
    }
    let note = log.notes()[0].to_string();
    // 51 rows with a roll, 21 with a pose, and 101 with speeds but no roll.
    assert!(note.contains("173 of its rows lack"), "{note}");
    // One that lacks a roll is told apart from a log of which all rows lack something.
    let one = CONTRACT.replace("0.1, 0.3, 0.4, 0.03, 0.04", "0.1, 0.3, 0.4, , ");
    let log = read(&one, &ColumnMap::default()).unwrap();
    let note = log.notes()[0].to_string();
    assert!(note.contains("1 of its rows lack"), "{note}");
}

#[test]
fn repeated_times_and_poses_that_are_no_numbers_are_left_out_and_said() {
    let twice = CONTRACT.replace("0.2, 0.5", "0.1, 0.3, 0.4, 0.03, 0.04, , , ,\n0.2, 0.5");
    let log = read(&twice, &ColumnMap::default()).unwrap();
    assert_eq!(
        log.rows(),
        read(CONTRACT, &ColumnMap::default()).unwrap().rows()
    );
    assert_eq!(log.notes(), [Note::RepeatedTimes { count: 1, rows: 4 }]);
    let coarse = CONTRACT
        .replace("0.1, 0.3", "0.0, 0.3")
        .replace("0.2, 0.5", "0.0, 0.5");
    let error = read(&coarse, &ColumnMap::default())
        .unwrap_err()
        .to_string();
    assert!(error.contains("more decimals"), "{error}");
    let lost = CONTRACT.replace("4, 5, 6, 0.7", "nan, nan, 6, 0.7");
    let log = read(&lost, &ColumnMap::default()).unwrap();
    assert_eq!((log.rows().len(), log.pose_count()), (3, 1));
    assert_eq!(log.notes(), [Note::PosesLeftOut { count: 1 }]);
}

#[test]
fn a_side_that_counts_backwards_and_turned_antennas_are_corrected_by_keys() {
    let map = ColumnMap {
        reversed: Reversed::Right,
        pose: ColumnMap::default().pose.map(|pose| PoseColumns {
            heading_offset_deg: 90.0,
            ..pose
        }),
        ..ColumnMap::default()
    };
    let row = read(CONTRACT, &map).unwrap().rows()[0];
    assert_eq!((row.speeds.left_m_s, row.speeds.right_m_s), (0.1, -0.2));
    let yaw_rad = row.pose.unwrap().yaw_rad;
    assert!((yaw_rad - (0.5 + std::f64::consts::FRAC_PI_2)).abs() < 1e-12);
}

#[test]
fn text_in_another_encoding_is_named_with_its_row() {
    let error = |bytes: &[u8]| {
        let log = DriveLog::read(bytes, &ColumnMap::default());
        log.unwrap_err().to_string()
    };
    let row = [
        CONTRACT.as_bytes(),
        b"0.3, 0.5, 0.6, 0.05, 0.06, 4, 5, 6, \xB0\n",
    ]
    .concat();
    assert_eq!(error(&row), "row 4: is not UTF-8 text; save it as UTF-8");
    let header = [b"gr\xF6\xDFe,", CONTRACT.as_bytes()].concat();
    assert_eq!(
        error(&header),
        "line 1: is not UTF-8 text; save it as UTF-8"
    );
}

#[test]
fn what_stands_in_place_of_a_header_is_named() {
    let error = |text: &str| read(text, &ColumnMap::default()).unwrap_err().to_string();
    let echo = "1700000000,0,odom,base_link,0.1,0.0,0.0,0.0,0.0,1.0\n";
    assert!(
        error(echo).contains("`ros2 topic echo --csv` writes none"),
        "{}",
        error(echo)
    );
    for separator in [',', ';'] {
        let error = error(&format!("sep={separator}\n{CONTRACT}"));
        assert!(error.contains("one for spreadsheets; remove it"), "{error}");
    }
}

#[test]
fn gaps_are_said_and_rows_that_a_spreadsheet_emptied_are_none() {
    let later = CONTRACT.replace("0.2, 0.5", "3600.1, 0.5");
    let note = read(&later, &ColumnMap::default()).unwrap().notes()[0].to_string();
    assert!(
        note.contains("1 times") && note.contains("3600.0 s, 0.1 s after the first"),
        "{note}"
    );
    let emptied = format!("# field 3\n{CONTRACT},,,,,,,,\n,,,,,,,,\n");
    let log = read(&emptied, &ColumnMap::default()).unwrap();
    assert_eq!(log, read(CONTRACT, &ColumnMap::default()).unwrap());
    assert!(log.notes().is_empty());
}
