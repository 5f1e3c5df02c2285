use anyhow::{Context, Result};
use sidehill::config::{ConfigFile, RunConfig};
use sidehill_can::layout::Layout;
use std::path::Path;
use std::sync::Arc;

/// Time after which the state of the bus is known, s.
pub(super) const BUS_KNOWN_S: f64 = 0.3;

/// The bus of a configuration of `run`.
pub(super) struct ConfiguredBus {
    pub(super) file: ConfigFile,
    pub(super) config: RunConfig,
    pub(super) interface: String,
    pub(super) layout: Arc<Layout>,
}

impl ConfiguredBus {
    pub(super) fn read(path: &Path) -> Result<Self> {
        let file = ConfigFile::read(path)?;
        let config: RunConfig = file.parse()?;
        let (interface, layout) = config.bus(&file)?;
        Ok(Self {
            interface: interface.to_owned(),
            layout: Arc::new(layout),
            file,
            config,
        })
    }

    /// Returns the file of the layout.
    pub(super) fn layout_file(&self) -> Result<ConfigFile> {
        let name = self.config.can.as_deref().context("can: is missing")?;
        Ok(self.file.sibling(name)?)
    }
}
