//! A campaign: one scenario, and the values drawn for each of its runs.

use super::BUILD;
use super::draws::{Draw, find, put};
use super::{Bundle, Conditions, ConfigError, ConfigFile, Overrides, Scenario, to_yaml};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde::{Deserialize, Serialize};
use serde_yaml::{Mapping, Value};
use sidehill_controller::config::{ControllerConfig, ControllerKind};
use sidehill_plant::fingerprint::fnv_1a;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::PoisonError;

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawCampaign {
    /// Name for files and tables.
    name: String,
    /// Seed of all draws. Run N depends on it and N alone.
    seed: u64,
    /// Runs of each controller; `--runs` replaces it.
    runs: u32,
    /// Controllers that drive each run.
    controllers: Vec<ControllerKind>,
    /// [Scenario](#scenario) file that the runs vary.
    scenario: PathBuf,
    /// [Conditions](#conditions) file applied to it.
    #[serde(default)]
    conditions: Option<PathBuf>,
    /// Keys of the scenario that are the same in all runs, nested ones by names with dots.
    #[serde(default)]
    with: Mapping,
    /// [What is drawn](#draw).
    draws: Vec<Draw>,
}

/// A campaign with its scenario read.
#[derive(Debug, Clone)]
pub struct Campaign {
    /// Name in files and tables.
    pub name: String,
    /// Runs of each controller.
    pub runs: u32,
    /// Controllers that drive each run.
    pub controllers: Vec<ControllerKind>,
    seed: u64,
    draws: Vec<Draw>,
    /// The scenario with conditions and fixed keys applied.
    scenario: ConfigFile,
}

/// A campaign with the texts of all files that its runs read.
#[derive(Deserialize, Serialize)]
struct Bundled {
    name: String,
    runs: u32,
    controllers: Vec<ControllerKind>,
    seed: u64,
    draws: Vec<Draw>,
    scenario: PathBuf,
    scenario_text: String,
    files: BTreeMap<PathBuf, String>,
}

/// The values drawn for a run, and the resulting scenario.
pub struct Drawn {
    /// Seed of everything random within the run.
    pub seed: u64,
    /// Values of the campaign's keys, in their order.
    pub values: Vec<Value>,
    /// The scenario.
    pub scenario: ConfigFile,
}

impl Campaign {
    /// Reads a campaign with the scenario it names.
    ///
    /// # Errors
    /// [`ConfigError`] with file, key, value and range.
    pub fn read(file: &ConfigFile) -> Result<Self, ConfigError> {
        let raw: RawCampaign = file.parse()?;
        if raw.controllers.is_empty() {
            return Err(file.error("controllers: the list is empty"));
        }
        let mut keys = BTreeSet::new();
        for draw in &raw.draws {
            draw.check().map_err(|message| file.error(message))?;
            if !keys.insert(draw.key.as_str()) {
                return Err(file.error(format!("draws: {} is drawn twice", draw.key)));
            }
        }
        let mut scenario = file.sibling(&raw.scenario)?;
        if let Some(name) = &raw.conditions {
            scenario = Conditions::beside(file, name)?.put_into(&scenario)?;
        }
        let campaign = Self {
            scenario: scenario.with_keys(&raw.with)?,
            name: raw.name,
            runs: raw.runs,
            controllers: raw.controllers,
            seed: raw.seed,
            draws: raw.draws,
        };
        // An unknown key would fail every run.
        let first = campaign.draw(0)?;
        Scenario::read(first.scenario)
            .map_err(|error| file.error(format!("run 0 is not a valid scenario: {error}")))?;
        Ok(campaign)
    }

    /// Returns the campaign of a campaign file, or of a scenario, whose runs then differ by their seeds only.
    ///
    /// # Errors
    /// [`ConfigError`] with file, key, value and range.
    pub fn read_any(file: &ConfigFile) -> Result<Self, ConfigError> {
        let keys: Mapping = file.parse()?;
        if keys.contains_key("draws") {
            return Self::read(file);
        }
        let scenario = Scenario::read(file.clone())?;
        let prepared = scenario.prepare(&Overrides::default())?;
        Ok(Self {
            name: prepared.name,
            runs: u32::MAX,
            controllers: prepared.controllers,
            seed: prepared.seed,
            draws: Vec::new(),
            scenario: file.clone(),
        })
    }

    /// Returns the campaign with these keys in its scenario, in place of those of the same name; of
    /// `controller` only what is named there is replaced.
    ///
    /// # Errors
    /// [`ConfigError`] where the result is not a valid scenario.
    pub fn with_keys(&self, keys: &Mapping) -> Result<Self, ConfigError> {
        let scenario = self.scenario.with_keys(keys)?;
        Scenario::read(scenario.clone())?.prepare(&Overrides::default())?;
        Ok(Self {
            scenario,
            ..self.clone()
        })
    }

    /// Returns the settings of the controllers before anything is drawn, defaults included.
    ///
    /// # Errors
    /// [`ConfigError`] with file, key, value and range.
    pub fn controller_settings(&self) -> Result<ControllerConfig, ConfigError> {
        let scenario = Scenario::read(self.scenario.clone())?;
        Ok(scenario.prepare(&Overrides::default())?.controller)
    }

    /// Returns the keys that are drawn.
    pub fn keys(&self) -> impl Iterator<Item = &str> {
        self.draws.iter().map(|draw| draw.key.as_str())
    }

    /// Returns the values and the scenario of run `index`. They depend only on the campaign's seed, its draws and
    /// the index.
    ///
    /// # Errors
    /// [`ConfigError`] where a value cannot be put into the scenario.
    pub fn draw(&self, index: u32) -> Result<Drawn, ConfigError> {
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        random.set_stream(u64::from(index));
        // Short enough to type.
        let seed = random.next_u64() >> 32;
        let values: Vec<Value> = self
            .draws
            .iter()
            .map(|draw| draw.value(&mut random))
            .collect();
        let mut keys: Mapping = self.scenario.parse()?;
        for (draw, value) in self.draws.iter().zip(&values) {
            put(&mut keys, &draw.key, value);
        }
        put(&mut keys, "seed", &Value::from(seed));
        let name = format!("{}_{index}", self.name);
        put(&mut keys, "name", &Value::from(name));
        Ok(Drawn {
            seed,
            values,
            scenario: self.scenario.with_keys(&keys)?,
        })
    }

    /// Returns the scenario of a run as a file that works in any folder: with the campaign's controllers and
    /// absolute file names.
    ///
    /// # Errors
    /// [`ConfigError`] where a named file does not exist.
    pub fn scenario_text(&self, index: u32) -> Result<String, ConfigError> {
        let scenario = self.draw(index)?.scenario;
        let mut keys: Mapping = scenario.parse()?;
        for key in [
            "vehicle",
            "route.file",
            "terrain.file",
            "contact.vehicle",
            "contact.identified",
        ] {
            if let Some(name) = find(&keys, key).and_then(Value::as_str) {
                let path = scenario.sibling(Path::new(name))?.path().to_owned();
                let whole = std::path::absolute(&path).map_err(|reason| ConfigError::Read {
                    file: path.display().to_string(),
                    reason,
                    named_by: None,
                })?;
                put(&mut keys, key, &Value::from(whole.display().to_string()));
            }
        }
        let names = self.controllers.iter().map(|kind| kind.name());
        put(&mut keys, "controllers", &names.collect());
        serde_yaml::to_string(&keys).map_err(|error| scenario.error(error))
    }

    /// Returns the campaign and all files it names as one text, for [`Campaign::from_bundle`] on another machine.
    ///
    /// # Errors
    /// [`ConfigError::Content`] where the campaign cannot be written as YAML.
    pub fn bundle(&self) -> Result<String, ConfigError> {
        let files = Bundle::default();
        let scenario = self.scenario.clone().with_bundle(files.clone());
        let prepare = |keys: &Mapping| {
            // A run that cannot be prepared becomes a row with its error.
            let _ = scenario
                .with_keys(keys)
                .and_then(Scenario::read)
                .and_then(|scenario| scenario.prepare(&Overrides::default()).map(drop));
        };
        let keys: Mapping = scenario.parse()?;
        prepare(&keys);
        for draw in &self.draws {
            for value in draw.choices() {
                let mut keys = keys.clone();
                put(&mut keys, &draw.key, &value);
                prepare(&keys);
            }
        }
        let files = files.lock().unwrap_or_else(PoisonError::into_inner);
        to_yaml(&Bundled {
            name: self.name.clone(),
            runs: self.runs,
            controllers: self.controllers.clone(),
            seed: self.seed,
            draws: self.draws.clone(),
            scenario: self.scenario.path().to_owned(),
            scenario_text: self.scenario.text().to_owned(),
            files: files.clone(),
        })
        .map_err(|error| self.scenario.error(error))
    }

    /// Returns the campaign of a text made by [`Campaign::bundle`], with the same results and fingerprint.
    ///
    /// # Errors
    /// [`ConfigError::Content`] where the text is not a bundle.
    pub fn from_bundle(text: &str) -> Result<Self, ConfigError> {
        let file = ConfigFile::with_text(Path::new("bundle"), text.to_owned());
        let bundled: Bundled = file.parse()?;
        let files = Bundle::new(bundled.files.into());
        let scenario = ConfigFile::with_text(&bundled.scenario, bundled.scenario_text);
        Ok(Self {
            name: bundled.name,
            runs: bundled.runs,
            controllers: bundled.controllers,
            seed: bundled.seed,
            draws: bundled.draws,
            scenario: scenario.with_bundle(files),
        })
    }

    /// Returns whether the steepness guard is on in its scenario.
    ///
    /// # Errors
    /// [`ConfigError`] where the scenario cannot be prepared.
    pub fn has_guard(&self) -> Result<bool, ConfigError> {
        Ok(Scenario::read(self.scenario.clone())?.has_guard())
    }

    /// Returns a hash of seed, draws, scenario and vehicles: results with different fingerprints do not belong
    /// together. The number of runs and the controllers do not change it.
    ///
    /// # Errors
    /// [`ConfigError`] where what the scenario names cannot be read.
    pub fn fingerprint(&self) -> Result<String, ConfigError> {
        let world = Scenario::read(self.scenario.clone())?.prepare(&Overrides::default())?;
        // Vehicles without this field keep the fingerprint they had before the field was added.
        let vehicle = format!("{:?}", world.vehicle).replace(", contact_encoder_scale: None", "");
        let all = format!(
            "{} {} {:?} {} {:?} {vehicle}",
            env!("CARGO_PKG_VERSION"),
            self.seed,
            self.draws,
            self.scenario.text(),
            world.plant
        );
        Ok(format!("{:016x}-{BUILD}", fnv_1a(all.as_bytes())))
    }
}
