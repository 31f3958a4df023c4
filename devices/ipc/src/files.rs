//! The lock file of a channel, and the removal of its files.

use crate::name::{FOLDER, Name};
use crate::{IpcError, Role};
use nix::fcntl::{FcntlArg, fcntl};
use std::fs::{self, File, OpenOptions};
use std::io;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};

/// The byte of the set-up lock.
const SET_UP: i64 = 0;

pub(crate) fn byte_of(role: Role) -> i64 {
    match role {
        Role::Sender => 1,
        Role::Receiver => 2,
    }
}

fn range(kind: i32, byte: i64) -> libc::flock {
    libc::flock {
        l_type: kind as libc::c_short,
        l_whence: libc::SEEK_SET as libc::c_short,
        l_start: byte,
        l_len: 1,
        l_pid: 0,
    }
}

/// An open lock file. Its locks end with it, and with its program.
#[derive(Debug)]
pub(crate) struct LockFile {
    name: Name,
    file: File,
}

/// The set-up lock of a channel.
pub(crate) struct SetUp<'a>(&'a LockFile);

impl LockFile {
    /// Opens the lock file, made if there is none, and takes the set-up lock. Drop the result's
    /// lock by [`leave`](Self::leave).
    pub(crate) fn enter(name: &Name) -> Result<Self, IpcError> {
        let failed = |error: io::Error| IpcError::system(name.text(), "open its lock file", error);
        loop {
            let file = OpenOptions::new()
                .read(true)
                .write(true)
                .create(true)
                .truncate(false)
                .mode(0o600)
                .custom_flags(libc::O_NOFOLLOW)
                .open(name.lock())
                .map_err(failed)?;
            let opened = Self {
                name: name.clone(),
                file,
            };
            opened.wait_for_set_up()?;
            // It may have been removed between the two: then the next one to come makes another.
            let own = opened.file.metadata().map_err(failed)?;
            match fs::metadata(name.lock()) {
                Ok(there) if (there.ino(), there.dev()) == (own.ino(), own.dev()) => {
                    return Ok(opened);
                }
                Ok(_) => {}
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                Err(error) => return Err(failed(error)),
            }
        }
    }

    /// Opens the lock file to ask for its locks alone; `None`: there is none.
    pub(crate) fn look(name: &Name) -> Result<Option<Self>, IpcError> {
        let opened = OpenOptions::new()
            .read(true)
            .custom_flags(libc::O_NOFOLLOW)
            .open(name.lock());
        match opened {
            Ok(file) => Ok(Some(Self {
                name: name.clone(),
                file,
            })),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(IpcError::system(name.text(), "open its lock file", error)),
        }
    }

    fn wait_for_set_up(&self) -> Result<(), IpcError> {
        let lock = range(libc::F_WRLCK, SET_UP);
        loop {
            match fcntl(&self.file, FcntlArg::F_OFD_SETLKW(&lock)) {
                Ok(_) => return Ok(()),
                Err(nix::Error::EINTR) => {}
                Err(error) => {
                    return Err(IpcError::system(self.name.text(), "lock it", error));
                }
            }
        }
    }

    /// Takes the set-up lock again.
    pub(crate) fn set_up(&self) -> Result<SetUp<'_>, IpcError> {
        self.wait_for_set_up()?;
        Ok(SetUp(self))
    }

    /// Releases the set-up lock. To release a lock that is held cannot fail.
    pub(crate) fn leave(&self) {
        let _ = fcntl(
            &self.file,
            FcntlArg::F_OFD_SETLK(&range(libc::F_UNLCK, SET_UP)),
        );
    }

    /// Takes the role; `false`: it is held. The set-up lock is held.
    pub(crate) fn take(&self, role: Role) -> Result<bool, IpcError> {
        self.lock(libc::F_WRLCK, role)
    }

    /// Takes the role beside others that share it; `false`: one holds it alone.
    pub(crate) fn share(&self, role: Role) -> Result<bool, IpcError> {
        self.lock(libc::F_RDLCK, role)
    }

    fn lock(&self, kind: i32, role: Role) -> Result<bool, IpcError> {
        let lock = range(kind, byte_of(role));
        match fcntl(&self.file, FcntlArg::F_OFD_SETLK(&lock)) {
            Ok(_) => Ok(true),
            Err(nix::Error::EAGAIN | nix::Error::EACCES) => Ok(false),
            Err(error) => Err(IpcError::system(self.name.text(), "lock its role", error)),
        }
    }

    /// Gives the role up.
    pub(crate) fn give_up(&self, role: Role) {
        let lock = range(libc::F_UNLCK, byte_of(role));
        let _ = fcntl(&self.file, FcntlArg::F_OFD_SETLK(&lock));
    }

    /// Whether another open file holds the role: a program that lives.
    pub(crate) fn is_held(&self, role: Role) -> Result<bool, IpcError> {
        let mut lock = range(libc::F_WRLCK, byte_of(role));
        match fcntl(&self.file, FcntlArg::F_OFD_GETLK(&mut lock)) {
            Ok(_) => Ok(i32::from(lock.l_type) != libc::F_UNLCK),
            Err(error) => Err(IpcError::system(
                self.name.text(),
                "ask for its locks",
                error,
            )),
        }
    }

    /// Removes what is left of a channel without a role that is held, but for the lock file. The
    /// set-up lock is held.
    pub(crate) fn remove_contents(&self) {
        // What is not there needs no removal; what cannot be removed fails when it is made anew.
        let _ = fs::remove_file(format!("{FOLDER}/{}", self.name.memory()));
        for role in [Role::Sender, Role::Receiver] {
            let _ = fs::remove_file(self.name.bell(role));
        }
    }

    /// Removes all files if no role is held. The set-up lock is held. Returns whether it did.
    pub(crate) fn remove_if_unused(&self) -> bool {
        let held = [Role::Sender, Role::Receiver].map(|role| self.is_held(role));
        if !matches!(held, [Ok(false), Ok(false)]) {
            return false;
        }
        self.remove_contents();
        fs::remove_file(self.name.lock()).is_ok()
    }
}

impl SetUp<'_> {
    /// As [`LockFile::remove_if_unused`].
    pub(crate) fn remove_if_unused(&self) -> bool {
        self.0.remove_if_unused()
    }
}

impl Drop for SetUp<'_> {
    fn drop(&mut self) {
        self.0.leave();
    }
}

/// Removes the files of all channels that no program has open, and returns how many channels these
/// were. Programs that were killed leave them; the next opening of a channel reuses or removes its
/// files too, so this is for a machine on which a channel is not opened again.
///
/// Channels of other users are left alone. Not for the real-time path.
///
/// # Errors
///
/// The folder of shared memory cannot be read.
///
/// ```
/// let removed = luna_ipc::clean_up()?;
/// println!("{removed} channels of programs that were killed");
/// # Ok::<(), std::io::Error>(())
/// ```
pub fn clean_up() -> io::Result<usize> {
    let mut removed = 0;
    for entry in fs::read_dir(FOLDER)? {
        let Ok(entry) = entry else { continue };
        let name = entry.file_name();
        let Some(name) = name.to_str().and_then(Name::of_lock) else {
            continue;
        };
        // Another user's cannot be opened.
        if let Ok(lock) = LockFile::enter(&name) {
            removed += usize::from(lock.remove_if_unused());
            lock.leave();
        }
    }
    Ok(removed)
}
