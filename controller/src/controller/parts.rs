//! What each kind of controller is made of.

use crate::config::{ControllerConfig, ControllerKind};
use crate::estimator::Estimator;
use crate::guard::{Guard, Stance};
use crate::memory::RecallError;
use crate::mpc::{Model, Mpc, QpFailure};
use sidehill_plant::bounds::RangeError;
use sidehill_plant::contact::ContactPrediction;
use sidehill_plant::fingerprint::fnv_1a;
use sidehill_plant::prediction::PredictionModel;
use sidehill_plant::vehicle::Vehicle;

/// Why a controller cannot be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ControllerError {
    /// A setting is out of its range.
    #[error("controller setting {0}")]
    Range(#[from] RangeError),
    /// What was learned before belongs to another vehicle, or its values are not plausible.
    #[error("what was learned is refused: {0}")]
    Recall(#[from] RecallError),
    /// The steepness guard needs to know where the mass is.
    #[error(
        "guard: the vehicle file has no centre_of_mass, and none in contact; the guard needs its height"
    )]
    CentreOfMass,
    /// The centre of mass is not above the wheels.
    #[error("guard: centre_of_mass is beside the wheels, so the vehicle tips over on level ground")]
    TipsOver,
    /// The solver does not take the problem.
    #[error("the MPC cannot be set up: {0}")]
    Solver(#[from] QpFailure),
}

/// What turns estimate and reference into a command.
#[derive(Clone)]
pub(super) enum Law {
    Mpc(Box<Mpc>),
    PurePursuit,
}

/// Share of the motors' deceleration with which the guard brakes before a steep place.
const BRAKING_SHARE: f64 = 0.25;

/// What a kind of controller estimates and commands with.
pub(super) struct Parts {
    /// The vehicle as the law knows it.
    pub(super) vehicle: Vehicle,
    pub(super) estimator: Estimator,
    pub(super) law: Law,
    /// Whether the law predicts with what the estimator learns.
    pub(super) adapts: bool,
}

impl Parts {
    /// Returns the parts of a controller of this kind for `vehicle`.
    ///
    /// # Errors
    /// [`ControllerError`] for a vehicle or settings that its model or solver does not take.
    pub(super) fn of(
        kind: ControllerKind,
        config: &ControllerConfig,
        vehicle: &Vehicle,
    ) -> Result<Self, ControllerError> {
        // An adapted model is estimated with as it predicts. A law that does not adapt leaves
        // dead reckoning to the best model there is.
        let adaptation = config.estimator.adaptation;
        let adapts = match kind {
            ControllerKind::IcrikMpc => adaptation.is_on(),
            ControllerKind::IcrhkMpc => adaptation.is_on() && adaptation.of_icrhk,
            ControllerKind::ContactMpc => config.estimator.contact.is_on(),
            ControllerKind::DiffdriveMpc | ControllerKind::PurePursuit => false,
        };
        let model = Model::of_kind(kind, vehicle, config.smoothing_m_s)?;
        let estimator = if let Some(Model::Contact(contact)) = &model {
            Estimator::with_contact(config.estimator, &vehicle.on_wheels(), (**contact).clone())
        } else if kind == ControllerKind::IcrhkMpc && adapts {
            let mut settings = config.estimator;
            settings.adaptation.slope_sigma = 0.0;
            Estimator::new(settings, vehicle.on_level_ground())
        } else {
            Estimator::new(config.estimator, vehicle.extended())
        };
        let law = match model {
            None => Law::PurePursuit,
            Some(model) => Law::Mpc(Box::new(Mpc::new(config.mpc(), model)?)),
        };
        Ok(Self {
            vehicle: modelled(kind, vehicle),
            estimator,
            law,
            adapts,
        })
    }
}

/// Returns a vehicle as the law of a kind of controller knows it.
fn modelled(kind: ControllerKind, vehicle: &Vehicle) -> Vehicle {
    match kind {
        ControllerKind::IcrikMpc => vehicle.extended(),
        ControllerKind::ContactMpc => vehicle.on_wheels(),
        ControllerKind::IcrhkMpc | ControllerKind::PurePursuit => vehicle.on_level_ground(),
        ControllerKind::DiffdriveMpc => vehicle.as_differential_drive(),
    }
}

impl Model {
    /// Returns the model by which an MPC of this kind predicts the motion of `vehicle`, before it learns; none of a law
    /// that does not predict. `smoothing_m_s` is that of [`PredictionModel::new`].
    ///
    /// # Errors
    /// [`RangeError`] where the axles do not carry the vehicle: all at one place.
    pub fn of_kind(
        kind: ControllerKind,
        vehicle: &Vehicle,
        smoothing_m_s: f64,
    ) -> Result<Option<Self>, RangeError> {
        Ok(match kind {
            ControllerKind::PurePursuit => None,
            ControllerKind::ContactMpc => {
                Some(ContactPrediction::new(&vehicle.contact_vehicle())?.into())
            }
            ControllerKind::IcrikMpc | ControllerKind::IcrhkMpc | ControllerKind::DiffdriveMpc => {
                Some(PredictionModel::new(modelled(kind, vehicle), smoothing_m_s).into())
            }
        })
    }
}

/// Returns the steepness guard of a vehicle, where it is on.
///
/// # Errors
/// [`ControllerError`] for a vehicle whose mass is unknown or not above its wheels.
pub(super) fn guard(
    config: &ControllerConfig,
    vehicle: &Vehicle,
) -> Result<Option<Guard>, ControllerError> {
    let Some(settings) = config.guard else {
        return Ok(None);
    };
    let stance = Stance::of(vehicle).ok_or(ControllerError::CentreOfMass)?;
    if !stance.stands() {
        return Err(ControllerError::TipsOver);
    }
    let braking_m_s2 = BRAKING_SHARE * config.limits.traction.deceleration_m_s2;
    Ok(Some(Guard::new(settings, stance, braking_m_s2)))
}

/// Returns the name of a vehicle under a kind of controller, with a number that is another where any of its
/// parameters is.
pub(super) fn owner(vehicle: &Vehicle, kind: ControllerKind) -> String {
    let text = format!("{vehicle:?}");
    let number = fnv_1a(text.as_bytes());
    format!("{} {number:016x} {}", vehicle.name, kind.name())
}
