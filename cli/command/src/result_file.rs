//! Files that the command makes of others, or of a measurement: what is there is replaced on
//! request alone, and a file of a result's name is a whole result.

use crate::failure::{Failure, failed, unusable};
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use tempfile::{NamedTempFile, TempPath};

/// A result that is being written, under another name. Without [`finish`](Self::finish) it is gone.
#[derive(Debug)]
pub struct ResultFile {
    to: BufWriter<File>,
    path: PathBuf,
    /// What it is called meanwhile; none for what is no regular file, such as `/dev/stdout`.
    meanwhile: Option<TempPath>,
    replaces: bool,
}

impl ResultFile {
    /// # Errors
    ///
    /// The file is there, and is not to be replaced; or nothing can be written beside it.
    pub fn create(path: &Path, replaces: bool) -> Result<Self, Failure> {
        // What is there as a link stays one.
        let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        let there = fs::metadata(&target).ok();
        if there.as_ref().is_some_and(|there| !there.is_file()) {
            let file = OpenOptions::new().write(true).open(&target);
            return Ok(Self {
                to: BufWriter::new(file.map_err(failed(path))?),
                path: target,
                meanwhile: None,
                replaces,
            });
        }
        let has_content = there.as_ref().is_some_and(|there| there.len() > 0);
        if has_content && !replaces {
            return Err(is_there(path));
        }
        let folder = target.parent().filter(|path| !path.as_os_str().is_empty());
        let mut builder = tempfile::Builder::new();
        builder.prefix(".luna-").suffix(".part");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // As of any file that a program makes; of one that is replaced, its own.
            let anew = fs::Permissions::from_mode(0o666);
            builder.permissions(there.map_or(anew, |there| there.permissions()));
        }
        let made = builder.tempfile_in(folder.unwrap_or(Path::new(".")));
        let (file, meanwhile) = made.map(NamedTempFile::into_parts).map_err(failed(path))?;
        Ok(Self {
            to: BufWriter::new(file),
            path: target,
            meanwhile: Some(meanwhile),
            replaces,
        })
    }

    /// It is whole: from now on it has its name.
    pub fn finish(self) -> Result<(), Failure> {
        let Self {
            to,
            path,
            meanwhile,
            replaces,
        } = self;
        let file = to
            .into_inner()
            .map_err(|error| failed(&path)(error.into_error()))?;
        let Some(meanwhile) = meanwhile else {
            return Ok(());
        };
        // What a full disk or a network has refused late is known now.
        file.sync_all().map_err(failed(&path))?;
        // An empty file was made by the user, or by `mktemp`, for this.
        let is_empty = fs::metadata(&path).is_ok_and(|there| there.len() == 0);
        let named = match replaces || is_empty {
            true => meanwhile.persist(&path),
            false => meanwhile.persist_noclobber(&path),
        };
        named.map_err(|error| match error.error.kind() {
            io::ErrorKind::AlreadyExists => is_there(&path),
            _ => failed(&path)(error.error),
        })
    }
}

/// The file would be lost.
pub fn is_there(path: &Path) -> Failure {
    let why =
        "it is there already, and would be lost; name another file, remove it, or say --replace";
    unusable(path.display(), why)
}

impl Write for ResultFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.to.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.to.flush()
    }
}

impl Seek for ResultFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.to.seek(to)
    }
}

/// Writes a whole result.
pub fn write(path: &Path, text: &str, replaces: bool) -> Result<(), Failure> {
    let mut file = ResultFile::create(path, replaces)?;
    file.write_all(text.as_bytes()).map_err(failed(path))?;
    file.finish()
}
