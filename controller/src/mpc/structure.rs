//! Which variables and rows the condensed QP has, and where their values stand in its matrices.

use super::limits::InputLimits;
use super::problem::{CscMatrix, QpData, pattern};
use super::stage_terms::StageTerms;
use std::ops::Range;

/// Rows an input stage has: bounds and changes of both motors, each from both sides.
pub const ROWS_PER_STAGE: usize = 8;

/// Where the parts of a block stand among the variables.
#[derive(Debug, Clone)]
pub struct Block {
    /// First stage of the horizon in it.
    pub first_stage: usize,
    /// Number of its stages.
    pub stages: usize,
    /// First of all the block's variables: its state's deviation, then its inputs.
    pub first: usize,
    /// 3, or 0 in the first block, whose state is known.
    pub states: usize,
    /// Where its upper triangle stands among P's values, by entry (row, column) packed by columns.
    pub hessian: Vec<usize>,
    /// Where the change cost ties its first inputs to the last of the block before (traction, steer).
    pub tie: Option<(usize, usize)>,
    /// Where the rows of the next block's state stand among A's values: 3 rows by `width` entries.
    pub continuity: Vec<usize>,
}

impl Block {
    /// First of a stage's two inputs among the block's variables.
    pub fn input(&self, stage_in_block: usize) -> usize {
        self.states + 2 * stage_in_block
    }

    /// Number of its variables.
    pub fn width(&self) -> usize {
        self.states + 2 * self.stages
    }
}

/// Returns the blocks of a horizon, a QP of their structure that holds the values which never
/// change, and where the entries of the extra rows of each stage stand among A's values. `extra_rows` is their number
/// in each stage where there are extra terms.
pub fn structure(
    stages: usize,
    block_stages: usize,
    limits: &InputLimits,
    tread_rows: bool,
    extra_rows: Option<usize>,
) -> (Vec<Block>, QpData, Vec<Vec<usize>>) {
    let (mut blocks, variables) = blocks(stages, block_stages);
    let p = hessian(&mut blocks, variables);
    let mut rows = RowList::default();
    let continuity = rows.continuity(&blocks);
    let equalities = rows.count;
    rows.inputs(&blocks, limits, tread_rows);
    let extra = rows.extra(&blocks, extra_rows.unwrap_or(0));
    let (mut a, positions) = pattern(rows.count, variables, &rows.entries);
    for (position, value) in positions.iter().zip(&rows.values) {
        a.nzval[*position] = *value;
    }
    for (block, entries) in blocks.iter_mut().zip(continuity) {
        block.continuity = positions[entries].to_vec();
    }
    let extra = extra.into_iter().map(|entries| positions[entries].to_vec());
    let extra = extra.collect();
    let data = QpData {
        p,
        q: vec![0.0; variables],
        a,
        b: vec![0.0; rows.count],
        equalities,
        stages: if tread_rows || extra_rows.is_some() {
            Vec::new()
        } else {
            vec![StageTerms::default(); stages]
        },
    };
    (blocks, data, extra)
}

/// Returns the blocks, and how many variables they have in all.
fn blocks(stages: usize, block_stages: usize) -> (Vec<Block>, usize) {
    let mut blocks = Vec::new();
    let (mut first_stage, mut first) = (0, 0);
    while first_stage < stages {
        let length = block_stages.min(stages - first_stage);
        let states = if first_stage == 0 { 0 } else { 3 };
        blocks.push(Block {
            first_stage,
            stages: length,
            first,
            states,
            hessian: Vec::new(),
            tie: None,
            continuity: Vec::new(),
        });
        first += states + 2 * length;
        first_stage += length;
    }
    (blocks, first)
}

/// Returns P: each block's dense upper triangle, and the change cost's ties between blocks.
fn hessian(blocks: &mut [Block], variables: usize) -> CscMatrix<f64> {
    let mut entries = Vec::new();
    let mut places: Vec<(usize, usize)> = Vec::new();
    for (i, block) in blocks.iter().enumerate() {
        let start = entries.len();
        let width = block.width();
        for column in 0..width {
            for row in 0..=column {
                entries.push((block.first + row, block.first + column));
            }
        }
        if i > 0 {
            let before = &blocks[i - 1];
            let last = before.first + before.input(before.stages - 1);
            let own = block.first + block.input(0);
            entries.push((last, own));
            entries.push((last + 1, own + 1));
        }
        places.push((start, width * (width + 1) / 2));
    }
    let (p, positions) = pattern(variables, variables, &entries);
    for (i, (start, count)) in places.into_iter().enumerate() {
        blocks[i].hessian = positions[start..start + count].to_vec();
        blocks[i].tie = (i > 0).then(|| (positions[start + count], positions[start + count + 1]));
    }
    p
}

/// The rows of A while they are listed.
#[derive(Default)]
struct RowList {
    entries: Vec<(usize, usize)>,
    values: Vec<f64>,
    count: usize,
}

impl RowList {
    fn set(&mut self, row: usize, column: usize, value: f64) {
        self.entries.push((row, column));
        self.values.push(value);
    }

    /// Lists the rows that tie each block's end to the next one's state; returns for each block
    /// which entries belong to its own variables.
    fn continuity(&mut self, blocks: &[Block]) -> Vec<Range<usize>> {
        let mut places = Vec::new();
        for pair in blocks.windows(2) {
            let (block, next) = (&pair[0], &pair[1]);
            let start = self.entries.len();
            for row in 0..3 {
                for column in 0..block.width() {
                    self.set(self.count + row, block.first + column, 0.0);
                }
            }
            places.push(start..self.entries.len());
            for row in 0..3 {
                self.set(self.count + row, next.first + row, 1.0);
            }
            self.count += 3;
        }
        places
    }

    /// Lists `count` extra rows of each stage, each from above and from below; returns for each stage which entries are
    /// theirs.
    fn extra(&mut self, blocks: &[Block], count: usize) -> Vec<Range<usize>> {
        let mut places = Vec::new();
        for block in blocks {
            for stage in 0..block.stages {
                let start = self.entries.len();
                for _ in 0..2 * count {
                    for column in 0..block.input(stage) + 2 {
                        self.set(self.count, block.first + column, 0.0);
                    }
                    self.count += 1;
                }
                places.push(start..self.entries.len());
            }
        }
        places
    }

    /// Lists the bounds on the inputs, their changes and, where wanted, the treads.
    fn inputs(&mut self, blocks: &[Block], limits: &InputLimits, tread_rows: bool) {
        let motors = [&limits.traction, &limits.steer];
        let mut before: Option<usize> = None;
        for block in blocks {
            for stage in 0..block.stages {
                let own = block.first + block.input(stage);
                for (motor, limit) in motors.into_iter().enumerate() {
                    let change = change_scale(limit.acceleration_m_s2);
                    for sign in [1.0, -1.0] {
                        self.set(self.count, own + motor, sign / limit.speed_m_s);
                        self.set(self.count + 1, own + motor, sign * change);
                        if let Some(before) = before {
                            self.set(self.count + 1, before + motor, -sign * change);
                        }
                        self.count += 2;
                    }
                }
                if tread_rows {
                    // +-(tau - sigma) and +-(tau + sigma)
                    for (sign, side) in [(1.0, -1.0), (-1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
                        self.set(self.count, own, sign / limits.tread_speed_m_s);
                        self.set(self.count, own + 1, sign * side / limits.tread_speed_m_s);
                        self.count += 1;
                    }
                }
                before = Some(own);
            }
        }
    }
}

/// Returns the position of (row, column) in an upper triangle packed by columns.
pub fn packed(row: usize, column: usize) -> usize {
    column * (column + 1) / 2 + row
}

/// Returns the factor that brings a change of speed to the size of 1.
pub fn change_scale(acceleration_m_s2: f64) -> f64 {
    /// A typical stage, s.
    const STAGE_S: f64 = 0.15;
    1.0 / (acceleration_m_s2 * STAGE_S)
}
