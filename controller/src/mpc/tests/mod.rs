#![allow(clippy::unwrap_used)]

mod active_set;
mod binding_limits;
mod closed_loop;
mod extra;
mod feedback;
mod first_plan;
mod following;
mod heading_excess;
mod limits;
mod qp;
mod same_optimum;
mod sparse;
mod speed_row;
mod stages;
mod stagewise;
mod step_limit;

use super::assembling::{COST_SCALE, assemble};
use super::limits::{Change, InputLimits, MotorLimits};
use super::stage::Stage;
use super::*;
use proptest::prelude::*;
use sidehill_plant::prediction::{LinearisedStep, PredictionModel};
use sidehill_plant::vehicle::Vehicle;

fn motors(traction_m_s: f64, steer_m_s: f64) -> MotorSpeeds {
    MotorSpeeds {
        traction_m_s,
        steer_m_s,
    }
}

/// Settings of a solver that is to be as exact as it can.
fn exact() -> QpSettings {
    QpSettings {
        mode: QpMode::InteriorPoint,
        max_iterations: 100,
        tolerance: 1e-10,
        accepted_residual: 1e-6,
        accepted_gap: 1e-6,
    }
}

fn input_limits(tread_speed_m_s: f64) -> InputLimits {
    InputLimits {
        traction: MotorLimits {
            speed_m_s: 1.0,
            acceleration_m_s2: 2.0,
            deceleration_m_s2: 3.0,
        },
        steer: MotorLimits {
            speed_m_s: 0.8,
            acceleration_m_s2: 1.5,
            deceleration_m_s2: 2.0,
        },
        tread_speed_m_s,
    }
}
