//! Opening files in a folder in which every user may make some.
//!
//! A name says nothing of what is there. So each file is checked once it is open, by its
//! descriptor: it is this user's, no other user may open it, it is of the kind that is wanted, and
//! it has no second name. The system's `fs.protected_*` settings are not relied on: a file that is
//! there is opened without `O_CREAT`, and made with `O_EXCL` alone. Links are not followed, and a
//! FIFO in the place of a file keeps nobody waiting.

use crate::IpcError;
use crate::name::Name;
use nix::unistd::geteuid;
use std::fs::{self, File, Metadata, OpenOptions};
use std::io::{self, ErrorKind};
use std::os::unix::fs::{FileTypeExt, MetadataExt, OpenOptionsExt};
use std::path::Path;

/// What is to be there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    File,
    Fifo,
}

/// What is done with it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Access {
    Read,
    Write,
}

/// Opens what is there, if it is this user's alone; `None`: nothing is there.
pub(crate) fn open(
    name: &Name,
    path: &Path,
    (kind, access): (Kind, Access),
    what: &'static str,
) -> Result<Option<File>, IpcError> {
    let opened = options(access).open(path);
    match opened {
        Ok(file) => checked(name, path, kind, file, what).map(Some),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(refused(name, path, kind, what, error)),
    }
}

/// Makes a file; `None`: something is there.
pub(crate) fn create(
    name: &Name,
    path: &Path,
    what: &'static str,
) -> Result<Option<File>, IpcError> {
    let mut options = options(Access::Write);
    let made = options.create_new(true).mode(0o600).open(path);
    match made {
        // Lists of rights that the folder gives to new files may let others in.
        Ok(file) => checked(name, path, Kind::File, file, what).map(Some),
        Err(error) if error.kind() == ErrorKind::AlreadyExists => Ok(None),
        Err(error) => Err(IpcError::system(name.text(), what, error)),
    }
}

fn options(access: Access) -> OpenOptions {
    let mut options = OpenOptions::new();
    options
        .read(true)
        .write(access == Access::Write)
        .custom_flags(libc::O_NOFOLLOW | libc::O_NONBLOCK);
    options
}

fn checked(
    name: &Name,
    path: &Path,
    kind: Kind,
    file: File,
    what: &'static str,
) -> Result<File, IpcError> {
    let found = file.metadata();
    let found = found.map_err(|error| IpcError::system(name.text(), what, error))?;
    match distrust(&found, kind) {
        None => Ok(file),
        Some(why) => Err(foreign(name, path, why)),
    }
}

/// What the system refused: because of what is there, if that is not to be trusted.
pub(crate) fn refused(
    name: &Name,
    path: &Path,
    kind: Kind,
    what: &'static str,
    error: io::Error,
) -> IpcError {
    let found = fs::symlink_metadata(path);
    match found.ok().and_then(|found| distrust(&found, kind)) {
        Some(why) => foreign(name, path, why),
        None => IpcError::system(name.text(), what, error),
    }
}

fn foreign(name: &Name, path: &Path, why: String) -> IpcError {
    IpcError::Foreign {
        name: name.text().to_owned(),
        path: path.to_owned(),
        why,
    }
}

fn distrust(found: &Metadata, kind: Kind) -> Option<String> {
    let own = geteuid().as_raw();
    let others = found.mode() & 0o077;
    let is_kind = match kind {
        Kind::File => found.is_file(),
        Kind::Fifo => found.file_type().is_fifo(),
    };
    if found.uid() != own {
        let owner = found.uid();
        return Some(format!(
            "it belongs to user {owner}, and this program runs as user {own}"
        ));
    }
    if !is_kind {
        return Some(match kind {
            Kind::File => "it is no regular file".to_owned(),
            Kind::Fifo => "it is no FIFO".to_owned(),
        });
    }
    if others != 0 {
        let mode = found.mode() & 0o777;
        return Some(format!("its mode, {mode:03o}, lets other users in"));
    }
    // None if it was removed since.
    (found.nlink() > 1).then(|| "it has another name too".to_owned())
}
