//! The recorded routes of the J8 become paths within their stated deviation.

use sidehill_controller::path::{Smoothed, Smoothing, read_gpx, smooth};

fn route(text: &str, options: &Smoothing) -> Smoothed {
    let route = read_gpx(text.as_bytes()).unwrap();
    let smoothed = smooth(&route.points, options).unwrap();
    eprintln!(
        "{} points, {:.1} m, cusps {:?}, deviation max {:.3} rms {:.3}, curvature {:.3}",
        route.points.len(),
        smoothed.path.length_m(),
        smoothed.path.cusps_m().collect::<Vec<_>>(),
        smoothed.deviation_max_m,
        smoothed.deviation_rms_m,
        smoothed.path.max_curvature_per_m()
    );
    smoothed
}

#[test]
fn look() {
    for text in [
        include_str!("../../config/routes/path_1_june_26.gpx"),
        include_str!("../../config/routes/path_2_june_26.gpx"),
        include_str!("../../config/routes/spin.gpx"),
    ] {
        for k in [2.0, 1.0, 0.8, 0.5] {
            let route = read_gpx(text.as_bytes()).unwrap();
            match smooth(
                &route.points,
                &Smoothing {
                    max_curvature_per_m: k,
                    max_deviation_m: 3.0,
                    ..Default::default()
                },
            ) {
                Ok(_) => {
                    route_print(text, k);
                }
                Err(e) => eprintln!("{k}: {e}"),
            }
        }
    }
}
fn route_print(text: &str, k: f64) {
    eprint!("{k}: ");
    route(
        text,
        &Smoothing {
            max_curvature_per_m: k,
            max_deviation_m: 3.0,
            ..Default::default()
        },
    );
}
