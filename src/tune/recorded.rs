//! Tuning on a recording: the error of dead reckoning over stretches whose poses are withheld.

use super::objective::Driven;
use super::options::Options;
use super::settings::{DEFAULT_KEYS, Setting};
use super::subject::{Subject, SubjectKind};
use crate::config::find;
use crate::replay::{Rebuilt, ReplayChanges};
use anyhow::{Context, Result, bail, ensure};
use serde_yaml::{Mapping, Value};
use sidehill_controller::config::ControllerConfig;
use sidehill_controller::controller::Controller;
use sidehill_plant::frames::{PlanarPose, wrap_angle};
use sidehill_plant::sample::Sample;
use sidehill_recording::Recording;
use std::ops::Range;
use std::path::Path;

/// Shortest distance driven in a usable stretch, m.
const MOVED_MIN_M: f64 = 0.2;
/// Time without poses, s: as long as a vehicle drives on without poses.
const STRETCH_S: f64 = 2.0;
/// Time with poses before it, s.
const BETWEEN_S: f64 = 2.0;
/// Longest time between two samples of one stretch, s.
const GAP_MAX_S: f64 = 0.5;
/// Fewest stretches for the search, and also for the decision.
const STRETCHES_MIN: u32 = 8;
/// Settings that can be judged by a recording.
const PREFIX: &str = "estimator.";

/// A recording with its stretches.
struct Recorded {
    rebuilt: Rebuilt,
    samples: Vec<Sample>,
    /// Samples of each stretch, in order; poses are withheld in them.
    stretches: Vec<Range<usize>>,
}

/// Returns a recording by which a search judges settings of the estimator. The first stretches are for training,
/// the later ones are held out, in the ratio of `--training` to `--held-out`.
///
/// # Errors
/// A recording that cannot be read or contains too little driving, or a setting that it cannot judge.
pub(super) fn subject(path: &Path, options: &Options) -> Result<Subject<'static>> {
    let named = || path.display().to_string();
    let recording = Recording::read(path)?;
    let changes = ReplayChanges {
        controller: options.controller,
        ..ReplayChanges::default()
    };
    let rebuilt = Rebuilt::of(&recording, &changes).with_context(named)?;
    let Value::Mapping(present) = serde_yaml::to_value(&rebuilt.config)? else {
        bail!("the settings of the controllers are not a mapping");
    };
    let keys = keys(options, &present)?;
    let settings = Setting::all(&present, &keys, |_| false)?;
    let samples: Vec<Sample> = recording
        .cycles
        .iter()
        .map(|cycle| cycle.sample())
        .collect();
    let stretches = stretches(&samples);
    let count = stretches.len() as u32;
    let share = f64::from(options.training) / f64::from(options.training + options.held_out);
    let training = (share * f64::from(count)).round() as u32;
    ensure!(
        training.min(count - training) >= STRETCHES_MIN,
        "{}: {count} stretches of {STRETCH_S} s with poses and driving, {training} of them for the search; at least \
         {STRETCHES_MIN} must be for the search and as many for the decision",
        named()
    );
    let id = recording.header.facts.get("recording").cloned();
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let kind = rebuilt.kind;
    let recorded = Recorded {
        rebuilt,
        samples,
        stretches,
    };
    Ok(Subject {
        kind: SubjectKind::Recording,
        name: name.into_owned(),
        fingerprint: format!("recording {} of {count}", id.unwrap_or_default()),
        controller: kind,
        settings: settings.clone(),
        training: 0..training,
        held_out: training..count,
        drive: Box::new(move |factors, runs| {
            let mut all = serde_yaml::to_value(&recorded.rebuilt.config)?;
            for (setting, factor) in settings.iter().zip(factors) {
                let mut place = &mut all;
                for key in setting.key.split('.') {
                    place = place.get_mut(key).context("no such setting")?;
                }
                *place = Value::from(setting.at(*factor));
            }
            recorded.drive(serde_yaml::from_value(all)?, runs)
        }),
    })
}

/// Settings searched by default: how fast the estimate follows the poses, and how much is learned.
const RECORDED_KEYS: [&str; 3] = [
    "estimator.slide_sigma_m_per_sqrt_s",
    "estimator.yaw_sigma_rad_per_sqrt_s",
    "estimator.adaptation.slope_sigma",
];

/// Returns the keys to search: all that were named, or the default ones of what is switched on.
fn keys(options: &Options, present: &Mapping) -> Result<Vec<String>> {
    if options.keys == DEFAULT_KEYS {
        let is_on = |key: &&str| find(present, key).and_then(Value::as_f64) > Some(0.0);
        let keys = RECORDED_KEYS.into_iter().filter(is_on);
        return Ok(keys.map(str::to_owned).collect());
    }
    match options.keys.iter().find(|key| !key.starts_with(PREFIX)) {
        None => Ok(options.keys.clone()),
        Some(key) => bail!(
            "--key {key}: a recording shows how the vehicle moved, so it judges settings of the estimator \
             ({PREFIX}...); for others tune on a scenario or campaign"
        ),
    }
}

/// Returns the stretches in which the vehicle drives.
fn stretches(samples: &[Sample]) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    let mut from_s = samples.first().map_or(0.0, |first| first.time_s) + BETWEEN_S;
    let mut begin = 0;
    while let Some(offset) = samples[begin..]
        .iter()
        .position(|sample| sample.time_s >= from_s)
    {
        begin += offset;
        let end_s = samples[begin].time_s + STRETCH_S;
        let Some(length) = samples[begin..]
            .iter()
            .position(|sample| sample.time_s > end_s)
        else {
            break;
        };
        let range = begin..begin + length;
        // The drive restarted within or before the stretch, and so did the estimate.
        let before = samples.partition_point(|sample| sample.time_s < from_s - BETWEEN_S);
        let whole = samples[before..range.end]
            .windows(2)
            .all(|pair| pair[1].time_s - pair[0].time_s <= GAP_MAX_S);
        if whole && tells(&samples[range.clone()]) {
            from_s = end_s + BETWEEN_S;
            found.push(range);
        } else {
            from_s += 0.5 * STRETCH_S;
        }
    }
    found
}

/// Returns whether there are poses at both ends and driving between.
fn tells(samples: &[Sample]) -> bool {
    let poses: Vec<_> = samples.iter().filter_map(|sample| sample.pose).collect();
    let (Some(first), Some(last)) = (poses.first(), poses.last()) else {
        return false;
    };
    let way_m: f64 = poses
        .windows(2)
        .map(|pair| {
            let [a, b] = [pair[0].value, pair[1].value];
            (b.x_m - a.x_m).hypot(b.y_m - a.y_m)
        })
        .sum();
    let turned = wrap_angle(last.value.yaw_rad - first.value.yaw_rad).abs() > 0.2;
    poses.len() >= 3 && (way_m >= MOVED_MIN_M || turned)
}

impl Recorded {
    /// Returns the errors of dead reckoning over some of the stretches: of each, the RMS distance between the
    /// poses that were withheld and the estimates at their times.
    fn drive(&self, config: ControllerConfig, runs: Range<u32>) -> Result<Vec<Driven>> {
        let stretches = &self.stretches[runs.start as usize..runs.end as usize];
        let (Some(first), Some(last)) = (stretches.first(), stretches.last()) else {
            return Ok(Vec::new());
        };
        let mut controller = Controller::new(self.rebuilt.kind, config, &self.rebuilt.vehicle)?;
        // Learning before the stretch is part of the estimate, so the whole drive before it is fed as well.
        let mut driven = Vec::with_capacity(stretches.len());
        let mut left = stretches.iter().peekable();
        let mut track: Vec<(f64, PlanarPose)> = Vec::new();
        debug_assert!(first.start <= last.start);
        for (i, sample) in self.samples[..last.end].iter().enumerate() {
            let withheld = left.peek().is_some_and(|stretch| stretch.contains(&i));
            let heard = Sample {
                pose: sample.pose.filter(|_| !withheld),
                ..*sample
            };
            let estimate = controller.repeat_step(&heard, None).estimate;
            if !withheld {
                continue;
            }
            track.extend(estimate.map(|estimate| (sample.time_s, estimate.pose)));
            if let Some(stretch) = left.next_if(|stretch| stretch.end == i + 1) {
                driven.push(error(&self.samples[stretch.clone()], &track));
                track.clear();
            }
        }
        Ok(driven)
    }
}

/// Returns the error of a stretch: the poses against the estimates at their times.
fn error(samples: &[Sample], track: &[(f64, PlanarPose)]) -> Driven {
    let squares: Vec<f64> = samples
        .iter()
        .filter_map(|sample| sample.pose)
        .filter_map(|pose| {
            let after = track
                .iter()
                .position(|(time_s, _)| *time_s >= pose.time_s)?;
            let [(from_s, from), (to_s, to)] = [track[after.checked_sub(1)?], track[after]];
            let share = (pose.time_s - from_s) / (to_s - from_s);
            let between = |from: f64, to: f64| from + share * (to - from);
            let (x_m, y_m) = (between(from.x_m, to.x_m), between(from.y_m, to.y_m));
            Some((x_m - pose.value.x_m).powi(2) + (y_m - pose.value.y_m).powi(2))
        })
        .collect();
    let mean = squares.iter().sum::<f64>() / squares.len().max(1) as f64;
    Driven {
        completed: !squares.is_empty() && mean.is_finite(),
        error_m: mean.sqrt(),
        steer_m_s: 0.0,
    }
}
