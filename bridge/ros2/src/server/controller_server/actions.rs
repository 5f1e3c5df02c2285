//! Actions along the route of the configuration.

use super::ControllerServer;
use sidehill_bridge::control_loop::channel::LoopStatus;
use sidehill_bridge::safety::SafetyState;
use sidehill_controller::controller::Decision;

impl ControllerServer {
    /// Publishes the actions of the route that the vehicle has passed.
    pub(super) fn pass_actions(
        &mut self,
        status: Option<&LoopStatus>,
        decision: Option<&Decision>,
    ) {
        // On the ramp of a stop it still moves.
        self.moves = match status.map(|status| status.row.state) {
            Some(SafetyState::Driving) => true,
            Some(SafetyState::Stopping) => self.moves,
            _ => false,
        };
        let moves = self.moves;
        let Some(route) = self.links.configured_route.as_mut().filter(|_| moves) else {
            return;
        };
        let left_m = decision.and_then(|decision| self.handler.left_on_route_m(decision));
        let Some(left_m) = left_m else {
            return;
        };
        let arc_length_m = (route.path.length_m(0) - left_m).max(0.0);
        if std::mem::take(&mut self.joins_route) {
            route.actions.join(arc_length_m);
        }
        let passed = route.actions.pass(arc_length_m);
        self.actions.publish(&self.links.inputs, passed);
    }

    /// Publishes what is left where the route was driven to its end.
    pub(super) fn finish_actions(&mut self) {
        if let Some(route) = &mut self.links.configured_route
            && !self.joins_route
        {
            self.actions
                .publish(&self.links.inputs, route.actions.finish());
        }
    }
}
