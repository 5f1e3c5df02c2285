//! A vehicle that follows a change of the model's velocity late.

use super::super::learned::LearnedModel;
use super::*;
use sidehill_plant::contact::{ContactPrediction, ContactVehicle};
use sidehill_plant::frames::BodyVelocity;

/// Returns how far learned parameters are from the truth, the prior, in its standard deviations, root of the
/// sum of squares, after a vehicle with a lag of 0.15 s has turned to and fro for 3 s.
fn learned_wrongly(lag_s: f64) -> f64 {
    let settings = EstimatorSettings {
        contact: ContactLearningSettings {
            lag_s,
            ..settings().contact
        },
        ..settings()
    };
    let vehicle = Vehicle::j8();
    let contact = ContactPrediction::new(&ContactVehicle::of_base("wheels", 0.6, 1.06)).unwrap();
    let mut model = LearnedContact::new(&vehicle, contact, settings.contact);
    let mut filter = Filter::new(settings, model.clone());
    let prior = model.prior();
    let slope = 8.0_f64.to_radians();
    let normal = Vector3::new(0.0, -slope.sin(), slope.cos());
    let mut pose = PlanarPose::default();
    let mut velocity = BodyVelocity::default();
    for cycle in 0..=60 {
        let time_s = 0.05 * f64::from(cycle);
        let steer_m_s = 0.3 * (3.0 * time_s).sin();
        let treads = TreadSpeeds {
            left_m_s: 0.3 - steer_m_s,
            right_m_s: 0.3 + steer_m_s,
        };
        let attitude = Attitude::on_plane(&normal, pose.yaw_rad);
        let (settled, _) = model.velocity(attitude, treads, &prior.mean);
        let share = 1.0 - (-0.05_f64 / 0.15).exp();
        velocity.right_m_s += share * (settled.right_m_s - velocity.right_m_s);
        velocity.forward_m_s += share * (settled.forward_m_s - velocity.forward_m_s);
        velocity.yaw_rate_rad_s += share * (settled.yaw_rate_rad_s - velocity.yaw_rate_rad_s);
        if cycle > 0 {
            let rate = pose_rate(&velocity, &attitude, pose.yaw_rad);
            pose.x_m += 0.05 * rate.x_m_s;
            pose.y_m += 0.05 * rate.y_m_s;
            pose.yaw_rad += 0.05 * rate.yaw_rad_s;
        }
        filter.update(&Sample {
            time_s,
            tread_speeds: stamped(time_s, model.encoder_scale().invert(treads)),
            attitude: stamped(time_s, Attitude::on_plane(&normal, pose.yaw_rad)),
            yaw_rate: None,
            pose: stamped(time_s, pose_at(&pose)),
        });
    }
    let learned = filter.newest().unwrap().parameters;
    (learned - prior.mean).component_div(&prior.sigma).norm()
}

#[test]
fn a_late_vehicle_teaches_little_that_is_wrong() {
    let (with, without) = (learned_wrongly(0.1), learned_wrongly(0.0));
    assert!(with < 0.6 * without, "{with}, without lag {without}");
}
