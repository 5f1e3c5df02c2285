//! Quality-of-service profiles that match those of the ROS 2 tools.
//!
//! No publisher blocks: a reliable peer that has disappeared must not delay its writer.

use ros2_client::QosProfile;
use ros2_client::qos::{Durability, History, Reliability, WhenFull};

const RELIABLE: Reliability = Reliability::Reliable {
    when_full: WhenFull::Fail,
};

/// Subscriptions to streams: the newest message, best effort. Matches every publisher.
pub const NEWEST: QosProfile = QosProfile::subscription_default();

/// Subscriptions of which no message may be skipped: best effort, with room for a burst. Matches every publisher.
pub const BURST: QosProfile = NEWEST.history(History::KeepLast { depth: 100 });

/// Publishers of streams: match reliable and best-effort subscriptions.
pub const STREAM: QosProfile = QosProfile::subscription_default()
    .reliability(RELIABLE)
    .history(History::KeepLast { depth: 1 });

/// Messages that must not be lost: transforms, diagnostics, feedback.
pub const RELIABLE_10: QosProfile = QosProfile::subscription_default()
    .reliability(RELIABLE)
    .history(History::KeepLast { depth: 10 });

/// Transient local: late subscriptions get the last message, as of `/tf_static` or a latched path.
pub const LATCHED: QosProfile = QosProfile::subscription_default()
    .reliability(RELIABLE)
    .durability(Durability::TransientLocal)
    .history(History::KeepLast { depth: 1 });

/// Subscription to `/tf_static`, where each publisher has its own message.
pub const LATCHED_ALL: QosProfile = QosProfile::subscription_default()
    .reliability(RELIABLE)
    .durability(Durability::TransientLocal)
    .history(History::KeepLast { depth: 100 });

/// Requests and replies of services.
pub const SERVICE: QosProfile = QosProfile::subscription_default()
    .reliability(Reliability::Reliable {
        when_full: WhenFull::DEFAULT,
    })
    .history(History::KeepLast { depth: 10 });
