use super::*;
use crate::contact::{ContactModel, ContactVehicle, FrictionField};
use crate::dead_reckoning::{StepMotion, advance};
use crate::terrain::PlaneTerrain;
use crate::test_support::motors;
use crate::vehicle::IcrMotion;
use crate::vehicle::Vehicle;
use proptest::prelude::*;

/// The J8 without its small asymmetry from left to right.
fn symmetric_j8() -> Vehicle {
    let mut vehicle = Vehicle::j8();
    vehicle.icrs.left_m = -vehicle.icrs.right_m;
    vehicle
}

fn plane(slope_deg: f64) -> Terrain {
    Terrain::Plane(PlaneTerrain::new(slope_deg, 0.0).unwrap())
}

fn setup(vehicle: Vehicle, terrain: Terrain) -> SimulationSetup {
    SimulationSetup {
        terrain,
        encoder_scale: vehicle.encoder_scale,
        motion: Box::new(IcrMotion {
            vehicle,
            inclined: true,
        }),
        drive_train: DriveTrainConfig::default(),
        sensors: SensorsConfig::default(),
        start: PlanarPose::default(),
        dt_s: 0.005,
        seed: 0,
    }
}

fn drive(simulation: &mut Simulation, command: MotorSpeeds, steps: u32) -> TrueState {
    simulation.set_command(command).unwrap();
    for _ in 0..steps {
        simulation.step().unwrap();
    }
    *simulation.state()
}

#[test]
fn a_seed_repeats_every_bit_and_another_does_not() {
    let run = |seed| {
        let mut setup = setup(Vehicle::j8(), plane(10.0));
        setup.seed = seed;
        setup.sensors = serde_yaml::from_str(
            "{tread_speeds: {timing: {rate_hz: 20}, errors: {noise_std_m_s: 0.02}},
              attitude: {timing: {rate_hz: 20, dropout_probability: 0.1}, errors: {noise_std_deg: 0.3}},
              pose: {timing: {rate_hz: 10, delay_s: 0.08}, errors: {noise_std_m: 0.02, noise_std_yaw_deg: 0.5}}}",
        ).unwrap();
        setup.drive_train = serde_yaml::from_str(
            "{traction: {time_constant_s: 0.2}, steer: {acceleration_max_m_s2: 2}, delay_s: 0.06}",
        )
        .unwrap();
        let mut simulation = Simulation::new(setup).unwrap();
        let mut trace = String::new();
        for cycle in 0..400 {
            let sample = simulation.sample();
            // Steering by a noisy reading, so that the noise reaches the motion.
            let roll_rad = sample
                .attitude
                .map_or(0.0, |attitude| attitude.value.roll_rad);
            let state = drive(
                &mut simulation,
                motors(0.4, roll_rad + 0.1 * f64::from(cycle % 7)),
                10,
            );
            trace += &format!("{state:?} {sample:?}\n");
        }
        trace
    };
    // Printed floats are the shortest that read back as the same bits.
    assert_eq!(run(5), run(5));
    assert_ne!(run(5), run(6));
}

#[test]
fn the_clock_does_not_drift_in_a_million_steps() {
    let mut setup = setup(Vehicle::j8(), Terrain::Level);
    setup.dt_s = 0.003;
    let mut simulation = Simulation::new(setup).unwrap();
    for _ in 0..1_000_000 {
        simulation.step().unwrap();
    }
    assert_eq!(simulation.state().time_s, 3000.0);
    assert_eq!(simulation.sample().pose.unwrap().time_s, 3000.0);
    assert_eq!(simulation.state().pose, Pose::default());
}

#[test]
fn motion_on_a_plane_is_the_dead_reckoning_of_equation_12() {
    let vehicle = Vehicle::j8();
    let mut simulation = Simulation::new(setup(vehicle.clone(), plane(10.0))).unwrap();
    let state = drive(&mut simulation, motors(0.3, 0.3), 4000);
    let normal = plane(10.0).surface(0.0, 0.0).unwrap().normal_in_world;
    let treads = TreadSpeeds::from(motors(0.3, 0.3));
    let mut reckoned = Pose::default();
    for _ in 0..4000 {
        reckoned = advance(&reckoned, 0.005, |_, yaw_rad| {
            let attitude = Attitude::on_plane(&normal, yaw_rad);
            StepMotion {
                velocity: vehicle.body_velocity(attitude, treads),
                attitude,
            }
        });
    }
    assert!((state.pose.x_m - reckoned.x_m).abs() < 1e-4);
    assert!((state.pose.y_m - reckoned.y_m).abs() < 1e-4);
    assert!((state.pose.yaw_rad - reckoned.yaw_rad).abs() < 1e-5);
    // The integrated height of (12) is the terrain's height.
    let height_m = plane(10.0)
        .surface(reckoned.x_m, reckoned.y_m)
        .unwrap()
        .height_m;
    assert!((reckoned.z_m - height_m).abs() < 1e-6);
    assert!(state.pose.z_m.abs() > 0.1);
}

#[test]
fn straight_driving_across_a_slope_does_not_slide_under_icrik() {
    let mut setup = setup(symmetric_j8(), plane(15.0));
    setup.start.yaw_rad = std::f64::consts::FRAC_PI_2;
    let mut simulation = Simulation::new(setup).unwrap();
    let state = drive(&mut simulation, motors(0.5, 0.0), 2000);
    assert!((state.pose.x_m + 5.0).abs() < 1e-9);
    assert!(state.pose.y_m.abs() < 1e-9 && state.pose.z_m.abs() < 1e-9);
    assert!((state.attitude.roll_rad + 15.0_f64.to_radians()).abs() < 1e-9);
}

#[test]
fn turning_on_a_slope_slides_downhill_under_icrik_only() {
    let mut descended_m = [0.0; 2];
    for (inclined, m) in [true, false].into_iter().zip(&mut descended_m) {
        let mut setup = setup(symmetric_j8(), plane(5.0));
        setup.motion = Box::new(IcrMotion {
            vehicle: symmetric_j8(),
            inclined,
        });
        let mut simulation = Simulation::new(setup).unwrap();
        *m = drive(&mut simulation, motors(0.0, 0.3), 6000).pose.y_m;
    }
    assert!(
        descended_m[0] < -1.0 && descended_m[1].abs() < 0.5,
        "{descended_m:?}"
    );
}

#[test]
fn perfect_sensors_give_the_truth_as_an_encoder_sees_it() {
    let mut simulation = Simulation::new(setup(Vehicle::j8(), plane(5.3))).unwrap();
    let state = drive(&mut simulation, motors(0.4, 0.2), 10);
    let sample = simulation.sample();
    assert_eq!(sample.time_s, state.time_s);
    assert_eq!(sample.pose.unwrap().value, state.pose);
    assert_eq!(sample.attitude.unwrap().value, state.attitude);
    let read = sample.tread_speeds.unwrap();
    assert_eq!(read.time_s, state.time_s);
    assert!((read.value.left_m_s * 1.004 - 0.2).abs() < 1e-12);
    assert!((read.value.right_m_s * 1.011 - 0.6).abs() < 1e-12);
}

#[test]
fn leaving_the_ground_is_an_error_with_time_and_place() {
    let text = "ncols 3\nnrows 3\nxllcenter -1\nyllcenter -1\ncellsize 1\n0 0 0\n0 0 0\n0 0 0\n";
    let grid = crate::terrain::GridTerrain::parse(text).unwrap();
    let mut simulation = Simulation::new(setup(Vehicle::j8(), Terrain::Grid(grid))).unwrap();
    simulation.set_command(motors(1.0, 0.0)).unwrap();
    let error = (0..400).find_map(|_| simulation.step().err()).unwrap();
    let text = error.to_string();
    assert!(
        text.contains("outside the elevation grid") && text.contains(" s: "),
        "{text}"
    );
    assert!((simulation.state().pose.y_m - 1.0).abs() < 0.006);
}

#[test]
fn bad_commands_steps_and_starts_are_refused() {
    let mut simulation = Simulation::new(setup(Vehicle::j8(), Terrain::Level)).unwrap();
    let error = simulation.set_command(motors(f64::NAN, 0.0)).unwrap_err();
    assert!(error.to_string().contains("traction NaN"), "{error}");
    let mut no_step = setup(Vehicle::j8(), Terrain::Level);
    no_step.dt_s = 0.0;
    assert!(Simulation::new(no_step).is_err());
    let mut nowhere = setup(Vehicle::j8(), Terrain::Level);
    nowhere.start.x_m = f64::INFINITY;
    assert!(matches!(
        Simulation::new(nowhere),
        Err(SimulationError::Terrain { .. })
    ));
}

/// A vehicle of four axles at rest on a plane of 15 degrees with or without brakes.
fn parked(vehicle: ContactVehicle, brakes: bool) -> Simulation {
    let mut setup = setup(Vehicle::j8(), plane(15.0));
    setup.motion = Box::new(ContactModel::new(vehicle));
    setup.start.yaw_rad = 1.0;
    setup.drive_train = serde_yaml::from_str(&format!(
        "{{brakes: {brakes}, traction: {{time_constant_s: 0.1}}, steer: {{time_constant_s: 0.1}}}}"
    ))
    .unwrap();
    Simulation::new(setup).unwrap()
}

fn with_inertia(
    vehicle: &ContactVehicle,
    inertia: f64,
    relaxation_length_m: f64,
) -> ContactVehicle {
    let mut vehicle = vehicle.clone();
    vehicle.set_inertia(inertia);
    vehicle.friction.relaxation_length_m = relaxation_length_m;
    vehicle
}

/// A vehicle without inertia, with it, and with tyres that build up their force.
fn kinds(vehicle: &ContactVehicle) -> [ContactVehicle; 3] {
    [(0.0, 0.0), (1.0, 0.0), (1.0, 0.2)].map(|(inertia, m)| with_inertia(vehicle, inertia, m))
}

#[test]
fn brakes_hold_a_parked_vehicle_that_creeps_without_them() {
    let wheels = ContactVehicle::of_base("wheels", 0.6, 1.06);
    let moved_m = |vehicle: ContactVehicle, brakes| {
        let pose = drive(&mut parked(vehicle, brakes), MotorSpeeds::STOP, 2000).pose;
        pose.x_m.hypot(pose.y_m)
    };
    for vehicle in kinds(&wheels) {
        let (free_m, held_m) = (moved_m(vehicle.clone(), false), moved_m(vehicle, true));
        assert!(free_m > 0.03 && held_m < 1e-4, "{free_m} {held_m}");
    }
}

#[test]
fn a_vehicle_stops_by_friction_before_it_is_held_and_drives_off_again() {
    let wheels = ContactVehicle::of_base("wheels", 0.6, 1.06);
    for vehicle in kinds(&wheels) {
        let mut simulation = parked(vehicle, true);
        let moving = drive(&mut simulation, motors(0.5, 0.2), 400);
        assert!(moving.velocity.forward_m_s > 0.4, "{moving:?}");
        let stopped = drive(&mut simulation, MotorSpeeds::STOP, 400);
        let later = drive(&mut simulation, MotorSpeeds::STOP, 2000);
        let crept_m = (later.pose.x_m - stopped.pose.x_m).hypot(later.pose.y_m - stopped.pose.y_m);
        assert!(crept_m < 1e-3, "{crept_m}");
        let again = drive(&mut simulation, motors(0.5, 0.2), 400);
        assert!((again.velocity.forward_m_s - moving.velocity.forward_m_s).abs() < 0.05);
    }
}

#[test]
fn brakes_do_not_hold_on_ground_steeper_than_friction() {
    let mut wheels = with_inertia(&ContactVehicle::of_base("wheels", 0.6, 1.06), 1.0, 0.0);
    wheels.friction.field = FrictionField::Uniform { coefficient: 0.2 };
    wheels.friction.rolling_resistance = 0.0;
    let slid = drive(&mut parked(wheels, true), MotorSpeeds::STOP, 400);
    // Down with g (sin - mu cos) for 2 s.
    let expected_m_s = 2.0 * 9.81 * (15f64.to_radians().sin() - 0.2 * 15f64.to_radians().cos());
    let speed_m_s = slid.velocity.right_m_s.hypot(slid.velocity.forward_m_s);
    assert!(
        (speed_m_s - expected_m_s).abs() < 0.1 * expected_m_s,
        "{speed_m_s} {expected_m_s}"
    );
}

proptest! {
    #[test]
    fn left_and_right_are_mirror_images(traction in -1.0..1.0f64, steer in -1.0..1.0f64,
                                        yaw in -3.0..3.0f64, slope in 0.0..20.0f64) {
        let run = |side: f64| {
            let mut setup = setup(symmetric_j8(), plane(slope));
            setup.start.yaw_rad = side * yaw;
            let mut simulation = Simulation::new(setup).unwrap();
            drive(&mut simulation, motors(traction, side * steer), 200)
        };
        let (left, right) = (run(1.0), run(-1.0));
        prop_assert!((left.pose.x_m + right.pose.x_m).abs() < 1e-9);
        prop_assert!((left.pose.y_m - right.pose.y_m).abs() < 1e-9);
        prop_assert!((left.pose.z_m - right.pose.z_m).abs() < 1e-9);
        prop_assert!((left.pose.yaw_rad + right.pose.yaw_rad).abs() < 1e-9);
        prop_assert!((left.attitude.roll_rad + right.attitude.roll_rad).abs() < 1e-9);
        prop_assert!((left.velocity.right_m_s + right.velocity.right_m_s).abs() < 1e-9);
    }
}

#[test]
fn a_vehicle_that_a_hand_moves_is_there_and_drives_on() {
    let mut simulation = Simulation::new(setup(symmetric_j8(), plane(8.0))).unwrap();
    let before = drive(&mut simulation, motors(0.5, 0.0), 400);
    let from = before.pose.planar();
    let aside = PlanarPose {
        x_m: from.x_m + 1.5,
        y_m: from.y_m + 0.5,
        yaw_rad: from.yaw_rad + 0.3,
    };
    simulation.put(aside).unwrap();
    let put = *simulation.state();
    assert_eq!(put.pose.planar(), aside);
    // The plane rises along Y_g.
    let rise_m = 0.5 * 8_f64.to_radians().tan();
    assert!((put.pose.z_m - before.pose.z_m - rise_m).abs() < 1e-12);
    assert_eq!((put.time_s, put.motors), (before.time_s, before.motors));
    let pose = |simulation: &mut Simulation| simulation.sample().pose.unwrap().value;
    let after = drive(&mut simulation, motors(0.5, 0.0), 1);
    let gone_m = (after.pose.x_m - aside.x_m).hypot(after.pose.y_m - aside.y_m);
    assert!((gone_m - 0.5 * 0.005).abs() < 1e-4, "{gone_m}");
    assert_eq!(pose(&mut simulation), after.pose);
}

#[test]
fn a_vehicle_is_not_put_where_there_is_no_ground() {
    let grid = "ncols 3\nnrows 3\nxllcenter -5\nyllcenter -5\ncellsize 5\n0 0 0\n0 0 0\n0 0 0\n";
    let terrain = Terrain::Grid(crate::terrain::GridTerrain::parse(grid).unwrap());
    let mut simulation = Simulation::new(setup(symmetric_j8(), terrain)).unwrap();
    let before = *simulation.state();
    let beyond = PlanarPose {
        x_m: 50.0,
        ..PlanarPose::default()
    };
    let error = simulation.put(beyond).unwrap_err();
    assert!(matches!(error, SimulationError::Terrain { .. }), "{error}");
    assert_eq!(*simulation.state(), before);
}
