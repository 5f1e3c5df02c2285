use super::*;
use crate::config::CanConfig;
use crate::controller_side::{Readings, VehicleReader};
use crate::database::Database;
use sidehill_plant::drive_train::DriveTrainConfig;
use sidehill_plant::frames::PlanarPose;
use sidehill_plant::simulation::SimulationSetup;
use sidehill_plant::terrain::{PlaneTerrain, Terrain};
use sidehill_plant::vehicle::IcrMotion;
use sidehill_plant::vehicle::Vehicle;

/// Returns what the controller's side reads of the first report of a standing rover.
fn first_report(can: &str, sensors: &str) -> Readings {
    let config: CanConfig = serde_yaml::from_str(can).unwrap();
    let dbc = include_str!("../../../../config/bridge/j8.dbc");
    let database = Database::parse("j8.dbc", dbc).unwrap();
    let layout = Arc::new(Layout::new(&config, &database).unwrap());
    let j8: Vehicle =
        serde_yaml::from_str(include_str!("../../../../config/vehicles/j8.yaml")).unwrap();
    let simulation = Simulation::new(SimulationSetup {
        terrain: Terrain::Plane(PlaneTerrain::new(5.0, 0.0).unwrap()),
        motion: Box::new(IcrMotion {
            vehicle: j8.clone(),
            inclined: true,
        }),
        drive_train: DriveTrainConfig::default(),
        sensors: serde_yaml::from_str(sensors).unwrap(),
        encoder_scale: j8.encoder_scale,
        start: PlanarPose::default(),
        dt_s: 0.005,
        seed: 1,
    })
    .unwrap();
    let setup = CanRoverSetup {
        dt_s: 0.005,
        correction: j8.encoder_scale,
        drive: DriveConfig::default(),
        report_period_s: 0.05,
        faults: Vec::new(),
    };
    let mut rover = CanRover::new(simulation, Arc::clone(&layout), setup).unwrap();
    rover.advance(0.05).unwrap();
    rover.report(0.05).unwrap();
    let mut reader = VehicleReader::new(layout);
    rover.flush(0.05, |frame| reader.take(&frame, 0.05).unwrap());
    *reader.readings()
}

#[test]
fn a_gyroscope_is_sent_where_the_layout_has_a_message_for_it() {
    let without = include_str!("../../../../config/bridge/can.yaml");
    let with = without.replace("# yaw_rate:", "yaw_rate:");
    let gyroscope = "{yaw_rate: {errors: {bias_deg_s: 2}}}";
    let readings = first_report(&with, gyroscope);
    let yaw_rate_rad_s = readings.yaw_rate.unwrap().value;
    assert!((yaw_rate_rad_s.to_degrees() - 2.0).abs() < 0.01);
    for (can, sensors) in [(without, gyroscope), (&with, "{}")] {
        let readings = first_report(can, sensors);
        assert_eq!(readings.yaw_rate, None);
        assert!(readings.attitude.is_some() && readings.pose.is_some());
    }
}
