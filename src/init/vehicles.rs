//! The vehicle of a set, from the maker's measures and assumptions for the rest.

use super::robots::Measures;
use crate::identify;
use anyhow::{Context, Result};
use sidehill_plant::vehicle::Vehicle;
use std::fmt::Write;

/// Coefficient of friction assumed until it is measured.
const FRICTION: f64 = 0.8;

/// Returns the vehicle on wheels with the maker's measures and assumptions for the rest.
pub(super) fn contact_vehicle(measures: &Measures<'_>) -> String {
    let Measures {
        name,
        title,
        source,
        mass_kg,
        track_m,
        axles,
        radius_m,
        centre_of_mass_height_m,
        ..
    } = *measures;
    let half_width_m = 0.5 * track_m;
    // A patch as long as half the wheel's radius; see patch_radius_m in the file.
    let patch_m = 0.5 * radius_m / 6_f64.sqrt();
    let mut lines = String::new();
    for forward_m in axle_positions_m(measures) {
        let _ = writeln!(
            lines,
            "  - {{ forward_m: {forward_m:.4}, load_share: {} }}",
            1.0 / axles as f64
        );
    }
    format!(
        "# {title} as a vehicle on wheels with friction: what `simulate --plant contact` drives and what\n\
         # contact-mpc predicts with. Measures: {source}.\n\
         # What is marked as an assumption is a guess: measure it, or let identification find it.\n\
         \n\
         # Name in tables and plots.\n\
         name: {name}-contact\n\
         \n\
         # Mass, in kg, without payload. Add what the vehicle carries.\n\
         mass_kg: {mass_kg:?}\n\
         \n\
         # Centre of mass from the body's origin (the middle of the wheels), in m; height above the ground.\n\
         # Assumption: over the middle. Payload moves it.\n\
         centre_of_mass_right_m: 0.0\n\
         centre_of_mass_forward_m: 0.0\n\
         centre_of_mass_height_m: {centre_of_mass_height_m:?}\n\
         \n\
         # Lateral distance of the wheel contacts from the origin, in m.\n\
         half_width_m: {half_width_m:?}\n\
         \n\
         # Axles: forward_m from the origin, in m; load_share of the weight on level ground with the centre\n\
         # of mass over the origin, all together 1. Assumption: equal loads.\n\
         axles:\n{lines}\
         \n\
         friction:\n\
         \x20 # Coefficient of friction of tyre and ground, without unit. Assumption: dry firm ground.\n\
         \x20 field: {{ kind: uniform, coefficient: {FRICTION:?} }}\n\
         \x20 # Share of it that acts sideways, without unit. Assumption: as much as lengthways.\n\
         \x20 lateral_share: 1.0\n\
         \x20 # Slip at which friction reaches 71 % of its limit, in m/s. Assumption.\n\
         \x20 slip_scale_m_s: 0.02\n\
         \x20 # Rolling resistance of the ground, force over load, without unit. Assumption.\n\
         \x20 rolling_resistance: 0.03\n\
         \x20 # Radius of gyration of a contact patch, in m: its side over the square root of 6. Assumption: a\n\
         \x20 # patch as long as half the wheel's radius.\n\
         \x20 patch_radius_m: {patch_m:.4}\n"
    )
}

/// Returns how far forward of the origin the axles are, m: evenly spaced.
fn axle_positions_m(measures: &Measures<'_>) -> impl Iterator<Item = f64> + use<> {
    let Measures {
        axles, wheelbase_m, ..
    } = *measures;
    (0..axles).map(move |axle| (0.5 - axle as f64 / (axles - 1) as f64) * wheelbase_m)
}

/// Returns the vehicle as ICRIK knows it: ICRs and slide gains that identification finds when the
/// vehicle on wheels drives the paper's procedure in simulation.
pub(super) fn first_guess(measures: &Measures<'_>, contact: &str) -> Result<String> {
    let half_width_m = 0.5 * measures.track_m;
    let half_length_m = 0.5 * measures.wheelbase_m;
    let speed_m_s = measures.speed_m_s.unwrap_or(1.0);
    let start: Vehicle = serde_yaml::from_str(&format!(
        "{{name: {}, x_icr_left_m: {}, x_icr_right_m: {}, y_icr_m: 0.0, lambda_1_s_per_rad: 1.0,
          lambda_2_s_per_rad: 1.0, speed_max_m_s: {speed_m_s:?}, base_half_width_m: {half_width_m},
          base_half_length_m: {half_length_m}, correction_left: 1.0, correction_right: 1.0}}",
        measures.name,
        -1.5 * half_width_m,
        1.5 * half_width_m,
    ))?;
    let found = identify::by_simulation(&serde_yaml::from_str(contact)?, &start, 1)
        .with_context(|| format!("{}: first guess", measures.name))?;
    let maker = measures
        .separation_multiplier
        .map_or_else(String::new, |multiplier| {
            format!(
                "# The maker's wheel_separation_multiplier, {multiplier}, would put them {:.3} m apart.\n",
                multiplier * measures.track_m
            )
        });
    let icrs = &found.icrs;
    let axles: String = axle_positions_m(measures)
        .map(|forward_m| format!("  - {{ forward_m: {forward_m:.4} }}\n"))
        .collect();
    Ok(format!(
        "# {title}: FIRST GUESSES, found by driving contact.yaml in simulation as\n\
         #     sidehill identify --simulate contact.yaml --vehicle vehicle.yaml --out better.yaml\n\
         # does. Replace them by `sidehill identify` with logs of your vehicle before you trust it on a slope.\n\
         # Measures: {source}.\n\
         \n\
         # Name in tables and plots.\n\
         name: {name}\n\
         \n\
         # Tread ICRs on level ground, in m from the body's origin (the middle of the wheels).\n\
         {maker}\
         x_icr_left_m: {left:.3}   # to the right, so negative: left of the origin\n\
         x_icr_right_m: {right:.3}   # to the right\n\
         y_icr_m: {forward:.3}   # forward\n\
         \n\
         # How far the ICRs move on a slope (ICRIK), in s/rad.\n\
         lambda_1_s_per_rad: {lambda_1:.3}   # all ICRs, with roll and pitch\n\
         lambda_2_s_per_rad: {lambda_2:.3}   # one tread more, when pointing mostly up or down\n\
         \n\
         # Largest speed that is driven (v_y^m), in m/s.\n\
         speed_max_m_s: {speed_m_s:?}\n\
         \n\
         # Half width and half length of the rectangle of the wheels' contact points, in m.\n\
         base_half_width_m: {half_width_m:?}\n\
         base_half_length_m: {half_length_m:?}\n\
         \n\
         # From measured to effective tread speed (c_l, c_r), without unit: 1 until identified.\n\
         correction_left: 1.0\n\
         correction_right: 1.0\n\
         \n\
         # Where its wheels touch the ground, in m from the origin: contact-mpc starts from this and from the ICRs, and\n\
         # learns friction and loads.\n\
         contact:\n\
         \x20 half_width_m: {half_width_m:?}\n\
         \x20 axles:\n{axles}",
        title = measures.title,
        source = measures.source,
        name = measures.name,
        left = icrs.left_m,
        right = icrs.right_m,
        forward = icrs.forward_m,
        lambda_1 = found.slide.shift_s_per_rad,
        lambda_2 = found.slide.aggravated_s_per_rad,
    ))
}
