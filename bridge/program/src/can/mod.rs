//! `sidehill can`: finds, watches and tests drives on a CAN bus.

mod bench;
mod bus;
mod correct;
mod monitor;
mod scan;
mod terminal;
mod test;

use anyhow::Result;
use sidehill::drive::{CanArgs, CanCommand};
use std::process::ExitCode;

/// Does what the arguments say.
///
/// # Errors
/// A file that cannot be read, a setting out of range, or a bus that carries nothing.
pub fn run(args: &CanArgs) -> Result<ExitCode> {
    match &args.command {
        CanCommand::Scan(args) => scan::run(args),
        CanCommand::Monitor(args) => monitor::run(args),
        CanCommand::Test(args) => test::run(args),
    }
}
