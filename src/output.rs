//! Files that the program writes: atomically, and without losing existing ones.

use anyhow::{Context, Result, bail};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Checks, before any work is done, that files can be written without overwriting anything.
///
/// # Errors
/// Names the file that exists and is not empty, unless `force`; or the folder that does not exist or is not
/// writable.
pub fn check_free(paths: &[impl AsRef<Path>], force: bool) -> Result<()> {
    for path in paths {
        let path = path.as_ref();
        if path.is_symlink() && !path.exists() && !force {
            bail!(
                "{}: is a link to a file that does not exist; name another file, or replace the link with --force",
                path.display()
            );
        }
        if let Ok(found) = std::fs::metadata(path) {
            if found.is_dir() {
                bail!("{}: is a folder", path.display());
            }
            if found.len() > 0 && !force {
                bail!(
                    "{}: exists already; name another file, or overwrite it with --force",
                    path.display()
                );
            }
        }
    }
    Ok(())
}

/// Checks as [`check_free`], and that the file's folder is writable.
///
/// # Errors
/// As [`check_free`].
pub fn check_writable(path: &Path, force: bool) -> Result<()> {
    check_free(&[path], force)?;
    if !folder(path).is_dir() {
        bail!(
            "{}: cannot be written: there is no folder {}; make it first",
            path.display(),
            folder(path).display()
        );
    }
    tempfile::Builder::new()
        .prefix(".sidehill")
        .tempfile_in(folder(path))
        .map(drop)
        .with_context(|| {
            format!(
                "{}: cannot be written; name a file in a folder that you may write to",
                path.display()
            )
        })
}

/// Checks that a file that is written is none of those that are read, which `--force` would lose.
///
/// # Errors
/// Names the file that is both.
pub fn check_apart<'a>(path: &Path, read: impl IntoIterator<Item = &'a PathBuf>) -> Result<()> {
    let Ok(written) = path.canonicalize() else {
        return Ok(());
    };
    let mut read = read.into_iter();
    if read.any(|read| read.canonicalize().is_ok_and(|read| read == written)) {
        bail!(
            "{}: is read, and what was recorded would be lost; name another file to write",
            path.display()
        );
    }
    Ok(())
}

/// Writes a file atomically: to a temporary file beside it, then renamed.
///
/// # Errors
/// As [`check_free`], or an I/O error.
pub fn write(path: &Path, bytes: &[u8], force: bool) -> Result<()> {
    check_free(&[path], force)?;
    let failed = || format!("{}: cannot be written", path.display());
    let mut temporary = tempfile::Builder::new();
    temporary.prefix(".sidehill");
    // Readable by everyone, as files usually are; temporary files are not by default.
    #[cfg(unix)]
    temporary.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o644));
    let mut file = temporary.tempfile_in(folder(path)).with_context(failed)?;
    file.write_all(bytes).with_context(failed)?;
    file.as_file().sync_data().with_context(failed)?;
    // A file that came while this one was made stays.
    let persisted = if force || path.exists() {
        file.persist(path)
    } else {
        file.persist_noclobber(path)
    };
    persisted.with_context(failed)?;
    Ok(())
}

/// Renames existing files of an earlier run: `a.csv` becomes `a.csv.1`, with the same number for all of `paths`.
/// For programs that drive a vehicle: they must start again with the same command.
///
/// # Errors
/// Names the file that cannot be renamed.
pub fn keep_earlier(paths: &[impl AsRef<Path>]) -> Result<()> {
    let numbered = |path: &Path, number: u32| {
        let mut name = path.as_os_str().to_owned();
        name.push(format!(".{number}"));
        PathBuf::from(name)
    };
    let in_the_way =
        |path: &Path| std::fs::metadata(path).is_ok_and(|found| found.is_file() && found.len() > 0);
    let earlier: Vec<&Path> = paths
        .iter()
        .map(AsRef::as_ref)
        .filter(|path| in_the_way(path))
        .collect();
    let is_free = |number: &u32| {
        paths
            .iter()
            .all(|path| !numbered(path.as_ref(), *number).exists())
    };
    let Some(number) = (1..u32::MAX).find(is_free) else {
        bail!("there are too many earlier files");
    };
    for path in earlier {
        let kept = numbered(path, number);
        std::fs::rename(path, &kept)
            .with_context(|| format!("{}: cannot be kept as {}", path.display(), kept.display()))?;
    }
    Ok(())
}

fn folder(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_earlier_runs_are_kept_with_one_number() {
        let folder = tempfile::tempdir().unwrap();
        let paths = ["a.log", "b.log"].map(|name| folder.path().join(name));
        for run in 0..3 {
            keep_earlier(&paths).unwrap();
            for path in &paths[usize::from(run == 1)..] {
                std::fs::write(path, format!("run {run}")).unwrap();
            }
        }
        let text = |name: &str| std::fs::read_to_string(folder.path().join(name)).ok();
        assert_eq!(text("a.log.1").as_deref(), Some("run 0"));
        assert_eq!(text("b.log.2").as_deref(), Some("run 1"));
        assert_eq!(text("a.log.2"), None);
        assert_eq!(text("a.log").as_deref(), Some("run 2"));
    }

    #[test]
    fn what_is_read_is_not_written_under_whatever_name() {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("log.csv");
        let other = folder.path().join("other.csv");
        std::fs::write(&log, "recorded").unwrap();
        check_apart(&other, [&log]).unwrap();
        std::fs::write(&other, "written").unwrap();
        check_apart(&other, [&log]).unwrap();
        let same = folder.path().join(".").join("log.csv");
        for name in [&log, &same] {
            let error = check_apart(name, [&other, &log]).unwrap_err().to_string();
            assert!(error.contains("log.csv: is read"), "{error}");
        }
    }

    #[test]
    fn what_exists_is_kept_but_by_force() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.yaml");
        write(&path, b"one", false).unwrap();
        let error = write(&path, b"two", false).unwrap_err().to_string();
        assert!(error.contains("a.yaml: exists already"), "{error}");
        assert_eq!(std::fs::read(&path).unwrap(), b"one");
        write(&path, b"two", true).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"two");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        assert!(write(&folder.path().join("no/b.yaml"), b"", false).is_err());
    }
}
