//! From any point of the QP to one that meets all its constraints.

use super::{Condenser, Stage};
use crate::mpc::limits::Change;
use crate::mpc::problem::QpData;
use sidehill_plant::speeds::MotorSpeeds;

impl Condenser {
    /// Moves the inputs of a primal point, the first stage's first, to the nearest that keep bounds,
    /// changes and treads; sets the states that follow. `stages` and `data` are those of
    /// the last [`Condenser::assemble`].
    ///
    /// Each input has room: that of the stage before, kept, meets all its limits.
    pub fn make_feasible(&self, stages: &[Stage], data: &QpData, primal: &mut [f64]) {
        let mut before = self.previous;
        for (index, block) in self.blocks.iter().enumerate() {
            for stage_in_block in 0..block.stages {
                let stage = &stages[block.first_stage + stage_in_block];
                let own = block.first + block.input(stage_in_block);
                let wanted = MotorSpeeds {
                    traction_m_s: stage.input.traction_m_s + primal[own],
                    steer_m_s: stage.input.steer_m_s + primal[own + 1],
                };
                let reached = self.reached(wanted, before, stage);
                primal[own] = reached.traction_m_s - stage.input.traction_m_s;
                primal[own + 1] = reached.steer_m_s - stage.input.steer_m_s;
                before = reached;
            }
            if let Some(next) = self.blocks.get(index + 1) {
                let width = block.width();
                for row in 0..3 {
                    let entries = &block.continuity[row * width..(row + 1) * width];
                    let own = &primal[block.first..block.first + width];
                    let known: f64 = entries
                        .iter()
                        .zip(own)
                        .map(|(entry, x)| data.a.nzval[*entry] * x)
                        .sum();
                    primal[next.first + row] = data.b[3 * index + row] - known;
                }
            }
        }
    }

    /// Returns the speeds nearest to `wanted` that a stage can have after `before`.
    fn reached(&self, wanted: MotorSpeeds, before: MotorSpeeds, stage: &Stage) -> MotorSpeeds {
        let limits = &self.limits;
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
            traction_m_s: before.traction_m_s
                + share * (reached.traction_m_s - before.traction_m_s),
            steer_m_s: before.steer_m_s + share * (reached.steer_m_s - before.steer_m_s),
        }
    }
}
