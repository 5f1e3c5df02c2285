//! The steepness guard: a lower speed where the ground ahead leaves little margin against tipping over and
//! sliding off, a stop before a place that leaves too little, and a stop at once beyond a limit of attitude.
//!
//! Each cycle it walks along the reference, takes the ground there from the map where there is one, else the
//! plane under the vehicle, and judges the attitude that the vehicle will have with [`Stance`]: on the
//! path, and with the vehicle's present offset from the path and its heading. Speeds
//! that a place allows are met by braking before it: with w = v^2 over the way s,
//! w(s) <= w(place) + 2 a (place - s). The reference's clock runs slower by that share, so the MPC sees a
//! slower reference over its whole horizon. Announcing an overturn from the ground ahead of a rover follows
//! N. Bouton, R. Lenain, B. Thuilot and P. Martinet, "A rollover indicator based on the prediction of the
//! load transfer in presence of sliding", ICRA 2007.
//!
//! It is an aid, with the limits of its inputs: a map, an attitude, a centre of mass and a coefficient of
//! friction. It is not a certified safety function.

mod place;
mod settings;
mod stance;

pub use place::{SteepMeasure, SteepPlace};
pub use settings::GuardConfig;
pub use stance::{Margins, Stance, Turning};

use crate::estimator::Estimate;
use crate::path::Point2;
use crate::reference::Reference;
use crate::trajectory::{Motion, Trajectory};
use nalgebra::Vector3;
use place::{Beside, Call, Judge};
use serde::{Deserialize, Serialize};
use sidehill_plant::contact::Parameter;
use sidehill_plant::speeds::MotorSpeeds;
use sidehill_plant::terrain::Terrain;

/// Why the guard stops the vehicle now.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum GuardStop {
    /// The place ahead that crosses a limit is reached.
    TooSteep(SteepPlace),
    /// The attitude under the vehicle crosses its limit.
    Tilted {
        /// What crosses it.
        measure: SteepMeasure,
        /// Its value, deg.
        value_deg: f64,
        /// Its limit, deg.
        limit_deg: f64,
    },
}

/// Time between the places that are judged, at the reference's full speed, s.
const STEP_S: f64 = 0.15;
/// Time constant of the low-pass of the ground's normal, s: a bump is not a slope.
const NORMAL_S: f64 = 0.2;
/// Way before the stopping place within which the vehicle is stopped, m.
const ARRIVED_M: f64 = 0.03;
/// Speed below which a reference counts as standing, m/s.
const STANDING_M_S: f64 = 1e-3;
/// Standard deviation of learned friction, over its prior's, below which it counts as learned.
const LEARNED_SHARE: f64 = 0.5;

/// What the guard says in a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct GuardView {
    /// Tip-over margin of the vehicle now.
    pub rollover_margin: f64,
    /// Use of friction now.
    pub friction_use: f64,
    /// Coefficient of friction that is reckoned with.
    pub friction: f64,
    /// Share of the reference's speed that is driven.
    pub speed_share: f64,
    /// Nearest place ahead before which the vehicle stops, else may have to stop, else over which it drives
    /// slower.
    pub ahead: Option<SteepPlace>,
}

/// What the guard looks at in a cycle.
pub(crate) struct Surroundings<'a> {
    pub(crate) estimate: &'a Estimate,
    pub(crate) reference: &'a Reference,
    pub(crate) map: Option<&'a Terrain>,
    /// Half the effective distance of the treads, m.
    pub(crate) half_track_m: f64,
    pub(crate) elapsed_s: f64,
    /// Command of the cycle before.
    pub(crate) command: MotorSpeeds,
}

/// A place on the way ahead.
#[derive(Debug, Clone, Copy)]
struct Place {
    /// Way from here, m.
    way_m: f64,
    /// Speed of the reference, m/s.
    speed_m_s: f64,
    /// Square of the largest speed there, m^2/s^2.
    square: f64,
}

/// The guard; nothing is allocated after it is made.
#[derive(Debug, Clone)]
pub struct Guard {
    config: GuardConfig,
    stance: Stance,
    deceleration_m_s2: f64,
    normal: Option<Vector3<f64>>,
    /// Places that are looked at.
    count: usize,
    places: Vec<Place>,
    shares: Vec<f64>,
    /// Whether any place ahead is driven slower than the reference has it.
    limited: bool,
    view: Option<GuardView>,
}

impl Guard {
    /// Returns the guard of a vehicle that brakes with `deceleration_m_s2`.
    pub(crate) fn new(config: GuardConfig, stance: Stance, deceleration_m_s2: f64) -> Self {
        let count = (config.look_ahead_s / STEP_S).ceil() as usize + 1;
        Self {
            config,
            stance,
            deceleration_m_s2,
            normal: None,
            count,
            places: Vec::with_capacity(count),
            shares: Vec::with_capacity(count),
            limited: false,
            view: None,
        }
    }

    /// Returns what the last cycle came to.
    pub fn view(&self) -> Option<GuardView> {
        self.view
    }

    /// Forgets the slope under a vehicle that may have been carried, and the ground ahead.
    pub(crate) fn reset(&mut self) {
        self.normal = None;
        self.limited = false;
        self.view = None;
    }

    /// Judges where the vehicle is and what is ahead; returns why it must be stopped now.
    pub(crate) fn look(&mut self, around: &Surroundings<'_>) -> Option<GuardStop> {
        let estimate = around.estimate;
        let normal = self.smooth(&estimate.normal_in_world, around.elapsed_s);
        let friction = self.friction(estimate);
        let judge = Judge {
            config: &self.config,
            stance: &self.stance,
            friction,
        };
        let moving = Turning {
            speed_m_s: around.command.traction_m_s,
            yaw_rate_rad_s: around.command.steer_m_s / around.half_track_m,
        };
        let now = self.stance.margins(&estimate.attitude, &moving, friction);
        let mut view = GuardView {
            rollover_margin: now.rollover,
            friction_use: now.friction_use,
            friction,
            speed_share: 1.0,
            ahead: None,
        };
        let tilt = judge.tilt(&estimate.attitude);
        let beside = Beside::of(&estimate.pose, &around.reference.ahead(0.0));
        self.places.clear();
        let (mut way_m, mut before_m, mut blocked_m) = (0.0, 0.0, None);
        for i in 0..self.count {
            let in_s = STEP_S * i as f64;
            let point = around.reference.ahead(in_s);
            if i > 0 {
                way_m += (point.arc_length_m - before_m).abs();
            }
            before_m = point.arc_length_m;
            let ground = |place: Point2| {
                around
                    .map
                    .and_then(|map| map.surface(place.x_m, place.y_m).ok())
                    .map_or(normal, |surface| surface.normal_in_world)
            };
            let on_path = judge.judge(&point, 0.0, &ground(point.position));
            let as_now = judge.judge(&point, beside.turned_rad, &ground(beside.place(&point)));
            let judged = on_path.and(as_now);
            let speed_m_s = point.speed_m_s.abs();
            let mut square = f64::INFINITY;
            if let Some(excess) = judged.near_limit
                && !view.ahead.is_some_and(|place| place.may_stop)
            {
                view.ahead = Some(excess.at(&point, in_s, Call::Warning));
            }
            if let Some(excess) = judged.blocked {
                view.ahead = Some(excess.at(&point, in_s, Call::Stop));
                blocked_m = Some(way_m);
                square = 0.0;
            } else if judged.share < 1.0 {
                square = (judged.share * speed_m_s).powi(2);
                let slow = judged
                    .slow
                    .map(|excess| excess.at(&point, in_s, Call::Slow));
                view.ahead = view.ahead.or(slow);
            }
            self.places.push(Place {
                way_m,
                speed_m_s,
                square,
            });
            // Beyond a stop, and beyond the end, there is nothing to judge.
            if blocked_m.is_some() || (i > 0 && point.motion == Motion::Stand) {
                break;
            }
        }
        let stop_m = blocked_m.map(|blocked_m| blocked_m - self.config.stop_before_m);
        self.limit_speeds(stop_m, around.command.traction_m_s.abs());
        view.speed_share = self.share_at(0.0);
        self.view = Some(view);
        if let Some(tilt) = tilt {
            return Some(GuardStop::Tilted {
                measure: tilt.measure,
                value_deg: tilt.value,
                limit_deg: tilt.limit,
            });
        }
        let place = view.ahead?;
        (stop_m? <= ARRIVED_M).then_some(GuardStop::TooSteep(place))
    }

    /// Returns whether any place ahead is driven slower than the reference has it.
    pub(crate) fn slows(&self) -> bool {
        self.limited
    }

    /// Returns the share of the reference's speed with which it is followed now.
    pub(crate) fn share(&self) -> f64 {
        if self.limited {
            self.share_at(0.0)
        } else {
            1.0
        }
    }

    fn smooth(&mut self, measured: &Vector3<f64>, elapsed_s: f64) -> Vector3<f64> {
        let before = self.normal.unwrap_or(*measured);
        let gain = (elapsed_s / NORMAL_S).min(1.0);
        let normal = (before + gain * (measured - before)).normalize();
        self.normal = Some(normal);
        normal
    }

    /// Returns the coefficient of friction: as learned, where poses have informed it, else as configured.
    fn friction(&self, estimate: &Estimate) -> f64 {
        let index = Parameter::Friction.index();
        estimate
            .contact
            .filter(|learned| learned.sigma[index] < LEARNED_SHARE * learned.prior_sigma[index])
            .map_or(self.config.friction, |learned| {
                Parameter::Friction.value(learned.parameters[index])
            })
    }

    /// Brakes before slow places and speeds up after them, by the speeds that places allow.
    fn limit_speeds(&mut self, stop_m: Option<f64>, speed_m_s: f64) {
        let twice = 2.0 * self.deceleration_m_s2;
        if let Some(stop_m) = stop_m {
            for place in &mut self.places {
                place.square = place.square.min(twice * (stop_m - place.way_m).max(0.0));
            }
        }
        for i in (1..self.places.len()).rev() {
            let (next, place) = (self.places[i], &mut self.places[i - 1]);
            let way_m = next.way_m - place.way_m;
            place.square = place.square.min(next.square + twice * way_m);
        }
        let slowed = |place: &Place| place.square < place.speed_m_s.powi(2);
        let was_slowed = self.limited && self.share() < 1.0;
        if was_slowed && let Some(first) = self.places.first_mut() {
            // From a slow stretch the speed grows as it fell before it.
            let growth_m_s = self.deceleration_m_s2 * STEP_S;
            first.square = first.square.min((speed_m_s + growth_m_s).powi(2));
            for i in 1..self.places.len() {
                let (before, place) = (self.places[i - 1], &mut self.places[i]);
                let way_m = place.way_m - before.way_m;
                place.square = place.square.min(before.square + twice * way_m.max(0.01));
            }
        }
        self.limited = self.places.iter().any(slowed);
        self.shares.clear();
        self.shares.extend(self.places.iter().map(|place| {
            if place.speed_m_s < STANDING_M_S {
                return f64::from(place.square > 0.0);
            }
            (place.square.sqrt() / place.speed_m_s).min(1.0)
        }));
    }

    /// Returns the share of the reference's speed at a time ahead on it.
    pub(crate) fn share_at(&self, offset_s: f64) -> f64 {
        let Some(last) = self.shares.len().checked_sub(1) else {
            return 1.0;
        };
        let index = offset_s / STEP_S;
        let low = (index as usize).min(last);
        let ratio = (index - low as f64).clamp(0.0, 1.0);
        (1.0 - ratio) * self.shares[low] + ratio * self.shares[(low + 1).min(last)]
    }
}

/// Returns the first place of a trajectory over known ground that the guard would stop before, at the
/// friction configured.
pub fn first_steep_place(
    config: &GuardConfig,
    stance: &Stance,
    trajectory: &Trajectory,
    terrain: &Terrain,
) -> Option<SteepPlace> {
    let judge = Judge {
        config,
        stance,
        friction: config.friction,
    };
    let count = (trajectory.duration_s() / STEP_S).ceil() as usize;
    (0..=count).find_map(|i| {
        let time_s = (STEP_S * i as f64).min(trajectory.duration_s());
        let point = trajectory.at(time_s);
        let surface = terrain
            .surface(point.position.x_m, point.position.y_m)
            .ok()?;
        let judged = judge.judge(&point, 0.0, &surface.normal_in_world);
        Some(judged.blocked?.at(&point, time_s, Call::Stop))
    })
}

#[cfg(test)]
mod tests;
