//! Motor speeds as the drives count them.

pub use sidehill_plant::speeds::MeasuredMotorSpeeds;
