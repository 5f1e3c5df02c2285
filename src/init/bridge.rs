//! The configuration of `run` and `vehicle` in a set.

use super::file::File;
use super::port::PortKind;
use anyhow::Result;

/// Returns the configuration of `run` and `vehicle`: the repository's own with the names of this set.
pub(super) fn bridge(port: PortKind, track_width_m: f64) -> Result<Vec<File>> {
    let replaced = |text: &str, pairs: &[(&str, String)]| -> Result<String> {
        pairs.iter().try_fold(text.to_owned(), |text, (from, to)| {
            anyhow::ensure!(text.contains(from), "the template has no `{from}`");
            Ok(text.replace(from, to))
        })
    };
    let vehicle = ("../vehicles/j8.yaml", "vehicle.yaml".to_owned());
    let world = ("../scenarios/figure_eight.yaml", "scenario.yaml".to_owned());
    let width = (
        "track_width_m: 2.053",
        format!("track_width_m: {track_width_m:.3}"),
    );
    Ok(match port {
        PortKind::Ros2 => {
            let run = include_str!("../../config/bridge/run_ros2.yaml");
            let rover = include_str!("../../config/bridge/vehicle_ros2.yaml");
            vec![
                File {
                    name: "run.yaml",
                    text: replaced(
                        run,
                        &[
                            vehicle,
                            ("vehicle_ros2.yaml", "virtual.yaml".to_owned()),
                            width.clone(),
                        ],
                    )?,
                },
                File {
                    name: "virtual.yaml",
                    text: replaced(rover, &[world, width])?,
                },
            ]
        }
        PortKind::Can => {
            let run = include_str!("../../config/bridge/run_vcan0.yaml");
            let rover = include_str!("../../config/bridge/vehicle_vcan0.yaml");
            vec![
                File {
                    name: "run.yaml",
                    text: replaced(
                        run,
                        &[vehicle, ("vehicle_vcan0.yaml", "virtual.yaml".to_owned())],
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
