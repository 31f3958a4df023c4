//! Files that are made anew: what is there is not lost unless that is asked for, and two programs
//! do not write one file.
//!
//! Each is locked (`flock`) as long as it is open, so a file that another program has just begun is
//! taken too, though nothing is in it yet. An empty file that nobody has locked counts as new. What
//! is no regular file, such as `/dev/null` or a FIFO, has nothing to lose: it is opened as it is.
//! Not for the real-time path: opening may wait for the disk, or for a FIFO's reader.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{Error, ErrorKind, Result};
use std::path::{Path, PathBuf};

/// How many files of one name there may be in a folder.
const MOST: u32 = 10_000;

/// A new file at `path`.
///
/// # Errors
///
/// [`AlreadyExists`](ErrorKind::AlreadyExists) if there is something in it, or another program
/// writes it. Else the system's own.
///
/// ```
/// use luna_machine::new_file;
/// use std::io::{ErrorKind, Write};
///
/// let path = std::env::temp_dir().join(format!("luna-new-{}", std::process::id()));
/// new_file::create(&path)?.write_all(b"kept")?;
/// assert_eq!(new_file::create(&path).unwrap_err().kind(), ErrorKind::AlreadyExists);
/// new_file::replace(&path)?.write_all(b"new")?;
/// # std::fs::remove_file(path)?;
/// # Ok::<(), std::io::Error>(())
/// ```
pub fn create(path: &Path) -> Result<File> {
    open_new(path)?.ok_or_else(|| {
        Error::new(
            ErrorKind::AlreadyExists,
            "it is there already, and would be lost; name another file, or remove it",
        )
    })
}

/// As [`create`]. If that is taken, one with a number: `run.luna`, `run-2.luna`, `run-3.luna`.
/// Returns its path with it.
///
/// # Errors
///
/// All of the first 10 000 names are taken, or the system's own.
pub fn create_numbered(path: &Path) -> Result<(PathBuf, File)> {
    for number in 1..=MOST {
        let numbered = numbered(path, number);
        if let Some(file) = open_new(&numbered)? {
            return Ok((numbered, file));
        }
    }
    Err(Error::new(
        ErrorKind::AlreadyExists,
        "there are too many files of this name; remove some, or name another",
    ))
}

/// A file at `path` whose former content is lost.
///
/// # Errors
///
/// [`WouldBlock`](ErrorKind::WouldBlock) if another program writes it: nothing is lost then. Else
/// the system's own.
pub fn replace(path: &Path) -> Result<File> {
    let mut options = OpenOptions::new();
    // What another program writes is not to be truncated, so it is locked first.
    let file = options
        .write(true)
        .create(true)
        .truncate(false)
        .open(path)?;
    if !file.metadata()?.is_file() {
        return Ok(file);
    }
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => Err(Error::new(
            ErrorKind::WouldBlock,
            "another program writes it; name another file, or end that program",
        )),
        // File systems without locks cannot tell.
        Ok(()) | Err(TryLockError::Error(_)) => file.set_len(0).map(|()| file),
    }
}

fn numbered(path: &Path, number: u32) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_owned();
    if number == 1 || name.is_empty() {
        return path.to_owned();
    }
    name.push(format!("-{number}"));
    if let Some(extension) = path.extension() {
        name.push(".");
        name.push(extension);
    }
    path.with_file_name(name)
}

/// None if there is something in it, or another program writes it.
fn open_new(path: &Path) -> Result<Option<File>> {
    let mut options = OpenOptions::new();
    options.write(true);
    let (file, is_new) = match options.clone().create_new(true).open(path) {
        Ok(file) => (file, true),
        Err(error) if error.kind() == ErrorKind::AlreadyExists => {
            // One that may only be read is taken as well. A link to nothing is made.
            match options.create(!path.exists()).truncate(false).open(path) {
                Ok(file) => (file, false),
                Err(error) => {
                    let has_content = fs::metadata(path).is_ok_and(|about| about.len() > 0);
                    return if has_content { Ok(None) } else { Err(error) };
                }
            }
        }
        Err(error) => return Err(error),
    };
    if !file.metadata()?.is_file() {
        return Ok(Some(file));
    }
    match file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => return Ok(None),
        // File systems without locks: a file that is there may be another program's.
        Err(TryLockError::Error(_)) if is_new => {}
        Err(TryLockError::Error(_)) => return Ok(None),
    }
    // Another program may have begun it in between, and have ended.
    Ok((file.metadata()?.len() == 0).then_some(file))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    /// A folder that goes with the test.
    struct Folder(PathBuf);

    impl Folder {
        fn new(name: &str) -> Self {
            let name = format!("luna-new-file-{name}-{}", std::process::id());
            let path = std::env::temp_dir().join(name);
            fs::create_dir_all(&path).unwrap();
            Self(path)
        }

        fn file(&self, name: &str) -> PathBuf {
            self.0.join(name)
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            let _ = fs::remove_dir_all(&self.0);
        }
    }

    #[test]
    fn what_is_there_stays() {
        let folder = Folder::new("stays");
        let path = folder.file("run.luna");
        let mut first = create(&path).unwrap();
        // It is empty, and another writes it.
        assert_eq!(create(&path).unwrap_err().kind(), ErrorKind::AlreadyExists);
        assert_eq!(replace(&path).unwrap_err().kind(), ErrorKind::WouldBlock);
        first.write_all(b"first").unwrap();
        drop(first);
        assert_eq!(create(&path).unwrap_err().kind(), ErrorKind::AlreadyExists);
        assert_eq!(fs::read(&path).unwrap(), b"first");
        let (second, mut file) = create_numbered(&path).unwrap();
        assert_eq!(second, folder.file("run-2.luna"));
        file.write_all(b"second").unwrap();
        assert_eq!(create_numbered(&path).unwrap().0, folder.file("run-3.luna"));
        replace(&path).unwrap().write_all(b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(fs::read(&second).unwrap(), b"second");
    }

    #[test]
    fn an_empty_file_is_new() {
        let folder = Folder::new("empty");
        let path = folder.file("made by mktemp");
        File::create(&path).unwrap();
        assert_eq!(create_numbered(&path).unwrap().0, path);
        assert_eq!(numbered(&path, 2), folder.file("made by mktemp-2"));
    }

    #[cfg(unix)]
    #[test]
    fn what_is_no_regular_file_is_opened_as_it_is() {
        let null = Path::new("/dev/null");
        let all = [
            create(null).unwrap(),
            replace(null).unwrap(),
            create_numbered(null).unwrap().1,
        ];
        assert!(all.iter().all(|file| !file.metadata().unwrap().is_file()));
    }

    /// As two programs that begin at the same time.
    #[test]
    fn of_two_at_once_each_has_a_file_of_its_own() {
        let folder = Folder::new("at-once");
        let path = folder.file("run.luna");
        let threads: Vec<_> = (0..8)
            .map(|_| {
                let path = path.clone();
                std::thread::spawn(move || {
                    let (path, mut file) = create_numbered(&path).unwrap();
                    file.write_all(b"x").unwrap();
                    path
                })
            })
            .collect();
        let mut paths: Vec<_> = threads.into_iter().map(|one| one.join().unwrap()).collect();
        paths.sort();
        paths.dedup();
        assert_eq!(paths.len(), 8);
    }
}
