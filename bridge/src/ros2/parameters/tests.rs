use super::*;
use ParameterValue::{Boolean, Double, Integer, NotSet, StringArray};

fn parameters() -> Parameters {
    Parameters::new(&Ros2Config::default(), 0.05, 0.5)
}

fn given(name: &str, value: ParameterValue) -> Parameter {
    Parameter {
        name: name.to_owned(),
        value,
    }
}

#[test]
fn a_tolerance_is_set_within_its_range_and_refused_with_a_reason() {
    let mut parameters = parameters();
    let name = "general_goal_checker.xy_goal_tolerance";
    parameters.set(name, Double(0.4)).unwrap();
    assert_eq!(parameters.tolerances().goal_xy_m, 0.4);
    for (name, value, reason) in [
        (
            name,
            Double(-1.0),
            "-1 is out of range, must be from 0.01 to 100",
        ),
        (name, Double(f64::NAN), "out of range"),
        (name, Integer(1), "must be a double"),
        ("controller_frequency", Double(30.0), "read-only"),
        ("use_sim_time", Boolean(true), "read-only"),
        ("no_such", Double(1.0), "there is no parameter no_such"),
    ] {
        let error = parameters.set(name, value).unwrap_err();
        assert!(error.contains(reason), "{error}");
    }
    assert_eq!(parameters.tolerances().goal_xy_m, 0.4);
    // To set what it is already is no change.
    parameters.set("use_sim_time", Boolean(false)).unwrap();
}

#[test]
fn several_are_set_all_or_none() {
    let mut parameters = parameters();
    let error = parameters.set_all(vec![
        given("failure_tolerance", Double(2.0)),
        given("transform_tolerance", Double(-2.0)),
    ]);
    assert!(error.unwrap_err().contains("transform_tolerance"));
    assert_eq!(parameters.tolerances().failure_s, 1.0);
    let both = vec![
        given("failure_tolerance", Double(2.0)),
        given("transform_tolerance", Double(0.2)),
    ];
    parameters.set_all(both).unwrap();
    let now = parameters.tolerances();
    assert_eq!((now.failure_s, now.transform_s), (2.0, 0.2));
}

#[test]
fn what_there_is_can_be_listed_and_described() {
    let parameters = parameters();
    let of = |prefix: &str| parameters.list(&[prefix.to_owned()], 0);
    assert_eq!(of("progress_checker").len(), 2);
    assert!(of("progress").is_empty());
    assert_eq!(of("use_sim_time"), ["use_sim_time"]);
    let flat = parameters.list(&[], 1);
    assert!(flat.iter().all(|name| !name.contains('.')) && flat.len() > 5);
    assert_eq!(parameters.list(&[], 0).len(), parameters.all().len());
    let range = parameters
        .describe("failure_tolerance")
        .floating_point_range;
    assert_eq!((range[0].from_value, range[0].to_value), (0.0, 60.0));
    assert!(parameters.describe("controller_frequency").read_only);
    assert_eq!(parameters.get("no_such"), NotSet);
    assert_eq!(parameters.get("controller_frequency"), Double(20.0));
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
