use super::*;
use crate::contact::{ContactModel, ContactVehicle};
use crate::log::DriveLog;
use crate::motion::IcrMotion;
use crate::terrain::Terrain;
use crate::vehicle::Vehicle;

fn j8() -> Vehicle {
    serde_yaml::from_str(include_str!("../../../config/vehicles/j8.yaml")).unwrap()
}

/// What somebody knows beforehand who has measured the vehicle's base only.
fn before() -> Vehicle {
    let mut vehicle = j8();
    vehicle.correction.left = 1.0;
    vehicle.correction.right = 1.0;
    vehicle.icrs.left_m = -0.7;
    vehicle.icrs.right_m = 0.7;
    vehicle.icrs.forward_m = 0.0;
    vehicle.slide.shift_s_per_rad = 0.5;
    vehicle.slide.aggravated_s_per_rad = 0.5;
    vehicle
}

fn settings(length_s: f64) -> IdentificationSettings {
    IdentificationSettings {
        segmentation: Segmentation::of_length(length_s).unwrap(),
        attitude_smoothing_s: 0.2,
    }
}

fn level_log(seed: u64, noise: &LogNoise) -> DriveLog {
    let procedure = Procedure::of_the_paper();
    let on_level = Drive {
        motion: Box::new(IcrMotion {
            vehicle: j8(),
            inclined: true,
        }),
        correction: j8().correction,
        terrain: Terrain::Level,
        legs: &procedure.level,
    };
    drive(on_level, noise, seed).unwrap()
}

fn slope_log(seed: u64, noise: &LogNoise) -> DriveLog {
    let procedure = Procedure::of_the_paper();
    let on_slope = Drive {
        motion: Box::new(IcrMotion {
            vehicle: j8(),
            inclined: true,
        }),
        correction: j8().correction,
        terrain: procedure.slope_terrain().unwrap(),
        legs: &procedure.slope,
    };
    drive(on_slope, noise, 1000 + seed).unwrap()
}

#[test]
fn explore() {
    let noise = LogNoise::usual();
    for length in [2.0, 4.0, 6.0, 10.0] {
        let t = std::time::Instant::now();
        let mut worst = [0.0_f64; 7];
        let mut sum = [0.0_f64; 7];
        let mut inside = [0; 7];
        let n = 6;
        for seed in 0..n {
            let (level, a) =
                identify_level(&[level_log(seed, &noise)], &before(), &settings(length)).unwrap();
            let (both, b) =
                identify_slope(&[slope_log(seed, &noise)], &level, &settings(length)).unwrap();
            let truth = [1.004, 1.011, -0.980, 1.073, 0.206, 1.222, 4.965];
            for (i, e) in a.estimates.iter().chain(&b.estimates).enumerate() {
                let err = e.value / truth[i] - 1.0;
                worst[i] = worst[i].max(err.abs());
                sum[i] += err / n as f64;
                inside[i] += u32::from((e.value - truth[i]).abs() < e.half_width.unwrap());
            }
            if seed == 0 {
                println!("{a:#?} {b:#?}");
            }
            let _ = both;
        }
        println!(
            "length {length} worst {worst:.4?} mean {sum:.4?} inside {inside:?} {:?}",
            t.elapsed()
        );
    }
    let contact: ContactVehicle =
        serde_yaml::from_str(include_str!("../../../config/vehicles/j8_contact.yaml")).unwrap();
    let _ = ContactModel::new(contact);
}
