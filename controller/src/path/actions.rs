//! Actions at points of a route.

/// What is to be done where the vehicle passes.
#[derive(Debug, Clone, PartialEq)]
pub struct RouteAction {
    /// Arc length, m.
    pub at_m: f64,
    /// What, as the route says it.
    pub text: String,
}

/// Way by which a vehicle may join a route beyond an action that it still passes, m.
const JOINED_M: f64 = 1.0;

/// The actions of a route, each of which is passed once from begin to end.
#[derive(Debug, Clone, Default)]
pub struct PendingActions {
    actions: Vec<RouteAction>,
    /// Number of those that were passed, or left out where the vehicle has joined the route beyond them.
    done: usize,
    /// How far the vehicle has come, m.
    reached_m: f64,
}

impl PendingActions {
    /// Returns the actions, none of which was passed yet.
    pub fn new(mut actions: Vec<RouteAction>) -> Self {
        actions.sort_by(|a, b| a.at_m.total_cmp(&b.at_m));
        Self {
            actions,
            done: 0,
            reached_m: 0.0,
        }
    }

    /// Returns whether there are none at all.
    pub fn is_empty(&self) -> bool {
        self.actions.is_empty()
    }

    /// Takes that the vehicle begins to drive, or drives on, at an arc length, m.
    ///
    /// It leaves out what is more than a metre behind. Where the vehicle is back in the first metre, all actions are to
    /// come again.
    pub fn join(&mut self, arc_length_m: f64) {
        if arc_length_m <= JOINED_M && self.reached_m > 2.0 * JOINED_M {
            self.done = 0;
        }
        self.reached_m = arc_length_m;
        let behind = |action: &RouteAction| action.at_m < arc_length_m - JOINED_M;
        self.done = self.done.max(self.actions.partition_point(behind));
    }

    /// Takes how far the vehicle has come, m, and returns the actions that it has passed since, in their order.
    pub fn pass(&mut self, arc_length_m: f64) -> &[RouteAction] {
        self.reached_m = arc_length_m;
        let passed = |action: &RouteAction| action.at_m <= arc_length_m;
        let from = self.done;
        self.done = from.max(self.actions.partition_point(passed));
        &self.actions[from..self.done]
    }

    /// Takes that the route was driven to its end, and returns the actions that are left; from then on all are to come
    /// again.
    pub fn finish(&mut self) -> &[RouteAction] {
        self.reached_m = 0.0;
        let from = std::mem::take(&mut self.done);
        &self.actions[from..]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pending(places_m: &[f64]) -> PendingActions {
        let action = |&at_m: &f64| RouteAction {
            at_m,
            text: format!("{at_m}"),
        };
        PendingActions::new(places_m.iter().map(action).collect())
    }

    fn passed(actions: &mut PendingActions, arc_length_m: f64) -> Vec<String> {
        let passed = actions.pass(arc_length_m).iter();
        passed.map(|action| action.text.clone()).collect()
    }

    #[test]
    fn each_action_is_passed_once() {
        let mut actions = pending(&[7.0, 0.0, 3.0, 3.0]);
        actions.join(0.2);
        assert_eq!(passed(&mut actions, 0.2), ["0"]);
        assert!(passed(&mut actions, 2.9).is_empty());
        assert_eq!(passed(&mut actions, 3.01), ["3", "3"]);
        // Noise, and a vehicle that rolls back.
        for arc_length_m in [2.99, 3.02, 1.5, 3.5] {
            assert!(passed(&mut actions, arc_length_m).is_empty());
        }
        let left: Vec<&str> = actions.finish().iter().map(|a| a.text.as_str()).collect();
        assert_eq!(left, ["7"]);
    }

    #[test]
    fn a_vehicle_that_drives_on_after_a_stop_passes_nothing_twice() {
        let mut actions = pending(&[0.4, 3.0, 5.0]);
        actions.join(0.0);
        assert_eq!(passed(&mut actions, 0.6), ["0.4"]);
        // It stopped in the first metre.
        actions.join(0.5);
        assert!(passed(&mut actions, 0.9).is_empty());
        assert_eq!(passed(&mut actions, 3.05), ["3"]);
        actions.join(2.7);
        assert_eq!(passed(&mut actions, 5.0), ["5"]);
    }

    #[test]
    fn what_lies_before_the_place_where_it_joins_is_left_out() {
        let mut actions = pending(&[1.0, 4.5, 6.0]);
        actions.join(5.0);
        assert_eq!(passed(&mut actions, 6.0), ["4.5", "6"]);
    }

    #[test]
    fn a_route_that_begins_anew_has_all_its_actions_again() {
        let mut actions = pending(&[0.5, 4.0]);
        actions.join(0.0);
        assert_eq!(passed(&mut actions, 4.0).len(), 2);
        // Given up on the way, and begun again at the start.
        actions.join(0.3);
        assert_eq!(passed(&mut actions, 4.0).len(), 2);
        assert!(actions.finish().is_empty());
        actions.join(3.5);
        assert_eq!(passed(&mut actions, 4.0), ["4"]);
    }
}
