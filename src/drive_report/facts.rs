//! The figures of a drive.

use super::input::DecodedRecording;
use super::place::PlaceInTime;
use super::stops::{Stop, StopKind, stops};
use super::weather::{FixWeather, SensorWeather, fix_weather, weather};
use crate::recording::fact;
use crate::report::figures::fixed;
use serde::Serialize;
use sidehill_plant::statistics::quantile;
use sidehill_recording::ControllerCycle;
use std::fmt::Write as _;

/// What was driven, and at what speed.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct DrivenSummary {
    /// Distance by the treads, m, of which in reverse.
    pub(super) distance_m: f64,
    pub(super) reverse_m: f64,
    /// Largest distance from the begin of a path, along it, m.
    pub(super) along_path_m: f64,
    /// Time in which a path was followed, s.
    pub(super) time_s: f64,
    pub(super) mean_speed_m_s: f64,
    pub(super) speed_max_m_s: f64,
}

/// Distance from the path while it was followed, m.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct CrossTrack {
    pub(super) rms_m: f64,
    pub(super) p95_m: f64,
    pub(super) max_m: f64,
}

/// A place where the vehicle was farther from the path than before and after.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct WorstPlace {
    /// Positive: left of the path.
    pub(super) cross_track_m: f64,
    pub(super) arc_length_m: f64,
    pub(super) speed_m_s: f64,
    pub(super) roll_deg: f64,
    pub(super) pitch_deg: f64,
    #[serde(flatten)]
    pub(super) place: PlaceInTime,
}

/// What the steepness guard found at worst.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct GuardFacts {
    pub(super) tip_over_margin_min: f64,
    pub(super) friction_use_max: f64,
    pub(super) speed_share_min: f64,
}

/// A learned parameter at the end, with its 95 % interval.
#[derive(Debug, Clone, Serialize)]
pub(super) struct LearnedParameter {
    pub(super) name: String,
    pub(super) value: f64,
    pub(super) low: f64,
    pub(super) high: f64,
    /// Whether the drive has excited it; else it is as configured.
    pub(super) excited: bool,
}

/// What the drives did.
#[derive(Debug, Clone, Serialize)]
pub(super) struct DriveFigures {
    /// Which motor fell short; empty where none did.
    pub(super) shortfall: String,
    pub(super) traction_reached_m_s: Option<f64>,
    pub(super) steer_reached_m_s: Option<f64>,
    pub(super) delay_s: Option<f64>,
    /// Difference of command and feedback of a cycle, RMS, m/s; none of a simulation.
    pub(super) traction_difference_rms_m_s: Option<f64>,
    pub(super) steer_difference_rms_m_s: Option<f64>,
    pub(super) feedback_age_max_s: Option<f64>,
}

/// A limit, and what the drive made of it.
#[derive(Debug, Clone, Serialize)]
pub(super) struct CheckedLimit {
    /// What is limited, in words.
    pub(super) name: &'static str,
    pub(super) unit: &'static str,
    /// Whether it is the least that is allowed, rather than the most.
    pub(super) is_least: bool,
    pub(super) limit: f64,
    /// None where the recording does not tell.
    pub(super) found: Option<f64>,
    /// What is not known has not passed.
    pub(super) passed: bool,
}

/// All figures of a drive, as `--format json` prints them.
#[derive(Debug, Clone, Serialize)]
pub(super) struct DriveFacts {
    pub(super) recording: String,
    pub(super) command: String,
    pub(super) controller: String,
    pub(super) version: String,
    /// Length of the recording, s.
    pub(super) duration_s: f64,
    /// Why reading ended early.
    pub(super) damaged: Option<String>,
    /// Whether all limits were kept; none where none was stated.
    pub(super) passed: Option<bool>,
    pub(super) limits: Vec<CheckedLimit>,
    pub(super) driven: DrivenSummary,
    pub(super) cross_track: Option<CrossTrack>,
    pub(super) worst: Vec<WorstPlace>,
    pub(super) stops: Vec<Stop>,
    /// Largest age of a pose while a path was followed, s.
    pub(super) pose_age_max_s: Option<f64>,
    pub(super) guard: Option<GuardFacts>,
    pub(super) drives: DriveFigures,
    pub(super) learned: Vec<LearnedParameter>,
    pub(super) sensors: Vec<SensorWeather>,
    /// What the fixes of a satellite receiver were worth, where poses came from one.
    pub(super) fixes: Option<FixWeather>,
    /// Whether x = 0, y = 0 has a place on earth.
    pub(super) has_datum: bool,
}

impl DriveFacts {
    pub(super) fn of(input: &DecodedRecording) -> Self {
        let get = |name: &str| input.header.facts.get(name).cloned().unwrap_or_default();
        let steps = input.steps.iter().filter(|(_, step)| follows(step));
        let following: Vec<&(f64, ControllerCycle)> = steps.collect();
        let ages = following.iter().map(|(_, step)| step.pose_age_s);
        Self {
            recording: input.name.clone(),
            command: get(fact::COMMAND),
            controller: get(fact::CONTROLLER),
            version: get(fact::VERSION),
            duration_s: input.range_s[1] - input.range_s[0],
            damaged: input.damaged.clone(),
            passed: None,
            limits: Vec::new(),
            driven: driven(input),
            cross_track: cross_track(&following),
            worst: worst(input, &following),
            stops: stops(input),
            pose_age_max_s: most(ages),
            guard: guard(input),
            drives: drives(input),
            learned: learned(input),
            sensors: weather(input),
            fixes: fix_weather(&input.fixes),
            has_datum: input.datum.is_some(),
        }
    }

    /// Returns the figures with limits that were judged by them.
    pub(super) fn judged(self, limits: Vec<CheckedLimit>) -> Self {
        let passed = (!limits.is_empty()).then(|| limits.iter().all(|limit| limit.passed));
        Self {
            passed,
            limits,
            ..self
        }
    }

    /// Returns the figures for a person.
    pub(super) fn table(&self) -> String {
        let mut out = format!(
            "recording {}\ncontroller {}\n",
            self.recording, self.controller
        );
        // Writing to a text does not fail.
        let mut add = |name: &str, value: String| {
            let _ = writeln!(out, "{name:24} {value}");
        };
        let driven = &self.driven;
        add(
            "driven",
            format!(
                "{:.1} m in {:.1} s, {:.2} m/s on average, at most {:.2} m/s",
                driven.distance_m, driven.time_s, driven.mean_speed_m_s, driven.speed_max_m_s
            ),
        );
        if let Some(error) = &self.cross_track {
            let [rms, p95, max] =
                [error.rms_m, error.p95_m, error.max_m].map(|value_m| 100.0 * value_m);
            add(
                "cross-track error",
                format!("{rms:.2} cm RMS, {p95:.2} cm p95, {max:.2} cm at most"),
            );
        }
        for worst in &self.worst {
            let place = &worst.place;
            add(
                "  worst place",
                format!(
                    "{:.1} s: {} cm at {}",
                    place.after_s,
                    fixed(100.0 * worst.cross_track_m, 2),
                    named(place)
                ),
            );
        }
        for stop in &self.stops {
            let kind = match stop.kind {
                StopKind::Arrived => "arrived",
                StopKind::Asked => "asked to stop",
                StopKind::Fault => "stopped",
            };
            add(
                kind,
                format!(
                    "{:.1} s: {} at {}",
                    stop.place.after_s,
                    stop.cause,
                    named(&stop.place)
                ),
            );
        }
        for sensor in &self.sensors {
            add(
                sensor.name,
                format!(
                    "{:.1} Hz, age {} s (p95 {}, max {}), longest gap {:.3} s",
                    sensor.rate_hz,
                    fixed(sensor.age_p50_s, 3),
                    fixed(sensor.age_p95_s, 3),
                    fixed(sensor.age_max_s, 3),
                    sensor.gap_max_s
                ),
            );
        }
        if let Some(fixes) = &self.fixes {
            let sigma = match [fixes.sigma_p50_m, fixes.sigma_max_m] {
                [Some(p50_m), Some(max_m)] => format!(
                    "; standard deviation {:.1} cm (max {:.1})",
                    100.0 * p50_m,
                    100.0 * max_m
                ),
                _ => String::new(),
            };
            add(
                "fixes",
                format!(
                    "RTK {:.1} %, corrected from satellites {:.1} %, alone {:.1} %, none {:.1} %{sigma}; longest \
                     without RTK {:.1} s",
                    100.0 * fixes.rtk_share,
                    100.0 * fixes.corrected_share,
                    100.0 * fixes.alone_share,
                    100.0 * fixes.none_share,
                    fixes.without_rtk_max_s
                ),
            );
        }
        for limit in &self.limits {
            let amount = |value: f64| format!("{value} {}", limit.unit).trim_end().to_owned();
            let found = limit
                .found
                .map(|found| amount((1e3 * found).round() / 1e3 + 0.0));
            let found = found.unwrap_or("not recorded".to_owned());
            let verdict = if limit.passed { "kept" } else { "EXCEEDED" };
            let bound = if limit.is_least {
                "at least"
            } else {
                "at most"
            };
            add(
                verdict,
                format!("{}: {found}, {bound} {}", limit.name, amount(limit.limit)),
            );
        }
        if let Some(reason) = &self.damaged {
            add("read up to", reason.clone());
        }
        out
    }
}

fn named(place: &PlaceInTime) -> String {
    match (
        place.latitude_deg,
        place.longitude_deg,
        place.x_m,
        place.y_m,
    ) {
        (Some(latitude_deg), Some(longitude_deg), ..) => {
            format!("{latitude_deg:.7}, {longitude_deg:.7}")
        }
        (.., Some(x_m), Some(y_m)) => format!("x {} m, y {} m", fixed(x_m, 2), fixed(y_m, 2)),
        _ => "an unknown place".to_owned(),
    }
}

/// Returns whether a path is followed in a step.
fn follows(step: &ControllerCycle) -> bool {
    step.engaged && (step.status == "tracking" || step.status.starts_with("fallback"))
}

fn most(values: impl Iterator<Item = f64>) -> Option<f64> {
    values
        .filter(|value| value.is_finite())
        .max_by(f64::total_cmp)
}

fn rms(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0.0);
    for value in values.filter(|value| value.is_finite()) {
        sum += value * value;
        count += 1.0;
    }
    (count > 0.0).then(|| f64::sqrt(sum / count))
}

/// Longest time between two steps that counts as driven, s.
const STEP_MAX_S: f64 = 0.5;

fn driven(input: &DecodedRecording) -> DrivenSummary {
    let [mut distance_m, mut reverse_m, mut time_s] = [0.0; 3];
    let (mut along_path_m, mut speed_max_m_s): (f64, f64) = (0.0, 0.0);
    for pair in input.steps.windows(2) {
        let [(before_s, before), (now_s, now)] = pair else {
            continue;
        };
        let step_s = (now_s - before_s).clamp(0.0, STEP_MAX_S);
        let speed_m_s = 0.5 * (now.left_m_s + now.right_m_s);
        if speed_m_s.is_finite() {
            distance_m += speed_m_s.abs() * step_s;
            reverse_m += (-speed_m_s).max(0.0) * step_s;
            speed_max_m_s = speed_max_m_s.max(speed_m_s.abs());
        }
        if follows(before) {
            time_s += step_s;
        }
        if now.arc_length_m.is_finite() {
            along_path_m = along_path_m.max(now.arc_length_m);
        }
    }
    DrivenSummary {
        distance_m,
        reverse_m,
        along_path_m,
        time_s,
        mean_speed_m_s: if time_s > 0.0 {
            distance_m / time_s
        } else {
            0.0
        },
        speed_max_m_s,
    }
}

fn cross_track(following: &[&(f64, ControllerCycle)]) -> Option<CrossTrack> {
    let errors = || following.iter().map(|(_, step)| step.cross_track_m.abs());
    let rms_m = rms(errors())?;
    let mut sorted: Vec<f64> = errors().filter(|error_m| error_m.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    Some(CrossTrack {
        rms_m,
        p95_m: quantile(&sorted, 0.95)?,
        max_m: *sorted.last()?,
    })
}

/// Worst places that are named, none of them better than the RMS, and the least time between two, s.
const WORST: usize = 5;
const APART_S: f64 = 5.0;

fn worst(input: &DecodedRecording, following: &[&(f64, ControllerCycle)]) -> Vec<WorstPlace> {
    let known = following
        .iter()
        .filter(|(_, step)| step.cross_track_m.is_finite());
    let mut ranked: Vec<_> = known.collect();
    ranked.sort_by(|(_, a), (_, b)| b.cross_track_m.abs().total_cmp(&a.cross_track_m.abs()));
    let usual_m = rms(following.iter().map(|(_, step)| step.cross_track_m)).unwrap_or(0.0);
    let mut taken: Vec<f64> = Vec::new();
    let mut worst = Vec::new();
    for (time_s, step) in ranked
        .into_iter()
        .take_while(|(_, step)| step.cross_track_m.abs() >= usual_m)
    {
        let near = |other_s: &f64| (time_s - other_s).abs() < APART_S;
        // The flank of a worse place is none of its own.
        if taken.iter().any(near) {
            continue;
        }
        taken.push(*time_s);
        let degrees = |angle_rad: f64| angle_rad.to_degrees();
        worst.push(WorstPlace {
            cross_track_m: step.cross_track_m,
            arc_length_m: step.arc_length_m,
            speed_m_s: 0.5 * (step.left_m_s + step.right_m_s),
            roll_deg: degrees(step.estimated_roll_rad),
            pitch_deg: degrees(step.estimated_pitch_rad),
            place: PlaceInTime::at(input, *time_s),
        });
        if worst.len() == WORST {
            break;
        }
    }
    worst
}

fn guard(input: &DecodedRecording) -> Option<GuardFacts> {
    let most_of =
        |get: fn(&sidehill_recording::GuardState) -> f64| most(input.guard.iter().map(get));
    Some(GuardFacts {
        tip_over_margin_min: -most_of(|guard| -guard.rollover_margin)?,
        friction_use_max: most_of(|guard| guard.friction_use)?,
        speed_share_min: -most_of(|guard| -guard.speed_share)?,
    })
}

fn drives(input: &DecodedRecording) -> DriveFigures {
    let number = |key: &str| {
        input
            .diagnostics
            .get(key)
            .and_then(|text| text.parse().ok())
    };
    let driving = || {
        input
            .cycles
            .iter()
            .map(|(_, cycle)| cycle)
            .filter(|cycle| cycle.state == "driving")
    };
    DriveFigures {
        shortfall: input.diagnostics.get("drives").cloned().unwrap_or_default(),
        traction_reached_m_s: number("traction_reached_m_s"),
        steer_reached_m_s: number("steer_reached_m_s"),
        delay_s: number("drive_delay_s"),
        traction_difference_rms_m_s: rms(
            driving().map(|cycle| cycle.traction_m_s - cycle.feedback_traction_m_s)
        ),
        steer_difference_rms_m_s: rms(
            driving().map(|cycle| cycle.steer_m_s - cycle.feedback_steer_m_s)
        ),
        feedback_age_max_s: most(driving().map(|cycle| cycle.feedback_age_s)),
    }
}

/// Returns the learned parameters, which diagnostics tell as `0.85 (0.80 to 0.90, not excited: prior)`.
fn learned(input: &DecodedRecording) -> Vec<LearnedParameter> {
    let values = input.diagnostics.iter();
    values
        .filter_map(|(key, text)| {
            let name = key.strip_prefix("learned_")?.to_owned();
            let (value, interval) = text.split_once(" (")?;
            let (low, rest) = interval.strip_suffix(')')?.split_once(" to ")?;
            let (high, excited) = match rest.split_once(',') {
                Some((high, _)) => (high, false),
                None => (rest, true),
            };
            Some(LearnedParameter {
                name,
                value: value.parse().ok()?,
                low: low.parse().ok()?,
                high: high.parse().ok()?,
                excited,
            })
        })
        .collect()
}
