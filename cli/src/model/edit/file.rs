//! The file on the disk, which others may write too.

use crate::failure::{Failure, failed};
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// A file, and what was in it when it was read or written last.
#[derive(Debug)]
pub(super) struct Kept {
    /// As given.
    pub(super) name: String,
    /// Where it is, without links.
    path: PathBuf,
    content: String,
}

impl Kept {
    pub(super) fn open(path: &Path) -> Result<Self, Failure> {
        Ok(Self {
            name: path.display().to_string(),
            content: fs::read_to_string(path).map_err(failed(path))?,
            path: fs::canonicalize(path).map_err(failed(path))?,
        })
    }

    pub(super) fn content(&self) -> &str {
        &self.content
    }

    /// What another program has written since.
    pub(super) fn foreign(&self) -> io::Result<Option<String>> {
        let now = fs::read_to_string(&self.path)?;
        Ok((now != self.content).then_some(now))
    }

    /// Takes what is on the disk as known.
    pub(super) fn know(&mut self, content: String) {
        self.content = content;
    }

    /// Writes it as a whole: a reader finds the former text or this one. Refused if another
    /// program has written it meanwhile.
    pub(super) fn write(&mut self, text: &str) -> io::Result<()> {
        if self.foreign()?.is_some() {
            let error = "another program has written it meanwhile";
            return Err(io::Error::other(error));
        }
        let folder = self.path.parent().unwrap_or(Path::new("."));
        let mut file = tempfile::NamedTempFile::new_in(folder)?;
        file.write_all(text.as_bytes())?;
        let permissions = fs::metadata(&self.path)?.permissions();
        file.as_file().set_permissions(permissions)?;
        file.as_file().sync_all()?;
        file.persist(&self.path).map_err(|error| error.error)?;
        text.clone_into(&mut self.content);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_another_program_has_written_is_not_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.toml");
        fs::write(&path, "a").unwrap();
        let mut kept = Kept::open(&path).unwrap();
        kept.write("b").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "b");
        assert_eq!(kept.foreign().unwrap(), None);
        fs::write(&path, "c").unwrap();
        kept.write("d").unwrap_err();
        assert_eq!(kept.foreign().unwrap().as_deref(), Some("c"));
        assert_eq!(fs::read_to_string(&path).unwrap(), "c");
        kept.know("c".to_owned());
        kept.write("d").unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[cfg(unix)]
    #[test]
    fn links_and_permissions_stay() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let folder = tempfile::tempdir().unwrap();
        let [path, link] = ["model.toml", "link.toml"].map(|name| folder.path().join(name));
        fs::write(&path, "a").unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
        symlink(&path, &link).unwrap();
        Kept::open(&link).unwrap().write("b").unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read_to_string(&path).unwrap(), "b");
        let mode = fs::metadata(&path).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o640);
    }
}
