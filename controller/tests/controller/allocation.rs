//! What a cycle allocates on the heap in the steady state.

use crate::rig::{Rig, Setup, course, plane};
use allocation_counter::{AllocationInfo, measure};
use sidehill_controller::config::{AttitudePreview, ControllerKind};
use sidehill_controller::controller::Status;
use sidehill_controller::guard::GuardConfig;
use sidehill_controller::memory::MemoryConfig;
use sidehill_controller::mpc::{ExtraCost, ExtraRow, ExtraTerms, SolvePath};
use sidehill_plant::sensors::SensorsConfig;

fn late_poses() -> SensorsConfig {
    serde_yaml::from_str(
        "{tread_speeds: {timing: {rate_hz: 20}, errors: {noise_std_m_s: 0.005}},
          attitude: {timing: {rate_hz: 20}, errors: {noise_std_deg: 0.1}},
          pose: {timing: {rate_hz: 10, delay_s: 0.12}, errors: {noise_std_m: 0.005}}}",
    )
    .unwrap()
}

/// Allocations of each of 400 cycles after the history of readings has filled.
fn allocations(setup: Setup) -> Vec<AllocationInfo> {
    let cycles = allocations_of(setup.build());
    cycles.into_iter().map(|(info, _)| info).collect()
}

/// Returns what each of 400 cycles allocates, and how its QP was solved.
fn allocations_of(mut rig: Rig) -> Vec<(AllocationInfo, Option<SolvePath>)> {
    for _ in 0..200 {
        rig.cycle();
    }
    (0..400)
        .map(|_| {
            let sample = rig.simulation.sample();
            let mut decision = None;
            let info = measure(|| decision = Some(rig.controller.step(&sample, None)));
            let decision = decision.unwrap();
            assert_eq!(decision.status, Status::Tracking);
            rig.simulation
                .set_command(decision.command_effective)
                .unwrap();
            for _ in 0..10 {
                rig.simulation.step().unwrap();
            }
            (info, decision.solve.map(|report| report.path))
        })
        .collect()
}

fn mpc(sensors: SensorsConfig, preview: AttitudePreview) -> Setup {
    let mut setup = Setup::new(course("{shape: figure_eight}"));
    setup.sensors = sensors;
    setup.config.attitude_preview = preview;
    setup.map = Some(plane(10.0));
    setup
}

#[test]
fn an_mpc_cycle_allocates_nothing() {
    for sensors in [SensorsConfig::default(), late_poses()] {
        for preview in [AttitudePreview::Measured, AttitudePreview::Terrain] {
            for (cycle, info) in allocations(mpc(sensors, preview)).iter().enumerate() {
                assert_eq!(*info, AllocationInfo::default(), "cycle {cycle}");
            }
        }
    }
}

#[test]
fn a_cycle_with_extra_terms_allocates_nothing() {
    let mut rig = mpc(SensorsConfig::default(), AttitudePreview::Measured).build();
    let stages = rig.controller.config().stages;
    let mut cost = ExtraCost::default();
    (cost.weight[3][3], cost.target[3]) = (5.0, 0.3);
    // One binds.
    let rows = [0.25, 0.9].map(|high| ExtraRow {
        by: [0.0, 0.0, 0.0, 1.0, 0.0],
        low: -high,
        high,
    });
    let terms = ExtraTerms::new(vec![cost; stages], rows.repeat(stages)).unwrap();
    rig.controller.set_extra_terms(Some(terms)).unwrap();
    // The interior-point method makes a buffer of its own. It is the last resort.
    let mut last_resort = 0;
    for (cycle, (info, path)) in allocations_of(rig).iter().enumerate() {
        match path {
            Some(SolvePath::InteriorPoint) => last_resort += 1,
            _ => assert_eq!(*info, AllocationInfo::default(), "cycle {cycle}"),
        }
    }
    assert!(last_resort < 20, "{last_resort}");
}

#[test]
fn guard_and_memory_allocate_nothing() {
    for kind in [ControllerKind::IcrikMpc, ControllerKind::PurePursuit] {
        for preview in [AttitudePreview::Measured, AttitudePreview::Terrain] {
            let mut setup = mpc(late_poses(), preview);
            setup.kind = kind;
            setup.config.guard = Some(GuardConfig::default());
            setup.config.memory = Some(MemoryConfig::default());
            // A lap of 20 s: places are learned and driven over again.
            setup.trajectory = course("{shape: circle, radius_m: 1, speed_m_s: 0.5}");
            setup.start = setup.trajectory.at(0.0).pose();
            setup.laps = 9;
            for (cycle, info) in allocations(setup).iter().enumerate() {
                assert_eq!(*info, AllocationInfo::default(), "cycle {cycle}");
            }
        }
    }
}

#[test]
fn a_pure_pursuit_cycle_allocates_nothing() {
    for sensors in [SensorsConfig::default(), late_poses()] {
        let setup = Setup {
            kind: ControllerKind::PurePursuit,
            sensors,
            ..Setup::new(course("{shape: figure_eight}"))
        };
        for info in allocations(setup) {
            assert_eq!(info, AllocationInfo::default());
        }
    }
}
