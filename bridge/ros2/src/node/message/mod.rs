//! Messages of services and actions; those of topics are [`sidehill_bridge::ros2::message`]'s.

pub mod action;
pub mod lifecycle;

/// Defines message structs as [`sidehill_bridge::wire`] does, for services and actions.
macro_rules! wire {
    ($($(#[$meta:meta])* $name:ident $(= $package:literal / $type:literal)? { $($field:ident: $kind:ty),* $(,)? })+) => {
        sidehill_bridge::ros2::message::wire! {
            $($(#[$meta])* $name $(= $package / $type)? { $($field: $kind),* })+
        }
        $(impl ros2_client::Message for $name {})+
    };
}
pub(crate) use wire;
