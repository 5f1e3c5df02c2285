//! What the contact vehicle does by itself, against what the paper measured on the real one.

use super::*;
use crate::frames::{Attitude, BodyVelocity};
use crate::motion::{GroundState, MotionModel};
use crate::speeds::TreadSpeeds;
use nalgebra::{DMatrix, DVector};

/// The J8 of `config/vehicles/j8_contact.yaml`.
pub(super) fn j8() -> ContactVehicle {
    serde_yaml::from_str(include_str!("../../../config/vehicles/j8_contact.yaml")).unwrap()
}

fn with_inner_share(inner: f64, mu: f64, right_m: f64, forward_m: f64, lateral_share: f64) -> ContactVehicle {
    let mut v = j8();
    for a in &mut v.axles {
        a.load_share = if a.forward_m.abs() < 0.5 { inner / 2.0 } else { (1.0 - inner) / 2.0 };
    }
    v.centre_of_mass = CentreOfMass { right_m, forward_m, height_m: 0.4 };
    v.friction.field = FrictionField::Uniform { coefficient: mu };
    v.friction.lateral_share = lateral_share;
    v
}

fn velocity(model: &mut ContactModel, slope: f64, gamma: f64, left: f64, right: f64) -> BodyVelocity {
    let ground = GroundState { attitude: Attitude::from_slope(slope, gamma), ..Default::default() };
    model.body_velocity(&ground, TreadSpeeds { left_m_s: left, right_m_s: right }, 0.0).unwrap()
}

/// level ICRs and lambdas by least squares on velocities.
fn fit(v: &ContactVehicle, sigmas: &[f64], taus: &[f64]) -> ([f64; 3], [f64; 2]) {
    let mut m = ContactModel::new(v.clone());
    // level: omega D = 2 sigma ; v_x = y omega ; v_y - tau = -(xr+xl)/2 omega
    let (mut d_num, mut d_den, mut y_num, mut c_num, mut oo) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for &tau in taus { for &sigma in sigmas { for s in [-1.0, 1.0] {
        let sigma = s * sigma;
        let b = velocity(&mut m, 0.0, 0.0, tau - sigma, tau + sigma);
        let o = b.yaw_rate_rad_s;
        d_num += 2.0 * sigma * o; d_den += o * o;
        y_num += b.right_m_s * o; c_num += -(b.forward_m_s - tau) * o; oo += o * o;
    }}}
    let (d, y, c) = (d_num / d_den, y_num / oo, c_num / oo);
    let (xl, xr) = (c - d / 2.0, c + d / 2.0);
    // slope 4 deg pivot
    let slope = 4f64.to_radians();
    let mut rows = vec![]; let mut rhs = vec![];
    for &tau in taus { for &sigma in sigmas { for s in [-1.0, 1.0] { let sigma = s * sigma; for k in 0..36 {
        let g = 1.0 - f64::abs(tau);
        let gamma = f64::from(k) * 10f64.to_radians();
        let a = Attitude::from_slope(slope, gamma);
        let b = velocity(&mut m, slope, gamma, tau - sigma, tau + sigma);
        let o = b.yaw_rate_rad_s; let (al, ph) = (a.roll_rad, a.pitch_rad);
        rows.push([g * al * o.abs(), 0.0]); rhs.push(b.right_m_s - y * o);
        let k2 = if ph.abs() > al.abs() { 1.0 - (al / ph).abs() } else { 0.0 };
        rows.push([-g * ph * o.abs(), -g * ph * o.abs() * 0.5 * k2]); rhs.push(b.forward_m_s - tau + c * o);
        // omega * (D + lam2 * (|ph|-|al|)+) = 2 sigma
        rows.push([0.0, g * o * (ph.abs() - al.abs()).max(0.0)]); rhs.push(2.0 * sigma - d * o);
    }}}}
    let a = DMatrix::from_fn(rows.len(), 2, |i, j| rows[i][j]);
    let x = a.svd(true, true).solve(&DVector::from_vec(rhs), 1e-12).unwrap();
    ([xl, xr, y], [x[0], x[1]])
}


fn slides(v: &ContactVehicle) -> (f64, f64) {
    let mut m = ContactModel::new(v.clone());
    let slope = 4f64.to_radians();
    let mut mean = |gamma: f64, right: bool| -> f64 {
        let mut total = 0.0;
        for s in [-0.33, 0.33] { for gamma in [gamma, gamma + 180.0] {
            let gamma = gamma.to_radians();
            let b = velocity(&mut m, slope, gamma, -s, s);
            let l = velocity(&mut m, 0.0, 0.0, -s, s);
            let a = Attitude::from_slope(slope, gamma);
            total += if right { (b.right_m_s - l.right_m_s) / a.roll_rad } else { -(b.forward_m_s - l.forward_m_s) / a.pitch_rad } / b.yaw_rate_rad_s.abs();
        }}
        total / 4.0
    };
    (mean(0.0, false), mean(90.0, true))
}

#[test]
fn tune() {
    let make = |p: &nalgebra::Vector3<f64>| { let mut v = with_inner_share(p.x, 0.9, p.y, p.z, 1.0); v.friction.patch_radius_m = 0.09; v };
    let icr = |p: &nalgebra::Vector3<f64>| { let (i, _) = fit(&make(p), &[0.15, 0.33, 0.5], &[0.0, 0.3, 0.6]); nalgebra::Vector3::from(i) };
    let mut p = nalgebra::Vector3::new(0.75, -0.03, 0.19);
    for _ in 0..6 {
        let r = icr(&p) - nalgebra::Vector3::new(-0.980, 1.073, 0.206);
        let mut j = nalgebra::Matrix3::zeros();
        for k in 0..3 { let mut q = p; q[k] += 1e-4; j.set_column(k, &((icr(&q) - icr(&p)) / 1e-4)); }
        p -= j.try_inverse().unwrap() * r;
    }
    println!("tuned {p} {:?} {:?} {:?}", fit(&make(&p), &[0.15, 0.33, 0.5], &[0.0, 0.3, 0.6]), fit(&make(&p), &[0.33], &[0.0]), slides(&make(&p)));
    for inner in [0.5, 0.6, 0.7, 0.75, 0.8, 0.9] { let q = nalgebra::Vector3::new(inner, p.y, p.z);
      println!("inner {inner} {:?} {:?}", fit(&make(&q), &[0.15, 0.33, 0.5], &[0.0, 0.3, 0.6]), slides(&make(&q))); }
    let v = make(&p);
    let mut m = ContactModel::new(v.clone());
    let t = std::time::Instant::now(); let mut acc = 0.0;
    for k in 0..20000 { let a = f64::from(k) * 1e-3; acc += velocity(&mut m, 0.2, a, 0.4 + 0.3 * a.sin(), 0.4 - 0.3 * a.sin()).right_m_s; }
    println!("us per call {} {acc}", t.elapsed().as_secs_f64() * 1e6 / 20000.0);
}
