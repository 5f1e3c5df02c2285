//! lifecycle_msgs: the requests of a lifecycle manager and their answers.

use super::wire;
use sidehill_bridge::ros2::message::Empty;

/// Primary states.
pub mod state {
    /// Unknown.
    pub const UNKNOWN: u8 = 0;
    /// Not configured.
    pub const UNCONFIGURED: u8 = 1;
    /// Configured, not active.
    pub const INACTIVE: u8 = 2;
    /// Active.
    pub const ACTIVE: u8 = 3;
    /// Shut down.
    pub const FINALIZED: u8 = 4;
}

/// Transitions that may be requested.
pub mod transition {
    /// Unconfigured to inactive.
    pub const CONFIGURE: u8 = 1;
    /// Inactive to unconfigured.
    pub const CLEANUP: u8 = 2;
    /// Inactive to active.
    pub const ACTIVATE: u8 = 3;
    /// Active to inactive.
    pub const DEACTIVATE: u8 = 4;
    /// Unconfigured to finalized.
    pub const UNCONFIGURED_SHUTDOWN: u8 = 5;
    /// Inactive to finalized.
    pub const INACTIVE_SHUTDOWN: u8 = 6;
    /// Active to finalized.
    pub const ACTIVE_SHUTDOWN: u8 = 7;
}

wire! {
    /// A state.
    State { id: u8, label: String }
    /// A transition.
    Transition { id: u8, label: String }
    /// A transition with both its ends.
    TransitionDescription { transition: Transition, start_state: State, goal_state: State }
    /// A transition that has happened; ns.
    TransitionEvent = "lifecycle_msgs" / "TransitionEvent" {
        timestamp: u64,
        transition: Transition,
        start_state: State,
        goal_state: State,
    }
    /// Asks for a transition.
    ChangeStateRequest { transition: Transition }
    /// Whether it happened.
    ChangeStateResponse { success: bool }
    /// Asks for the state.
    GetStateRequest { request: Empty }
    /// The state.
    GetStateResponse { current_state: State }
    /// Asks for all states.
    GetAvailableStatesRequest { request: Empty }
    /// All states.
    GetAvailableStatesResponse { available_states: Vec<State> }
    /// Asks for transitions.
    GetAvailableTransitionsRequest { request: Empty }
    /// Transitions.
    GetAvailableTransitionsResponse { available_transitions: Vec<TransitionDescription> }
}
