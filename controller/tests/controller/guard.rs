//! The steepness guard in the loop: what it does to a drive towards ground that is too steep.

use crate::rig::{KINDS, Rig, Setup, course};
use sidehill_controller::config::{AttitudePreview, ControllerKind};
use sidehill_controller::controller::{Status, StopReason};
use sidehill_controller::guard::GuardConfig;
use sidehill_plant::terrain::Terrain;

/// Where the ground becomes too steep, m along the path.
const STEEP_FROM_M: f64 = 6.0;

/// A vehicle on level ground that drives straight towards ground of 28 deg, with a map, which is looked at or not.
fn towards_steep_ground(kind: ControllerKind, preview: AttitudePreview) -> Rig {
    setup(kind, preview).build()
}

fn setup(kind: ControllerKind, preview: AttitudePreview) -> Setup {
    let ground =
        "{transition_m: 1, zones: [{start_m: 0, slope_deg: 0}, {start_m: 6.5, slope_deg: 28}]}";
    let ground = Terrain::Zones(serde_yaml::from_str(ground).unwrap());
    let mut setup = Setup::new(course("{shape: straight, length_m: 12, speed_m_s: 0.6}"));
    setup.kind = kind;
    setup.terrain = ground.clone();
    setup.map = Some(ground);
    setup.config.guard = Some(GuardConfig {
        friction: 0.5,
        ..GuardConfig::default()
    });
    setup.config.attitude_preview = preview;
    setup
}

/// Drives until the vehicle is stopped; returns why, where along the path, and its speed then and at most.
fn until_stopped(rig: &mut Rig) -> (StopReason, f64, f64, f64) {
    let mut fastest_m_s = 0.0_f64;
    for _ in 0..1200 {
        let before_m_s = rig.command.traction_m_s;
        let decision = rig.cycle();
        if let Status::Stopping(reason) = decision.status {
            let at_m = decision.progress.unwrap().arc_length_m;
            return (reason, at_m, before_m_s, fastest_m_s);
        }
        fastest_m_s = fastest_m_s.max(rig.command.traction_m_s);
    }
    panic!("not stopped");
}

#[test]
fn a_vehicle_slows_down_to_steep_ground_on_its_map_and_stops_before_it() {
    for kind in KINDS {
        let mut rig = towards_steep_ground(kind, AttitudePreview::Terrain);
        let (reason, at_m, speed_m_s, fastest_m_s) = until_stopped(&mut rig);
        assert!(
            matches!(reason, StopReason::TooSteep { .. }),
            "{kind:?} {reason:?}"
        );
        assert!(
            (STEEP_FROM_M - 1.5..STEEP_FROM_M + 0.5).contains(&at_m),
            "{kind:?} {at_m}"
        );
        assert!(speed_m_s < 0.3, "{kind:?} {speed_m_s}");
        assert!((0.5..0.65).contains(&fastest_m_s), "{kind:?} {fastest_m_s}");
    }
}

#[test]
fn a_map_that_is_not_to_be_looked_at_does_not_stop_the_vehicle_before_it_is_there() {
    let mut rig = towards_steep_ground(ControllerKind::IcrikMpc, AttitudePreview::Measured);
    let (_, at_m, speed_m_s, _) = until_stopped(&mut rig);
    assert!(at_m > STEEP_FROM_M, "{at_m}");
    assert!(speed_m_s > 0.3, "{speed_m_s}");
}

#[test]
fn a_vehicle_that_brakes_harder_slows_down_later() {
    let slows_at_m = |rate_m_s2: f64| {
        let mut setup = setup(ControllerKind::IcrikMpc, AttitudePreview::Terrain);
        let traction = &mut setup.config.limits.traction;
        (traction.acceleration_m_s2, traction.deceleration_m_s2) = (rate_m_s2, rate_m_s2);
        let mut rig = setup.build();
        let mut fast = false;
        for _ in 0..1200 {
            let at_m = rig.cycle().progress.unwrap().arc_length_m;
            fast |= rig.command.traction_m_s > 0.55;
            if fast && rig.command.traction_m_s < 0.5 {
                return at_m;
            }
        }
        panic!("not slowed down");
    };
    let (early_m, late_m) = (slows_at_m(0.6), slows_at_m(2.4));
    // From 0.6 m/s to 0.5 m/s at a quarter of the rates.
    assert!(
        late_m > early_m + 0.3 && late_m < early_m + 1.5,
        "{early_m} {late_m}"
    );
}
