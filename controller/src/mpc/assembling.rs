//! The stages about a plan as the QP of a cycle.

use super::extra::{ExtraRow, ExtraTerms, product, row_size, values};
use super::limits::{Change, InputLimits};
use super::stage::Stage;
use super::stage_qp::{MOTORS, StageQp, StageRow, VARIABLES, dot};
use nalgebra::Vector3;
use sidehill_plant::speeds::MotorSpeeds;

/// Factor on all costs: brings the QP's numbers near 1, where clarabel's tolerances are meant.
pub const COST_SCALE: f64 = 10.0;

/// Writes the QP of `stages` about a plan with these `states`, the present one first; `previous` is the input in force,
/// `extra` are terms with as many rows as there is room for. Allocates nothing.
pub fn assemble(
    qp: &mut StageQp,
    stages: &[Stage],
    states: &[Vector3<f64>],
    previous: MotorSpeeds,
    limits: &InputLimits,
    extra: Option<&ExtraTerms>,
) {
    let mut before = both(previous);
    for (k, stage) in stages.iter().enumerate() {
        let own = both(stage.input);
        let change = [own[0] - before[0], own[1] - before[1]];
        qp.stages[k] = stage.terms(change, COST_SCALE);
        if let Some(extra) = extra {
            let z = values(&states[k + 1], stage.input, states[0].z);
            let (terms, weight) = (&mut qp.stages[k], extra.weight(k));
            let pull = product(weight, &extra.error(k, &z));
            for i in 0..VARIABLES {
                terms.force[i] += COST_SCALE * pull[i];
                for (entry, weight) in terms.weight[i].iter_mut().zip(&weight[i]) {
                    *entry += COST_SCALE * weight;
                }
            }
            let (_, rows) = qp.rows_mut(k);
            for (row, terms) in rows.iter_mut().zip(extra.rows(k)) {
                row.write(terms, &z);
            }
        }
        let (rows, _) = qp.rows_mut(k);
        let speeds = [limits.traction.speed_m_s, limits.steer.speed_m_s];
        let rates = [&stage.traction_change, &stage.steer_change];
        for m in 0..MOTORS {
            rows[2 * m].between(-speeds[m] - own[m], speeds[m] - own[m]);
            rows[2 * m + 1].between(-rates[m].fall - change[m], rates[m].rise - change[m]);
        }
        let tread_m_s = limits.tread_speed_m_s;
        let treads = [own[0] - own[1], own[0] + own[1]];
        for (row, speed) in rows[2 * MOTORS..].iter_mut().zip(treads) {
            row.between(-tread_m_s - speed, tread_m_s - speed);
        }
        before = own;
    }
}

impl StageRow {
    fn between(&mut self, low: f64, high: f64) {
        (self.low, self.high) = (low, high);
    }

    /// Becomes an extra row about z, divided by its size.
    fn write(&mut self, row: &ExtraRow, z: &[f64; VARIABLES]) {
        let size = row_size(row);
        let value = dot(&row.by, z);
        self.by = row.by.map(|by| by / size);
        self.between((row.low - value) / size, (row.high - value) / size);
    }
}

/// Moves corrections of the planned inputs to the nearest that keep bounds, changes and treads.
///
/// Each input has room: that of the stage before, kept, meets all its limits.
pub fn make_feasible(
    corrections: &mut [[f64; MOTORS]],
    stages: &[Stage],
    previous: MotorSpeeds,
    limits: &InputLimits,
) {
    let mut before = previous;
    for (stage, own) in stages.iter().zip(corrections) {
        let wanted = MotorSpeeds {
            traction_m_s: stage.input.traction_m_s + own[0],
            steer_m_s: stage.input.steer_m_s + own[1],
        };
        before = reached(wanted, before, stage, limits);
        own[0] = before.traction_m_s - stage.input.traction_m_s;
        own[1] = before.steer_m_s - stage.input.steer_m_s;
    }
}

/// Returns the speeds nearest to `wanted` that a stage can have after `before`.
fn reached(
    wanted: MotorSpeeds,
    before: MotorSpeeds,
    stage: &Stage,
    limits: &InputLimits,
) -> MotorSpeeds {
    let one = |wanted: f64, before: f64, change: &Change, speed: f64| {
        wanted
            .max((before - change.fall).max(-speed))
            .min((before + change.rise).min(speed))
    };
    let reached = MotorSpeeds {
        traction_m_s: one(
            wanted.traction_m_s,
            before.traction_m_s,
            &stage.traction_change,
            limits.traction.speed_m_s,
        ),
        steer_m_s: one(
            wanted.steer_m_s,
            before.steer_m_s,
            &stage.steer_change,
            limits.steer.speed_m_s,
        ),
    };
    // As far from the speeds before towards these as the faster tread allows.
    let tread = |speeds: &MotorSpeeds| speeds.traction_m_s.abs() + speeds.steer_m_s.abs();
    let (now, then) = (tread(&before), tread(&reached));
    let room = limits.tread_speed_m_s;
    if then <= room {
        return reached;
    }
    // |.| is convex: on the way the tread is at most the line between its ends.
    let share = ((room - now) / (then - now)).clamp(0.0, 1.0);
    MotorSpeeds {
        traction_m_s: before.traction_m_s + share * (reached.traction_m_s - before.traction_m_s),
        steer_m_s: before.steer_m_s + share * (reached.steer_m_s - before.steer_m_s),
    }
}

fn both(speeds: MotorSpeeds) -> [f64; MOTORS] {
    [speeds.traction_m_s, speeds.steer_m_s]
}
