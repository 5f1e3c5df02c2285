//! What was tried, on the disk: a line of CSV each, so that a search that was killed goes on.

use anyhow::{Context, Result, bail};
use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

/// Choices of settings with their costs, in the order in which they were tried.
pub struct Tried {
    file: Option<(PathBuf, File)>,
    rows: Vec<(Vec<f64>, f64)>,
}

impl Tried {
    /// Opens the file of a search or begins one; a torn last line is cut off. Without a path it is in
    /// memory only.
    ///
    /// # Errors
    /// A file of another search, or what the disk says.
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

    /// Returns the cost of try `number`, from 1, where it is known.
    ///
    /// # Errors
    /// Where another choice was tried then: the file is of another machine or build.
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

    /// Adds a try and waits until it is on the disk.
    ///
    /// # Errors
    /// What the disk says.
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

    /// Returns the choice of the least cost; the first of equal ones.
    pub fn best(&self) -> Option<Vec<f64>> {
        let best = self.rows.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
        Some(best.0.clone())
    }

    /// Returns the costs in order.
    pub fn costs(&self) -> Vec<f64> {
        self.rows.iter().map(|(_, cost)| *cost).collect()
    }
}
