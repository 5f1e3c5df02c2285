//! A path moved aside, by a distance that changes along it.

use super::{Hermite, Path, PathPoint, PathSample, Piece, Point2, SAMPLE_STEP_M, SpeedStretch};

/// How far a path is moved to the left of travel at an arc length, with the derivatives by arc length.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Aside {
    /// Distance, m.
    pub left_m: f64,
    /// First derivative, dimensionless.
    pub slope: f64,
    /// Second derivative, 1/m.
    pub bend_per_m: f64,
}

impl Aside {
    /// On the path itself.
    pub const NONE: Self = Self {
        left_m: 0.0,
        slope: 0.0,
        bend_per_m: 0.0,
    };
}

/// A path that was moved aside, and where its arc lengths are on the original.
#[derive(Debug, Clone, PartialEq)]
pub struct MovedPath {
    /// The path.
    pub path: Path,
    /// Arc lengths of it and of the original at the same places, m, increasing.
    places_m: Vec<[f64; 2]>,
}

impl MovedPath {
    /// Returns the arc length of the original at which an arc length of this path is, m.
    pub fn original_m(&self, arc_length_m: f64) -> f64 {
        let after = self
            .places_m
            .partition_point(|[moved_m, _]| *moved_m < arc_length_m)
            .clamp(1, self.places_m.len() - 1);
        let ([from, a], [to, b]) = (self.places_m[after - 1], self.places_m[after]);
        let share = ((arc_length_m - from) / (to - from)).clamp(0.0, 1.0);
        a + share * (b - a)
    }

    /// Returns the arc length of this path at which an arc length of the original is, m.
    pub fn moved_m(&self, original_m: f64) -> f64 {
        let after = self
            .places_m
            .partition_point(|[_, at_m]| *at_m < original_m)
            .clamp(1, self.places_m.len() - 1);
        let ([a, from], [b, to]) = (self.places_m[after - 1], self.places_m[after]);
        let share = ((original_m - from) / (to - from).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        a + share * (b - a)
    }
}

/// Least speed of the moved point relative to that of the original: where less is left, the path is moved
/// almost into the centre of its bend.
const SPEED_MIN: f64 = 0.2;

/// The moved point at an arc length of the original, and its speed relative to the original's.
struct ShiftedPoint {
    point: PathPoint,
    speed: f64,
}

impl Path {
    /// Returns the point beside the path at `arc_length_m`, with heading and curvature of a path that is
    /// moved aside like that.
    ///
    /// With the tangent t, the normal n to the left and the curvature k of the path, r' = (1 - k d) t + d' n
    /// and r'' = -(k' d + 2 k d') t + (k (1 - k d) + d'') n.
    pub fn beside(&self, arc_length_m: f64, aside: &Aside) -> PathPoint {
        self.moved(arc_length_m, aside).point
    }

    fn moved(&self, arc_length_m: f64, aside: &Aside) -> ShiftedPoint {
        let point = self.at(arc_length_m);
        if *aside == Aside::NONE {
            return ShiftedPoint { point, speed: 1.0 };
        }
        let Aside {
            left_m,
            slope,
            bend_per_m,
        } = *aside;
        let curvature = point.curvature_per_m;
        let piece = &self.pieces[self.piece_index(arc_length_m)];
        let growth = piece.curvature_growth(arc_length_m);
        let along = 1.0 - curvature * left_m;
        let speed = along.hypot(slope);
        let second = [
            -(growth * left_m + 2.0 * curvature * slope),
            curvature * along + bend_per_m,
        ];
        let (sin, cos) = point.travel_heading_rad().sin_cos();
        ShiftedPoint {
            point: PathPoint {
                position: Point2 {
                    x_m: point.position.x_m - left_m * cos,
                    y_m: point.position.y_m - left_m * sin,
                },
                heading_rad: point.heading_rad + slope.atan2(along),
                curvature_per_m: (along * second[1] - slope * second[0]) / speed.powi(3),
                ..point
            },
            speed: speed.copysign(along),
        }
    }

    /// Returns this path, which must be open, moved aside by what is smooth along it, and none at the ends of
    /// each piece, with the speeds of its stretches; none where it would be moved into the centre of a bend.
    pub fn moved_aside(&self, aside: impl Fn(f64) -> Aside) -> Option<MovedPath> {
        let mut pieces = Vec::with_capacity(self.pieces.len());
        let mut places_m = Vec::new();
        let mut start_m = 0.0;
        for piece in &self.pieces {
            let (length_m, samples) = self.move_piece(piece, &aside, |moved_m, original_m| {
                places_m.push([start_m + moved_m, original_m]);
            })?;
            start_m += length_m;
            pieces.push((piece.direction, length_m, samples));
        }
        places_m.dedup_by(|next, last| next[0] <= last[0]);
        let mut moved = MovedPath {
            path: Path::from_pieces(pieces, false).ok()?,
            places_m,
        };
        let speeds = self.speeds.iter().map(|stretch| SpeedStretch {
            from_m: moved.moved_m(stretch.from_m),
            ..*stretch
        });
        let speeds = speeds.collect();
        moved.path = moved.path.with_speeds(speeds).ok()?;
        Some(moved)
    }

    /// Returns length and samples of a piece; `place` gets arc lengths on the moved and on the original one.
    fn move_piece(
        &self,
        piece: &Piece,
        aside: impl Fn(f64) -> Aside,
        mut place: impl FnMut(f64, f64),
    ) -> Option<(f64, Vec<PathSample>)> {
        let step_m = piece.step_m();
        // The end of a piece is a cusp, at which the path is that of the next one.
        let end_m = piece.end_m().next_down();
        let within_m =
            |index: usize, share: f64| (piece.start_m + (index as f64 + share) * step_m).min(end_m);
        let speed = |arc_length_m: f64| {
            let moved = self.moved(arc_length_m, &aside(arc_length_m));
            (moved.speed >= SPEED_MIN).then_some(moved.speed)
        };
        let intervals = piece.samples.len() - 1;
        let mut lengths_m = vec![0.0];
        let mut speeds = vec![speed(within_m(0, 0.0))?];
        for index in 0..intervals {
            let middle = speed(within_m(index, 0.5))?;
            let end = speed(within_m(index + 1, 0.0))?;
            // Simpson's rule.
            let interval_m = step_m * (speeds[index] + 4.0 * middle + end) / 6.0;
            lengths_m.push(lengths_m[index] + interval_m);
            speeds.push(end);
        }
        let length_m = lengths_m[intervals];
        let count = (length_m / SAMPLE_STEP_M).ceil().max(1.0) as usize;
        let mut samples = Vec::with_capacity(count + 1);
        let mut index = 0;
        for sample in 0..=count {
            let at_m = length_m * sample as f64 / count as f64;
            while index + 1 < intervals && lengths_m[index + 1] < at_m {
                index += 1;
            }
            let interval_m = lengths_m[index + 1] - lengths_m[index];
            let ratio = ((at_m - lengths_m[index]) / interval_m).clamp(0.0, 1.0);
            // The inverse function, from its values and slopes at both ends.
            let share = Hermite::at(ratio, interval_m).value(
                0.0,
                1.0 / (speeds[index] * step_m),
                1.0,
                1.0 / (speeds[index + 1] * step_m),
            );
            let original_m = within_m(index, share);
            place(at_m, original_m);
            let point = self.moved(original_m, &aside(original_m)).point;
            samples.push(PathSample {
                position: point.position,
                heading_rad: point.heading_rad,
                curvature_per_m: point.curvature_per_m,
            });
        }
        Some((length_m, samples))
    }
}

impl Piece {
    /// Returns the derivative of the curvature by arc length, 1/m^2.
    fn curvature_growth(&self, arc_length_m: f64) -> f64 {
        let from_start = ((arc_length_m - self.start_m) / self.step_m()).max(0.0);
        let index = (from_start as usize).min(self.samples.len() - 2);
        let [a, b] = [index, index + 1].map(|index| self.samples[index].curvature_per_m);
        (b - a) / self.step_m()
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Direction, RawPoint, Smoothing, smooth};
    use super::*;

    fn path(points: impl Iterator<Item = ([f64; 2], Direction)>) -> Path {
        let points: Vec<RawPoint> = points
            .map(|([x_m, y_m], direction)| RawPoint {
                position: Point2 { x_m, y_m },
                direction: Some(direction),
                ..RawPoint::default()
            })
            .collect();
        smooth(&points, &Smoothing::default()).unwrap().path
    }

    fn line(direction: Direction) -> Path {
        path((0..=100).map(|i| ([0.0, 0.1 * f64::from(i)], direction)))
    }

    /// A bump of 0.5 m that is smooth and 0 with its derivatives at 2 m and 8 m.
    fn bump(arc_length_m: f64) -> Aside {
        let u = std::f64::consts::PI * (arc_length_m - 2.0) / 6.0;
        if !(2.0..8.0).contains(&arc_length_m) {
            return Aside::NONE;
        }
        let rate = std::f64::consts::PI / 6.0;
        let (sin, cos) = u.sin_cos();
        Aside {
            left_m: 0.5 * sin.powi(4),
            slope: 2.0 * rate * sin.powi(3) * cos,
            bend_per_m: 2.0 * rate * rate * (3.0 * sin.powi(2) * cos.powi(2) - sin.powi(4)),
        }
    }

    #[test]
    fn the_moved_path_has_the_offset_heading_and_curvature_of_its_own_course() {
        for (direction, left) in [(Direction::Forward, -1.0), (Direction::Reverse, -1.0)] {
            let line = line(direction);
            let moved = line.moved_aside(bump).unwrap();
            let path = &moved.path;
            assert!(path.length_m() > line.length_m() + 0.05);
            for i in 1..200 {
                let at_m = path.length_m() * f64::from(i) / 200.0;
                let original_m = moved.original_m(at_m);
                let (here, there) = (path.at(at_m), line.at(original_m));
                let offset_m = left * (here.position.x_m - there.position.x_m);
                assert!((offset_m - bump(original_m).left_m).abs() < 1e-4, "{at_m}");
                assert!((here.position.y_m - there.position.y_m).abs() < 1e-3);
                // Heading and curvature are those of the positions.
                let [before, after] = [-0.01, 0.01].map(|by_m| path.at(at_m + by_m));
                let (x, y) = (
                    after.position.x_m - before.position.x_m,
                    after.position.y_m - before.position.y_m,
                );
                assert!((x.hypot(y) - 0.02).abs() < 1e-4, "{at_m}");
                let turned = (here.travel_heading_rad() - (-x).atan2(y)).sin();
                assert!(turned.abs() < 2e-3, "{at_m} {turned}");
                let curvature = (after.heading_rad - before.heading_rad) / 0.02;
                assert!((curvature - here.curvature_per_m).abs() < 1e-2, "{at_m}");
            }
            let unmoved = line.moved_aside(|_| Aside::NONE).unwrap();
            assert!((unmoved.path.length_m() - line.length_m()).abs() < 1e-9);
        }
    }

    #[test]
    fn arc_lengths_before_the_offset_are_those_of_the_original() {
        let moved = line(Direction::Forward).moved_aside(bump).unwrap();
        for at_m in [0.0, 0.7, 1.9] {
            assert!((moved.original_m(at_m) - at_m).abs() < 1e-6);
        }
        let length_m = moved.path.length_m();
        assert!((moved.original_m(length_m) - 10.0).abs() < 1e-6);
    }

    #[test]
    fn a_cusp_stays_where_it_is() {
        let there = (0..=100).map(|i| ([0.0, 0.1 * f64::from(i)], Direction::Forward));
        let back = (0..100).rev();
        let back = back.map(|i| ([0.0, 0.1 * f64::from(i)], Direction::Reverse));
        let path = path(there.chain(back));
        let moved = path.moved_aside(bump).unwrap().path;
        let [cusp_m, moved_m] = [&path, &moved].map(|path| path.cusps_m().next().unwrap());
        assert!(moved_m > cusp_m + 0.05);
        assert!(
            path.at(cusp_m)
                .position
                .distance_m(&moved.at(moved_m).position)
                < 1e-6
        );
        let turned_rad = path.at(15.0).heading_rad - moved.at(moved_m + 5.0).heading_rad;
        assert!(turned_rad.abs() < 1e-6);
    }

    #[test]
    fn a_circle_moved_inward_has_a_smaller_radius_and_not_none() {
        let circle = path((0..=60).map(|i| {
            let (sin, cos) = (0.05 * f64::from(i)).sin_cos();
            ([2.0 * cos, 2.0 * sin], Direction::Forward)
        }));
        let inward = |left_m| {
            move |_| Aside {
                left_m,
                ..Aside::NONE
            }
        };
        // Counter-clockwise: the centre is to the left.
        let moved = circle.moved_aside(inward(0.5)).unwrap().path;
        let middle = moved.at(0.5 * moved.length_m());
        assert!((middle.position.x_m.hypot(middle.position.y_m) - 1.5).abs() < 0.01);
        assert!((middle.curvature_per_m - 1.0 / 1.5).abs() < 0.02);
        assert_eq!(circle.moved_aside(inward(1.9)), None);
    }
}
