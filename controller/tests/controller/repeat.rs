//! A recorded step is repeated bit by bit, also where the deadline ended its solve, and so does a copy go on.

use crate::rig::{CIRCLE, Setup, course};
use sidehill_controller::config::ControllerKind;
use sidehill_controller::controller::Decision;
use std::time::{Duration, Instant};

/// Returns a decision without the time that it took.
fn untimed(mut decision: Decision) -> Decision {
    if let Some(solve) = &mut decision.solve {
        solve.solve_time_s = 0.0;
    }
    decision
}

#[test]
fn a_step_is_repeated_where_the_deadline_cut_it_short() {
    for kind in [ControllerKind::IcrikMpc, ControllerKind::ContactMpc] {
        let setup = || {
            Setup {
                kind,
                ..Setup::new(course(CIRCLE))
            }
            .build()
        };
        let (mut original, mut repeated) = (setup(), setup());
        let mut cut = 0;
        for i in 0..120_u32 {
            // From no time at all to more than enough.
            let patience = Duration::from_micros(u64::from(i % 8) * 20);
            let deadline = (i % 3 != 0).then(|| Instant::now() + patience);
            let mut given = None;
            let first = original.cycle_with(deadline, |sample| given = Some(*sample));
            let cut_at = original.controller.was_cut_at();
            cut += u32::from(cut_at.is_some());
            let again = repeated.controller.repeat_step(&given.unwrap(), cut_at);
            assert_eq!(
                untimed(first),
                untimed(again),
                "cycle {i}, cut at {cut_at:?}"
            );
            assert_eq!(repeated.controller.was_cut_at(), cut_at);
        }
        assert!(cut > 10, "only {cut} solves were cut short");
    }
}

#[test]
fn a_copy_goes_on_bit_by_bit_as_the_original_does() {
    for kind in ControllerKind::ALL {
        let mut original = Setup {
            kind,
            config: serde_yaml::from_str("{memory: {}, guard: {}}").unwrap(),
            ..Setup::new(course(
                "{shape: figure_eight, half_width_m: 2.4, half_length_m: 3.9, period_s: 40}",
            ))
        }
        .build();
        for _ in 0..90 {
            original.cycle();
        }
        let mut copy = original.clone();
        for i in 0..60 {
            let (first, again) = (original.cycle(), copy.cycle());
            assert_eq!(untimed(first), untimed(again), "{kind:?}, cycle {i}");
            assert_eq!(original.simulation.state(), copy.simulation.state());
        }
        // A copy of a copy, and deadlines.
        let mut copy = copy.clone();
        for i in 0..60_u32 {
            let patience = Duration::from_micros(u64::from(i % 8) * 20);
            let mut given = None;
            let deadline = Instant::now() + patience;
            let first = original.cycle_with(Some(deadline), |sample| given = Some(*sample));
            let cut_at = original.controller.was_cut_at();
            let again = copy.controller.repeat_step(&given.unwrap(), cut_at);
            assert_eq!(untimed(first), untimed(again), "{kind:?}, cycle {i}");
        }
    }
}
