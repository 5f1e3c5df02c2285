//! Costs and constraints that are added to those of tracking.

use crate::rig::{CIRCLE, KINDS, Rig, Setup, course, plane};
use sidehill_controller::config::ControllerKind;
use sidehill_controller::controller::{Status, StopReason};
use sidehill_controller::mpc::{ExtraCost, ExtraError, ExtraRow, ExtraTerms, QpFailure};

const MPCS: [ControllerKind; 4] = [
    ControllerKind::IcrikMpc,
    ControllerKind::IcrhkMpc,
    ControllerKind::DiffdriveMpc,
    ControllerKind::ContactMpc,
];

/// A vehicle at the start of a circle.
fn rig(kind: ControllerKind) -> Rig {
    Setup {
        kind,
        ..Setup::new(course(CIRCLE))
    }
    .build()
}

/// Terms with a cost that is the same in each stage and a row that is free in the first stages.
fn terms(rig: &Rig, cost: ExtraCost, free: usize, row: ExtraRow) -> ExtraTerms {
    let stages = rig.controller.config().stages;
    let rows = (0..stages).map(|stage| {
        let wide = ExtraRow {
            low: f64::NEG_INFINITY,
            high: f64::INFINITY,
            ..row
        };
        if stage < free { wide } else { row }
    });
    ExtraTerms::new(vec![cost; stages], rows.collect()).unwrap()
}

fn traction_at_most(high: f64) -> ExtraRow {
    ExtraRow {
        by: [0.0, 0.0, 0.0, 1.0, 0.0],
        low: f64::NEG_INFINITY,
        high,
    }
}

#[test]
fn every_mpc_keeps_to_a_wall_and_to_a_limit_of_speed() {
    for kind in MPCS {
        let mut rig = rig(kind);
        let start = rig.simulation.state().pose;
        let mut free = rig.clone();
        // The circle turns left and comes to x of its start less its diameter; the wall stands in its way.
        let wall_m = start.x_m - 1.0;
        let wall = ExtraRow {
            by: [1.0, 0.0, 0.0, 0.0, 0.0],
            low: wall_m,
            high: f64::INFINITY,
        };
        let added = terms(&rig, ExtraCost::default(), 3, wall);
        rig.controller.set_extra_terms(Some(added)).unwrap();
        let (mut nearest_m, mut crossed) = (f64::INFINITY, false);
        for cycle in 0..320 {
            let decision = rig.cycle();
            assert_eq!(decision.status, Status::Tracking, "{kind:?}, cycle {cycle}");
            nearest_m = nearest_m.min(rig.simulation.state().pose.x_m - wall_m);
            free.cycle();
            crossed |= free.simulation.state().pose.x_m < wall_m - 0.3;
        }
        assert!(crossed, "{kind:?}: nothing leads across the wall");
        assert!(nearest_m > 0.0, "{kind:?}: {nearest_m}");
        // The flat model does not know of the slide.
        let most_m = if kind == ControllerKind::DiffdriveMpc {
            0.4
        } else {
            0.2
        };
        assert!(nearest_m < most_m, "{kind:?}: {nearest_m}");

        let mut rig = free;
        let added = terms(&rig, ExtraCost::default(), 0, traction_at_most(0.35));
        rig.controller.set_extra_terms(Some(added)).unwrap();
        for cycle in 0..40 {
            let decision = rig.cycle();
            assert_eq!(decision.status, Status::Tracking, "{kind:?}, cycle {cycle}");
            let traction = decision.command_effective.traction_m_s;
            assert!(traction < 0.35 + 1e-4, "{kind:?}: {traction}");
        }
        rig.controller.set_extra_terms(None).unwrap();
        (0..40).for_each(|_| _ = rig.cycle());
        assert!(rig.command.traction_m_s > 0.37, "{:?}", rig.command);
    }
}

#[test]
fn every_mpc_drives_where_an_extra_cost_leads() {
    for kind in MPCS {
        let mut setup = Setup::new(course(CIRCLE));
        (setup.kind, setup.terrain) = (kind, plane(0.0));
        let mut rig = setup.build();
        let mut cost = ExtraCost::default();
        cost.weight[3][3] = 1e4;
        cost.target[3] = 0.15;
        let wide = traction_at_most(f64::INFINITY);
        let added = terms(&rig, cost, 0, wide);
        rig.controller.set_extra_terms(Some(added)).unwrap();
        for _ in 0..60 {
            assert_eq!(rig.cycle().status, Status::Tracking, "{kind:?}");
        }
        let traction = rig.command.traction_m_s;
        assert!((traction - 0.15).abs() < 0.01, "{kind:?}: {traction}");
    }
}

#[test]
fn rows_that_no_plan_meets_stop_the_vehicle() {
    for kind in MPCS {
        let mut rig = rig(kind);
        (0..40).for_each(|_| _ = rig.cycle());
        let mut impossible = traction_at_most(9.0);
        impossible.low = 8.0;
        let added = terms(&rig, ExtraCost::default(), 5, impossible);
        rig.controller.set_extra_terms(Some(added)).unwrap();
        let reason = QpFailure::Infeasible;
        for cycles in 1..=10 {
            let decision = rig.cycle();
            assert_eq!(decision.status, Status::Fallback { reason, cycles });
        }
        let stop = StopReason::NoSolution { cycles: 11, reason };
        assert_eq!(rig.cycle().status, Status::Stopping(stop), "{kind:?}");
        let (_, stopped) = rig.until_standing(20);
        assert_eq!(stopped.status, Status::Stopping(stop));
    }
}

#[test]
fn a_law_without_a_plan_refuses_them() {
    let mut rig = rig(KINDS[1]);
    assert_eq!(
        rig.controller.set_extra_terms(None),
        Err(ExtraError::NoPlan)
    );
}
