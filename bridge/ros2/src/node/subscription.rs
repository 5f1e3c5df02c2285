//! Reading a subscription without waiting.

use ros2_client::{MessageInfo, Subscription};
use serde::de::DeserializeOwned;

/// Messages that cannot be read and are skipped in one call; a flood of them must not hold up the thread.
const UNREADABLE_MAX: usize = 100;

/// Passes all messages that have arrived to `take`, with the publisher and number of each, and returns how many could
/// not be read.
pub fn take_all<M>(subscription: &Subscription<M>, mut take: impl FnMut(M, &MessageInfo)) -> usize
where
    M: 'static + DeserializeOwned,
{
    let mut unreadable = 0;
    while unreadable < UNREADABLE_MAX {
        match subscription.take() {
            Ok(Some((message, info))) => take(message, &info),
            Ok(None) => break,
            Err(_) => unreadable += 1,
        }
    }
    unreadable
}

/// Returns the newest message that has arrived.
pub fn take_newest<M>(subscription: &Subscription<M>) -> Option<M>
where
    M: 'static + DeserializeOwned,
{
    let mut newest = None;
    take_all(subscription, |message, _| newest = Some(message));
    newest
}
