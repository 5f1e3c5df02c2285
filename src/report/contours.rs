//! Lines of equal height by marching squares.
//!
//! Own code, because the ground may be unknown in places: existing crates close contours along the edge of such a
//! place, which would show a slope that is not there.

/// Heights at the nodes of a regular grid.
pub(super) struct Heights {
    /// Place of the first node.
    pub(super) origin: [f64; 2],
    /// Distance between nodes along both axes.
    pub(super) spacing: f64,
    /// Nodes along x.
    pub(super) columns: usize,
    /// Heights, row by row along x; none where there is no ground.
    pub(super) values: Vec<Option<f64>>,
}

/// A piece of a contour within a cell of the grid.
pub(super) type ContourSegment = [[f64; 2]; 2];

impl Heights {
    /// Returns the pieces of the contour at `level`, unordered. Cells with a node without ground have none.
    pub(super) fn contour(&self, level: f64) -> Vec<ContourSegment> {
        let rows = self.values.len() / self.columns;
        let mut segments = Vec::new();
        for row in 1..rows {
            for column in 1..self.columns {
                self.cell(column - 1, row - 1, level, &mut segments);
            }
        }
        segments
    }

    fn cell(&self, column: usize, row: usize, level: f64, segments: &mut Vec<ContourSegment>) {
        // Counter-clockwise from the node of the lowest coordinates.
        let nodes = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(right, up)| {
            let (column, row) = (column + right, row + up);
            let place = [
                self.origin[0] + self.spacing * column as f64,
                self.origin[1] + self.spacing * row as f64,
            ];
            self.values[row * self.columns + column].map(|height| (place, height))
        });
        let [Some(a), Some(b), Some(c), Some(d)] = nodes else {
            return;
        };
        let sides = [(a, b), (b, c), (c, d), (d, a)];
        let crossings: Vec<_> = sides
            .iter()
            .filter_map(|&(from, to)| crossing(from, to, level))
            .collect();
        match crossings[..] {
            [p, q] => segments.push([p, q]),
            [ab, bc, cd, da] => {
                let mean = 0.25 * (a.1 + b.1 + c.1 + d.1);
                // At a saddle the middle decides which opposite nodes belong together.
                if (mean < level) == (a.1 < level) {
                    segments.extend([[ab, bc], [cd, da]]);
                } else {
                    segments.extend([[da, ab], [bc, cd]]);
                }
            }
            _ => {}
        }
    }
}

/// Where a side of a cell passes `level`.
fn crossing(from: ([f64; 2], f64), to: ([f64; 2], f64), level: f64) -> Option<[f64; 2]> {
    if (from.1 < level) == (to.1 < level) {
        return None;
    }
    let share = (level - from.1) / (to.1 - from.1);
    let between = |axis: usize| from.0[axis] + share * (to.0[axis] - from.0[axis]);
    Some([between(0), between(1)])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heights(side: usize, height: impl Fn(f64, f64) -> Option<f64>) -> Heights {
        let spacing = 10.0 / (side - 1) as f64;
        let at = |i: usize| -5.0 + spacing * i as f64;
        let values = (0..side * side).map(|i| height(at(i % side), at(i / side)));
        Heights {
            origin: [-5.0, -5.0],
            spacing,
            columns: side,
            values: values.collect(),
        }
    }

    fn length(segments: &[ContourSegment]) -> f64 {
        let run = |s: &ContourSegment| (s[1][0] - s[0][0]).hypot(s[1][1] - s[0][1]);
        segments.iter().map(run).sum()
    }

    #[test]
    fn contours_of_a_bowl_are_circles() {
        let bowl = heights(201, |x, y| Some(x * x + y * y));
        let segments = bowl.contour(9.0);
        for [x, y] in segments.iter().flatten() {
            assert!((x.hypot(*y) - 3.0).abs() < 1e-3, "{x} {y}");
        }
        assert!((length(&segments) - 6.0 * std::f64::consts::PI).abs() < 0.01);
        assert!(bowl.contour(-1.0).is_empty());
    }

    #[test]
    fn a_contour_ends_where_the_ground_does() {
        let slope = heights(101, |x, y| (x.abs() <= 2.0).then_some(y));
        let segments = slope.contour(0.25);
        assert!((length(&segments) - 4.0).abs() < 1e-9);
        assert!(
            segments
                .iter()
                .flatten()
                .all(|p| (p[1] - 0.25).abs() < 1e-9)
        );
    }

    #[test]
    fn contours_of_a_saddle_do_not_cross() {
        // One cell about the saddle, whose middle is above the level, then below it.
        for (level, along) in [(-1.0, 1.0), (1.0, -1.0)] {
            let saddle = heights(2, |x, y| Some(x * y));
            let segments = saddle.contour(level);
            assert_eq!(segments.len(), 2);
            for [p, q] in segments {
                assert_eq!((p[0] + q[0]).signum(), -along * (p[1] + q[1]).signum());
            }
        }
    }
}
