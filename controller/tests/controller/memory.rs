//! What was learned of a course is used when it is driven again, and by another controller.

use crate::rig::{CIRCLE, Rig, Setup, course};
use sidehill_controller::config::{ControllerConfig, ControllerKind};
use sidehill_controller::memory::{Learned, MemoryConfig, RecallError};

fn rig(kind: ControllerKind, memory: Option<MemoryConfig>) -> Rig {
    Setup {
        kind,
        laps: 3,
        config: ControllerConfig {
            memory,
            ..ControllerConfig::default()
        },
        ..Setup::new(course(CIRCLE))
    }
    .build()
}

/// Whether the same gains were learned, and something of the same places.
fn same(own: &Learned, other: &Learned) -> bool {
    let places = |learned: &Learned| -> Vec<_> {
        let keys = learned.cells.iter().map(|cell| cell.key);
        let mut places: Vec<_> = keys.map(|key| (key.x, key.y, key.sector)).collect();
        places.sort_unstable();
        places
    };
    own.gains == other.gains && places(own) == places(other)
}

/// Drives a lap of the circle; returns the root mean square of the distance from it, m. With `outliers` one pose of ten is
/// a metre beside the vehicle, and one of a hundred is no place at all.
fn lap_m(rig: &mut Rig, outliers: bool) -> f64 {
    let mut squares = 0.0;
    for cycle in 0..1250 {
        let decision = rig.cycle_with(None, |sample| {
            let Some(pose) = sample.pose.as_mut().filter(|_| outliers) else {
                return;
            };
            match cycle % 100 {
                7 => pose.value.x_m = f64::NAN,
                other if other % 10 == 3 => pose.value.x_m += 1.0,
                _ => {}
            }
        });
        squares += decision.progress.unwrap().cross_track_m.powi(2);
    }
    (squares / 1250.0).sqrt()
}

#[test]
fn a_slope_that_the_model_does_not_know_is_learned_by_place_and_recalled() {
    let (kind, with) = (ControllerKind::IcrhkMpc, Some(MemoryConfig::default()));
    let mut without = rig(kind, None);
    let laps_m = [(); 2].map(|()| lap_m(&mut without, false));
    assert!(laps_m[1] > 0.9 * laps_m[0], "{laps_m:?}");
    for outliers in [false, true] {
        let mut own = rig(kind, with);
        let laps_m = [(); 2].map(|()| lap_m(&mut own, outliers));
        assert!(laps_m[1] < 0.25 * laps_m[0], "{laps_m:?}");
        let learned = own.controller.learned().unwrap();
        let mut other = rig(kind, with);
        other.controller.recall(&learned).unwrap();
        assert!(same(&other.controller.learned().unwrap(), &learned));
        let lap = lap_m(&mut other, false);
        assert!(lap < 0.25 * laps_m[0], "{lap} {laps_m:?}");
    }
}

#[test]
fn what_was_learned_belongs_to_its_controller_and_gains_to_one_that_adapts() {
    let memory = MemoryConfig::default();
    let new = |kind, memory| rig(kind, memory).controller;
    let mut learning = rig(ControllerKind::IcrikMpc, Some(memory));
    // Nothing yet.
    assert_eq!(learning.controller.learned().unwrap().gains, None);
    let mut way_m = 0.0;
    for _ in 0..400 {
        way_m = learning.cycle().progress.unwrap().arc_length_m;
    }
    let learned = learning.controller.learned().unwrap();
    let seen = learned.cells.iter().map(|cell| cell.evidence.error_way_m);
    assert!((seen.sum::<f64>() / way_m - 1.0).abs() < 0.1);
    assert!(learned.gains.is_some() && learned.confidence() > 0.0 && !learned.cells.is_empty());
    assert_eq!(
        learning.controller.learned_covariance().unwrap().nrows(),
        15
    );
    let mut room = learning.controller.room_for_learned().unwrap();
    assert_eq!((&room.owner, room.cell_m), (&learned.owner, learned.cell_m));
    assert!(learning.controller.learned_into(&mut room));
    assert!(room == learned);

    assert!(learned.owner.starts_with("j8 ") && learned.owner.ends_with(" icrik-mpc"));
    let mut other = new(ControllerKind::IcrikMpc, Some(memory));
    other.recall(&learned).unwrap();
    assert!(same(&other.learned().unwrap(), &learned));

    let mut flat = rig(ControllerKind::IcrhkMpc, Some(memory));
    flat.cycle();
    assert_eq!(flat.controller.learned_covariance(), None);
    assert_eq!(flat.controller.room_for_learned().unwrap().gains, None);
    assert!(matches!(
        flat.controller.recall(&learned),
        Err(RecallError::Foreign { .. })
    ));
    let mut off = new(ControllerKind::IcrikMpc, None);
    assert_eq!(off.recall(&learned), Err(RecallError::Off));
    assert_eq!((off.learned(), off.room_for_learned()), (None, None));
    let cell_m = 0.3;
    let mut wider = new(
        ControllerKind::IcrikMpc,
        Some(MemoryConfig { cell_m, ..memory }),
    );
    assert!(matches!(wider.recall(&learned), Err(RecallError::Wrong(_))));
}
