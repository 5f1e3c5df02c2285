//! What a contact vehicle's motion depends on besides its geometry, as a vector that can be learned.

use super::vehicle::ContactVehicle;
use super::{Friction, FrictionField};
use nalgebra::SVector;
use serde::Serialize;

/// Number of the parameters.
pub const PARAMETERS: usize = 14;

/// The parameters in the order of [`Parameter::ALL`]; factors as natural logarithms, the patch radius as its square.
pub type ParameterVector = SVector<f64, PARAMETERS>;

/// One parameter of a contact vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Parameter {
    /// Coefficient of friction mu.
    Friction,
    /// Centre of mass to the right of the origin, m.
    CentreRight,
    /// Centre of mass ahead of the origin, m.
    CentreForward,
    /// Centre of mass above the ground, m.
    CentreHeight,
    /// Share of the weight on the inner axles, those between the first and the last.
    InnerShare,
    /// Stiffness of an inner axle over that of an outer one: which axles take weight that moves.
    InnerStiffness,
    /// Share `a` of mu that acts sideways.
    LateralShare,
    /// Slip scale eps, m/s.
    SlipScale,
    /// Rolling resistance c.
    RollingResistance,
    /// Radius of gyration r of a contact patch, m.
    PatchRadius,
    /// Inertia over that of a homogeneous box of the vehicle's mass on its wheels; 0 where the vehicle follows its treads at
    /// once.
    Inertia,
    /// Relaxation length of the tyres, m: the distance over which their force builds up. It needs inertia.
    RelaxationLength,
    /// Speed of the left tread over that which encoders and commands say, in addition to c_l.
    LeftTread,
    /// The same of the right tread, in addition to c_r.
    RightTread,
}

/// Length s of the entry ln(1 + L / s) of a relaxation length L, m. The shorter L, the smaller are the changes of it for which
/// derivatives of the forces by L hold; those by the entry hold for changes of 1.
const SHORT_M: f64 = 1e-3;

impl Parameter {
    /// All parameters, in the order of a [`ParameterVector`].
    pub const ALL: [Self; PARAMETERS] = [
        Self::Friction,
        Self::CentreRight,
        Self::CentreForward,
        Self::CentreHeight,
        Self::InnerShare,
        Self::InnerStiffness,
        Self::LateralShare,
        Self::SlipScale,
        Self::RollingResistance,
        Self::PatchRadius,
        Self::Inertia,
        Self::RelaxationLength,
        Self::LeftTread,
        Self::RightTread,
    ];

    /// Returns its key in records, diagnostics and reports.
    pub fn key(self) -> &'static str {
        match self {
            Self::Friction => "friction",
            Self::CentreRight => "centre_of_mass_right_m",
            Self::CentreForward => "centre_of_mass_forward_m",
            Self::CentreHeight => "centre_of_mass_height_m",
            Self::InnerShare => "inner_load_share",
            Self::InnerStiffness => "inner_stiffness",
            Self::LateralShare => "lateral_share",
            Self::SlipScale => "slip_scale_m_s",
            Self::RollingResistance => "rolling_resistance",
            Self::PatchRadius => "patch_radius_m",
            Self::Inertia => "inertia",
            Self::RelaxationLength => "relaxation_length_m",
            Self::LeftTread => "left_tread_factor",
            Self::RightTread => "right_tread_factor",
        }
    }

    /// Returns its place in a [`ParameterVector`].
    pub fn index(self) -> usize {
        self as usize
    }

    /// Returns whether a [`ParameterVector`] holds its natural logarithm: a positive factor.
    pub fn is_logarithm(self) -> bool {
        matches!(
            self,
            Self::Friction
                | Self::InnerStiffness
                | Self::LateralShare
                | Self::SlipScale
                | Self::LeftTread
                | Self::RightTread
        )
    }

    /// Returns whether only a vehicle with axles between the first and the last has it.
    pub fn is_of_inner_axles(self) -> bool {
        matches!(self, Self::InnerShare | Self::InnerStiffness)
    }

    /// Returns whether it is identified as such from logs: all but inertia and relaxation length, which slow drives do not
    /// show, and the factors of the treads, which are identified as c_l and c_r: a [`ContactVehicle`] has none.
    pub fn is_identified(self) -> bool {
        !matches!(
            self,
            Self::Inertia | Self::RelaxationLength | Self::LeftTread | Self::RightTread
        )
    }

    /// Returns the value, in its own unit, of an entry of a [`ParameterVector`].
    pub fn value(self, entry: f64) -> f64 {
        if self.is_logarithm() {
            entry.exp()
        } else if self == Self::PatchRadius {
            // Forces depend on the square; their derivative by the radius vanishes at 0.
            entry.max(0.0).sqrt()
        } else if self == Self::RelaxationLength {
            SHORT_M * entry.max(0.0).exp_m1()
        } else {
            entry
        }
    }

    /// Returns the entry of a [`ParameterVector`] for a value in the parameter's own unit.
    pub fn entry(self, value: f64) -> f64 {
        if self.is_logarithm() {
            value.ln()
        } else if self == Self::PatchRadius {
            value * value
        } else if self == Self::RelaxationLength {
            (value / SHORT_M).ln_1p()
        } else {
            value
        }
    }

    /// Returns the derivative of a relaxation length by its entry of a [`ParameterVector`], m.
    pub(super) fn length_by_entry_m(length_m: f64) -> f64 {
        length_m + SHORT_M
    }

    /// Returns the standard deviation, in entries of a [`ParameterVector`], of a guess for a vehicle of half
    /// width `half_width_m` and half length `half_length_m` of which only geometry is known.
    pub(crate) fn guess_sigma(self, half_width_m: f64, half_length_m: f64) -> f64 {
        match self {
            Self::Friction => 0.3,
            Self::CentreRight => 0.17 * half_width_m,
            Self::CentreForward => 0.14 * half_length_m,
            Self::CentreHeight => 0.3 * half_width_m,
            Self::InnerShare => 0.15,
            Self::InnerStiffness => 0.7,
            Self::LateralShare => 0.2,
            Self::SlipScale => 0.7,
            Self::RollingResistance => 0.02,
            Self::PatchRadius => 0.02 * half_width_m * half_width_m,
            Self::Inertia => 0.5,
            Self::RelaxationLength => 1.0,
            Self::LeftTread | Self::RightTread => 0.2,
        }
    }

    /// Returns the range of values that a vehicle of half width `half_width_m` and half length
    /// `half_length_m` may have.
    pub fn range(self, half_width_m: f64, half_length_m: f64) -> (f64, f64) {
        match self {
            Self::Friction => (0.1, 2.0),
            Self::CentreRight => (-0.5 * half_width_m, 0.5 * half_width_m),
            Self::CentreForward => (-0.7 * half_length_m, 0.7 * half_length_m),
            Self::CentreHeight => (0.0, 2.5 * half_width_m),
            Self::InnerShare => (0.02, 0.98),
            Self::InnerStiffness => (0.2, 5.0),
            Self::LateralShare => (0.3, 2.0),
            Self::SlipScale => (0.002, 0.2),
            Self::RollingResistance => (0.0, 0.3),
            Self::PatchRadius => (0.0, 0.5 * half_width_m),
            Self::Inertia => (0.0, 3.0),
            Self::RelaxationLength => (0.0, half_width_m),
            Self::LeftTread | Self::RightTread => (0.2, 2.0),
        }
    }
}

impl ContactVehicle {
    /// Returns the vehicle's parameters; friction in patches counts with the middle of its range.
    pub fn parameters(&self) -> ParameterVector {
        let value = |parameter| match parameter {
            Parameter::Friction => self.friction.field.middle(),
            Parameter::CentreRight => self.centre_of_mass.right_m,
            Parameter::CentreForward => self.centre_of_mass.forward_m,
            Parameter::CentreHeight => self.centre_of_mass.height_m,
            Parameter::InnerShare => self.inner_share(),
            Parameter::InnerStiffness => self.inner_stiffness,
            Parameter::LateralShare => self.friction.lateral_share,
            Parameter::SlipScale => self.friction.slip_scale_m_s,
            Parameter::RollingResistance => self.friction.rolling_resistance,
            Parameter::PatchRadius => self.friction.patch_radius_m,
            Parameter::Inertia => self.inertia(),
            Parameter::RelaxationLength => self.friction.relaxation_length_m,
            Parameter::LeftTread | Parameter::RightTread => 1.0,
        };
        ParameterVector::from_fn(|i, _| {
            let parameter = Parameter::ALL[i];
            parameter.entry(value(parameter))
        })
    }

    /// Returns the same vehicle with other parameters, on ground of even friction; factors of the treads are left
    /// out.
    #[must_use]
    pub fn with_parameters(&self, parameters: &ParameterVector) -> Self {
        let value = |parameter: Parameter| parameter.value(parameters[parameter.index()]);
        let mut vehicle = self.clone();
        vehicle.centre_of_mass.right_m = value(Parameter::CentreRight);
        vehicle.centre_of_mass.forward_m = value(Parameter::CentreForward);
        vehicle.centre_of_mass.height_m = value(Parameter::CentreHeight);
        vehicle.friction = Friction {
            field: FrictionField::Uniform {
                coefficient: value(Parameter::Friction),
            },
            lateral_share: value(Parameter::LateralShare),
            slip_scale_m_s: value(Parameter::SlipScale),
            rolling_resistance: value(Parameter::RollingResistance),
            patch_radius_m: value(Parameter::PatchRadius),
            relaxation_length_m: value(Parameter::RelaxationLength),
            ..self.friction
        };
        vehicle.inner_stiffness = value(Parameter::InnerStiffness);
        vehicle.set_inner_share(value(Parameter::InnerShare));
        vehicle.set_inertia(value(Parameter::Inertia));
        vehicle
    }
}
