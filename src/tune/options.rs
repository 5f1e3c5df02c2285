//! Options of the search.

use super::settings::DEFAULT_KEYS;
use anyhow::Result;
use sidehill_controller::config::ControllerKind;
use sidehill_plant::bounds::Bounds;
use std::ops::Range;

/// Options of the search.
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// Controller; by default icrik-mpc, or that of the recording.
    #[arg(long, value_name = "NAME", value_parser = crate::simulate::controller)]
    pub controller: Option<ControllerKind>,
    /// Setting of the controller to search, with dots between nested keys, as in
    /// `weights.cross_per_m2`; may be given several times. Its present value must be positive.
    #[arg(long = "key", value_name = "KEY", default_values_t = DEFAULT_KEYS.map(str::to_owned))]
    pub keys: Vec<String>,
    /// Largest factor by which a setting may change, up or down.
    #[arg(long, default_value_t = 8.0)]
    pub factor: f64,
    /// Weight of calmness: twice the total variation of steer counts like 2^W times the error.
    #[arg(long, value_name = "W", default_value_t = 0.2)]
    pub calmness: f64,
    /// Runs used by the search, the first of the campaign. For a recording, --training and
    /// --held-out set only the ratio.
    #[arg(long, value_name = "RUNS", default_value_t = 60)]
    pub training: u32,
    /// Runs that decide on acceptance: those that follow.
    #[arg(long, value_name = "RUNS", default_value_t = 120)]
    pub held_out: u32,
    /// Largest number of settings tried.
    #[arg(long, default_value_t = 120)]
    pub tries: u32,
    /// Time limit including the held-out runs, min.
    #[arg(long, default_value_t = 10.0)]
    pub minutes: f64,
    /// Number of parallel simulations, instead of one for each core.
    #[arg(long)]
    pub threads: Option<usize>,
}

impl Options {
    /// Checks the ranges.
    ///
    /// # Errors
    /// Names the option, its value and its range.
    pub fn check(&self) -> Result<()> {
        Bounds::new(1.01, 1e4, "").check("--factor", self.factor)?;
        Bounds::new(0.0, 100.0, "").check("--calmness", self.calmness)?;
        Bounds::new(2.0, 1e6, "").check("--training", f64::from(self.training))?;
        Bounds::new(2.0, 1e6, "").check("--held-out", f64::from(self.held_out))?;
        Bounds::new(1.0, 1e6, "").check("--tries", f64::from(self.tries))?;
        Bounds::new(1e-3, 1e6, "min").check("--minutes", self.minutes)?;
        let threads = self.threads.map_or(1.0, |threads| threads as f64);
        Bounds::new(1.0, f64::INFINITY, "").check("--threads", threads)?;
        Ok(())
    }

    /// Returns the training runs.
    pub fn training_runs(&self) -> Range<u32> {
        0..self.training
    }

    /// Returns the held-out runs.
    pub fn held_out_runs(&self) -> Range<u32> {
        self.training..self.training + self.held_out
    }
}
