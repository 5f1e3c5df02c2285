//! Actions along the controller's path, by what the cycles say.

use crate::safety::SafetyState;
use sidehill_controller::path::{PendingActions, RouteAction};

/// Finds which actions the vehicle passes while it drives.
#[derive(Debug, Default)]
pub(super) struct ActionWatch {
    pending: PendingActions,
    drives: bool,
}

impl ActionWatch {
    pub(super) fn new(pending: PendingActions) -> Self {
        Self {
            pending,
            drives: false,
        }
    }

    /// Takes the state of the safety after a cycle and how far the vehicle has come, m, and returns the actions that it
    /// has passed. A vehicle that is moved by others passes none.
    pub(super) fn cycle(
        &mut self,
        state: SafetyState,
        arc_length_m: Option<f64>,
    ) -> &[RouteAction] {
        let drove = self.drives;
        self.drives = match state {
            SafetyState::Driving => true,
            SafetyState::Stopping => drove,
            SafetyState::Disarmed
            | SafetyState::Latched
            | SafetyState::Zeroing
            | SafetyState::Enabling => false,
        };
        let Some(arc_length_m) = arc_length_m.filter(|_| self.drives) else {
            return &[];
        };
        if !drove {
            self.pending.join(arc_length_m);
        }
        self.pending.pass(arc_length_m)
    }

    /// Takes that the path was driven to its end, and returns the actions that are left.
    pub(super) fn finish(&mut self) -> &[RouteAction] {
        self.drives = false;
        self.pending.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn actions_are_passed_only_while_the_vehicle_drives() {
        let places_m = [2.0, 4.0, 6.0, 8.0, 9.9];
        let actions = places_m.map(|at_m| RouteAction {
            at_m,
            text: format!("{at_m}"),
        });
        let mut watch = ActionWatch::new(PendingActions::new(actions.to_vec()));
        let mut cycle = |state, arc_length_m| {
            let passed = watch.cycle(state, Some(arc_length_m)).iter();
            passed.map(|action| action.at_m).collect::<Vec<f64>>()
        };
        let none: [f64; 0] = [];
        assert_eq!(cycle(SafetyState::Disarmed, 2.5), none);
        assert_eq!(cycle(SafetyState::Driving, 0.0), none);
        assert_eq!(cycle(SafetyState::Driving, 2.1), [2.0]);
        // On the ramp it still moves.
        assert_eq!(cycle(SafetyState::Stopping, 4.05), [4.0]);
        assert_eq!(cycle(SafetyState::Latched, 4.1), none);
        // Pushed by hand, past the third.
        assert_eq!(cycle(SafetyState::Latched, 7.5), none);
        assert_eq!(cycle(SafetyState::Driving, 7.5), none);
        assert_eq!(cycle(SafetyState::Driving, 8.0), [8.0]);
        assert_eq!(watch.finish().len(), 1);
        // It stops at the end, where nothing begins again.
        assert!(watch.cycle(SafetyState::Stopping, Some(9.9)).is_empty());
        assert!(watch.cycle(SafetyState::Latched, Some(9.9)).is_empty());
    }
}
