//! Two programs on a real CAN bus. `.ci/vcan` runs these tests under a kernel that has one.

mod vcan_support;

use std::time::Duration;
use vcan_support::*;

#[test]
#[ignore = "needs a CAN bus: run .ci/vcan"]
fn a_vehicle_and_a_controller_follow_the_figure_of_eight() {
    let folder = Folder::new("figure_eight");
    let vehicle = Program::vehicle(&folder, "");
    let run = Program::run(&folder, "", &["--arm"]);
    let ending = run.wait(Duration::from_secs(90));
    drop(vehicle);
    println!("{ending}");
    assert_eq!(ending["ended"], "finished");

    let rms_m = cross_track_rms_m(&folder.truth());
    println!("cross-track RMS {:.4} m", rms_m);
    assert!(rms_m <= 0.02, "{rms_m}");
    // The bound is the kernel's own lateness: 24 ms were measured under two busy processes.
    let number = |key: &str| ending[key].as_f64().unwrap();
    println!(
        "lateness p50 {:.2} ms, p99 {:.2} ms, max {:.2} ms; least slack {:.2} ms, skipped {}",
        1e3 * number("lateness_p50_s"),
        1e3 * number("lateness_p99_s"),
        1e3 * number("lateness_max_s"),
        1e3 * number("slack_min_s"),
        ending["skipped"],
    );
    assert_eq!(ending["skipped"], 0);
    assert_eq!(ending["unsent"], 0);
    decode_with_cantools(&folder);
}
