//! The configuration of `run` and `vehicle` in a set.

use super::file::File;
use super::port::PortKind;
use super::robots::Measures;
use anyhow::Result;

/// Returns the configuration of `run` and `vehicle`: the repository's own with the names of this set, and with the
/// measures of the robot where they are given.
pub(super) fn bridge(
    port: PortKind,
    track_width_m: f64,
    measures: Option<&Measures<'_>>,
) -> Result<Vec<File>> {
    let replaced = |text: &str, pairs: &[(&str, String)]| -> Result<String> {
        pairs.iter().try_fold(text.to_owned(), |text, (from, to)| {
            anyhow::ensure!(text.contains(from), "the template has no `{from}`");
            Ok(text.replace(from, to))
        })
    };
    let vehicle = ("../vehicles/j8.yaml", "vehicle.yaml".to_owned());
    let world = ("../scenarios/figure_eight.yaml", "scenario.yaml".to_owned());
    let radius_m = measures.map_or(1.0, |measures| measures.radius_m);
    let radius = ("radius_m: 1.0", format!("radius_m: {radius_m:?}"));
    let width = (
        "track_width_m: 2.053",
        format!("track_width_m: {track_width_m:.3}"),
    );
    // The robot's own speed: of the controller and the safety, and of the virtual robot's motors.
    let with_speed =
        |text: String, pairs: &dyn Fn(f64) -> Vec<(&'static str, String)>| match measures
            .and_then(|measures| measures.speed_m_s)
        {
            Some(speed_m_s) => replaced(&text, &pairs(speed_m_s)),
            None => Ok(text),
        };
    let settings = |speed_m_s: f64| {
        let limits = limits(speed_m_s);
        let text = format!(
            "\nsettings:\n  limits: {limits} # m/s and m/s^2 of each motor, m/s of a tread\n"
        );
        ("\nsettings:\n", text)
    };
    let motors = |speed_m_s: f64| {
        let text = format!("speed_max_m_s: {speed_m_s:?}, acceleration");
        vec![("speed_max_m_s: 1.0, acceleration", text)]
    };
    Ok(match port {
        PortKind::Ros2 => {
            let run = include_str!("../../config/bridge/run_ros2.yaml");
            let rover = include_str!("../../config/bridge/vehicle_ros2.yaml");
            vec![
                File {
                    name: "run.yaml",
                    text: with_speed(
                        replaced(
                            run,
                            &[
                                vehicle,
                                ("vehicle_ros2.yaml", "virtual.yaml".to_owned()),
                                width.clone(),
                                radius.clone(),
                                // By default the largest curvature follows from the vehicle.
                                ("max_curvature_per_m: 2.0, ", String::new()),
                                ("# 1/m, m, m", "# m, m".to_owned()),
                            ],
                        )?,
                        &|speed_m_s| {
                            let usual_m_s = usual_speed_m_s(speed_m_s);
                            vec![
                                settings(speed_m_s),
                                ("speed_m_s: 0.5,", format!("speed_m_s: {usual_m_s:?},")),
                                (
                                    "\nsafety:\n",
                                    format!(
                                        "\nsafety:\n  speed_max_m_s: {speed_m_s:?} # m/s, of each motor\n"
                                    ),
                                ),
                            ]
                        },
                    )?,
                },
                File {
                    name: "virtual.yaml",
                    text: with_speed(replaced(rover, &[world, width, radius])?, &motors)?,
                },
            ]
        }
        PortKind::Can => {
            let run = include_str!("../../config/bridge/run_vcan0.yaml");
            let rover = include_str!("../../config/bridge/vehicle_vcan0.yaml");
            vec![
                File {
                    name: "run.yaml",
                    text: with_speed(
                        replaced(
                            run,
                            &[vehicle, ("vehicle_vcan0.yaml", "virtual.yaml".to_owned())],
                        )?,
                        &|speed_m_s| {
                            vec![
                                settings(speed_m_s),
                                (
                                    "speed_max_m_s: 1.0",
                                    format!("speed_max_m_s: {speed_m_s:?}"),
                                ),
                            ]
                        },
                    )?,
                },
                File {
                    name: "virtual.yaml",
                    text: replaced(rover, &[world])?,
                },
                File {
                    name: "can.yaml",
                    text: include_str!("../../config/bridge/can.yaml").to_owned(),
                },
                File {
                    name: "j8.dbc",
                    text: include_str!("../../config/bridge/j8.dbc").to_owned(),
                },
            ]
        }
    })
}

/// Returns the limits of motors that reach a speed, m/s, as YAML.
pub(super) fn limits(speed_m_s: f64) -> String {
    let motor =
        format!("{{speed_m_s: {speed_m_s:?}, acceleration_m_s2: 2.0, deceleration_m_s2: 2.0}}");
    format!("{{traction: {motor}, steer: {motor}, tread_speed_m_s: {speed_m_s:?}}}")
}

/// Returns the speed of the first drives of a vehicle that reaches a speed, m/s.
pub(super) fn usual_speed_m_s(speed_m_s: f64) -> f64 {
    (0.5 * speed_m_s).clamp(0.1, 0.5)
}
