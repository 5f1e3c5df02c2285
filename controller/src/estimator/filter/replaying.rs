//! Readings put in their places in time, and the replay from the first that changes.

use super::super::Innovation;
use super::super::belief::Belief;
use super::super::gate::PoseSigmas;
use super::super::gyro::{GyroInterval, HOLDS_S, YawRate};
use super::super::learned::LearnedModel;
use super::{Event, Filter, HISTORY, HISTORY_S, Reading};
use sidehill_plant::speeds::TreadSpeeds;
use std::mem::discriminant;

impl<M: LearnedModel<N>, const N: usize> Filter<M, N> {
    /// Puts a reading in its place in time, after those of the same time; returns false, without any effect, for one
    /// older than all that is kept.
    pub(super) fn insert(&mut self, time_s: f64, reading: Reading) -> bool {
        let place = self.events.partition_point(|event| event.time_s <= time_s);
        if place == 0 {
            return false;
        }
        // New speeds also hold for the intervals since the speeds before them, and so does a yaw rate.
        let since = match reading {
            Reading::Speeds(_) | Reading::YawRate(_) => {
                let kind = discriminant(&reading);
                let mut before = self.events.iter().take(place);
                before.rposition(|event| discriminant(&event.reading) == kind)
            }
            Reading::Attitude(_) | Reading::Pose(_) => Some(place - 1),
        };
        self.changed = self.changed.min(since.unwrap_or(0) + 1);
        let belief = self.events[place - 1].belief;
        self.events.insert(
            place,
            Event {
                time_s,
                reading,
                new: true,
                inflation: None,
                belief,
            },
        );
        true
    }

    /// Replays the events from the first that changed.
    pub(super) fn replay(&mut self) {
        for i in self.changed..self.events.len() {
            let mut before = self.events[i - 1].belief;
            let event = self.events[i];
            // Between two readings of the speeds the later one holds: it shows what the command of the
            // interval has made of them.
            if let Some(treads) = self.next_treads(i) {
                before.treads = treads;
            }
            let before_s = self.events[i - 1].time_s;
            let gyro = self.gyro_between(&before, before_s, i);
            let mut belief = self.propagate(&before, event.time_s - before_s, gyro);
            if event.new
                && let Reading::Pose(pose) = event.reading
            {
                self.events[i].inflation = self.judge(&belief, event.time_s, &pose);
                self.confirm_gyro(&mut belief, event.time_s, &pose);
            }
            if let Some(inflation) = &self.events[i].inflation {
                let mut pose = belief.covariance.fixed_view_mut::<3, 3>(0, 0);
                pose += inflation;
            }
            self.events[i].belief = self.absorb(belief, &event);
            self.events[i].new = false;
        }
        let newest_s = self.events.back().map_or(0.0, |event| event.time_s);
        let is_old = |event: &Event<N>| newest_s - event.time_s > HISTORY_S;
        while self.events.len() > HISTORY || self.events.get(1).is_some_and(is_old) {
            self.events.pop_front();
        }
        self.changed = self.events.len();
    }

    /// Returns the first tread speeds read at event `from` or later.
    fn next_treads(&self, from: usize) -> Option<TreadSpeeds> {
        self.events.iter().skip(from).find_map(|e| match e.reading {
            Reading::Speeds(treads) => Some(treads),
            _ => None,
        })
    }

    /// Returns what the gyroscope reads between event `i` and the one before it, whose belief is `before`: the mean of
    /// the readings around, or the newest while it holds.
    pub(super) fn gyro_between(
        &self,
        before: &Belief<N>,
        before_s: f64,
        i: usize,
    ) -> Option<GyroInterval> {
        let newest = before
            .yaw_rate
            .filter(|read| before_s - read.time_s <= HOLDS_S)?;
        let next = self.events.iter().skip(i).find_map(|e| match e.reading {
            Reading::YawRate(rad_s) if e.time_s - newest.time_s <= HOLDS_S => Some(rad_s),
            _ => None,
        });
        Some(GyroInterval {
            rad_s: next.map_or(newest.rad_s, |next| 0.5 * (newest.rad_s + next)),
            confirmed: self.gyro.confirmed(),
        })
    }

    /// Returns the belief after a reading.
    fn absorb(&mut self, mut belief: Belief<N>, event: &Event<N>) -> Belief<N> {
        match event.reading {
            Reading::Speeds(treads) => belief.treads = treads,
            Reading::Attitude(attitude) => belief.attitude = attitude,
            Reading::YawRate(rad_s) => {
                let read = YawRate {
                    time_s: event.time_s,
                    rad_s,
                };
                if self.gyro.confirmed() {
                    let noise = self.model.process_noise(&self.settings);
                    let factor = self.gate.noise_factor();
                    let gate = self.settings.gate;
                    belief.correct_yaw_rate(&mut self.model, &noise, factor, read, gate);
                    let attitude = belief.attitude;
                    self.model.bound(&mut belief.parameters, &attitude);
                }
                belief.yaw_rate = Some(read);
            }
            Reading::Pose(pose) => {
                let s = &self.settings;
                let noise = PoseSigmas::of(&self.settings).covariance();
                let difference = belief.off(&pose);
                let Some(inverse) = (belief.read_covariance() + noise).try_inverse() else {
                    return belief;
                };
                let normalised = (difference.transpose() * inverse * difference).x;
                let believed = normalised <= s.gate;
                if event.new {
                    let innovation = Innovation {
                        time_s: event.time_s,
                        difference,
                        normalised,
                    };
                    self.innovation = Some(innovation);
                    let noise_m2 = 2.0 * s.pose_sigma_m * s.pose_sigma_m;
                    self.model_error
                        .absorb(&innovation, noise_m2, s.error_averaging_s);
                    if believed {
                        self.pose_time_s = self.pose_time_s.max(event.time_s);
                        self.poses_gated = 0;
                        self.poses_late = 0;
                    } else {
                        self.poses_gated += 1;
                    }
                }
                if !believed {
                    belief.pose_noise.interrupt();
                    return belief;
                }
                // The gate goes by the settings, the weight of a pose by the noise that poses show.
                let noise = belief.pose_noise.covariance(&noise);
                let Some(inverse) = (belief.read_covariance() + noise).try_inverse() else {
                    return belief;
                };
                belief.correct(&difference, &noise, &inverse);
                let attitude = belief.attitude;
                self.model.bound(&mut belief.parameters, &attitude);
                let residual = belief.off(&pose);
                belief
                    .pose_noise
                    .observe(event.time_s, &difference, residual);
            }
        }
        belief
    }

    pub(super) fn propagate(
        &mut self,
        belief: &Belief<N>,
        time_s: f64,
        gyro: Option<GyroInterval>,
    ) -> Belief<N> {
        let noise = self.model.process_noise(&self.settings);
        let factor = self.gate.noise_factor();
        belief.propagated(&mut self.model, &noise, factor, time_s, gyro)
    }
}
