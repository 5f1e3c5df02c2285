//! The trials of a search on disk, one CSV line each, so that a killed search can continue.

use anyhow::{Context, Result, bail};
use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

/// Trials in their order: settings with their costs.
pub struct Tried {
    file: Option<(PathBuf, File)>,
    rows: Vec<(Vec<f64>, f64)>,
}

impl Tried {
    /// Opens or creates the file of a search; an incomplete last line is cut off. Without a path, trials are kept
    /// in memory only.
    ///
    /// # Errors
    /// A file of another search, or an I/O error.
    pub fn open(path: Option<&Path>, search: &str, keys: &[String]) -> Result<Self> {
        let Some(path) = path else {
            return Ok(Self {
                file: None,
                rows: Vec::new(),
            });
        };
        let name = || path.display().to_string();
        let mut options = OpenOptions::new();
        options.read(true).append(true).create(true);
        let mut file = options.open(path).with_context(name)?;
        file.try_lock()
            .with_context(|| format!("{}: in use by another search", name()))?;
        let mut text = String::new();
        file.read_to_string(&mut text).with_context(name)?;
        let whole = &text[..text.rfind('\n').map_or(0, |end| end + 1)];
        file.set_len(whole.len() as u64).with_context(name)?;
        let header = format!("# {search}\n{},cost\n", keys.join(","));
        if whole.is_empty() {
            file.write_all(header.as_bytes()).with_context(name)?;
        } else if !whole.starts_with(&header) {
            bail!(
                "{}: made by another search; other runs, settings, options or version: name another --out",
                name()
            );
        }
        let rows = whole.lines().enumerate().skip(2);
        let rows = rows
            .map(|(index, line)| {
                let numbers: Result<Vec<f64>, _> = line.split(',').map(str::parse).collect();
                match numbers {
                    Ok(mut numbers) if numbers.len() == keys.len() + 1 => {
                        let cost = numbers.pop().unwrap_or(f64::MAX);
                        Ok((numbers, cost))
                    }
                    _ => bail!(
                        "{}: line {}: no try of {} settings",
                        name(),
                        index + 1,
                        keys.len()
                    ),
                }
            })
            .collect::<Result<_>>()?;
        Ok(Self {
            file: Some((path.to_owned(), file)),
            rows,
        })
    }

    /// Returns the cost of trial `number`, from 1, if it is known.
    ///
    /// # Errors
    /// The recorded trial had other settings: the file is from another machine or build.
    pub fn cost(&self, number: u32, factors: &[f64]) -> Result<Option<f64>> {
        let Some((held, cost)) = self.rows.get(number as usize - 1) else {
            return Ok(None);
        };
        if held != factors {
            let name = self.file.iter().map(|(path, _)| path.display().to_string());
            bail!(
                "{}: try {number} is another than this build makes; name another --out",
                name.collect::<String>()
            );
        }
        Ok(Some(*cost))
    }

    /// Adds a trial and waits until it is on disk.
    ///
    /// # Errors
    /// An I/O error.
    pub fn add(&mut self, factors: &[f64], cost: f64) -> Result<()> {
        if let Some((path, file)) = &mut self.file {
            let fields = factors.iter().chain([&cost]).map(f64::to_string);
            let line = fields.collect::<Vec<_>>().join(",") + "\n";
            file.write_all(line.as_bytes())
                .and_then(|()| file.sync_data())
                .with_context(|| path.display().to_string())?;
        }
        self.rows.push((factors.to_vec(), cost));
        Ok(())
    }

    /// Returns the trial with the lowest cost, the first of equal ones.
    pub fn best(&self) -> Option<Vec<f64>> {
        let best = self.rows.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
        Some(best.0.clone())
    }

    /// Returns the costs in order.
    pub fn costs(&self) -> Vec<f64> {
        self.rows.iter().map(|(_, cost)| *cost).collect()
    }
}
