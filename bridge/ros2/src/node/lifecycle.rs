//! The states and transitions of a managed node.

use super::message::lifecycle::{State, Transition, TransitionDescription, state, transition};

/// A transition that may be requested.
struct LifecycleTransition {
    id: u8,
    label: &'static str,
    from: u8,
    to: u8,
}

const fn edge(id: u8, label: &'static str, from: u8, to: u8) -> LifecycleTransition {
    LifecycleTransition {
        id,
        label,
        from,
        to,
    }
}

const EDGES: [LifecycleTransition; 7] = [
    edge(
        transition::CONFIGURE,
        "configure",
        state::UNCONFIGURED,
        state::INACTIVE,
    ),
    edge(
        transition::CLEANUP,
        "cleanup",
        state::INACTIVE,
        state::UNCONFIGURED,
    ),
    edge(
        transition::ACTIVATE,
        "activate",
        state::INACTIVE,
        state::ACTIVE,
    ),
    edge(
        transition::DEACTIVATE,
        "deactivate",
        state::ACTIVE,
        state::INACTIVE,
    ),
    edge(
        transition::UNCONFIGURED_SHUTDOWN,
        "shutdown",
        state::UNCONFIGURED,
        state::FINALIZED,
    ),
    edge(
        transition::INACTIVE_SHUTDOWN,
        "shutdown",
        state::INACTIVE,
        state::FINALIZED,
    ),
    edge(
        transition::ACTIVE_SHUTDOWN,
        "shutdown",
        state::ACTIVE,
        state::FINALIZED,
    ),
];

/// Primary and transition states.
const STATES: [(u8, &str); 11] = [
    (state::UNKNOWN, "unknown"),
    (state::UNCONFIGURED, "unconfigured"),
    (state::INACTIVE, "inactive"),
    (state::ACTIVE, "active"),
    (state::FINALIZED, "finalized"),
    (10, "configuring"),
    (11, "cleaningup"),
    (12, "shuttingdown"),
    (13, "activating"),
    (14, "deactivating"),
    (15, "errorprocessing"),
];

/// A managed node.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Lifecycle {
    state: u8,
}

impl Lifecycle {
    /// Returns a node that is active, or one that is unconfigured and waits for a lifecycle manager.
    pub fn new(active: bool) -> Self {
        Self {
            state: if active {
                state::ACTIVE
            } else {
                state::UNCONFIGURED
            },
        }
    }

    /// Returns whether the node is active.
    pub fn is_active(&self) -> bool {
        self.state == state::ACTIVE
    }

    /// Returns the state.
    pub fn state(&self) -> State {
        named(self.state)
    }

    /// Makes a transition, requested by id or, where that is 0, by label; returns it, or none where the
    /// present state has no such transition.
    pub fn change(&mut self, request: &Transition) -> Option<TransitionDescription> {
        let edge = EDGES.iter().find(|edge| {
            let matches = match request.id {
                0 => edge.label == request.label,
                id => edge.id == id,
            };
            edge.from == self.state && matches
        })?;
        self.state = edge.to;
        Some(described(edge))
    }

    /// Returns the transitions of the present state.
    pub fn available(&self) -> Vec<TransitionDescription> {
        let from_here = EDGES.iter().filter(|edge| edge.from == self.state);
        from_here.map(described).collect()
    }

    /// Returns all transitions.
    pub fn graph() -> Vec<TransitionDescription> {
        EDGES.iter().map(described).collect()
    }

    /// Returns all states.
    pub fn states() -> Vec<State> {
        STATES.iter().map(|(id, _)| named(*id)).collect()
    }
}

fn named(id: u8) -> State {
    let label = STATES.iter().find(|(known, _)| *known == id);
    State {
        id,
        label: label.map_or("unknown", |(_, label)| label).to_owned(),
    }
}

fn described(edge: &LifecycleTransition) -> TransitionDescription {
    TransitionDescription {
        transition: Transition {
            id: edge.id,
            label: edge.label.to_owned(),
        },
        start_state: named(edge.from),
        goal_state: named(edge.to),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ask(id: u8, label: &str) -> Transition {
        Transition {
            id,
            label: label.to_owned(),
        }
    }

    #[test]
    fn a_lifecycle_manager_brings_the_node_up_and_down() {
        let mut node = Lifecycle::new(false);
        for (request, state, active) in [
            (ask(transition::CONFIGURE, ""), "inactive", false),
            (ask(transition::ACTIVATE, ""), "active", true),
            (ask(0, "deactivate"), "inactive", false),
            (ask(transition::CLEANUP, ""), "unconfigured", false),
            (ask(0, "configure"), "inactive", false),
            (ask(0, "shutdown"), "finalized", false),
        ] {
            let done = node.change(&request).unwrap();
            assert_eq!(
                (done.goal_state.label.as_str(), node.is_active()),
                (state, active)
            );
            assert_eq!(node.state().label, state);
        }
        assert!(node.available().is_empty());
    }

    #[test]
    fn an_impossible_transition_changes_nothing() {
        let mut node = Lifecycle::new(true);
        for request in [
            ask(transition::CONFIGURE, ""),
            ask(transition::INACTIVE_SHUTDOWN, ""),
            ask(99, ""),
            ask(0, "no_such"),
        ] {
            assert_eq!(node.change(&request), None);
        }
        assert!(node.is_active());
        let labels: Vec<String> = node
            .available()
            .into_iter()
            .map(|t| t.transition.label)
            .collect();
        assert_eq!(labels, ["deactivate", "shutdown"]);
        assert_eq!(Lifecycle::graph().len(), 7);
    }
}
