//! Which bounds and changes of the inputs are active, and what follows from that.
//!
//! For each motor the active changes tie consecutive inputs to chains. A chain with an active bound in
//! it, or with an active first change, is fixed; any other has one degree of freedom. A second bound
//! in a fixed chain would be linearly dependent and is never active.

use super::problem::QpData;
use super::recursion::InputRule;
use super::rows::Rows;
use super::stage_terms::MOTORS;
use super::structure::ROWS_PER_STAGE;
use std::ops::RangeInclusive;

/// Whether a limit is one of an input or of its change from the stage before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LimitKind {
    Bound,
    Change,
}

pub const KINDS: [LimitKind; 2] = [LimitKind::Bound, LimitKind::Change];

/// A limit from both sides: of a kind, at a stage, of a motor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limit {
    pub kind: LimitKind,
    pub stage: usize,
    pub motor: usize,
}

impl Limit {
    /// Returns what it limits, of inputs.
    pub fn of(self, inputs: &[[f64; MOTORS]]) -> f64 {
        let value = inputs[self.stage][self.motor];
        if self.kind == LimitKind::Change && self.stage > 0 {
            value - inputs[self.stage - 1][self.motor]
        } else {
            value
        }
    }
}

/// A value for each limit.
#[derive(Debug, Clone, Default)]
pub struct PerLimit<T> {
    values: Vec<[[T; MOTORS]; 2]>,
}

impl<T: Copy> PerLimit<T> {
    pub fn new(stages: usize, value: T) -> Self {
        Self {
            values: vec![[[value; MOTORS]; 2]; stages],
        }
    }

    pub fn get(&self, limit: Limit) -> T {
        self.values[limit.stage][limit.kind as usize][limit.motor]
    }

    pub fn set(&mut self, limit: Limit, value: T) {
        self.values[limit.stage][limit.kind as usize][limit.motor] = value;
    }

    pub fn fill(&mut self, value: T) {
        self.values.fill([[value; MOTORS]; 2]);
    }

    pub fn copy_from(&mut self, other: &Self) {
        self.values.copy_from_slice(&other.values);
    }
}

/// The limits and the set of the active ones.
#[derive(Clone)]
pub struct ActiveLimits {
    stages: usize,
    /// Low and high, m/s.
    ranges: PerLimit<[f64; 2]>,
    /// -1 where the low side is active, 1 where the high side is, else 0.
    pub sides: PerLimit<i8>,
    pub rules: Vec<[InputRule; MOTORS]>,
}

impl ActiveLimits {
    pub fn new(stages: usize) -> Self {
        Self {
            stages,
            ranges: PerLimit::new(stages, [0.0; 2]),
            sides: PerLimit::new(stages, 0),
            rules: vec![[InputRule::Free; MOTORS]; stages],
        }
    }

    /// Returns all limits, stage by stage.
    pub fn limits(&self) -> impl Iterator<Item = Limit> + use<> {
        (0..self.stages * MOTORS * KINDS.len()).map(|place| Limit {
            kind: KINDS[place % 2],
            motor: place / 2 % 2,
            stage: place / 4,
        })
    }

    /// Takes the limits from the rows of a QP, and those of `guess` as active.
    pub fn load(&mut self, data: &QpData, rows: &Rows, guess: &[bool]) {
        self.sides.fill(0);
        for limit in self.limits() {
            // A row's last entry is its own stage's.
            let end = |side: i8| {
                let row = row_of(limit, side);
                data.b[data.equalities + row] / rows.last(data, row)
            };
            self.ranges.set(limit, [end(-1), end(1)]);
            for side in [1, -1] {
                if guess[row_of(limit, side)] {
                    self.add(limit, side);
                }
            }
        }
    }

    /// Marks the active rows in `members`.
    pub fn store(&self, members: &mut [bool]) {
        members.fill(false);
        for limit in self.limits() {
            let side = self.sides.get(limit);
            if side != 0 {
                members[row_of(limit, side)] = true;
            }
        }
    }

    /// Returns where the row of an active limit stands among all rows of a QP, and the size of its own stage's entry;
    /// none of an inactive limit.
    pub fn row(&self, limit: Limit, data: &QpData, rows: &Rows) -> Option<(usize, f64)> {
        let side = self.sides.get(limit);
        let row = row_of(limit, side);
        (side != 0).then(|| (data.equalities + row, rows.last(data, row).abs()))
    }

    /// Returns the value of the active side.
    fn value(&self, limit: Limit) -> f64 {
        self.ranges.get(limit)[usize::from(self.sides.get(limit) > 0)]
    }

    /// Returns how far an inactive limit is exceeded, m/s, and on which side.
    pub fn excess(&self, limit: Limit, inputs: &[[f64; MOTORS]]) -> (f64, i8) {
        let value = limit.of(inputs);
        let [low, high] = self.ranges.get(limit);
        if value > high {
            (value - high, 1)
        } else {
            (low - value, -1)
        }
    }

    /// Makes a limit active unless one of it is or it depends on those that are; returns whether it did.
    pub fn add(&mut self, limit: Limit, side: i8) -> bool {
        let added = self.sides.get(limit) == 0 && !self.depends(limit);
        if added {
            self.sides.set(limit, side);
        }
        added
    }

    /// Returns whether a limit is linearly dependent on the active ones.
    pub fn depends(&self, limit: Limit) -> bool {
        let Limit { stage, motor, .. } = limit;
        self.is_fixed(stage, motor)
            && (limit.kind == LimitKind::Bound || stage == 0 || self.is_fixed(stage - 1, motor))
    }

    /// Returns whether an input's chain has a fixed value.
    fn is_fixed(&self, stage: usize, motor: usize) -> bool {
        let mut first = stage;
        while first > 0 && self.is_tied(first, motor) {
            first -= 1;
        }
        self.fixed_at(self.chain(first, motor), motor).is_some()
    }

    fn is_tied(&self, stage: usize, motor: usize) -> bool {
        self.sides.values[stage][LimitKind::Change as usize][motor] != 0
    }

    /// Returns the stages of the chain that begins with `first`.
    fn chain(&self, first: usize, motor: usize) -> RangeInclusive<usize> {
        let mut last = first;
        while last + 1 < self.stages && self.is_tied(last + 1, motor) {
            last += 1;
        }
        first..=last
    }

    /// Returns the limit that fixes a chain.
    fn fixed_at(&self, chain: RangeInclusive<usize>, motor: usize) -> Option<Limit> {
        if *chain.start() == 0 && self.is_tied(0, motor) {
            return Some(limit(LimitKind::Change, 0, motor));
        }
        chain
            .map(|stage| limit(LimitKind::Bound, stage, motor))
            .find(|bound| self.sides.get(*bound) != 0)
    }

    /// Sets the rules that follow; returns the last stage at which they changed.
    pub fn update_rules(&mut self) -> Option<usize> {
        let mut last_changed = None;
        for motor in 0..MOTORS {
            let mut first = 0;
            while first < self.stages {
                let chain = self.chain(first, motor);
                let fixed = self.fixed_at(chain.clone(), motor);
                // The first input of the chain, where it is fixed.
                let mut value = fixed.map(|fixing| {
                    let ties = first + 1..=fixing.stage;
                    let rise: f64 = ties
                        .map(|k| self.value(limit(LimitKind::Change, k, motor)))
                        .sum();
                    self.value(fixing) - rise
                });
                for stage in chain.clone() {
                    let tie = if stage > first {
                        self.value(limit(LimitKind::Change, stage, motor))
                    } else {
                        0.0
                    };
                    let rule = match &mut value {
                        Some(value) => {
                            *value += tie;
                            InputRule::Fixed(*value)
                        }
                        None if stage == first => InputRule::Free,
                        None => InputRule::Tied(tie),
                    };
                    if self.rules[stage][motor] != rule {
                        self.rules[stage][motor] = rule;
                        last_changed = last_changed.max(Some(stage));
                    }
                }
                first = chain.end() + 1;
            }
        }
        last_changed
    }

    /// Sets the multipliers of the active limits that balance `slopes`, the derivatives of the cost by
    /// the inputs; a limit that pushes the right way has a positive one.
    pub fn balance(&self, slopes: impl Fn(usize, usize) -> f64, multipliers: &mut PerLimit<f64>) {
        let mut put = |limit: Limit, force: f64| {
            multipliers.set(limit, f64::from(self.sides.get(limit)) * force);
        };
        for motor in 0..MOTORS {
            let mut first = 0;
            while first < self.stages {
                let chain = self.chain(first, motor);
                let last = *chain.end();
                let fixing = self.fixed_at(chain, motor);
                let middle = fixing.map_or(last, |fixing| fixing.stage);
                // From both ends towards the input that is fixed.
                let mut left = 0.0;
                for stage in first..middle {
                    left += slopes(stage, motor);
                    put(limit(LimitKind::Change, stage + 1, motor), left);
                }
                let mut right = 0.0;
                for stage in (middle + 1..=last).rev() {
                    right -= slopes(stage, motor);
                    put(limit(LimitKind::Change, stage, motor), right);
                }
                if let Some(fixing) = fixing {
                    put(fixing, right - left - slopes(middle, motor));
                }
                first = last + 1;
            }
        }
    }
}

fn limit(kind: LimitKind, stage: usize, motor: usize) -> Limit {
    Limit { kind, stage, motor }
}

/// Returns the row of a limit's side: bound and change from above, then from below.
fn row_of(limit: Limit, side: i8) -> usize {
    let below = usize::from(side < 0);
    ROWS_PER_STAGE * limit.stage
        + 4 * limit.motor
        + 2 * below
        + usize::from(limit.kind == LimitKind::Change)
}
