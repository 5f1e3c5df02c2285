//! The weather of the sensors: how old readings were, and how long none came.

use super::input::Input;
use serde::Serialize;
use sidehill_plant::sample::{Sample, Stamped};
use sidehill_plant::statistics::quantile;

/// Readings of a sensor as the controller got them.
#[derive(Debug, Clone, Serialize)]
pub(super) struct SensorWeather {
    pub(super) name: &'static str,
    /// Readings that differ in time.
    pub(super) readings: usize,
    /// Readings in a second, on average.
    pub(super) rate_hz: f64,
    /// Age in a step, s.
    pub(super) age_p50_s: f64,
    pub(super) age_p95_s: f64,
    pub(super) age_max_s: f64,
    /// Longest time between two readings, s, and when it ended, s.
    pub(super) gap_max_s: f64,
    pub(super) gap_time_s: f64,
    /// Share of the steps that had none.
    pub(super) missing_share: f64,
}

/// Returns the time of a sensor's reading in a sample, s.
type ReadingTime = fn(&Sample) -> Option<f64>;

/// Returns the weather of all sensors that sent something.
pub(super) fn weather(input: &Input) -> Vec<SensorWeather> {
    let samples: Vec<(f64, Sample)> = input
        .steps
        .iter()
        .map(|(at_s, step)| (*at_s, step.sample()))
        .collect();
    fn time<T>(reading: &Option<Stamped<T>>) -> Option<f64> {
        reading.as_ref().map(|reading| reading.time_s)
    }
    let sensors: [(_, ReadingTime); 4] = [
        ("pose", |sample| time(&sample.pose)),
        ("tread speeds", |sample| time(&sample.tread_speeds)),
        ("attitude", |sample| time(&sample.attitude)),
        ("yaw rate", |sample| time(&sample.yaw_rate)),
    ];
    let sensors = sensors.into_iter();
    sensors
        .filter_map(|(name, read)| of(name, &samples, read))
        .collect()
}

fn of(
    name: &'static str,
    samples: &[(f64, Sample)],
    read: impl Fn(&Sample) -> Option<f64>,
) -> Option<SensorWeather> {
    let (mut ages_s, mut times_s) = (Vec::new(), Vec::<f64>::new());
    let mut gap = (0.0, f64::NAN);
    for (at_s, sample) in samples {
        let Some(time_s) = read(sample) else { continue };
        ages_s.push(sample.time_s - time_s);
        match times_s.last() {
            Some(&last_s) if time_s <= last_s => {}
            last_s => {
                if let Some(gap_s) = last_s
                    .map(|last_s| time_s - last_s)
                    .filter(|gap_s| *gap_s > gap.0)
                {
                    gap = (gap_s, *at_s);
                }
                times_s.push(time_s);
            }
        }
    }
    let (first_s, last_s) = (times_s.first()?, times_s.last()?);
    let missing = samples.len() - ages_s.len();
    ages_s.sort_by(f64::total_cmp);
    let age = |share| quantile(&ages_s, share).unwrap_or(f64::NAN);
    Some(SensorWeather {
        name,
        readings: times_s.len(),
        rate_hz: (times_s.len() - 1) as f64 / (last_s - first_s).max(1e-9),
        age_p50_s: age(0.5),
        age_p95_s: age(0.95),
        age_max_s: age(1.0),
        gap_max_s: gap.0,
        gap_time_s: gap.1,
        missing_share: missing as f64 / samples.len() as f64,
    })
}
