//! The Riccati recursion over the stages of a QP.
//!
//! With each input free, fixed, or tied to the one before, the recursion over (xi_k, u_{k-1}) solves the QP
//! of [`StageTerms`] in a time proportional to the number of stages, and a fraction of that of the sparse
//! linear system.

use super::stage_terms::{MOTORS, StageTerms, dot};

/// Entries of (xi, inputs of the stage before).
const STATES: usize = 5;
/// Those, and the stage's own inputs.
const ALL: usize = STATES + MOTORS;

/// What determines an input.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum InputRule {
    /// The cost.
    Free,
    /// A value, m/s.
    Fixed(f64),
    /// The same motor's input of the stage before, plus a difference, m/s.
    Tied(f64),
}

/// How a stage's inputs follow from (xi, inputs before): u_m = constant + gain' (xi, inputs before, u_0).
#[derive(Debug, Clone, Copy, Default)]
struct InputFeedback {
    gains: [[f64; ALL - 1]; MOTORS],
    constants: [f64; MOTORS],
    /// 1 / curvature of the inputs that are free, 0 of the others.
    compliances: [f64; MOTORS],
}

/// A quadratic function of (xi, inputs before): curvature and slope.
#[derive(Debug, Clone, Copy, Default)]
struct CostToGo {
    curvature: [[f64; STATES]; STATES],
    slope: [f64; STATES],
}

/// Inputs, states and derivatives of the cost by the inputs, stage by stage.
#[derive(Debug, Clone, Default)]
pub struct StageTrajectory {
    /// u.
    pub inputs: Vec<[f64; MOTORS]>,
    /// Derivatives of the cost by u, rows left out.
    pub slopes: Vec<[f64; MOTORS]>,
    /// xi at the stages' ends.
    pub states: Vec<[f64; 3]>,
    /// Derivatives of the cost from each stage on by xi at its begin.
    pub costates: Vec<[f64; 3]>,
}

impl StageTrajectory {
    fn new(stages: usize) -> Self {
        Self {
            inputs: vec![[0.0; MOTORS]; stages],
            slopes: vec![[0.0; MOTORS]; stages],
            states: vec![[0.0; 3]; stages],
            costates: vec![[0.0; 3]; stages],
        }
    }
}

/// The Riccati recursion and its solutions.
#[derive(Clone)]
pub struct Recursion {
    feedback: Vec<InputFeedback>,
    /// From each stage on, and of the end.
    to_go: Vec<CostToGo>,
    /// The optimum under the rules.
    pub optimum: StageTrajectory,
    /// How the optimum moves under a force on inputs.
    pub direction: StageTrajectory,
    constants: Vec<[f64; MOTORS]>,
}

impl Recursion {
    /// Returns the workspace of a horizon of `stages`.
    pub fn new(stages: usize) -> Self {
        Self {
            feedback: vec![InputFeedback::default(); stages],
            to_go: vec![CostToGo::default(); stages + 1],
            optimum: StageTrajectory::new(stages),
            direction: StageTrajectory::new(stages),
            constants: vec![[0.0; MOTORS]; stages],
        }
    }

    /// Solves for `rules`, of which those after stage `last` are the same as before. Returns the cost of the
    /// optimum, none where a free input has no positive curvature.
    pub fn solve(
        &mut self,
        stages: &[StageTerms],
        rules: &[[InputRule; MOTORS]],
        last: usize,
    ) -> Option<f64> {
        for k in (0..=last).rev() {
            let (feedback, to_go) = backwards(&stages[k], rules[k], &self.to_go[k + 1])?;
            self.feedback[k] = feedback;
            self.to_go[k] = to_go;
        }
        let optimum = &mut self.optimum;
        let (mut xi, mut before) = ([0.0; 3], [0.0; MOTORS]);
        for (k, (terms, feedback)) in stages.iter().zip(&self.feedback).enumerate() {
            let inputs = feedback.inputs(&feedback.constants, &xi, &before);
            xi = forwards(terms, &xi, &inputs);
            optimum.states[k] = xi;
            optimum.inputs[k] = inputs;
            before = inputs;
        }
        Some(differentiate(stages, optimum, 1.0))
    }

    /// Moves the optimum under the rules by a force on the inputs of a motor from stage `k` on: 1 at
    /// stage `k`, and `before` at the one before. Sets `direction`, without the force in its slopes.
    pub fn push(&mut self, stages: &[StageTerms], motor: usize, k: usize, force: f64, before: f64) {
        self.constants.fill([0.0; MOTORS]);
        let mut slope = [0.0; STATES];
        for i in (0..=k).rev() {
            let (terms, feedback) = (&stages[i], &self.feedback[i]);
            let ahead = [slope[0], slope[1], slope[2]];
            let mut all = [0.0; ALL];
            all[..3].copy_from_slice(&terms.back(ahead));
            for m in 0..MOTORS {
                all[STATES + m] = dot(&terms.by_input[m], &ahead) + slope[3 + m];
            }
            if i == k {
                all[STATES + motor] += force;
            } else if i + 1 == k {
                all[STATES + motor] += before;
            }
            for m in (0..MOTORS).rev() {
                let own = all[STATES + m];
                for (entry, gain) in all[..STATES + m].iter_mut().zip(&feedback.gains[m]) {
                    *entry += gain * own;
                }
                self.constants[i][m] = -feedback.compliances[m] * own;
            }
            slope.copy_from_slice(&all[..STATES]);
        }
        let direction = &mut self.direction;
        let (mut xi, mut inputs) = ([0.0; 3], [0.0; MOTORS]);
        for (i, (terms, feedback)) in stages.iter().zip(&self.feedback).enumerate() {
            inputs = feedback.inputs(&self.constants[i], &xi, &inputs);
            xi = forwards(terms, &xi, &inputs);
            direction.states[i] = xi;
            direction.inputs[i] = inputs;
        }
        differentiate(stages, direction, 0.0);
    }
}

/// The feedback that a QP's cost asks for, limits aside.
#[derive(Clone)]
pub struct PlanFeedback {
    /// Terms and feedback of the stages, the last first.
    stages: Vec<(StageTerms, InputFeedback)>,
}

impl PlanFeedback {
    /// Returns the workspace of a horizon of `stages`.
    pub fn new(stages: usize) -> Self {
        Self {
            stages: Vec::with_capacity(stages),
        }
    }

    /// Finds the feedback of stages with these terms, the first one first, each with the curvature that extra costs have by
    /// the state at its end and its inputs; none where an input has no positive curvature.
    pub fn find(
        &mut self,
        terms: impl DoubleEndedIterator<Item = (StageTerms, Option<[[f64; STATES]; STATES]>)>,
    ) -> Option<()> {
        self.stages.clear();
        let mut after = CostToGo::default();
        for (terms, extra) in terms.rev() {
            if let Some(extra) = extra {
                let curvature = after.curvature.as_flattened_mut();
                for (entry, extra) in curvature.iter_mut().zip(extra.as_flattened()) {
                    *entry += extra;
                }
            }
            let (feedback, to_go) = backwards(&terms, [InputRule::Free; MOTORS], &after)?;
            self.stages.push((terms, feedback));
            after = to_go;
        }
        Some(())
    }

    /// Returns by how much the state at the stages' ends changes where that at the first one's begin changes by `xi`.
    pub fn answer(&self, mut xi: [f64; 3]) -> impl Iterator<Item = [f64; 3]> {
        let mut before = [0.0; MOTORS];
        self.stages.iter().rev().map(move |(terms, feedback)| {
            let inputs = feedback.inputs(&[0.0; MOTORS], &xi, &before);
            xi = forwards(terms, &xi, &inputs);
            before = inputs;
            xi
        })
    }
}

impl InputFeedback {
    fn inputs(
        &self,
        constants: &[f64; MOTORS],
        xi: &[f64; 3],
        before: &[f64; MOTORS],
    ) -> [f64; MOTORS] {
        let known = [xi[0], xi[1], xi[2], before[0], before[1]];
        let of = |m: usize| constants[m] + dot(&self.gains[m][..STATES], &known);
        let first = of(0);
        [first, of(1) + self.gains[1][STATES] * first]
    }
}

/// Returns A xi + B u.
fn forwards(terms: &StageTerms, xi: &[f64; 3], inputs: &[f64; MOTORS]) -> [f64; 3] {
    std::array::from_fn(|i| {
        xi[i]
            + terms.by_yaw[i] * xi[2]
            + terms.by_input[0][i] * inputs[0]
            + terms.by_input[1][i] * inputs[1]
    })
}

/// Sets the derivatives of the cost and returns the cost; its linear terms are multiplied
/// by `linear`.
fn differentiate(stages: &[StageTerms], path: &mut StageTrajectory, linear: f64) -> f64 {
    let mut cost = 0.0;
    let mut ahead = [0.0; 3];
    let mut change_after = [0.0; MOTORS];
    for (k, terms) in stages.iter().enumerate().rev() {
        let xi = &path.states[k];
        for i in 0..3 {
            let (turned, force) = (dot(&terms.weight[i], xi), linear * terms.force[i]);
            cost += xi[i] * (0.5 * turned + force);
            ahead[i] += turned + force;
        }
        let yaw = if k == 0 { 0.0 } else { path.states[k - 1][2] };
        let [by_yaw, by_inputs @ ..] = &terms.speed_row;
        let speed = by_yaw * yaw + dot(by_inputs, &path.inputs[k]) + linear * terms.speed_error;
        let pull = terms.speed_weight * speed;
        cost += 0.5 * pull * speed;
        for (m, after) in change_after.iter_mut().enumerate() {
            let before = if k == 0 { 0.0 } else { path.inputs[k - 1][m] };
            let change = path.inputs[k][m] - before + linear * terms.change[m];
            let force = terms.change_weight[m] * change;
            let damping = terms.damping * path.inputs[k][m];
            cost += 0.5 * (force * change + damping * path.inputs[k][m]);
            path.slopes[k][m] =
                dot(&terms.by_input[m], &ahead) + force + damping + pull * by_inputs[m] - *after;
            *after = force;
        }
        ahead = terms.back(ahead);
        ahead[2] += pull * by_yaw;
        path.costates[k] = ahead;
    }
    cost
}

/// Returns the feedback of a stage and the cost to go from it, of the cost to go from its end.
fn backwards(
    terms: &StageTerms,
    rules: [InputRule; MOTORS],
    after: &CostToGo,
) -> Option<(InputFeedback, CostToGo)> {
    let mut p = after.curvature;
    let mut slope = after.slope;
    for i in 0..3 {
        slope[i] += terms.force[i];
        for (entry, weight) in p[i].iter_mut().zip(&terms.weight[i]) {
            *entry += weight;
        }
    }
    let ahead = [slope[0], slope[1], slope[2]];
    let mut m = [[0.0; ALL]; ALL];
    let mut h = [0.0; ALL];
    h[..3].copy_from_slice(&terms.back(ahead));
    let turned: [f64; 3] = std::array::from_fn(|i| dot(&p[i][..3], &terms.by_yaw));
    for i in 0..3 {
        m[i][..3].copy_from_slice(&p[i][..3]);
    }
    for i in 0..2 {
        m[i][2] += turned[i];
        m[2][i] = m[i][2];
    }
    m[2][2] += 2.0 * turned[2] + dot(&terms.by_yaw, &turned);
    for j in 0..MOTORS {
        let by_input = &terms.by_input[j];
        // P_xx b + P_xu
        let column: [f64; 3] = std::array::from_fn(|i| dot(&p[i][..3], by_input) + p[i][3 + j]);
        let turned = terms.back(column);
        m[STATES + j][..3].copy_from_slice(&turned);
        for l in 0..MOTORS {
            let across: f64 = dot(&terms.by_input[l], &column);
            m[STATES + l][STATES + j] = across + dot(&p[3 + l][..3], by_input) + p[3 + l][3 + j];
        }
        h[STATES + j] = dot(by_input, &ahead) + slope[3 + j];
        let weight = terms.change_weight[j];
        m[STATES + j][STATES + j] += weight + terms.damping;
        m[3 + j][3 + j] = weight;
        m[STATES + j][3 + j] = -weight;
        h[STATES + j] += weight * terms.change[j];
        h[3 + j] = -weight * terms.change[j];
    }
    let speed_entries = [2, STATES, STATES + 1];
    for (i, by) in speed_entries.into_iter().zip(&terms.speed_row) {
        let pull = terms.speed_weight * by;
        h[i] += pull * terms.speed_error;
        for (j, by) in speed_entries.into_iter().zip(&terms.speed_row) {
            m[i][j] += pull * by;
        }
    }
    let mut feedback = InputFeedback::default();
    for j in (0..MOTORS).rev() {
        let own = STATES + j;
        let line = m[own];
        let gains = &mut feedback.gains[j];
        match rules[j] {
            InputRule::Free => {
                let compliance = 1.0 / line[own];
                // No comparison with a NaN is true, so NaN fails too.
                let curved = compliance > 0.0;
                if !curved {
                    return None;
                }
                feedback.compliances[j] = compliance;
                feedback.constants[j] = -compliance * h[own];
                for i in 0..own {
                    gains[i] = -compliance * line[i];
                    h[i] += gains[i] * h[own];
                    for l in 0..own {
                        m[i][l] += gains[i] * line[l];
                    }
                }
            }
            InputRule::Tied(difference) => {
                let before = 3 + j;
                gains[before] = 1.0;
                feedback.constants[j] = difference;
                for i in 0..own {
                    h[i] += line[i] * difference;
                    m[i][before] += line[i];
                }
                for i in 0..own {
                    m[before][i] += line[i];
                }
                m[before][before] += line[own];
                h[before] += h[own] + line[own] * difference;
            }
            InputRule::Fixed(value) => {
                feedback.constants[j] = value;
                for i in 0..own {
                    h[i] += line[i] * value;
                }
            }
        }
    }
    let mut to_go = CostToGo::default();
    to_go.slope.copy_from_slice(&h[..STATES]);
    for (line, from) in to_go.curvature.iter_mut().zip(&m) {
        line.copy_from_slice(&from[..STATES]);
    }
    Some((feedback, to_go))
}
