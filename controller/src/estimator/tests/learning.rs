//! What contact-mpc's estimator learns of a vehicle, and what it leaves at its prior.

use super::super::learned::LearnedModel;
use super::consistency::learned_contact;
use super::*;
use sidehill_plant::contact::Parameter;
use sidehill_plant::frames::BodyVelocity;

#[test]
fn what_is_not_excited_stays_at_its_prior_and_says_so() {
    let settings = settings();
    let mut filter = Filter::new(settings, learned_contact(settings.contact));
    let straight = TreadSpeeds {
        left_m_s: 0.4,
        right_m_s: 0.4,
    };
    let mut estimate = None;
    for cycle in 0..400 {
        let time_s = 0.05 * f64::from(cycle);
        let pose = PlanarPose {
            y_m: 0.4 * time_s,
            ..PlanarPose::default()
        };
        estimate = filter
            .update(&Sample {
                time_s,
                tread_speeds: stamped(time_s, Vehicle::j8().encoder_scale.invert(straight)),
                attitude: stamped(time_s, Attitude::LEVEL),
                yaw_rate: None,
                pose: stamped(time_s, pose_at(&pose)),
            })
            .0;
    }
    let learned = estimate.unwrap().contact.unwrap();
    // On level ground, straight ahead, a height or a share of friction moves nothing.
    for parameter in [
        Parameter::CentreHeight,
        Parameter::LateralShare,
        Parameter::InnerShare,
        Parameter::InnerStiffness,
    ] {
        let i = parameter.index();
        assert!(
            learned.sigma[i] > 0.99 * learned.prior_sigma[i],
            "{parameter:?}"
        );
        assert!(
            learned.sigma[i] <= 1.000_001 * learned.prior_sigma[i],
            "{parameter:?}"
        );
    }
}

#[test]
fn friction_is_forgotten_by_the_metres_driven_and_the_centre_of_mass_by_those_steered() {
    let settings = ContactLearningSettings::default();
    let model = learned_contact(settings);
    let straight = TreadSpeeds {
        left_m_s: 0.5,
        right_m_s: 0.5,
    };
    let turn = TreadSpeeds {
        left_m_s: -0.5,
        right_m_s: 0.5,
    };
    let prior = model.prior();
    for (treads, of_friction, of_centre) in [
        (straight, settings.friction_forgetting_per_m, 0.0),
        (
            turn,
            settings.friction_forgetting_per_m + settings.forgetting_per_m,
            settings.forgetting_per_m,
        ),
    ] {
        // 5 cm.
        let drift = model.drift(treads, 0.1);
        for (parameter, per_m) in [
            (Parameter::Friction, of_friction),
            (Parameter::CentreRight, of_centre),
        ] {
            let i = parameter.index();
            let share = 0.05 * per_m;
            let variance = drift.variance[i] / prior.sigma[i].powi(2);
            assert!(
                (variance - share).abs() < 1e-12,
                "{parameter:?}: {variance}"
            );
            assert!((drift.keep[i].powi(2) - (1.0 - share)).abs() < 1e-12);
        }
    }
}

/// Traction and steer of a vehicle that weaves, m/s.
const WEAVING: fn(f64) -> (f64, f64) = |time_s| (0.4, 0.2 * (0.9 * time_s).sin());

/// Returns what is learned by poses every 50 ms in `duration_s` on a slope of 8 deg of a vehicle some of whose parameters are not those of the
/// prior; `speeds` are traction and steer over time.
fn learned_of(
    differing: &[(Parameter, f64)],
    duration_s: f64,
    speeds: impl Fn(f64) -> (f64, f64),
) -> ContactEstimate {
    let settings = settings();
    let mut model = learned_contact(settings.contact);
    let mut filter = Filter::new(settings, model.clone());
    let mut parameters = model.prior().mean;
    for (parameter, value) in differing {
        parameters[parameter.index()] = parameter.entry(*value);
    }
    let normal = Vector3::new(0.0, -8.0_f64.to_radians().sin(), 8.0_f64.to_radians().cos());
    let mut pose = PlanarPose::default();
    let mut learned = None;
    let mut moving = None;
    for cycle in 0..=(duration_s / 0.05).round() as u32 {
        let time_s = 0.05 * f64::from(cycle);
        let (traction_m_s, steer_m_s) = speeds(time_s);
        let said = TreadSpeeds {
            left_m_s: traction_m_s - steer_m_s,
            right_m_s: traction_m_s + steer_m_s,
        };
        let attitude = Attitude::on_plane(&normal, pose.yaw_rad);
        if cycle > 0 {
            let before = moving.unwrap_or_else(|| {
                let rest = TreadSpeeds::default();
                model.velocity(attitude, rest, &parameters).into()
            });
            let moved = model.moved(attitude, said, &parameters, &before, 0.05);
            moving = Some(moved.end);
            let velocity = BodyVelocity::from_vector(&moved.mean.value);
            let rate = pose_rate(&velocity, &attitude, pose.yaw_rad);
            pose.x_m += 0.05 * rate.x_m_s;
            pose.y_m += 0.05 * rate.y_m_s;
            pose.yaw_rad += 0.05 * rate.yaw_rad_s;
        }
        let sample = Sample {
            time_s,
            tread_speeds: stamped(time_s, model.encoder_scale().invert(said)),
            attitude: stamped(time_s, Attitude::on_plane(&normal, pose.yaw_rad)),
            yaw_rate: None,
            pose: stamped(time_s, pose_at(&pose)),
        };
        learned = filter.update(&sample).0.and_then(|e| e.contact);
    }
    learned.unwrap()
}

/// Treads that move at 70 and 75 % of what encoders say.
#[test]
fn factors_of_treads_that_slip_are_learned() {
    let truth = [(Parameter::LeftTread, 0.7), (Parameter::RightTread, 0.75)];
    let learned = learned_of(&truth, 20.0, WEAVING);
    for (parameter, factor) in truth {
        let (found, _) = learned.interval(parameter);
        assert!((found - factor).abs() < 0.02, "{parameter:?}: {found}");
        assert!(learned.observed(parameter), "{parameter:?}");
    }
}

#[test]
fn the_radius_of_a_patch_is_learned_on_the_spot_and_not_by_gentle_weaving() {
    let patch = Parameter::PatchRadius;
    let (guess_m, _) = learned_of(&[], 0.0, WEAVING).interval(patch);
    let on_the_spot = |time_s: f64| (0.0, 0.5 * (0.3 * time_s).sin());
    for radius_m in [0.0, 0.14] {
        let truth = [(patch, radius_m)];
        let learned = learned_of(&truth, 60.0, on_the_spot);
        assert!(learned.observed(patch), "{learned:?}");
        let (found_m, (low_m, high_m)) = learned.interval(patch);
        assert!((low_m..=high_m).contains(&radius_m), "{learned:?}");
        let off = |m: f64| (m * m - radius_m * radius_m).abs();
        assert!(off(found_m) < 0.8 * off(guess_m), "{found_m}");

        let learned = learned_of(&truth, 20.0, WEAVING);
        assert!(!learned.observed(patch), "{learned:?}");
        let (found_m, (low_m, high_m)) = learned.interval(patch);
        assert!((low_m..=high_m).contains(&radius_m), "{learned:?}");
        assert!((found_m - guess_m).abs() < 0.01, "{found_m}");
    }
}

#[test]
fn the_stiffness_of_inner_axles_is_learned_in_turns_on_a_slope() {
    let stiffness = Parameter::InnerStiffness;
    let on_the_spot = |time_s: f64| (0.0, 0.4 * (0.3 * time_s).sin());
    for truth in [0.4, 2.5] {
        // The further ahead the centre of mass is, the more depends on who carries it.
        let truths = [(stiffness, truth), (Parameter::CentreForward, 0.3)];
        let learned = learned_of(&truths, 120.0, on_the_spot);
        assert!(learned.observed(stiffness), "{learned:?}");
        let (found, (low, high)) = learned.interval(stiffness);
        assert!((low..=high).contains(&truth), "{learned:?}");
        let off = f64::ln(found / truth).abs();
        assert!(off < 0.6 * truth.ln().abs(), "{found}, {truth}");
    }
}

#[test]
fn inertia_is_learned_by_turning_to_and_fro() {
    let inertia = Parameter::Inertia;
    let to_and_fro = |time_s: f64| (0.3, 0.4 * (3.0 * time_s).sin());
    for truth in [0.6, 1.6] {
        let learned = learned_of(&[(inertia, truth)], 60.0, to_and_fro);
        assert!(learned.observed(inertia), "{learned:?}");
        let (found, _) = learned.interval(inertia);
        assert!(
            (found - truth).abs() < 0.6 * (truth - 1.0_f64).abs(),
            "{found}, {truth}"
        );
    }
    let learned = learned_of(&[(inertia, 0.6)], 10.0, |_| (0.4, 0.0));
    assert!(!learned.observed(inertia), "{learned:?}");
}

#[test]
fn the_relaxation_length_is_learned_by_turning_to_and_fro() {
    let length = Parameter::RelaxationLength;
    let to_and_fro = |time_s: f64| (0.4, 0.4 * (3.0 * time_s).sin());
    let guess_m = Vehicle::j8().contact_vehicle().friction.relaxation_length_m;
    for truth_m in [0.12, 0.25] {
        let learned = learned_of(&[(length, truth_m)], 60.0, to_and_fro);
        assert!(learned.observed(length), "{learned:?}");
        let (found_m, _) = learned.interval(length);
        assert!(
            (found_m - truth_m).abs() < 0.6 * (truth_m - guess_m).abs(),
            "{found_m}, {truth_m}"
        );
    }
    let learned = learned_of(&[(length, 0.0)], 10.0, |_| (0.4, 0.0));
    assert!(!learned.observed(length), "{learned:?}");
}

#[test]
fn a_vehicle_that_is_known_to_have_no_inertia_has_none() {
    let vehicle = Vehicle::j8();
    let mut wheels = vehicle.contact_vehicle();
    wheels.set_inertia(0.0);
    let contact = ContactPrediction::new(&wheels).unwrap();
    let settings = ContactLearningSettings::default();
    let prior = LearnedContact::new(&vehicle, contact, settings).prior();
    let i = Parameter::Inertia.index();
    assert_eq!((prior.mean[i], prior.sigma[i]), (0.0, 0.0));
    let i = Parameter::RelaxationLength.index();
    assert_eq!((prior.mean[i], prior.sigma[i]), (0.0, 0.0));
}

#[test]
fn what_was_learned_of_other_parameters_is_refused() {
    let settings = settings();
    let mut filter = Filter::new(settings, learned_contact(settings.contact));
    // Versions before had eight and ten to thirteen.
    for number in [8, 10, 11, 12, 13] {
        let refused = filter.recall(&LearnedGains {
            mean: vec![0.0; number],
            covariance: vec![0.0; number * number],
            prior_sigma: vec![0.1; number],
        });
        assert_eq!(refused, Err("gains have another number than the model"));
    }
}
