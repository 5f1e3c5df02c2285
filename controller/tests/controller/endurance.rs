//! Long drives neither drift nor depend on anything but their inputs.

use crate::rig::{Setup, course};
use sidehill_controller::config::ControllerKind;
use sidehill_controller::controller::{Decision, Status};

#[test]
fn a_hundred_thousand_cycles_go_round_as_the_first_ones_do() {
    const CYCLES: u32 = 100_000;
    let mut setup = Setup::new(course("{shape: circle, radius_m: 4, speed_m_s: 0.4}"));
    setup.laps = 1000;
    setup.steps_per_cycle = 2;
    let period_s = setup.config.period_s;
    // The circle goes round counter-clockwise from its easternmost point.
    let centre = (setup.start.x_m - 4.0, setup.start.y_m);
    let mut rig = setup.build();
    let mut largest_m = [0.0_f64; 10];
    for cycle in 0..CYCLES {
        let decision = rig.cycle();
        assert_eq!(decision.status, Status::Tracking, "cycle {cycle}");
        assert_eq!(decision.time_s, f64::from(2 * cycle) * (period_s / 2.0));
        assert_eq!(decision.time_s, f64::from(cycle) * period_s);
        let progress = decision.progress.unwrap();
        if cycle >= 200 {
            let part = (cycle / (CYCLES / 10)) as usize;
            largest_m[part] = largest_m[part].max(progress.cross_track_m.abs());
        }
        // The laps are counted as the vehicle drives them.
        let laps =
            progress.arc_length_m / rig.controller.reference().unwrap().trajectory().length_m();
        let pose = rig.simulation.state().pose;
        let angle = (pose.y_m - centre.1).atan2(pose.x_m - centre.0) / std::f64::consts::TAU;
        let off = (laps - angle).rem_euclid(1.0);
        assert!(off.min(1.0 - off) < 0.01, "cycle {cycle}: {laps} {angle}");
    }
    assert!(largest_m.iter().all(|&m| m < 0.01), "{largest_m:?}");
    assert!(largest_m[9] < 1.2 * largest_m[1], "{largest_m:?}");
}

#[test]
fn two_runs_are_equal_in_every_bit() {
    let run = |kind| -> Vec<(Decision, [u64; 2])> {
        let mut setup = Setup::new(course("{shape: figure_eight}"));
        setup.kind = kind;
        setup.sensors = serde_yaml::from_str(
            "{tread_speeds: {timing: {rate_hz: 20}, errors: {noise_std_m_s: 0.01}},
              attitude: {timing: {rate_hz: 20, dropout_probability: 0.05}, errors: {noise_std_deg: 0.2}},
              pose: {timing: {rate_hz: 10, delay_s: 0.08}, errors: {noise_std_m: 0.01, noise_std_yaw_deg: 0.3}}}",
        )
        .unwrap();
        setup.drive_train =
            serde_yaml::from_str("{traction: {time_constant_s: 0.1}, delay_s: 0.05}").unwrap();
        setup.config.command_delay_s = 0.05;
        let mut rig = setup.build();
        (0..600)
            .map(|_| {
                let mut decision = rig.cycle();
                if let Some(solve) = &mut decision.solve {
                    solve.solve_time_s = 0.0;
                }
                let command = decision.command_effective;
                let bits = [command.traction_m_s.to_bits(), command.steer_m_s.to_bits()];
                (decision, bits)
            })
            .collect()
    };
    for kind in ControllerKind::ALL {
        let (first, second) = (run(kind), run(kind));
        for (cycle, (a, b)) in first.iter().zip(&second).enumerate() {
            assert_eq!(a, b, "{kind:?}, cycle {cycle}");
        }
        assert!(
            first
                .iter()
                .any(|(decision, _)| decision.status == Status::Tracking)
        );
    }
}
