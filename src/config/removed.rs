//! Keys that configuration files no longer have. What is listed here `sidehill migrate` takes out, and the error about an
//! unknown key names.

use super::keys::{KeyPlace, Keys};

/// Sections of the controller's settings: of scenarios and conditions, of `run`, and of the scenario of a campaign.
const SECTIONS: [&str; 3] = ["controller", "settings", "with.controller"];

/// Keys of the controller's settings, with the version that removed them and the reason.
const REMOVED: [(&str, &str, &[&str]); 6] = [
    (
        "0.2.0",
        "the MPCs follow the path, not a clock",
        &["lead_max_m", "weights.along_per_m2"],
    ),
    (
        "0.2.0",
        "it improves no drive",
        &[
            "caution",
            "corridor",
            "supervisor.settle_time_s",
            "weights.terminal_factor",
        ],
    ),
    (
        "0.2.0",
        "`weights` holds for all MPCs, the rest is constant",
        &["contact"],
    ),
    (
        "0.2.0",
        "the last stage lasts 22/15 of `step_s`",
        &["last_step_s"],
    ),
    (
        "0.2.0",
        "it is a constant",
        &[
            "block_stages",
            "pure_pursuit",
            "smoothing_m_s",
            "solver",
            "step_limit",
            "weights.cross_ramp_s",
            "weights.heading_excess_per_rad2",
            "weights.heading_free_rad",
            "weights.pivot_heading_per_rad2",
            "weights.pivot_position_per_m2",
            "estimator.adaptation.of_icrhk",
            "estimator.adaptation.shift_sigma",
            "estimator.believed_after_s",
            "estimator.contact.centre_forward_sigma",
            "estimator.contact.centre_height_sigma",
            "estimator.contact.centre_right_sigma",
            "estimator.contact.forgetting_per_m",
            "estimator.contact.friction_sigma",
            "estimator.contact.inertia_sigma",
            "estimator.contact.inner_share_sigma",
            "estimator.contact.inner_stiffness_sigma",
            "estimator.contact.lag_s",
            "estimator.contact.lateral_share_sigma",
            "estimator.contact.patch_squared_sigma",
            "estimator.contact.prior_factor",
            "estimator.contact.relaxation_length_sigma",
            "estimator.contact.rolling_resistance_sigma",
            "estimator.contact.slide_sigma_m_per_sqrt_s",
            "estimator.contact.slip_scale_sigma",
            "estimator.contact.tread_forgetting_per_m",
            "estimator.contact.tread_sigma",
            "estimator.contact.yaw_sigma_rad_per_sqrt_s",
            "estimator.error_averaging_s",
            "estimator.gyro_bias_sigma_rad_s",
            "estimator.gyro_model_sigma_rad_per_sqrt_s",
            "estimator.gyro_sigma_rad_per_sqrt_s",
            "guard.friction_use_max",
            "guard.friction_use_slow",
            "guard.heading_spread_deg",
            "guard.look_ahead_s",
            "guard.rollover_margin_slow",
            "guard.speed_share_min",
            "guard.stop_before_m",
            "supervisor.attitude_timeout_s",
            "supervisor.fallback_cycles",
            "supervisor.heading_error_max_rad",
            "supervisor.speeds_timeout_s",
            "supervisor.stall_share",
            "supervisor.stall_time_s",
        ],
    ),
    (
        "0.2.0",
        "`memory: {}` keeps what was learned, with constants",
        &[
            "memory.aim_max_m",
            "memory.by_place",
            "memory.cell_m",
            "memory.error_share",
            "memory.keep_gains",
            "memory.kept_share",
        ],
    ),
];

/// A key of a file that no longer exists.
pub(super) struct Removed<'keys> {
    /// Where it stands.
    pub(super) place: &'keys KeyPlace,
    /// The version that removed it.
    pub(super) version: &'static str,
    /// Why, in a line.
    pub(super) reason: &'static str,
}

/// Returns the keys of a text that no longer exist, in their order.
pub(super) fn removed(keys: &Keys) -> impl Iterator<Item = Removed<'_>> {
    keys.keys
        .iter()
        .filter_map(|place| of_setting(place, &place.path.join(".")))
}

/// Returns the keys of a campaign's `draws` that no longer exist, or whose section does not: where they are named.
pub(super) fn removed_draws(keys: &Keys) -> impl Iterator<Item = Removed<'_>> {
    keys.keys.iter().filter_map(|place| {
        let is_drawn = place.path.iter().eq(["draws", "key"]);
        let key = place.value.as_deref().filter(|_| is_drawn)?;
        let ends = key.match_indices('.').map(|(dot, _)| dot);
        ends.chain([key.len()])
            .find_map(|end| of_setting(place, &key[..end]))
    })
}

fn of_setting<'keys>(place: &'keys KeyPlace, path: &str) -> Option<Removed<'keys>> {
    let key = SECTIONS
        .iter()
        .find_map(|section| path.strip_prefix(section)?.strip_prefix('.'))?;
    let (version, reason, _) = REMOVED
        .iter()
        .find(|(_, _, removed)| removed.contains(&key))?;
    Some(Removed {
        place,
        version,
        reason,
    })
}

/// Returns what a message about an unknown key lacks, where the key is one that was removed.
pub(super) fn hint(keys: &Keys, message: &str) -> Option<String> {
    let (_, rest) = message.split_once("unknown field `")?;
    let (unknown, _) = rest.split_once('`')?;
    let found = removed(keys).find(|removed| {
        let name = removed.place.path.last();
        name.is_some_and(|name| name.rsplit('.').next() == Some(unknown))
    })?;
    Some(format!(
        "; removed in {}, {}: `sidehill migrate FILE` takes it out",
        found.version, found.reason
    ))
}
