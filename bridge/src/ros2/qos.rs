//! Qualities of service, as the ROS 2 tools expect them.
//!
//! No publisher waits: one whose reliable peer has gone would hold up a control cycle.

use ros2_client::QosProfile;
use ros2_client::qos::{Durability, History, Reliability, WhenFull};

const RELIABLE: Reliability = Reliability::Reliable {
    when_full: WhenFull::Fail,
};

/// Subscriptions to streams: the newest, and a lost one stays lost. Matches every publisher.
pub const NEWEST: QosProfile = QosProfile::subscription_default();

/// Publishers of streams: matches reliable and best-effort subscriptions.
pub const STREAM: QosProfile = QosProfile::subscription_default()
    .reliability(RELIABLE)
    .history(History::KeepLast { depth: 1 });

/// What must not be lost but grows old: transforms, diagnostics, paths.
pub const RELIABLE_10: QosProfile = QosProfile::subscription_default()
    .reliability(RELIABLE)
    .history(History::KeepLast { depth: 10 });

/// What a late subscription shall still get: /tf_static, a latched path, an emergency stop.
pub const LATCHED: QosProfile = QosProfile::subscription_default()
    .reliability(RELIABLE)
    .durability(Durability::TransientLocal)
    .history(History::KeepLast { depth: 1 });

/// Subscription to /tf_static, where each publisher has one message of its own.
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
