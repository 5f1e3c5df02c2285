//! Parameters as clients of the live view see and set them.
//!
//! Those of the controller's configuration are fixed. Others belong to an owner, which checks each request by
//! its own rules; only the client waits for the answer.

use super::lock::lock;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Longest wait of a client for the owner.
const ANSWER_WAIT: Duration = Duration::from_secs(1);
/// Why nothing is set if no owner has parameters that can be set.
const NO_OWNER: &str = "the parameters of this server cannot be set";
/// Requests that wait for the owner.
const REQUESTS: usize = 16;

/// Values by name.
pub type Values = BTreeMap<String, Value>;

/// The values that a client requests: all are set, or none.
pub struct SetRequest {
    /// Values by name.
    pub values: Values,
    answer: SyncSender<Result<(), String>>,
}

impl SetRequest {
    /// Tells the client whether the values are set, or why not.
    pub fn answer(self, result: Result<(), String>) {
        // A client that has disconnected or no longer waits gets none.
        let _ = self.answer.try_send(result);
    }
}

/// The owner's end of the parameters that can be set.
pub struct ParameterOwner {
    requests: Receiver<SetRequest>,
    shared: Arc<LiveParameters>,
}

impl ParameterOwner {
    /// Returns the next request.
    pub fn next_request(&self) -> Option<SetRequest> {
        self.requests.try_recv().ok()
    }

    /// Shows the owner's values, all of them, as they now are.
    pub fn publish(&self, values: Values) {
        *lock(&self.shared.owned) = values;
        self.shared.version.fetch_add(1, Ordering::Release);
    }
}

/// The parameters of a view.
#[derive(Default)]
pub(super) struct LiveParameters {
    fixed: Values,
    owned: Mutex<Values>,
    owner: Mutex<Option<SyncSender<SetRequest>>>,
    version: AtomicU64,
}

impl LiveParameters {
    pub(super) fn new(fixed: Values) -> Self {
        Self {
            fixed,
            ..Self::default()
        }
    }

    /// Returns the end of a new owner, which replaces an earlier one.
    pub(super) fn owner(self: &Arc<Self>) -> ParameterOwner {
        let (sender, requests) = sync_channel(REQUESTS);
        *lock(&self.owner) = Some(sender);
        ParameterOwner {
            requests,
            shared: Arc::clone(self),
        }
    }

    /// Returns a number that is another after each change.
    pub(super) fn version(&self) -> u64 {
        self.version.load(Ordering::Acquire)
    }

    /// Returns the values of these names, or all.
    pub(super) fn values(&self, names: &[String]) -> Values {
        let mut all = self.fixed.clone();
        all.extend(lock(&self.owned).clone());
        if !names.is_empty() {
            all.retain(|name, _| names.contains(name));
        }
        all
    }

    /// Asks the owner to set values.
    ///
    /// # Errors
    /// Why nothing was set.
    pub(super) fn set(&self, values: Values) -> Result<(), String> {
        if let Some(name) = values.keys().find(|name| self.fixed.contains_key(*name)) {
            return Err(format!("{name} is fixed while the program runs"));
        }
        let owner = lock(&self.owner).clone();
        let owner = owner.ok_or(NO_OWNER)?;
        let (answer, answered) = sync_channel(1);
        owner
            .try_send(SetRequest { values, answer })
            .map_err(|error| match error {
                TrySendError::Full(_) => "too many requests wait; nothing was set",
                TrySendError::Disconnected(_) => NO_OWNER,
            })?;
        answered
            .recv_timeout(ANSWER_WAIT)
            .unwrap_or_else(|_| Err("no answer yet; the parameter may still be set".to_owned()))
    }
}

/// Returns values as the protocol has them: floating-point numbers are not integers, even if they print as such.
pub(super) fn listed(values: &Values) -> Vec<Value> {
    let parameters = values.iter().map(|(name, value)| {
        let mut parameter = json!({ "name": name, "value": value });
        let first = value.as_array().and_then(|all| all.first());
        if value.is_f64() {
            parameter["type"] = json!("float64");
        } else if first.is_some_and(Value::is_f64) {
            parameter["type"] = json!("float64_array");
        }
        parameter
    });
    parameters.collect()
}
