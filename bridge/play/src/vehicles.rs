//! The shipped vehicles, and the files that their scenarios name.

use serde::Serialize;

/// A vehicle to choose.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct ShippedVehicle {
    /// Name in links.
    pub id: &'static str,
    /// Name on the page.
    pub name: &'static str,
    /// Size of the courses for it, as a share of that for the J8.
    pub size: f64,
    /// Largest speed on a course, m/s.
    pub speed_max_m_s: f64,
    /// File of the vehicle as controllers know it.
    #[serde(skip)]
    pub vehicle: &'static str,
    /// Files of the vehicle on wheels and of what identification finds of it; none where only ICRIK is known.
    #[serde(skip)]
    pub contact: Option<[&'static str; 2]>,
    /// Whether friction of the ground acts on it.
    pub has_wheels: bool,
}

const J8: ShippedVehicle = ShippedVehicle {
    id: "j8",
    name: "Argo J8, 1 t",
    size: 1.0,
    speed_max_m_s: 1.0,
    vehicle: "config/vehicles/j8.yaml",
    contact: Some([
        "config/vehicles/j8_contact.yaml",
        "config/vehicles/j8_contact_identified.yaml",
    ]),
    has_wheels: true,
};

/// All of them, the default first.
pub const VEHICLES: [ShippedVehicle; 8] = [
    J8,
    ShippedVehicle {
        id: "j8_loaded",
        name: "Argo J8 with 400 kg on deck",
        contact: Some([
            "config/vehicles/j8_loaded_contact.yaml",
            "config/vehicles/j8_contact_identified.yaml",
        ]),
        ..J8
    },
    family("eight", "Eight wheels, 900 kg", 1.0, EIGHT),
    family("six", "Six wheels, 250 kg", 0.6, SIX),
    family("four_large", "Four wheels, 300 kg", 0.6, FOUR_LARGE),
    family("four_small", "Four wheels, 50 kg", 0.35, FOUR_SMALL),
    family("tracks", "Tracks, 1.2 t", 0.7, TRACKS),
    ShippedVehicle {
        id: "lazaro",
        name: "Lazaro, small",
        size: 0.3,
        speed_max_m_s: 0.25,
        vehicle: "config/vehicles/lazaro.yaml",
        contact: None,
        has_wheels: false,
    },
];

const EIGHT: [&str; 2] = [
    "config/vehicles/family/eight.yaml",
    "config/vehicles/family/eight_guess.yaml",
];
const SIX: [&str; 2] = [
    "config/vehicles/family/six.yaml",
    "config/vehicles/family/six_guess.yaml",
];
const FOUR_LARGE: [&str; 2] = [
    "config/vehicles/family/four_large.yaml",
    "config/vehicles/family/four_large_guess.yaml",
];
const FOUR_SMALL: [&str; 2] = [
    "config/vehicles/family/four_small.yaml",
    "config/vehicles/family/four_small_guess.yaml",
];
const TRACKS: [&str; 2] = [
    "config/vehicles/family/tracks.yaml",
    "config/vehicles/family/tracks_guess.yaml",
];

const fn family(
    id: &'static str,
    name: &'static str,
    size: f64,
    [wheels, guess]: [&'static str; 2],
) -> ShippedVehicle {
    ShippedVehicle {
        id,
        name,
        size,
        vehicle: guess,
        contact: Some([wheels, guess]),
        ..J8
    }
}
