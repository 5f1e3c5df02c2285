use serde::Serialize;

/// An input of a run: what it carries, where it comes from, and why it is missing.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Input {
    /// What it carries, such as `odometry`.
    pub input: String,
    /// Where it comes from: topic and type, or message and identifier.
    pub source: String,
    /// Why it is missing; none while it arrives, or where the vehicle drives without it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub missing: Option<String>,
}

impl std::fmt::Display for Input {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} on {}", self.input, self.source)?;
        match &self.missing {
            Some(reason) => write!(f, ": {reason}"),
            None => Ok(()),
        }
    }
}

/// Knows the inputs of a port. Asked outside the control loop, about once a second.
pub trait InputStatus: Send {
    /// Returns all inputs as they are at `now_s` of the loop's time.
    fn inputs(&mut self, now_s: f64) -> Vec<Input>;
}

/// An input that is older than this is missing, s.
pub const MISSING_AFTER_S: f64 = 1.0;
