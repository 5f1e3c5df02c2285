//! One session at a time, and the speed that is asked of it.

use super::goal_context::{GoalContext, PathSource, Request, StepRequests};
use super::goal_session::{GoalSession, PivotSettings, SessionSettings, TrackingState};
use super::outcome::Outcome;
use super::requested_path::RequestedPath;
use super::route::RouteSettings;
use super::termination::Termination;
use crate::node::message::action::code;
use crate::node::peers::ClientId;
use ros2_client::action::GoalId;
use sidehill_bridge::ros2::message::SpeedLimit;
use sidehill_bridge::safety::{Geofence, StopCause};
use sidehill_controller::controller::Decision;
use sidehill_plant::vehicle::Vehicle;

/// Slowest speed that a limit asks for, m/s.
const SPEED_MIN_M_S: f64 = 0.01;

/// Holds the session of the newest path.
pub(crate) struct GoalHandler {
    settings: SessionSettings,
    /// Speed without a limit, m/s.
    desired_speed_m_s: f64,
    limit: SpeedLimit,
    session: Option<GoalSession>,
    requests: StepRequests,
}

impl GoalHandler {
    /// Returns a handler without a session; paths are tracked in the frame `odometry_frame`.
    pub(crate) fn new(
        route: RouteSettings,
        pivots: PivotSettings,
        odometry_frame: &str,
        vehicle: &Vehicle,
    ) -> Self {
        Self {
            desired_speed_m_s: route.limits.speed_max_m_s,
            settings: SessionSettings {
                route,
                pivots,
                odometry_frame: odometry_frame.to_owned(),
                vehicle: vehicle.clone(),
                geofence: None,
            },
            limit: SpeedLimit::default(),
            session: None,
            requests: StepRequests::default(),
        }
    }

    /// Refuses paths that leave an area.
    #[must_use]
    pub(crate) fn within(mut self, geofence: Option<Geofence>) -> Self {
        self.settings.geofence = geofence;
        self
    }

    /// Begins a session in place of the present one; a path that was refused ends it at once.
    pub(crate) fn begin(
        &mut self,
        client: PathSource,
        path: Result<RequestedPath, Outcome>,
        now_s: f64,
    ) {
        let progress = match self.session.take().map(GoalSession::preempt) {
            Some((progress, finish)) => {
                self.requests.push(finish);
                progress
            }
            None => Default::default(),
        };
        let number = self.requests.next_number();
        let (path, refusal) = match path {
            Ok(path) => (path, None),
            Err(outcome) => (RequestedPath::default(), Some(outcome)),
        };
        let mut session = GoalSession::new(client, path, number, progress, now_s);
        if let Some(outcome) = refusal {
            let refused = Termination::abort_with(StopCause::PathRefused, outcome);
            session.terminate(now_s, refused, &mut self.requests);
        }
        self.session = Some(session);
    }

    /// Cancels a goal where it is that of the session.
    pub(crate) fn cancel(&mut self, goal: GoalId, now_s: f64) {
        if self.goal() == Some(goal) {
            self.terminate(Termination::cancel(), now_s);
        }
    }

    /// Aborts the session.
    pub(crate) fn abort(&mut self, cause: StopCause, now_s: f64) {
        self.terminate(Termination::abort(code::UNKNOWN, cause), now_s);
    }

    fn terminate(&mut self, termination: Termination, now_s: f64) {
        if let Some(session) = &mut self.session {
            session.terminate(now_s, termination, &mut self.requests);
        }
    }

    /// Takes that clients have left.
    pub(crate) fn clients_left(&mut self, has_left: impl Fn(&ClientId) -> bool) {
        if let Some(session) = &mut self.session
            && let PathSource::Goal { client, .. } = session.client()
            && has_left(&client)
        {
            session.lose_client();
        }
    }

    /// Returns the goal of the session, unless its path is nobody's.
    pub(crate) fn goal(&self) -> Option<GoalId> {
        match self.session.as_ref()?.client() {
            PathSource::Goal { id, .. } => Some(id),
            PathSource::Route | PathSource::None => None,
        }
    }

    /// Returns the distance left along the path, m, and the commanded speed, m/s, while the route of a goal
    /// is followed.
    pub(crate) fn feedback(&self, decision: &Decision) -> Option<(f64, f64)> {
        self.session.as_ref()?.feedback(decision)
    }

    /// Returns how much of the route of the configuration is left, m, while it is followed.
    pub(crate) fn left_on_route_m(&self, decision: &Decision) -> Option<f64> {
        let session = self.session.as_ref()?;
        match session.client() {
            PathSource::Route => session.left_on_route_m(decision),
            PathSource::Goal { .. } | PathSource::None => None,
        }
    }

    /// Returns where the vehicle is on the route of a goal that is followed.
    pub(crate) fn tracking(&self, decision: &Decision) -> Option<TrackingState> {
        self.session.as_ref()?.tracking(decision)
    }

    /// Returns what keeps the vehicle of the session from driving; none where nothing does.
    pub(crate) fn blocked_by(&self) -> Option<&str> {
        self.session.as_ref()?.blocked_by()
    }

    /// Takes a speed limit; one that is negative or not finite is ignored.
    pub(crate) fn limit_speed(&mut self, limit: SpeedLimit) {
        if limit.speed_limit.is_finite() && limit.speed_limit >= 0.0 {
            self.limit = limit;
            self.change_speed();
        }
    }

    /// Sets the speed without a limit, m/s.
    pub(crate) fn set_desired_speed(&mut self, speed_m_s: f64) {
        self.desired_speed_m_s = speed_m_s;
        self.change_speed();
    }

    fn change_speed(&mut self) {
        let desired_m_s = self.desired_speed_m_s;
        let limited_m_s = match (self.limit.percentage, self.limit.speed_limit) {
            (_, 0.0) => desired_m_s,
            (true, percentage) => desired_m_s * percentage / 100.0,
            (false, speed_m_s) => speed_m_s,
        };
        let speed_m_s = limited_m_s.min(desired_m_s).max(SPEED_MIN_M_S);
        let route = &mut self.settings.route;
        if speed_m_s != route.limits.speed_max_m_s {
            route.limits.speed_max_m_s = speed_m_s;
            if let Some(session) = &mut self.session {
                session.change_speeds(route);
            }
        }
    }

    /// Runs one step. Without a session a moving vehicle is stopped.
    pub(crate) fn step(&mut self, context: &GoalContext<'_>) {
        let requests = &mut self.requests;
        if let Some(session) = &mut self.session {
            if session.step(context, &self.settings, requests) {
                self.session = None;
            }
            return;
        }
        let cause = (!context.is_off()).then_some(StopCause::NobodyAsked);
        if cause.is_some() != requests.stop_cause().is_some() {
            requests.stop(cause);
        }
    }

    /// Returns the requests since the last call, to be carried out in order.
    pub(crate) fn take_requests(&mut self) -> Vec<Request> {
        self.requests.take()
    }
}

#[cfg(test)]
mod tests;
