//! The horizon's linearised dynamics and costs as a QP, condensed in blocks of a few stages.
//!
//! Direct multiple shooting about a plan (x_k, u_k), k = 0..N, with deviations xi and du:
//!
//! ```text
//! xi_{k+1} = A_k xi_k + B_k du_k,   xi_0 = 0
//! cost = sum_k  w_along a_k^2 + w_cross n_k^2 + w_heading h_k^2 + w_speed s_k^2
//!        +  sum_k  r |u_k - u_{k-1}|^2 + d |du_k|^2
//! ```
//!
//! with a, n, h the errors of the tracked point along and across the reference and of the heading at the end
//! of stage k, and s that of its mean speed along the reference during the stage.
//! Inside a block the deviations are eliminated (they are linear in the block's first one and its
//! inputs); between blocks they stay variables tied by equalities. That keeps the Hessian's blocks
//! small and dense, where an interior-point method spends the least time on 20 to 50 stages.

mod extra;
mod feasible;
mod terms;

use super::limits::{Change, InputLimits};
use super::problem::QpData;
use super::settings::ChangeWeights;
use super::structure::{Block, ROWS_PER_STAGE, change_scale, packed, structure};
pub use extra::PlannedExtra;
use extra::{ExtraRows, StageLines};
use nalgebra::Vector3;
use sidehill_plant::prediction::LinearisedStep;
use sidehill_plant::speeds::MotorSpeeds;

/// What one stage contributes: its linearised dynamics and the cost at its end.
#[derive(Debug, Clone, Copy)]
pub struct Stage {
    /// Increment and sensitivities of the stage's step about the plan.
    pub step: LinearisedStep,
    /// Plan's next tracked point less the reference, x and y in m, and heading less the one asked for there, rad.
    pub error: Vector3<f64>,
    /// Derivative of the tracked point's (x, y) by the heading, m/rad; zero of the origin.
    pub point_by_yaw_m: (f64, f64),
    /// Unit vector along the reference, (x, y).
    pub along: (f64, f64),
    /// How the asked heading turns along the reference, rad/m.
    pub curvature_per_m: f64,
    /// Weights at the end of this stage.
    pub weights: StageWeights,
    /// Derivatives of the speed along the reference by the yaw before, traction and steer, in m/s per rad and 1.
    pub speed_row: [f64; 3],
    /// Planned speed along the reference less that of the target, m/s.
    pub speed_error: f64,
    /// Planned input of the stage.
    pub input: MotorSpeeds,
    /// Weights r of a change of traction and steer from the stage before, 1/(m/s)^2.
    pub change_weights: ChangeWeights,
    /// Weight d of the correction of each planned input, 1/(m/s)^2.
    pub damping: f64,
    /// How far traction may change from the stage before.
    pub traction_change: Change,
    /// How far steer may change from the stage before.
    pub steer_change: Change,
}

impl Stage {
    /// Returns the weights of its cost.
    pub fn weights(&self) -> CostWeights {
        CostWeights {
            errors: self.weights,
            changes: self.change_weights,
        }
    }
}

/// The weights of a stage's cost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CostWeights {
    /// Of its errors.
    pub errors: StageWeights,
    /// Of the changes of its inputs, 1/(m/s)^2.
    pub changes: ChangeWeights,
}

/// Weights of the errors at the end of a stage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StageWeights {
    /// Of the position error along the reference, 1/m^2.
    pub along_per_m2: f64,
    /// Of the position error across it, 1/m^2.
    pub cross_per_m2: f64,
    /// Of the heading error, 1/rad^2.
    pub heading_per_rad2: f64,
    /// Of the speed along the reference, 1/(m/s)^2.
    pub speed_s2_per_m2: f64,
}

impl StageWeights {
    /// Returns all weights times `factor`.
    pub(crate) fn scaled(self, factor: f64) -> Self {
        Self {
            along_per_m2: factor * self.along_per_m2,
            cross_per_m2: factor * self.cross_per_m2,
            heading_per_rad2: factor * self.heading_per_rad2,
            speed_s2_per_m2: factor * self.speed_s2_per_m2,
        }
    }
}

/// Builds the QP of a horizon and reads its solution back.
#[derive(Clone)]
pub struct Condenser {
    blocks: Vec<Block>,
    stages: usize,
    /// Limits of this cycle.
    limits: InputLimits,
    /// Limits as they were at first, by which the rows are scaled.
    row_limits: InputLimits,
    tread_rows: bool,
    first_inequality: usize,
    extra_rows: ExtraRows,
    block_stages: usize,
    cost_scale: f64,
    /// The input in force, of the last QP.
    previous: MotorSpeeds,
    /// Rows of d(x, y, yaw)/d(block's variables), reused by every block.
    jacobian: [Vec<f64>; 3],
    along: Vec<f64>,
    cross: Vec<f64>,
    heading: Vec<f64>,
    speed: Vec<f64>,
    hessian: Vec<f64>,
}

impl Condenser {
    /// Returns the condenser of a horizon of `stages` in blocks of `block_stages`, with the QP data
    /// whose values it writes. With extra terms it has so many rows of them a stage.
    pub fn new(
        stages: usize,
        block_stages: usize,
        limits: InputLimits,
        extra_rows: Option<usize>,
        cost_scale: f64,
    ) -> (Self, QpData) {
        let tread_rows = !limits.treads_follow_from_motors();
        let (blocks, data, places) =
            structure(stages, block_stages, &limits, tread_rows, extra_rows);
        let extra_count = 2 * stages * extra_rows.unwrap_or(0);
        let widest = blocks.iter().map(Block::width).max().unwrap_or(0);
        let condenser = Self {
            blocks,
            stages,
            row_limits: limits,
            limits,
            tread_rows,
            first_inequality: data.equalities,
            extra_rows: ExtraRows::new(data.b.len() - extra_count, extra_count, places),
            block_stages,
            cost_scale,
            previous: MotorSpeeds::STOP,
            jacobian: std::array::from_fn(|_| vec![0.0; widest]),
            along: vec![0.0; widest],
            cross: vec![0.0; widest],
            heading: vec![0.0; widest],
            speed: vec![0.0; widest],
            hessian: vec![0.0; widest * widest],
        };
        (condenser, data)
    }

    /// Returns the condenser of the same horizon with other extra rows, and its QP data.
    pub fn with_extra_rows(&self, extra_rows: Option<usize>) -> (Self, QpData) {
        let (stages, block_stages) = (self.stages, self.block_stages);
        let limits = self.row_limits;
        let (mut other, data) =
            Self::new(stages, block_stages, limits, extra_rows, self.cost_scale);
        other.limits = self.limits;
        (other, data)
    }

    /// Writes the QP of `stages` about the plan, which begins in the present state; `previous` is the
    /// input in force, `extra` are terms with as many rows as there is room for.
    ///
    /// `stages` must have the horizon's length; no memory is allocated.
    pub fn assemble(
        &mut self,
        stages: &[Stage],
        previous: MotorSpeeds,
        extra: Option<PlannedExtra<'_>>,
        data: &mut QpData,
    ) {
        debug_assert_eq!(stages.len(), self.stages);
        self.previous = previous;
        data.q.fill(0.0);
        for i in 0..self.blocks.len() {
            self.condense_block(i, stages, extra, data);
        }
        self.input_cost(stages, previous, data);
        self.bounds(stages, previous, data);
        let mut before = previous;
        for (own, stage) in data.stages.iter_mut().zip(stages) {
            let change = [
                stage.input.traction_m_s - before.traction_m_s,
                stage.input.steer_m_s - before.steer_m_s,
            ];
            *own = stage.terms(change, self.cost_scale);
            before = stage.input;
        }
    }

    /// Returns the limits of the inputs, to be lowered to those of the motors as they are.
    pub fn limits_mut(&mut self) -> &mut InputLimits {
        &mut self.limits
    }

    /// Returns the largest multiplier of an extra row, for each of its units and in those of the cost, of the
    /// multipliers of a QP.
    pub fn largest_extra_multiplier(&self, dual: &[f64]) -> f64 {
        // The QP's cost is half of the plan's, times the scale.
        2.0 / self.cost_scale * self.extra_rows.largest_multiplier(dual)
    }

    /// Writes one block's Hessian, gradient, extra rows and continuity.
    fn condense_block(
        &mut self,
        index: usize,
        stages: &[Stage],
        extra: Option<PlannedExtra<'_>>,
        data: &mut QpData,
    ) {
        let block = &self.blocks[index];
        let width = block.width();
        let [x, y, yaw] = &mut self.jacobian;
        for row in [&mut *x, &mut *y, &mut *yaw] {
            row.fill(0.0);
        }
        if block.states == 3 {
            (x[0], y[1], yaw[2]) = (1.0, 1.0, 1.0);
        }
        self.hessian.fill(0.0);
        for stage_in_block in 0..block.stages {
            let stage = &stages[block.first_stage + stage_in_block];
            let used = block.input(stage_in_block);
            let step = &stage.step;
            let [speed_by_yaw, speed_by_inputs @ ..] = stage.speed_row;
            for (speed, yaw) in self.speed.iter_mut().zip(&*yaw) {
                *speed = speed_by_yaw * yaw;
            }
            self.speed[used..used + 2].copy_from_slice(&speed_by_inputs);
            // Columns of inputs to come are zero.
            for ((x, y), yaw) in x.iter_mut().zip(&mut *y).zip(&mut *yaw) {
                let turned = *yaw;
                *x += step.by_yaw.x * turned;
                *y += step.by_yaw.y * turned;
                *yaw += step.by_yaw.z * turned;
            }
            for (offset, by_input) in [(0, &step.by_traction), (1, &step.by_steer)] {
                x[used + offset] = by_input.x;
                y[used + offset] = by_input.y;
                yaw[used + offset] = by_input.z;
            }
            if let Some(extra) = extra {
                let k = block.first_stage + stage_in_block;
                let lines = StageLines {
                    states: [x, y, yaw],
                    input: used,
                };
                let gradient = &mut data.q[block.first..];
                let hessian = (&mut self.hessian[..], width);
                extra.add_cost(k, &lines, self.cost_scale, gradient, hessian);
                self.extra_rows.write(k, extra, &lines, data);
            }
            let used = used + 2;

            let (along_x, along_y) = stage.along;
            let (point_x, point_y) = stage.point_by_yaw_m;
            let along_by_yaw = along_x * point_x + along_y * point_y;
            let cross_by_yaw = along_x * point_y - along_y * point_x;
            let errors = self.along.iter_mut().zip(&mut self.cross);
            let errors = errors.zip(&mut self.heading);
            for ((((along, cross), heading), (x, y)), yaw) in
                errors.zip(x.iter().zip(&*y)).zip(&*yaw)
            {
                *along = along_x * x + along_y * y + along_by_yaw * yaw;
                *cross = along_x * y - along_y * x + cross_by_yaw * yaw;
                *heading = yaw - stage.curvature_per_m * *along;
            }
            let error_along = along_x * stage.error.x + along_y * stage.error.y;
            let error_cross = along_x * stage.error.y - along_y * stage.error.x;
            let scale = self.cost_scale;
            let w = &stage.weights;
            let (w_a, w_c, w_h, w_s) = (
                scale * w.along_per_m2,
                scale * w.cross_per_m2,
                scale * w.heading_per_rad2,
                scale * w.speed_s2_per_m2,
            );
            for column in 0..used {
                let (a, c, h, s) = (
                    w_a * self.along[column],
                    w_c * self.cross[column],
                    w_h * self.heading[column],
                    w_s * self.speed[column],
                );
                data.q[block.first + column] +=
                    a * error_along + c * error_cross + h * stage.error.z + s * stage.speed_error;
                let packed = &mut self.hessian[column * width..column * width + column + 1];
                let errors = self.along.iter().zip(&self.cross).zip(&self.heading);
                let errors = errors.zip(&self.speed);
                for (entry, (((along, cross), heading), speed)) in packed.iter_mut().zip(errors) {
                    *entry += a * along + c * cross + h * heading + s * speed;
                }
            }
        }
        let mut entry = 0;
        for column in 0..width {
            for row in 0..=column {
                data.p.nzval[block.hessian[entry]] = self.hessian[column * width + row];
                entry += 1;
            }
        }
        if !block.continuity.is_empty() {
            for (row, values) in [&*x, &*y, &*yaw].into_iter().enumerate() {
                for (column, value) in values.iter().enumerate().take(width) {
                    data.a.nzval[block.continuity[row * width + column]] = -value;
                }
            }
        }
    }

    /// Adds r |u_k - u_{k-1}|^2 + d |du_k|^2 for each stage.
    fn input_cost(&self, stages: &[Stage], previous: MotorSpeeds, data: &mut QpData) {
        let mut before: Option<(usize, usize)> = None;
        let mut before_input = previous;
        for (i, block) in self.blocks.iter().enumerate() {
            for stage_in_block in 0..block.stages {
                let stage = &stages[block.first_stage + stage_in_block];
                let own = block.input(stage_in_block);
                let weights = [
                    self.cost_scale * stage.change_weights.traction,
                    self.cost_scale * stage.change_weights.steer,
                ];
                let damping = self.cost_scale * stage.damping;
                let offsets = [
                    stage.input.traction_m_s - before_input.traction_m_s,
                    stage.input.steer_m_s - before_input.steer_m_s,
                ];
                for motor in 0..2 {
                    let (w, offset) = (weights[motor], offsets[motor]);
                    let column = own + motor;
                    data.p.nzval[block.hessian[packed(column, column)]] += w + damping;
                    data.q[block.first + column] += w * offset;
                    let Some((before_block, before_input)) = before else {
                        continue;
                    };
                    let holder = &self.blocks[before_block];
                    let row = before_input + motor;
                    data.p.nzval[holder.hessian[packed(row, row)]] += w;
                    data.q[holder.first + row] -= w * offset;
                    match (before_block == i, block.tie) {
                        (true, _) => data.p.nzval[block.hessian[packed(row, column)]] -= w,
                        (false, Some((traction, steer))) => {
                            data.p.nzval[if motor == 0 { traction } else { steer }] = -w;
                        }
                        (false, None) => {}
                    }
                }
                before = Some((i, own));
                before_input = stage.input;
            }
        }
        debug_assert!(self.blocks.iter().all(|b| {
            let width = b.width();
            b.hessian.len() == width * (width + 1) / 2
        }));
    }

    /// Writes the right-hand sides of bounds, changes and treads.
    fn bounds(&self, stages: &[Stage], previous: MotorSpeeds, data: &mut QpData) {
        let largest_m_s = [self.limits.traction.speed_m_s, self.limits.steer.speed_m_s];
        let scales = [self.row_limits.traction, self.row_limits.steer]
            .map(|limits| (limits.speed_m_s, change_scale(limits.acceleration_m_s2)));
        let mut before = previous;
        let mut row = self.first_inequality;
        for stage in stages {
            let own = [stage.input.traction_m_s, stage.input.steer_m_s];
            let last = [before.traction_m_s, before.steer_m_s];
            let changes = [stage.traction_change, stage.steer_change];
            for motor in 0..2 {
                let (row_speed_m_s, change_scale) = scales[motor];
                let change = own[motor] - last[motor];
                data.b[row] = (largest_m_s[motor] - own[motor]) / row_speed_m_s;
                data.b[row + 1] = (changes[motor].rise - change) * change_scale;
                data.b[row + 2] = (largest_m_s[motor] + own[motor]) / row_speed_m_s;
                data.b[row + 3] = (changes[motor].fall + change) * change_scale;
                row += 4;
            }
            if self.tread_rows {
                let limit = self.limits.tread_speed_m_s;
                let (left, right) = (own[0] - own[1], own[0] + own[1]);
                for (offset, speed) in [left, -left, right, -right].into_iter().enumerate() {
                    data.b[row + offset] = (limit - speed) / limit;
                }
                row += 4;
            }
            before = stage.input;
        }
        debug_assert!(
            row - self.first_inequality
                == stages.len() * (ROWS_PER_STAGE + if self.tread_rows { 4 } else { 0 })
        );
    }

    /// Returns the planned inputs' corrections of a primal point, stage by stage.
    pub fn input_corrections<'a>(
        &'a self,
        primal: &'a [f64],
    ) -> impl Iterator<Item = MotorSpeeds> + 'a {
        self.blocks.iter().flat_map(move |block| {
            (0..block.stages).map(move |stage| {
                let own = block.first + block.input(stage);
                MotorSpeeds {
                    traction_m_s: primal[own],
                    steer_m_s: primal[own + 1],
                }
            })
        })
    }
}
