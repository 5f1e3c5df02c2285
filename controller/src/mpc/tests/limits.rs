//! Commands never leave bounds and rates, and stops end.

use super::*;

fn motor() -> impl Strategy<Value = MotorLimits> {
    (0.2..2.0_f64, 0.3..4.0_f64, 0.3..4.0_f64).prop_map(|(speed, acceleration, deceleration)| {
        MotorLimits {
            speed_m_s: speed,
            acceleration_m_s2: acceleration,
            deceleration_m_s2: deceleration,
        }
    })
}

fn vehicle_limits() -> impl Strategy<Value = InputLimits> {
    (motor(), motor(), 0.3..3.0_f64).prop_map(|(traction, steer, tread_speed_m_s)| InputLimits {
        traction,
        steer,
        tread_speed_m_s,
    })
}

/// Time a motor needs from one speed to another: towards standstill at its deceleration, away from
/// it at its acceleration.
fn time_needed_s(limits: &MotorLimits, from_m_s: f64, to_m_s: f64) -> f64 {
    let (from, to) = (from_m_s.abs(), to_m_s.abs());
    if from_m_s * to_m_s < 0.0 {
        from / limits.deceleration_m_s2 + to / limits.acceleration_m_s2
    } else if to > from {
        (to - from) / limits.acceleration_m_s2
    } else {
        (from - to) / limits.deceleration_m_s2
    }
}

/// Returns a point within motors' and treads' bounds: `x` and `y` from -1 to 1 span them.
fn within(limits: &InputLimits, x: f64, y: f64) -> MotorSpeeds {
    let steer_m_s = y * limits.steer.speed_m_s.min(limits.tread_speed_m_s);
    let traction_max = limits
        .traction
        .speed_m_s
        .min(limits.tread_speed_m_s - steer_m_s.abs());
    motors(x * traction_max, steer_m_s)
}

fn assert_within_bounds(limits: &InputLimits, command: MotorSpeeds) {
    let (traction, steer) = (command.traction_m_s.abs(), command.steer_m_s.abs());
    assert!(traction <= limits.traction.speed_m_s + 1e-12, "{command:?}");
    assert!(steer <= limits.steer.speed_m_s + 1e-12, "{command:?}");
    assert!(
        traction + steer <= limits.tread_speed_m_s + 1e-12,
        "{command:?} in {limits:?}"
    );
}

proptest! {
    #[test]
    fn what_a_motor_can_reach_is_what_its_rates_allow(
        limits in motor(),
        from in -2.0..2.0_f64,
        wanted in -3.0..3.0_f64,
        time_s in 0.01..0.5_f64,
    ) {
        let reached = limits.project(wanted, from, time_s);
        let needed_s = time_needed_s(&limits, from, reached);
        prop_assert!(needed_s <= time_s + 1e-9, "{needed_s} s");
        if time_needed_s(&limits, from, wanted) <= time_s - 1e-9 {
            prop_assert!((reached - wanted).abs() < 1e-12);
        } else {
            prop_assert!((needed_s - time_s).abs() < 1e-9, "all of the time is used");
            prop_assert!((reached - from) * (wanted - from) >= 0.0);
        }
        let change = limits.change(from, time_s);
        prop_assert!(change.fall >= 0.0 && change.rise >= 0.0);
        let mirrored = limits.change(-from, time_s);
        if from != 0.0 {
            prop_assert_eq!(change.fall, mirrored.rise);
            prop_assert_eq!(change.rise, mirrored.fall);
        }
    }

    #[test]
    fn commands_stay_within_bounds_and_rates(
        limits in vehicle_limits(),
        start in (-1.0..1.0_f64, -1.0..1.0_f64),
        wishes in prop::collection::vec((-4.0..4.0_f64, -4.0..4.0_f64), 1..20),
        time_s in 0.01..0.2_f64,
    ) {
        let mut command = within(&limits, start.0, start.1);
        for (traction, steer) in wishes {
            let next = limits.project(motors(traction, steer), command, time_s);
            assert_within_bounds(&limits, next);
            for (limits, from, to) in [
                (&limits.traction, command.traction_m_s, next.traction_m_s),
                (&limits.steer, command.steer_m_s, next.steer_m_s),
            ] {
                prop_assert!(time_needed_s(limits, from, to) <= time_s + 1e-9);
            }
            command = next;
        }
    }

    #[test]
    fn what_is_within_bounds_and_in_reach_is_not_changed(
        limits in vehicle_limits(),
        x in -1.0..1.0_f64,
        y in -1.0..1.0_f64,
    ) {
        let wanted = within(&limits, x, y);
        let bounded = limits.within_bounds(wanted);
        prop_assert!((bounded.traction_m_s - wanted.traction_m_s).abs() < 1e-12);
        prop_assert!((bounded.steer_m_s - wanted.steer_m_s).abs() < 1e-12);
        prop_assert_eq!(limits.project(bounded, bounded, 0.05), bounded);
    }

    #[test]
    fn a_stop_ends_when_the_decelerations_say(
        limits in vehicle_limits(),
        x in -1.0..1.0_f64,
        y in -1.0..1.0_f64,
        time_s in 0.01..0.2_f64,
    ) {
        let start = within(&limits, x, y);
        let cycles = |speed: f64, deceleration: f64| speed.abs() / (deceleration * time_s);
        let exact = cycles(start.traction_m_s, limits.traction.deceleration_m_s2)
            .max(cycles(start.steer_m_s, limits.steer.deceleration_m_s2));
        let mut command = start;
        let mut count = 0_u32;
        while command != MotorSpeeds::STOP {
            let next = limits.stop_step(command, time_s);
            assert_within_bounds(&limits, next);
            prop_assert!(next.traction_m_s.abs() <= command.traction_m_s.abs());
            prop_assert!(next.steer_m_s.abs() <= command.steer_m_s.abs());
            prop_assert!(next.traction_m_s * start.traction_m_s >= 0.0);
            prop_assert!(next.steer_m_s * start.steer_m_s >= 0.0);
            for (limits, from, to) in [
                (&limits.traction, command.traction_m_s, next.traction_m_s),
                (&limits.steer, command.steer_m_s, next.steer_m_s),
            ] {
                prop_assert!(time_needed_s(limits, from, to) <= time_s + 1e-9);
            }
            command = next;
            count += 1;
            prop_assert!(f64::from(count) < exact + 1.0 + 1e-6, "{count} cycles, {exact}");
        }
        prop_assert!(f64::from(count) >= exact - 1e-6, "{count} cycles, {exact}");
        prop_assert_eq!(limits.stop_step(command, time_s), MotorSpeeds::STOP);
    }
}

#[test]
fn a_tread_at_its_limit_is_not_overdriven_by_a_traction_that_brakes_slowly() {
    let motor = |acceleration_m_s2, deceleration_m_s2| MotorLimits {
        speed_m_s: 1.0,
        acceleration_m_s2,
        deceleration_m_s2,
    };
    let limits = InputLimits {
        traction: motor(2.0, 0.5),
        steer: motor(2.0, 2.0),
        tread_speed_m_s: 1.2,
    };
    let next = limits.project(motors(0.2, 1.0), motors(1.0, 0.2), 0.1);
    assert!((next.traction_m_s - 0.95).abs() < 1e-12, "{next:?}");
    assert!((next.steer_m_s - 0.25).abs() < 1e-12, "{next:?}");
}

#[test]
fn limits_out_of_range_are_named() {
    let mut limits = input_limits(1.5);
    assert!(limits.validate().is_ok());
    limits.steer.deceleration_m_s2 = f64::NAN;
    assert_eq!(
        limits.validate().unwrap_err().key,
        "limits.steer.deceleration_m_s2"
    );
    let mut limits = input_limits(0.0);
    assert_eq!(limits.validate().unwrap_err().key, "limits.tread_speed_m_s");
    limits.traction.speed_m_s = -1.0;
    assert_eq!(
        limits.validate().unwrap_err().key,
        "limits.traction.speed_m_s"
    );
}
