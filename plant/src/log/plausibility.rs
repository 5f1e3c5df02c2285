//! Mistakes of units, sides and frames that can be seen in a log alone.

use super::{DriveLog, LogRow, frozen};
use crate::frames::wrap_angle;
use crate::statistics::median;

/// A likely mistake in how a log was made or read. It is a hint, not a proof: each says what was seen.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Suspicion {
    /// Time runs by thousands of seconds a row.
    #[error(
        "rows are {step_s:.3e} s apart in the middle: is the time column in {}? It must be in seconds",
        time_unit(*.step_s)
    )]
    TimeUnit {
        /// Median distance of two rows, s.
        step_s: f64,
    },
    /// The heading turns with the direction of travel only if it is taken for degrees.
    #[error(
        "yaw turns with the direction of travel if it is read as degrees: it must be in radians"
    )]
    YawUnit,
    /// The poses leave out a way.
    #[error(
        "jumps of the poses: {count}; the longest is of {length_m:.1} m within {duration_s:.2} s, at {time_s:.2} s: \
         localisation lost its place there or was set anew; cut the log there"
    )]
    Jumps {
        /// Number of jumps.
        count: usize,
        /// Length of the longest, m.
        length_m: f64,
        /// Time from the pose before it, s.
        duration_s: f64,
        /// Time of the log behind it, s.
        time_s: f64,
    },
    /// The poses stay the same to the bit while the treads turn.
    #[error(
        "the poses are the same from {from_s:.1} to {to_s:.1} s while the treads travel {treads_m:.1} m: \
         did localisation stop there? Cut the log there"
    )]
    PosesFrozen {
        /// Time of the log of the first of these poses, s.
        from_s: f64,
        /// Time of the last, s.
        to_s: f64,
        /// Way of the treads in that time, m.
        treads_m: f64,
    },
    /// The speeds of both treads stay the same to the bit while the vehicle stops or sets off.
    #[error(
        "the tread speeds are the same from {from_s:.1} to {to_s:.1} s while the vehicle drives at {slowest_m_s:.2} to \
         {fastest_m_s:.2} m/s by its poses: did the encoders or their driver stop there? Cut the log there"
    )]
    SpeedsFrozen {
        /// Time of the log of the first of these speeds, s.
        from_s: f64,
        /// Time of the last, s.
        to_s: f64,
        /// Least speed by the poses, m/s.
        slowest_m_s: f64,
        /// Largest speed by the poses, m/s.
        fastest_m_s: f64,
    },
    /// The treads stand where the vehicle drives.
    #[error(
        "where the poses move the treads stand in {share:.0} % of the rows: do the speeds come from the encoders of the wheels?"
    )]
    TreadsStand {
        /// Share of the moving rows, percent.
        share: f64,
    },
    /// The vehicle turns against its treads.
    #[error(
        "the poses turn against the treads (correlation of yaw rate and v_right - v_left: {correlation:.2}): \
         are the left and right columns swapped, or does yaw count clockwise?"
    )]
    SidesSwapped {
        /// Correlation of yaw rate by the poses and speed difference of the treads, from -1 to 1.
        correlation: f64,
    },
    /// The treads of one side roll backwards where the vehicle goes forwards.
    #[error(
        "the {side} treads count backwards: with their sign reversed the treads go where the poses go; \
         write `reversed: {side}` in the column map (--columns) or in `tread_speeds` of the topic map (--topics)"
    )]
    SideReversed {
        /// `left` or `right`.
        side: &'static str,
    },
    /// Heading and direction of travel differ by a constant angle.
    #[error(
        "straight ahead the poses move {angle_deg:.1} deg to the left of the heading ({share:.0} % of the rows to the \
         same side): are the antennas that measure the heading turned? `heading_offset_deg: {angle_deg:.1}` in the map \
         of the columns (--columns, in `pose`) or topics (--topics) corrects it"
    )]
    HeadingOffset {
        /// Median angle from heading to direction of travel, counter-clockwise, degrees.
        angle_deg: f64,
        /// Share of the rows whose angle has the sign of the median, percent.
        share: f64,
    },
    /// Treads and poses disagree on the distance driven straight ahead.
    #[error(
        "straight ahead the treads travel {ratio:.2} times as far as the poses: {}",
        distance_cause(*.ratio)
    )]
    TreadScale {
        /// Distance by the treads over distance by the poses.
        ratio: f64,
    },
    /// The vehicle moves backwards where the treads roll forwards.
    #[error(
        "the poses move backwards where the treads roll forwards ({share:.0} % of the rows): \
         does the heading point backwards, or are the speeds' signs reversed?"
    )]
    HeadingReversed {
        /// Share of moving rows that go the wrong way, percent.
        share: f64,
    },
    /// Heading and direction of travel are a quarter turn apart.
    #[error(
        "straight ahead the poses move {angle_deg:.0} deg to the left of the heading: is yaw counted from \
         x (REP-103) rather than from y (the paper)? See `heading: {{kind: rep103}}` of --columns"
    )]
    HeadingTurned {
        /// Median angle from heading to direction of travel, counter-clockwise, degrees.
        angle_deg: f64,
    },
    /// Slopes that no vehicle drives on.
    #[error(
        "roll or pitch reaches {angle_rad:.2} rad ({:.0} deg): are the columns in degrees? They must be in \
         radians",
        .angle_rad.to_degrees()
    )]
    AttitudeUnit {
        /// Largest absolute roll or pitch, rad.
        angle_rad: f64,
    },
}

fn time_unit(step_s: f64) -> &'static str {
    match step_s {
        s if s > 1e5 => "nanoseconds",
        s if s > 1e3 => "microseconds",
        _ => "milliseconds",
    }
}

fn distance_cause(ratio: f64) -> &'static str {
    if ratio < 0.02 {
        "are the positions in mm or cm? They must be in m"
    } else if ratio > 3.0 {
        "are the speeds km/h, rad/s or rpm? They must be m/s (`tread_speed_scale` of --columns converts; for a bag \
         `radius_m` of --topics)"
    } else if ratio > 1.0 {
        "is the wheel radius or `tread_speed_scale` too large (a diameter for a radius)?"
    } else {
        "is the wheel radius or `tread_speed_scale` too small (a radius for a diameter)?"
    }
}

/// Rows that a verdict needs at least.
const ROWS_MIN: usize = 20;
/// Steepest plausible attitude, rad: 40 deg.
const ATTITUDE_MAX_RAD: f64 = 0.7;
/// Largest angle between heading and travel that slip explains, deg.
const HEADING_OFFSET_DEG: f64 = 6.0;
/// Treads slower than this count as standing, m/s.
const MOVING_M_S: f64 = 0.05;

/// Motion between two rows with poses.
struct LogStretch {
    duration_s: f64,
    /// Mean of both treads, m/s.
    traction_m_s: f64,
    /// Right less left tread, m/s.
    difference_m_s: f64,
    yaw_rate_rad_s: f64,
    /// Heading at the start, and direction of travel from x.
    yaw_rad: f64,
    course_rad: f64,
    /// Displacement by the poses along and to the left of the heading half way, m.
    forward_m: f64,
    left_m: f64,
}

impl DriveLog {
    /// Returns the likely mistakes that the log shows, the most basic first.
    ///
    /// Treads are compared with poses over stretches of about half a second; without poses only time
    /// and attitude are judged.
    pub fn suspicions(&self) -> Vec<Suspicion> {
        let mut found = Vec::new();
        let steps = self.rows().windows(2).map(|w| w[1].time_s - w[0].time_s);
        let step_s = median(steps.collect()).unwrap_or(0.0);
        if step_s > 10.0 {
            found.push(Suspicion::TimeUnit { step_s });
        }
        let angle_rad = self
            .rows()
            .iter()
            .map(|row| {
                row.attitude
                    .roll_rad
                    .abs()
                    .max(row.attitude.pitch_rad.abs())
            })
            .fold(0.0, f64::max);
        if angle_rad > ATTITUDE_MAX_RAD {
            found.push(Suspicion::AttitudeUnit { angle_rad });
        }
        let broken = frozen_readings(self.rows()).or_else(|| jumps(self.rows()));
        if let Some(broken) = broken {
            // Other verdicts on the treads would follow from it.
            found.push(broken);
            return found;
        }
        let stretches = stretches(self.rows());
        if is_yaw_in_degrees(&stretches) {
            found.push(Suspicion::YawUnit);
            return found;
        }
        found.extend(standing(&stretches));
        if let Some(reversed) = reversed_side(&stretches) {
            // Any other verdict would follow from it.
            found.push(reversed);
            return found;
        }
        found.extend(sides(&stretches));
        found.extend(distance(&stretches));
        found
    }
}

/// Returns whether poses or speeds stay the same while the vehicle moves.
fn frozen_readings(rows: &[LogRow]) -> Option<Suspicion> {
    let poses = frozen::poses(rows).map(|found| Suspicion::PosesFrozen {
        from_s: found.from_s,
        to_s: found.to_s,
        treads_m: found.meanwhile,
    });
    poses.or_else(|| {
        let found = frozen::speeds(rows)?;
        let (slowest_m_s, fastest_m_s) = found.meanwhile;
        Some(Suspicion::SpeedsFrozen {
            from_s: found.from_s,
            to_s: found.to_s,
            slowest_m_s,
            fastest_m_s,
        })
    })
}

/// Returns whether poses are farther apart than a vehicle gets between them.
fn jumps(rows: &[LogRow]) -> Option<Suspicion> {
    /// Shortest jump, m: noise is less.
    const LENGTH_MIN_M: f64 = 1.0;
    /// Faster than a vehicle with treads, m/s.
    const SPEED_MAX_M_S: f64 = 20.0;
    let mut poses = rows.iter().filter_map(|row| Some((row.time_s, row.pose?)));
    let (mut time_before_s, mut before) = poses.next()?;
    let (mut count, mut longest) = (0, (0.0, 0.0, 0.0));
    for (time_s, pose) in poses {
        let length_m = (pose.x_m - before.x_m).hypot(pose.y_m - before.y_m);
        let duration_s = time_s - time_before_s;
        if length_m > LENGTH_MIN_M.max(SPEED_MAX_M_S * duration_s) {
            count += 1;
            if length_m > longest.0 {
                longest = (length_m, duration_s, time_s);
            }
        }
        (time_before_s, before) = (time_s, pose);
    }
    let (length_m, duration_s, time_s) = longest;
    // More are a wrong unit.
    (count > 0 && 10 * count <= rows.len()).then_some(Suspicion::Jumps {
        count,
        length_m,
        duration_s,
        time_s,
    })
}

/// Returns whether heading and direction of travel keep their angle with the yaw taken for degrees, and not as it is.
fn is_yaw_in_degrees(stretches: &[LogStretch]) -> bool {
    let moving: Vec<&LogStretch> = stretches
        .iter()
        .filter(|s| s.forward_m.hypot(s.left_m) > 2.0 * MOVING_M_S * s.duration_s)
        .collect();
    // Length of the mean direction of the angles between both, from 0 to 1.
    let constancy = |unit_rad: f64| {
        let angles = moving.iter().map(|s| s.course_rad - unit_rad * s.yaw_rad);
        let (sin, cos) = angles.fold((0.0, 0.0), |(sin, cos), angle| {
            (sin + angle.sin(), cos + angle.cos())
        });
        f64::hypot(sin, cos) / moving.len() as f64
    };
    let turns = moving
        .iter()
        .any(|s| s.yaw_rad.abs() > std::f64::consts::TAU);
    moving.len() >= ROWS_MIN
        && turns
        && constancy(1_f64.to_radians()) > 0.95
        && constancy(1.0) < 0.7
}

/// Returns whether the treads stand for most of the drive.
fn standing(stretches: &[LogStretch]) -> Option<Suspicion> {
    let moving = stretches
        .iter()
        .filter(|s| s.forward_m.hypot(s.left_m) > 2.0 * MOVING_M_S * s.duration_s);
    let (mut count, mut stand) = (0, 0);
    for stretch in moving {
        count += 1;
        let fastest_m_s = stretch.traction_m_s.abs() + 0.5 * stretch.difference_m_s.abs();
        stand += usize::from(fastest_m_s < 0.1 * MOVING_M_S);
    }
    let share = 100.0 * stand as f64 / count as f64;
    (count >= ROWS_MIN && share > 50.0).then_some(Suspicion::TreadsStand { share })
}

/// Returns whether the vehicle goes where its treads would with the sign of one side reversed.
fn reversed_side(stretches: &[LogStretch]) -> Option<Suspicion> {
    let moving: Vec<&LogStretch> = stretches
        .iter()
        .filter(|s| s.forward_m.hypot(s.left_m) > MOVING_M_S * s.duration_s)
        .collect();
    if moving.len() < ROWS_MIN {
        return None;
    }
    // Share of the travel that is explained, by the least squares of one factor.
    let explained = |signs: [f64; 2]| {
        let (mut product, mut treads, mut poses) = (0.0, 0.0, 0.0);
        for s in &moving {
            let [left, right] = [-0.5, 0.5].map(|half| s.traction_m_s + half * s.difference_m_s);
            let speed = 0.5 * (signs[0] * left + signs[1] * right) * s.duration_s;
            product += speed * s.forward_m;
            treads += speed * speed;
            poses += s.forward_m.powi(2) + s.left_m.powi(2);
        }
        product / (treads * poses).sqrt().max(f64::MIN_POSITIVE)
    };
    let as_read = explained([1.0, 1.0]);
    let sides = [("left", [-1.0, 1.0]), ("right", [1.0, -1.0])];
    let (side, share) = sides
        .map(|(side, signs)| (side, explained(signs)))
        .into_iter()
        .max_by(|a, b| a.1.total_cmp(&b.1))?;
    (share > 0.9 && as_read < 0.8).then_some(Suspicion::SideReversed { side })
}

/// Returns whether the vehicle turns with its treads.
fn sides(stretches: &[LogStretch]) -> Option<Suspicion> {
    let turning: Vec<&LogStretch> = stretches
        .iter()
        .filter(|s| s.difference_m_s.abs() > MOVING_M_S)
        .collect();
    if turning.len() < ROWS_MIN {
        return None;
    }
    let sum = |value: &dyn Fn(&LogStretch) -> f64| turning.iter().map(|s| value(s)).sum::<f64>();
    let product = sum(&|s| s.yaw_rate_rad_s * s.difference_m_s);
    let squares = sum(&|s| s.yaw_rate_rad_s.powi(2)) * sum(&|s| s.difference_m_s.powi(2));
    let correlation = product / squares.sqrt().max(f64::MIN_POSITIVE);
    (correlation < -0.3).then_some(Suspicion::SidesSwapped { correlation })
}

/// Compares the way by treads and poses where the vehicle goes about straight.
fn distance(stretches: &[LogStretch]) -> Option<Suspicion> {
    let straight: Vec<&LogStretch> = stretches
        .iter()
        .filter(|s| s.traction_m_s.abs() > 2.0 * MOVING_M_S.max(s.difference_m_s.abs()))
        .collect();
    if straight.len() < ROWS_MIN {
        return None;
    }
    let angles = straight.iter().map(|s| {
        let sign = s.traction_m_s.signum();
        (sign * s.left_m).atan2(sign * s.forward_m).to_degrees()
    });
    let angle_deg = median(angles.collect())?;
    if angle_deg.abs() > 150.0 {
        let wrong = straight
            .iter()
            .filter(|s| s.forward_m * s.traction_m_s < 0.0)
            .count();
        let share = 100.0 * wrong as f64 / straight.len() as f64;
        return Some(Suspicion::HeadingReversed { share });
    }
    if angle_deg.abs() > 30.0 {
        return Some(Suspicion::HeadingTurned { angle_deg });
    }
    let angles: Vec<f64> = straight
        .iter()
        .map(|s| (s.left_m / s.forward_m).atan().to_degrees())
        .filter(|angle_deg| angle_deg.is_finite())
        .collect();
    let same = angles
        .iter()
        .filter(|angle| **angle * angle_deg > 0.0)
        .count();
    let share = 100.0 * same as f64 / angles.len().max(1) as f64;
    // A slope pushes to either side, as the vehicle drives to and fro, and by less.
    if angle_deg.abs() > HEADING_OFFSET_DEG && share > 90.0 {
        return Some(Suspicion::HeadingOffset { angle_deg, share });
    }
    let treads_m: f64 = straight
        .iter()
        .map(|s| s.traction_m_s.abs() * s.duration_s)
        .sum();
    let poses_m: f64 = straight.iter().map(|s| s.forward_m.hypot(s.left_m)).sum();
    let ratio = treads_m / poses_m.max(f64::MIN_POSITIVE);
    (!(0.6..=1.6).contains(&ratio)).then_some(Suspicion::TreadScale { ratio })
}

/// Returns the motion from each pose to one about half a second later.
fn stretches(rows: &[LogRow]) -> Vec<LogStretch> {
    let mut out = Vec::new();
    let mut first = 0;
    while let Some(start) = rows.get(first) {
        let end = rows[first + 1..]
            .iter()
            .position(|row| row.pose.is_some() && row.time_s - start.time_s >= 0.45)
            .map(|offset| first + 1 + offset);
        let Some(end) = end else { break };
        let duration_s = rows[end].time_s - start.time_s;
        // A gap in time is not a stretch.
        if let (Some(from), Some(to), true) = (start.pose, rows[end].pose, duration_s < 2.0) {
            let between = &rows[first + 1..=end];
            let mean = |value: &dyn Fn(&LogRow) -> f64| {
                between.iter().map(value).sum::<f64>() / between.len() as f64
            };
            let turned = wrap_angle(to.yaw_rad - from.yaw_rad);
            let (sin, cos) = (from.yaw_rad + 0.5 * turned).sin_cos();
            let (dx, dy) = (to.x_m - from.x_m, to.y_m - from.y_m);
            out.push(LogStretch {
                duration_s,
                traction_m_s: mean(&|r| 0.5 * (r.speeds.left_m_s + r.speeds.right_m_s)),
                difference_m_s: mean(&|r| r.speeds.right_m_s - r.speeds.left_m_s),
                yaw_rate_rad_s: turned / duration_s,
                yaw_rad: from.yaw_rad,
                course_rad: dy.atan2(dx),
                forward_m: -sin * dx + cos * dy,
                left_m: -cos * dx - sin * dy,
            });
        }
        first = if rows[first].pose.is_some() {
            end
        } else {
            first + 1
        };
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::{Attitude, Pose};
    use crate::speeds::MeasuredTreadSpeeds;
    use std::cell::Cell;

    /// A drive at 20 Hz in wide arcs and straights, made by `change` into what is to be found.
    fn log(change: impl Fn(&mut LogRow)) -> Vec<Suspicion> {
        let mut pose = Pose::default();
        let rows = (0..1200).map(|i| {
            let time_s = 0.05 * f64::from(i);
            let difference = if i % 400 < 200 { 0.0 } else { 0.3 };
            let (speed, rate) = (0.6, difference / 1.5);
            let mut row = LogRow {
                time_s,
                speeds: MeasuredTreadSpeeds {
                    left_m_s: speed - 0.5 * difference,
                    right_m_s: speed + 0.5 * difference,
                },
                attitude: Attitude {
                    roll_rad: 0.1,
                    pitch_rad: -0.05,
                },
                pose: Some(pose),
            };
            pose.yaw_rad += 0.05 * rate;
            pose.x_m -= 0.05 * speed * pose.yaw_rad.sin();
            pose.y_m += 0.05 * speed * pose.yaw_rad.cos();
            change(&mut row);
            row
        });
        DriveLog::new(rows.collect()).unwrap().suspicions()
    }

    #[test]
    fn a_good_log_raises_none() {
        assert_eq!(log(|_| {}), []);
        assert_eq!(log(|row| row.pose = None), []);
    }

    #[test]
    fn readings_that_freeze_are_told_with_their_time() {
        let says = |found: Vec<Suspicion>, words: &str| {
            assert_eq!(found.len(), 1, "{found:?}");
            assert!(found[0].to_string().starts_with(words), "{}", found[0]);
        };
        let freezes = |row: &LogRow| (30.0..40.0).contains(&row.time_s);
        let last_pose = Cell::new(None);
        let poses = |row: &mut LogRow| {
            if freezes(row) {
                row.pose = last_pose.get();
            }
            last_pose.set(row.pose);
        };
        says(
            log(poses),
            "the poses are the same from 30.0 to 40.0 s while the treads travel 6.0 m",
        );
        // The vehicle stops at 33 s, and its poses are noisy.
        let (last_speeds, stop) = (Cell::new(None), Cell::new(None));
        let speeds = |row: &mut LogRow| {
            let stands = (33.0..40.0).contains(&row.time_s);
            let here = if stands { stop.get() } else { row.pose };
            stop.set(here);
            row.pose = here.map(|pose| Pose {
                x_m: pose.x_m + 1e-3 * (100.0 * row.time_s).sin(),
                ..pose
            });
            if freezes(row) {
                row.speeds = last_speeds.get().unwrap();
            }
            last_speeds.set(Some(row.speeds));
        };
        says(
            log(speeds),
            "the tread speeds are the same from 20.0 to 50.0 s while the vehicle drives at 0.00 to",
        );
    }

    #[test]
    fn constant_treads_on_a_slope_are_not_frozen() {
        // Round and round at 0.3 m/s, down the slope by half of that in addition.
        let poses = |row: &mut LogRow| {
            let (rate, speed, slide) = (0.6, 0.3, 0.15);
            row.speeds = MeasuredTreadSpeeds {
                left_m_s: speed - 0.45,
                right_m_s: speed + 0.45,
            };
            let yaw_rad = rate * row.time_s;
            row.pose = Some(Pose {
                x_m: speed / rate * yaw_rad.cos(),
                y_m: speed / rate * yaw_rad.sin() - slide * row.time_s,
                z_m: 0.0,
                yaw_rad,
            });
        };
        assert_eq!(log(poses), []);
    }

    #[test]
    fn mistakes_are_recognised() {
        let says = |found: Vec<Suspicion>, words: &str| {
            assert_eq!(found.len(), 1, "{found:?}");
            assert!(found[0].to_string().contains(words), "{}", found[0]);
        };
        let swap = |row: &mut LogRow| {
            let speeds = row.speeds;
            row.speeds.left_m_s = speeds.right_m_s;
            row.speeds.right_m_s = speeds.left_m_s;
        };
        says(log(swap), "swapped");
        let scale = |factor: f64| {
            move |row: &mut LogRow| {
                row.speeds.left_m_s *= factor;
                row.speeds.right_m_s *= factor;
            }
        };
        says(log(scale(2.0)), "diameter for a radius");
        says(log(scale(0.5)), "radius for a diameter");
        says(log(scale(9.5)), "rpm");
        says(log(scale(-1.0)).split_off(1), "backwards");
        says(log(|row| row.time_s *= 1e9).split_off(0), "nanoseconds");
        says(log(|row| row.time_s *= 1e3).split_off(0), "milliseconds");
        says(log(|row| row.attitude.roll_rad = 1.2), "degrees");
        let rep_103 = |row: &mut LogRow| {
            if let Some(pose) = &mut row.pose {
                pose.yaw_rad += std::f64::consts::FRAC_PI_2;
            }
        };
        says(log(rep_103), "rep103");
        says(log(|row| row.speeds.left_m_s *= -1.0), "`reversed: left`");
        says(log(|row| row.speeds.right_m_s *= -1.0), "`reversed: right`");
        let antennas = |offset_deg: f64| {
            move |row: &mut LogRow| {
                if let Some(pose) = &mut row.pose {
                    pose.yaw_rad -= offset_deg.to_radians();
                }
            }
        };
        says(log(antennas(10.0)), "`heading_offset_deg: 10.0`");
        says(log(antennas(-10.0)), "`heading_offset_deg: -10.0`");
        assert_eq!(log(antennas(3.0)), []);
        says(log(scale(0.0)), "the treads stand in 100 %");
        let in_degrees = |row: &mut LogRow| {
            if let Some(pose) = &mut row.pose {
                pose.yaw_rad = pose.yaw_rad.to_degrees();
            }
        };
        says(log(in_degrees), "must be in radians");
        let in_mm = |row: &mut LogRow| {
            if let Some(pose) = &mut row.pose {
                (pose.x_m, pose.y_m) = (1000.0 * pose.x_m, 1000.0 * pose.y_m);
            }
        };
        says(log(in_mm), "in mm or cm");
        says(log(scale(3.6)), "km/h");
        let set_anew = |row: &mut LogRow| {
            if let (30.0..50.0, Some(pose)) = (row.time_s, &mut row.pose) {
                pose.x_m += 7.0;
            }
        };
        says(
            log(set_anew),
            "jumps of the poses: 2; the longest is of 7.0 m within 0.05 s",
        );
    }
}
