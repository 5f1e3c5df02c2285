use super::*;
use crate::ros2::conversions;
use crate::ros2::convert;
use sidehill_plant::drive_train::DriveTrainConfig;
use sidehill_plant::frames::PlanarPose;
use sidehill_plant::sensors::SensorsConfig;
use sidehill_plant::simulation::SimulationSetup;
use sidehill_plant::terrain::{PlaneTerrain, Terrain};
use sidehill_plant::vehicle::IcrMotion;

const DT_S: f64 = 0.005;
const FORWARD: MeasuredMotorSpeeds = MeasuredMotorSpeeds {
    traction_m_s: 0.4,
    steer_m_s: 0.05,
};

fn vehicle(config: VehicleNodeConfig) -> RosVehicle {
    vehicle_with(SensorsConfig::default(), config)
}

fn vehicle_with(sensors: SensorsConfig, config: VehicleNodeConfig) -> RosVehicle {
    let text = include_str!("../../../../config/vehicles/j8.yaml");
    let j8: Vehicle = serde_yaml::from_str(text).unwrap();
    let simulation = Simulation::new(SimulationSetup {
        terrain: Terrain::Plane(PlaneTerrain::new(10.0, 30.0).unwrap()),
        motion: Box::new(IcrMotion {
            vehicle: j8.clone(),
            inclined: true,
        }),
        drive_train: DriveTrainConfig::default(),
        sensors,
        encoder_scale: j8.encoder_scale,
        start: PlanarPose::default(),
        dt_s: DT_S,
        seed: 1,
    })
    .unwrap();
    let setup = VehicleSetup {
        dt_s: DT_S,
        correction: j8.encoder_scale,
        vehicle: &j8,
        drive: DriveConfig::default(),
        report_period_s: 0.02,
        origin_ns: 0,
    };
    RosVehicle::new(simulation, &setup, config).unwrap()
}

/// Drives until `until_s` with a command every 50 ms and returns the reports.
fn drive(vehicle: &mut RosVehicle, motors: MeasuredMotorSpeeds, until_s: f64) -> Vec<Report> {
    let mut reports = Vec::new();
    let mut step = (vehicle.state().time_s / DT_S).round() as u64;
    while vehicle.state().time_s < until_s {
        step += 1;
        let now_s = step as f64 * DT_S;
        if step % 10 == 1 {
            vehicle.take(motors, now_s);
        }
        vehicle.advance(now_s).unwrap();
        if now_s >= vehicle.next_report_s() {
            vehicle.report(now_s, |report| reports.push(report));
        }
    }
    reports
}

fn fault(after_enabled_s: f64, for_s: f64, fault: VehicleFaultKind) -> VehicleNodeConfig {
    VehicleNodeConfig {
        faults: vec![VehicleFault {
            after_enabled_s,
            for_s,
            fault,
        }],
        ..VehicleNodeConfig::default()
    }
}

#[test]
fn it_drives_as_commanded_and_its_transforms_lead_to_the_truth() {
    let mut vehicle = vehicle(VehicleNodeConfig {
        map_from_odom: PlanarOffset {
            x_m: 3.0,
            y_m: -2.0,
            yaw_deg: 25.0,
        },
        ..VehicleNodeConfig::default()
    });
    let reports = drive(&mut vehicle, FORWARD, 3.0);
    let last = reports.last().unwrap();
    let odometry = last.odometry.as_ref().unwrap();
    assert!((odometry.twist.twist.linear.x - FORWARD.traction_m_s).abs() < 1e-9);
    let back = vehicle.twist().motors(&odometry.twist.twist).unwrap();
    assert!((back.steer_m_s - FORWARD.steer_m_s).abs() < 1e-9);

    let map_from_odom = report::map_from_odom(vehicle.config());
    let odom_from_base = conversions::from_pose(&odometry.pose.pose).unwrap();
    let (pose, attitude) = convert::pose_and_attitude(&(map_from_odom * odom_from_base));
    let truth = vehicle.state();
    assert!((pose.x_m - truth.pose.x_m).abs() < 1e-9 && (pose.y_m - truth.pose.y_m).abs() < 1e-9);
    assert!((attitude.roll_rad - truth.attitude.roll_rad).abs() < 1e-9);
    assert!((attitude.pitch_rad - truth.attitude.pitch_rad).abs() < 1e-9);
    // The body's z axis is the plane's normal, and gravity is felt along it for the most part.
    let imu = last.imu.as_ref().unwrap();
    let expected = 9.80665 * 10.0_f64.to_radians().cos();
    assert!((imu.linear_acceleration.z - expected).abs() < 1e-9);
}

#[test]
fn the_imu_has_the_yaw_rate_of_its_sensor_or_the_true_one_left_positive() {
    let turn_left = MeasuredMotorSpeeds {
        traction_m_s: 0.0,
        steer_m_s: 0.3,
    };
    for (sensors, bias_deg_s) in [("{}", 0.0), ("yaw_rate: {errors: {bias_deg_s: 2}}", 2.0)] {
        let sensors = serde_yaml::from_str(sensors).unwrap();
        let mut vehicle = vehicle_with(sensors, VehicleNodeConfig::default());
        let yaw_before_rad = vehicle.state().pose.yaw_rad;
        let reports = drive(&mut vehicle, turn_left, 3.0);
        let state = vehicle.state();
        assert!(state.pose.yaw_rad > yaw_before_rad + 0.1);
        let imu = reports.last().unwrap().imu.as_ref().unwrap();
        let error_rad_s = imu.angular_velocity.z - state.velocity.yaw_rate_rad_s;
        assert!(imu.angular_velocity.z > 0.1);
        assert!((error_rad_s.to_degrees() - bias_deg_s).abs() < 1e-9);
    }
}

#[test]
fn drives_without_commands_stop_and_go_on_when_commands_come_again() {
    let mut vehicle = vehicle(VehicleNodeConfig::default());
    drive(&mut vehicle, FORWARD, 2.0);
    vehicle.advance(3.0).unwrap();
    assert_eq!(vehicle.mode(), DriveMode::Disabled);
    assert_eq!(vehicle.state().motors.traction_m_s, 0.0);
    drive(&mut vehicle, FORWARD, 4.0);
    assert_eq!(vehicle.mode(), DriveMode::Enabled);
    assert!((vehicle.state().motors.traction_m_s - 0.4).abs() < 0.1);
}

#[test]
fn an_emergency_stop_holds_until_zero_has_been_commanded() {
    let mut vehicle = vehicle(fault(1.0, 1.0, VehicleFaultKind::EmergencyStop));
    let reports = drive(&mut vehicle, FORWARD, 4.0);
    let pressed = reports
        .iter()
        .filter(|report| report.emergency_stop)
        .count();
    assert!((45..=55).contains(&pressed), "{pressed}");
    assert_eq!(vehicle.state().motors.traction_m_s, 0.0);
    drive(&mut vehicle, MeasuredMotorSpeeds::STOP, 4.2);
    drive(&mut vehicle, FORWARD, 6.0);
    assert!((vehicle.state().motors.traction_m_s - 0.4).abs() < 0.1);
}

#[test]
fn streams_stop_alone_and_numbers_and_frames_go_wrong() {
    let at_end = |kind| {
        let mut vehicle = vehicle(fault(0.5, 10.0, kind));
        drive(&mut vehicle, FORWARD, 2.0).pop().unwrap()
    };
    let stopped = at_end(VehicleFaultKind::Stop(vec![Stream::Imu]));
    assert!(stopped.imu.is_none() && stopped.odometry.is_some() && stopped.transforms.is_some());
    let odometry = at_end(VehicleFaultKind::NotANumber(Stream::Odometry)).odometry;
    assert!(odometry.unwrap().pose.pose.position.x.is_nan());
    let odometry = at_end(VehicleFaultKind::WrongFrame(Stream::Odometry)).odometry;
    assert_eq!(odometry.unwrap().header.frame_id, "nowhere");
}

#[test]
fn stamps_freeze_jump_and_are_delayed() {
    let stamps = |kind| -> Vec<f64> {
        let mut vehicle = vehicle(fault(0.5, 10.0, kind));
        drive(&mut vehicle, FORWARD, 2.0)
            .iter()
            .filter_map(|report| report.odometry.as_ref())
            .map(|odometry| conversions::nanoseconds(odometry.header.stamp).unwrap() as f64 * 1e-9)
            .collect()
    };
    let last = |stamps: &[f64]| stamps[stamps.len() - 1];
    let frozen = stamps(VehicleFaultKind::FreezeStamps);
    assert!((last(&frozen) - 0.52).abs() < 0.05, "{}", last(&frozen));
    let jumped = stamps(VehicleFaultKind::ClockJumpS(-1.0));
    assert!((last(&jumped) - 1.0).abs() < 0.05);
    let delayed = stamps(VehicleFaultKind::DelayS(0.5));
    assert!((last(&delayed) - 1.5).abs() < 0.05);
}
