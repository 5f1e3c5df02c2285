//! The Python module `sidehill._sidehill`, from which the package `sidehill` takes its names.
//!
//! Values come in through [`arguments`], which names the argument at fault; work runs without the
//! interpreter's lock in [`errors::guarded`], which lets no panic out.

mod arguments;
mod campaign;
mod controller;
mod decision;
mod errors;
mod extra;
mod history;
mod linearise;
mod logs;
mod measured;
mod plant;
mod qp;
mod recordings;
mod scenario;
mod simulate;
mod simulation;
mod tune;
mod vehicle;

use pyo3::prelude::*;

#[pymodule]
fn _sidehill(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<vehicle::Vehicle>()?;
    module.add_class::<scenario::Scenario>()?;
    module.add_class::<controller::Controller>()?;
    module.add_class::<decision::Decision>()?;
    module.add_class::<decision::Estimate>()?;
    module.add_class::<measured::Measured>()?;
    module.add_class::<qp::Qp>()?;
    module.add_class::<logs::Identification>()?;
    module.add_class::<simulate::Run>()?;
    module.add_class::<simulate::SimulationResult>()?;
    module.add_class::<simulation::Simulation>()?;
    module.add_class::<campaign::Campaign>()?;
    module.add_class::<campaign::Results>()?;
    module.add_function(wrap_pyfunction!(vehicle::icr, module)?)?;
    module.add_function(wrap_pyfunction!(vehicle::contact_from_geometry, module)?)?;
    module.add_function(wrap_pyfunction!(linearise::linearise, module)?)?;
    module.add_function(wrap_pyfunction!(simulate::simulate, module)?)?;
    module.add_function(wrap_pyfunction!(simulate::figures_of_log, module)?)?;
    module.add_function(wrap_pyfunction!(simulation::drive, module)?)?;
    module.add_function(wrap_pyfunction!(logs::identify, module)?)?;
    module.add_function(wrap_pyfunction!(logs::identify_drives, module)?)?;
    module.add_function(wrap_pyfunction!(logs::odometry, module)?)?;
    module.add_function(wrap_pyfunction!(tune::tune, module)?)?;
    module.add_function(wrap_pyfunction!(recordings::replay, module)?)?;
    module.add_function(wrap_pyfunction!(recordings::report, module)?)?;
    module.add_function(wrap_pyfunction!(recordings::route, module)?)?;
    Ok(())
}
