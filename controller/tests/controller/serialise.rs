//! What a cycle takes and gives survives serialisation, whatever the cycle's status is.

use crate::rig::{CIRCLE, KINDS, Setup, course, driving};
use serde::Serialize;
use serde::de::DeserializeOwned;
use sidehill_controller::controller::{Decision, Status};
use std::fmt::Debug;
use std::time::Instant;

fn assert_survives<T: Serialize + DeserializeOwned + PartialEq + Debug>(value: &T) {
    let json = serde_json::to_value(value).unwrap();
    let back: T = serde_json::from_value(json.clone()).unwrap_or_else(|e| panic!("{e}: {json}"));
    assert_eq!(&back, value, "{json}");
}

fn name(decision: &Decision) -> String {
    serde_json::to_string(&decision.status).unwrap()
}

#[test]
fn a_decision_of_every_status_survives() {
    for kind in KINDS {
        let mut rig = Setup {
            kind,
            ..Setup::new(course(CIRCLE))
        }
        .build();
        let waiting = rig.cycle_with(None, |sample| {
            sample.pose = None;
            sample.attitude = None;
            sample.tread_speeds = None;
            assert_survives(sample);
        });
        assert_eq!(waiting.status, Status::Waiting);
        assert_survives(&waiting);
        // A pose and an attitude, but no tread speeds yet: they are waited for.
        let waiting = rig.cycle_with(None, |sample| sample.tread_speeds = None);
        assert_eq!(waiting.status, Status::Waiting);
        let mut ageless = rig.cycle_with(None, |_| ());
        assert_eq!(ageless.status, Status::Tracking);
        ageless.estimate.as_mut().unwrap().speeds_age_s = f64::INFINITY;
        assert_survives(&ageless);
    }
    let mut rig = driving(KINDS[0]);
    let tracking = rig.cycle_with(None, |sample| assert_survives(sample));
    assert!(name(&tracking) == "\"tracking\"");
    assert_survives(&tracking);
    let fallback = rig.cycle_with(Some(Instant::now()), |_| ());
    assert!(name(&fallback).contains("deadline"), "{}", name(&fallback));
    assert_survives(&fallback);
    rig.controller.forget_path();
    let stopping = rig.cycle();
    assert!(name(&stopping).contains("no_path"), "{}", name(&stopping));
    assert_survives(&stopping);
}
