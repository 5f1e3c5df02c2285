use super::*;
use ParameterValue::{Boolean, Double, Integer, StringArray};

fn given(name: &str, value: ParameterValue) -> Parameter {
    Parameter {
        name: name.to_owned(),
        value,
    }
}

#[test]
fn tolerances_speed_and_thresholds_are_those_that_are_set() {
    let config = Ros2Config::default();
    let names = ServerParameters::new(&config.follow_path);
    let mut values = names.declare(&config, 0.05, 0.5);
    assert_eq!(names.tolerances(&values), config.tolerances);
    assert_eq!(values.get("controller_frequency"), Double(20.0));
    assert_eq!(names.speed_m_s(&values), 0.5);
    for (name, value) in [
        ("general_goal_checker.xy_goal_tolerance", 0.4),
        ("general_goal_checker.yaw_goal_tolerance", 0.3),
        ("progress_checker.required_movement_radius", 0.6),
        ("progress_checker.movement_time_allowance", 20.0),
        ("transform_tolerance", 0.2),
        ("failure_tolerance", 2.0),
        ("FollowPath.desired_linear_vel", 0.8),
        ("min_theta_velocity_threshold", 0.01),
    ] {
        values.set(name, Double(value)).unwrap();
    }
    let expected = Tolerances {
        goal_xy_m: 0.4,
        goal_yaw_rad: 0.3,
        progress_m: 0.6,
        progress_time_s: 20.0,
        transform_s: 0.2,
        failure_s: 2.0,
    };
    assert_eq!(names.tolerances(&values), expected);
    assert_eq!(names.speed_m_s(&values), 0.8);
    let thresholds = ServerParameters::velocity_thresholds(&values);
    assert_eq!(thresholds, [0.0001, 0.01]);
}

#[test]
fn topics_and_plugins_are_read_only() {
    let config = Ros2Config::default();
    let values = ServerParameters::new(&config.follow_path).declare(&config, 0.05, 0.5);
    for name in [
        "odom_topic",
        "use_sim_time",
        "controller_plugins",
        "controller_frequency",
    ] {
        assert!(!values.is_writable(name), "{name}");
        assert_ne!(values.get(name), ParameterValue::NotSet, "{name}");
    }
}

#[test]
fn a_file_of_nav2_is_understood_where_it_is_ours() {
    let mut config = Ros2Config::default();
    let mut speed_m_s = 0.5;
    let file = [
        given("use_sim_time", Boolean(true)),
        given(
            "goal_checker_plugins",
            StringArray(vec!["precise".to_owned()]),
        ),
        given("precise.xy_goal_tolerance", Double(0.1)),
        given("progress_checker.movement_time_allowance", Integer(20)),
        given("FollowPath.desired_linear_vel", Double(0.3)),
        given("FollowPath.plugin", ParameterValue::String("x".to_owned())),
        given("controller_frequency", Double(100.0)),
    ];
    override_config(&mut config, &mut speed_m_s, 0.05, &file).unwrap();
    assert!(config.use_sim_time);
    assert_eq!(config.follow_path.goal_checker_id, "precise");
    assert_eq!(config.tolerances.goal_xy_m, 0.1);
    assert_eq!(config.tolerances.progress_time_s, 20.0);
    assert_eq!(speed_m_s, 0.3);
    let wrong = [given("failure_tolerance", Double(-1.0))];
    let error = override_config(&mut config, &mut speed_m_s, 0.05, &wrong).unwrap_err();
    assert!(error.contains("failure_tolerance: -1"), "{error}");
}

#[test]
fn a_goal_checker_of_positions_asks_for_no_heading() {
    let text = |name: &str, value: &str| given(name, ParameterValue::String(value.to_owned()));
    let yaw_rad = |plugin: &str| {
        let mut config = Ros2Config::default();
        let file = [
            text("general_goal_checker.plugin", plugin),
            given("general_goal_checker.yaw_goal_tolerance", Double(0.1)),
        ];
        override_config(&mut config, &mut 0.5, 0.05, &file).unwrap();
        config.validate().unwrap();
        config.tolerances.goal_yaw_rad
    };
    assert_eq!(yaw_rad("nav2_controller::SimpleGoalChecker"), 0.1);
    assert_eq!(yaw_rad("nav2_controller::PositionGoalChecker"), PI);
}

#[test]
fn a_heading_tolerance_of_nav2_that_allows_all_is_understood() {
    let mut config = Ros2Config::default();
    let name = "general_goal_checker.yaw_goal_tolerance";
    override_config(&mut config, &mut 0.5, 0.05, &[given(name, Double(6.25))]).unwrap();
    config.validate().unwrap();
    assert_eq!(config.tolerances.goal_yaw_rad, 6.25);
}

#[test]
fn the_page_of_parameters_has_every_one_with_type_default_and_range() {
    let page = include_str!("../../../../../docs/ros2.md");
    let rows: Vec<Vec<&str>> = page
        .lines()
        .skip_while(|line| !line.starts_with("| parameter |"))
        .skip(2)
        .take_while(|line| line.starts_with('|'))
        .map(|line| line.split('|').map(str::trim).skip(1).take(4).collect())
        .collect();
    let config = Ros2Config::default();
    let values = ServerParameters::new(&config.follow_path).declare(&config, 0.05, 0.5);
    let mut found: Vec<Vec<String>> = rows
        .iter()
        .map(|row| row.iter().map(|cell| (*cell).to_owned()).collect())
        .collect();
    let mut expected: Vec<Vec<String>> = values
        .all()
        .into_iter()
        .map(|Parameter { name, value }| {
            let description = values.describe(&name);
            let (kind, default) = match value {
                Double(value) => {
                    let unit = description.description.split([' ', ',']).next().unwrap();
                    (
                        format!("double, {}", unit.trim_end_matches(';')),
                        format!("{value:?}"),
                    )
                }
                Boolean(value) => ("bool".to_owned(), value.to_string()),
                ParameterValue::String(value) => ("string".to_owned(), format!("`{value}`")),
                StringArray(values) => (
                    "string array".to_owned(),
                    format!("`[{}]`", values.join(", ")),
                ),
                value => panic!("{value:?}"),
            };
            let range = match description.floating_point_range.first() {
                Some(range) => format!("{} to {}", range.from_value, range.to_value),
                None => "fixed".to_owned(),
            };
            vec![format!("`{name}`"), kind, default, range]
        })
        .collect();
    found.sort();
    expected.sort();
    assert_eq!(found, expected);
}
