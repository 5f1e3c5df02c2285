//! One virtual rover, whichever port it hangs on.

mod can_vehicle;
mod drive;
mod simulated_port;

pub use can_vehicle::{
    FaultKind, InjectedFault, VirtualVehicle, VirtualVehicleError, VirtualVehicleSetup,
};
pub use drive::{DriveConfig, DriveInput, VirtualDrive};
pub use simulated_port::SimulatedPort;
