//! Summary of the steepness guard in a simulated run, from the true state.

use crate::config::Prepared;
use crate::record::{GuardSummary, SlopeRow};
use sidehill_controller::closed_loop::Cycle;
use sidehill_controller::controller::{Status, StopReason};
use sidehill_controller::guard::{Stance, SteepPlace, Turning};

/// Extremes of a run under way.
pub(crate) struct GuardWatch {
    stance: Stance,
    friction: f64,
    summary: GuardSummary,
    announced_s: Option<f64>,
}

impl GuardWatch {
    /// Begins a run of a vehicle with this stance.
    pub(crate) fn new(stance: Stance, prepared: &Prepared) -> Self {
        let configured = prepared.controller.guard.unwrap_or_default().friction;
        Self {
            stance,
            friction: prepared.plant.friction().unwrap_or(configured),
            summary: GuardSummary {
                rollover_margin_min: f64::INFINITY,
                friction_use_max: 0.0,
                tilt_max_deg: 0.0,
                speed_share_min: 1.0,
                warned_s: None,
                stopped_before: None,
            },
            announced_s: None,
        }
    }

    /// Counts a cycle and returns its margins.
    pub(crate) fn watch(&mut self, cycle: &Cycle) -> Option<SlopeRow> {
        let state = &cycle.state;
        let turning = Turning {
            speed_m_s: state.velocity.forward_m_s,
            yaw_rate_rad_s: state.velocity.yaw_rate_rad_s,
        };
        let margins = self
            .stance
            .margins(&state.attitude, &turning, self.friction);
        let view = cycle.decision.guard?;
        let s = &mut self.summary;
        let up = state.attitude.plane_normal(state.pose.yaw_rad).z;
        s.rollover_margin_min = s.rollover_margin_min.min(margins.rollover);
        s.friction_use_max = s.friction_use_max.max(margins.friction_use);
        s.tilt_max_deg = s.tilt_max_deg.max(up.clamp(-1.0, 1.0).acos().to_degrees());
        s.speed_share_min = s.speed_share_min.min(view.speed_share);
        let may_stop = view.ahead.is_some_and(|place| place.may_stop);
        self.announced_s = self.announced_s.or(Some(state.time_s)).filter(|_| may_stop);
        if let Status::Stopping(StopReason::TooSteep { place }) = cycle.decision.status
            && s.stopped_before.is_none()
        {
            s.stopped_before = Some(place);
            s.warned_s = self.announced_s.map(|since_s| state.time_s - since_s);
        }
        Some(SlopeRow {
            margins,
            speed_share: view.speed_share,
            arc_length_m: cycle.decision.progress.map_or(f64::NAN, |p| p.arc_length_m),
        })
    }

    /// Returns the summary; `refused` is the place for which the route was refused.
    pub(crate) fn summary(&self, refused: Option<SteepPlace>) -> GuardSummary {
        GuardSummary {
            stopped_before: refused.or(self.summary.stopped_before),
            rollover_margin_min: match refused {
                // Nothing was driven.
                Some(_) => 1.0,
                None => self.summary.rollover_margin_min,
            },
            ..self.summary
        }
    }
}
