//! The weather of the sensors: how old readings were, how long none came, and how good fixes were.

use super::input::Input;
use serde::Serialize;
use sidehill_plant::sample::{Sample, Stamped};
use sidehill_plant::statistics::quantile;
use sidehill_recording::FixState;

/// Readings of a sensor as the controller got them.
#[derive(Debug, Clone, Serialize)]
pub(super) struct SensorWeather {
    pub(super) name: &'static str,
    /// Readings that differ in time.
    pub(super) readings: usize,
    /// Readings in a second, on average.
    pub(super) rate_hz: f64,
    /// Age in a step, s; of fixes as they came.
    pub(super) age_p50_s: f64,
    pub(super) age_p95_s: f64,
    pub(super) age_max_s: f64,
    /// Longest time between two readings, s, and when it ended, s.
    pub(super) gap_max_s: f64,
    pub(super) gap_time_s: Option<f64>,
    /// Share of the steps that had none; of the fixes that were not good enough.
    pub(super) missing_share: f64,
}

/// What the fixes of a satellite receiver were worth.
#[derive(Debug, Clone, Serialize)]
pub(super) struct FixWeather {
    /// Share of the fixes that were corrected from the ground: RTK, fixed or float.
    pub(super) rtk_share: f64,
    /// That were corrected from satellites.
    pub(super) corrected_share: f64,
    /// That were not corrected.
    pub(super) alone_share: f64,
    /// That were none.
    pub(super) none_share: f64,
    /// Standard deviation, m; none where the receiver does not tell it.
    pub(super) sigma_p50_m: Option<f64>,
    pub(super) sigma_p95_m: Option<f64>,
    pub(super) sigma_max_m: Option<f64>,
    /// Longest time without RTK between two fixes that had it, s, and when it ended, s.
    pub(super) without_rtk_max_s: f64,
    pub(super) without_rtk_time_s: Option<f64>,
}

/// A reading: when it came and when it was measured, s.
type Reading = (f64, f64);

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
    let sensors = sensors.into_iter().filter_map(|(name, read)| {
        let read = |(at_s, sample): &(f64, Sample)| Some((*at_s, sample.time_s, read(sample)?));
        let readings: Vec<_> = samples.iter().filter_map(read).collect();
        let ages = readings.iter().map(|(_, now_s, time_s)| now_s - time_s);
        let stamps = readings.iter().map(|(at_s, _, time_s)| (*at_s, *time_s));
        let missing = samples.len() - readings.len();
        let missing_share = missing as f64 / samples.len() as f64;
        of(name, ages.collect(), stamps, missing_share)
    });
    sensors.chain(of_fixes(input)).collect()
}

/// Returns how old fixes were when they came, and how long none came that was good enough.
fn of_fixes(input: &Input) -> Option<SensorWeather> {
    let fixes = &input.fixes;
    let used = || fixes.iter().filter(|(_, fix)| fix.used);
    // The clock of the steps is that of the fixes.
    let (step_s, step) = input.steps.first()?;
    let zero_s = step_s - step.time_s;
    let ages = used().map(|(at_s, fix)| at_s - zero_s - fix.time_s);
    let stamps = used().map(|(at_s, fix)| (*at_s, fix.time_s));
    let unused = fixes.len() - used().count();
    let missing_share = unused as f64 / fixes.len().max(1) as f64;
    of("fixes used", ages.collect(), stamps, missing_share)
}

fn of(
    name: &'static str,
    mut ages_s: Vec<f64>,
    stamps: impl Iterator<Item = Reading>,
    missing_share: f64,
) -> Option<SensorWeather> {
    let mut times_s = Vec::<f64>::new();
    let mut gap = (0.0, None);
    for (at_s, time_s) in stamps {
        match times_s.last() {
            Some(&last_s) if time_s <= last_s => {}
            last_s => {
                if let Some(gap_s) = last_s
                    .map(|last_s| time_s - last_s)
                    .filter(|gap_s| *gap_s > gap.0)
                {
                    gap = (gap_s, Some(at_s));
                }
                times_s.push(time_s);
            }
        }
    }
    let (first_s, last_s) = (times_s.first()?, times_s.last()?);
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
        missing_share,
    })
}

/// Status of fixes that are corrected from the ground, from satellites, and not at all.
const RTK: i8 = 2;
const CORRECTED: i8 = 1;
const ALONE: i8 = 0;

/// Returns what the fixes were worth; none where there were none.
pub(super) fn fix_weather(fixes: &[(f64, FixState)]) -> Option<FixWeather> {
    if fixes.is_empty() {
        return None;
    }
    let share = |is: &dyn Fn(i8) -> bool| {
        let count = fixes.iter().filter(|(_, fix)| is(fix.status)).count();
        count as f64 / fixes.len() as f64
    };
    let mut sigmas_m: Vec<f64> = fixes
        .iter()
        .filter(|(_, fix)| fix.status >= ALONE && fix.sigma_m.is_finite())
        .map(|(_, fix)| fix.sigma_m)
        .collect();
    sigmas_m.sort_by(f64::total_cmp);
    let mut longest = (0.0, None);
    let with_rtk: Vec<f64> = fixes
        .iter()
        .filter(|(_, fix)| fix.status == RTK)
        .map(|(at_s, _)| *at_s)
        .collect();
    for pair in with_rtk.windows(2) {
        if pair[1] - pair[0] > longest.0 {
            longest = (pair[1] - pair[0], Some(pair[1]));
        }
    }
    Some(FixWeather {
        rtk_share: share(&|status| status == RTK),
        corrected_share: share(&|status| status == CORRECTED),
        alone_share: share(&|status| status == ALONE),
        none_share: share(&|status| status < ALONE),
        sigma_p50_m: quantile(&sigmas_m, 0.5),
        sigma_p95_m: quantile(&sigmas_m, 0.95),
        sigma_max_m: sigmas_m.last().copied(),
        without_rtk_max_s: longest.0,
        without_rtk_time_s: longest.1,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fix(at_s: f64, status: i8, sigma_m: f64) -> (f64, FixState) {
        let state = FixState {
            time_s: at_s - 0.1,
            status,
            sigma_m,
            used: status == RTK,
        };
        (at_s, state)
    }

    #[test]
    fn fixes_are_counted_by_their_kind() {
        assert!(fix_weather(&[]).is_none());
        let fixes = [
            fix(1.0, RTK, 0.01),
            fix(2.0, ALONE, 1.5),
            fix(3.0, -1, 0.0),
            fix(4.5, RTK, 0.02),
        ];
        let weather = fix_weather(&fixes).unwrap();
        assert_eq!((weather.rtk_share, weather.alone_share), (0.5, 0.25));
        assert_eq!((weather.corrected_share, weather.none_share), (0.0, 0.25));
        // What is no fix has no accuracy.
        assert_eq!(weather.sigma_p50_m, Some(0.02));
        assert_eq!(weather.sigma_max_m, Some(1.5));
        assert_eq!(weather.without_rtk_max_s, 3.5);
        assert_eq!(weather.without_rtk_time_s, Some(4.5));
    }

    #[test]
    fn a_receiver_may_not_tell_its_accuracy() {
        let weather = fix_weather(&[fix(1.0, RTK, f64::NAN)]).unwrap();
        assert_eq!((weather.sigma_p50_m, weather.sigma_max_m), (None, None));
        assert_eq!(weather.without_rtk_time_s, None);
    }
}
