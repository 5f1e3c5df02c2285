//! The Riccati recursion over the stages of a QP, rows left out.
//!
//! It finds the feedback from (xi_k, du_{k-1}) that the cost asks for, in a time proportional to the number of stages and a
//! fraction of that of a sparse linear system. From it the answer to any linear cost follows.

use super::stage_qp::{MOTORS, Rollout, STATES, StageTerms, VARIABLES, dot};

/// Entries of (xi, inputs of the stage before, inputs).
const ALL: usize = VARIABLES + MOTORS;

/// A quadratic function's curvature.
type Curvature = [[f64; VARIABLES]; VARIABLES];

/// How a stage's inputs follow from (xi, inputs before): u_m = constant + gain' (xi, inputs before, u_0).
#[derive(Debug, Clone, Copy, Default)]
struct InputFeedback {
    gains: [[f64; ALL - 1]; MOTORS],
    /// 1 / curvature of the inputs.
    compliances: [f64; MOTORS],
}

/// The Riccati recursion and its solutions.
#[derive(Clone)]
pub struct Recursion {
    feedback: Vec<InputFeedback>,
    constants: Vec<[f64; MOTORS]>,
}

impl Recursion {
    /// Returns the workspace of a horizon of `stages`.
    pub fn new(stages: usize) -> Self {
        Self {
            feedback: vec![InputFeedback::default(); stages],
            constants: vec![[0.0; MOTORS]; stages],
        }
    }

    /// Finds the feedback; returns whether there is one: not where an input has no positive curvature.
    pub fn factorise(&mut self, stages: &[StageTerms]) -> bool {
        let mut after = Curvature::default();
        for (terms, feedback) in stages.iter().zip(&mut self.feedback).rev() {
            let Some(found) = backwards(terms, &mut after) else {
                return false;
            };
            *feedback = found;
        }
        true
    }

    /// Sets `rollout`, as far as stage `end`, to the minimum of the quadratic cost, without its own linear terms, plus `forces`
    /// times the v of each stage, of which those after stage `last` are zero.
    pub fn respond(
        &mut self,
        stages: &[StageTerms],
        forces: &[[f64; VARIABLES]],
        last: usize,
        end: usize,
        rollout: &mut Rollout,
    ) {
        let mut slope = [0.0; VARIABLES];
        self.constants[last + 1..].fill([0.0; MOTORS]);
        for k in (0..=last).rev() {
            let (terms, feedback) = (&stages[k], &self.feedback[k]);
            for (slope, force) in slope.iter_mut().zip(&forces[k]) {
                *slope += force;
            }
            let ahead = [slope[0], slope[1], slope[2]];
            let mut all = [0.0; ALL];
            all[..STATES].copy_from_slice(&terms.back(ahead));
            for m in 0..MOTORS {
                all[VARIABLES + m] = dot(&terms.by_input[m], &ahead) + slope[STATES + m];
            }
            for m in (0..MOTORS).rev() {
                let own = all[VARIABLES + m];
                for (entry, gain) in all[..VARIABLES + m].iter_mut().zip(&feedback.gains[m]) {
                    *entry += gain * own;
                }
                self.constants[k][m] = -feedback.compliances[m] * own;
            }
            slope.copy_from_slice(&all[..VARIABLES]);
        }
        let (mut xi, mut inputs) = ([0.0; STATES], [0.0; MOTORS]);
        let counted = stages.iter().zip(&self.feedback).take(end + 1);
        for (k, (terms, feedback)) in counted.enumerate() {
            inputs = feedback.inputs(&self.constants[k], &xi, &inputs);
            xi = terms.forward(&xi, &inputs);
            rollout.inputs[k] = inputs;
            rollout.states[k] = xi;
        }
    }

    /// Returns by how much the state at the stages' ends changes where that at the first one's begin changes by `xi`.
    pub fn answer(
        &self,
        stages: &[StageTerms],
        mut xi: [f64; STATES],
    ) -> impl Iterator<Item = [f64; STATES]> {
        let mut before = [0.0; MOTORS];
        stages
            .iter()
            .zip(&self.feedback)
            .map(move |(terms, feedback)| {
                before = feedback.inputs(&[0.0; MOTORS], &xi, &before);
                xi = terms.forward(&xi, &before);
                xi
            })
    }
}

impl InputFeedback {
    fn inputs(
        &self,
        constants: &[f64; MOTORS],
        xi: &[f64; STATES],
        before: &[f64; MOTORS],
    ) -> [f64; MOTORS] {
        let known = [xi[0], xi[1], xi[2], before[0], before[1]];
        let of = |m: usize| constants[m] + dot(&self.gains[m][..VARIABLES], &known);
        let first = of(0);
        [first, of(1) + self.gains[1][VARIABLES] * first]
    }
}

/// Returns the feedback of a stage. `after` is the curvature of the cost to go from its end by (xi, inputs), and becomes that
/// from its begin by (xi, inputs before).
fn backwards(terms: &StageTerms, after: &mut Curvature) -> Option<InputFeedback> {
    let mut p = *after;
    for (line, weights) in p.iter_mut().zip(&terms.weight) {
        for (entry, weight) in line.iter_mut().zip(weights) {
            *entry += weight;
        }
    }
    let mut m = [[0.0; ALL]; ALL];
    let turned: [f64; STATES] = std::array::from_fn(|i| dot(&p[i][..STATES], &terms.by_yaw));
    for i in 0..STATES {
        m[i][..STATES].copy_from_slice(&p[i][..STATES]);
    }
    for i in 0..2 {
        m[i][2] += turned[i];
        m[2][i] = m[i][2];
    }
    m[2][2] += 2.0 * turned[2] + dot(&terms.by_yaw, &turned);
    for j in 0..MOTORS {
        let by_input = &terms.by_input[j];
        // P_xx b + P_xu
        let column: [f64; STATES] =
            std::array::from_fn(|i| dot(&p[i][..STATES], by_input) + p[i][STATES + j]);
        m[VARIABLES + j][..STATES].copy_from_slice(&terms.back(column));
        for l in 0..MOTORS {
            m[VARIABLES + l][VARIABLES + j] = dot(&terms.by_input[l], &column)
                + dot(&p[STATES + l][..STATES], by_input)
                + p[STATES + l][STATES + j];
        }
        let weight = terms.change_weight[j];
        m[VARIABLES + j][VARIABLES + j] += weight;
        m[STATES + j][STATES + j] = weight;
        m[VARIABLES + j][STATES + j] = -weight;
    }
    let speed_entries = [2, VARIABLES, VARIABLES + 1];
    for (i, by) in speed_entries.into_iter().zip(&terms.speed_row) {
        let pull = terms.speed_weight * by;
        for (j, by) in speed_entries.into_iter().zip(&terms.speed_row) {
            m[i][j] += pull * by;
        }
    }
    let mut feedback = InputFeedback::default();
    for j in (0..MOTORS).rev() {
        let own = VARIABLES + j;
        let line = m[own];
        let compliance = 1.0 / line[own];
        // No comparison with a NaN is true, so NaN fails too.
        let curved = compliance > 0.0;
        if !curved {
            return None;
        }
        feedback.compliances[j] = compliance;
        let gains = &mut feedback.gains[j];
        for i in 0..own {
            gains[i] = -compliance * line[i];
            for l in 0..own {
                m[i][l] += gains[i] * line[l];
            }
        }
    }
    for (line, from) in after.iter_mut().zip(&m) {
        line.copy_from_slice(&from[..VARIABLES]);
    }
    Some(feedback)
}
