//! The result of a goal that its client receives.

use crate::node::message::action::code;

/// The result of a goal that its client receives.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Outcome {
    /// One of [`code`].
    pub code: u16,
    /// The reason; empty for success.
    pub message: String,
}

impl Outcome {
    /// Returns an outcome.
    pub fn new(code: u16, message: impl Into<String>) -> Self {
        Self {
            code,
            message: message.into(),
        }
    }

    /// Returns why a path cannot be followed.
    pub(crate) fn invalid_path(reason: impl ToString) -> Self {
        Self::new(code::INVALID_PATH, reason.to_string())
    }
}
