//! The lock file of a channel, and the removal of its files.

use crate::name::{FOLDER, Name};
use crate::owned::{self, Access, Kind};
use crate::{IpcError, Role};
use nix::fcntl::{FcntlArg, fcntl};
use std::fs::{self, File};
use std::io;
use std::os::unix::fs::MetadataExt;
use std::time::{Duration, Instant};

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

/// How long a program waits for the set-up lock: far longer than an opening or closing holds it.
const PATIENCE: Duration = Duration::from_secs(5);
/// The longest pause between two tries.
const PAUSE: Duration = Duration::from_millis(10);

/// Waits for what other programs do, for a bounded time.
struct Patience {
    begin: Instant,
    pause: Duration,
}

impl Patience {
    fn new() -> Self {
        Self {
            begin: Instant::now(),
            pause: Duration::from_micros(50),
        }
    }

    /// Pauses before the next try.
    fn pause(&mut self, name: &Name) -> Result<(), IpcError> {
        let waited = self.begin.elapsed();
        if waited >= PATIENCE {
            return Err(IpcError::Held {
                name: name.text().to_owned(),
                path: name.lock(),
                waited,
            });
        }
        std::thread::sleep(self.pause);
        self.pause = self.pause.saturating_mul(2).min(PAUSE);
        Ok(())
    }
}

const OPEN: &str = "open its lock file";

impl LockFile {
    /// Opens the lock file, made if there is none, and takes the set-up lock. Drop the result's
    /// lock by [`leave`](Self::leave).
    pub(crate) fn enter(name: &Name) -> Result<Self, IpcError> {
        let mut patience = Patience::new();
        loop {
            let file = match Self::open(name, Access::Write)? {
                None => owned::create(name, &name.lock(), OPEN)?,
                there => there,
            };
            // Made by another program between the two.
            let Some(file) = file else {
                patience.pause(name)?;
                continue;
            };
            let opened = Self {
                name: name.clone(),
                file,
            };
            opened.wait_for_set_up(&mut patience)?;
            // It may have been removed between the two: then the next one to come makes another.
            if opened.is_there()? {
                return Ok(opened);
            }
            patience.pause(name)?;
        }
    }

    /// As [`enter`](Self::enter), without making a file or waiting; `None`: there is none, or
    /// another program has the set-up lock.
    fn try_enter(name: &Name) -> Result<Option<Self>, IpcError> {
        let Some(file) = Self::open(name, Access::Write)? else {
            return Ok(None);
        };
        let opened = Self {
            name: name.clone(),
            file,
        };
        let is_entered = opened.try_set_up()? && opened.is_there()?;
        Ok(is_entered.then_some(opened))
    }

    /// Opens the lock file to ask for its locks alone; `None`: there is none.
    pub(crate) fn look(name: &Name) -> Result<Option<Self>, IpcError> {
        let opened = Self::open(name, Access::Read)?;
        Ok(opened.map(|file| Self {
            name: name.clone(),
            file,
        }))
    }

    fn open(name: &Name, access: Access) -> Result<Option<File>, IpcError> {
        owned::open(name, &name.lock(), (Kind::File, access), OPEN)
    }

    /// Whether the file has its name still.
    fn is_there(&self) -> Result<bool, IpcError> {
        let failed = |error: io::Error| IpcError::system(self.name.text(), OPEN, error);
        let own = self.file.metadata().map_err(failed)?;
        match fs::symlink_metadata(self.name.lock()) {
            Ok(there) => Ok((there.ino(), there.dev()) == (own.ino(), own.dev())),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
            Err(error) => Err(failed(error)),
        }
    }

    fn try_set_up(&self) -> Result<bool, IpcError> {
        self.lock(libc::F_WRLCK, SET_UP, "lock it")
    }

    /// Asks again and again: a wait in the kernel has no bound, and the lock may be held by a
    /// program that was stopped.
    fn wait_for_set_up(&self, patience: &mut Patience) -> Result<(), IpcError> {
        while !self.try_set_up()? {
            patience.pause(&self.name)?;
        }
        Ok(())
    }

    /// Takes the set-up lock again.
    pub(crate) fn set_up(&self) -> Result<SetUp<'_>, IpcError> {
        self.wait_for_set_up(&mut Patience::new())?;
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
        self.lock(libc::F_WRLCK, byte_of(role), "lock its role")
    }

    /// Takes the role beside others that share it; `false`: one holds it alone.
    pub(crate) fn share(&self, role: Role) -> Result<bool, IpcError> {
        self.lock(libc::F_RDLCK, byte_of(role), "lock its role")
    }

    /// Takes the lock of a byte; `false`: it is held. Does not wait.
    fn lock(&self, kind: i32, byte: i64, what: &'static str) -> Result<bool, IpcError> {
        let lock = range(kind, byte);
        match fcntl(&self.file, FcntlArg::F_OFD_SETLK(&lock)) {
            Ok(_) => Ok(true),
            Err(nix::Error::EAGAIN | nix::Error::EACCES) => Ok(false),
            Err(error) => Err(IpcError::system(self.name.text(), what, error)),
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
        let _ = fs::remove_file(self.name.memory());
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
/// Channels of other users are left alone, and those that a program opens or closes at this moment.
/// It waits for no program. Not for the real-time path.
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
    let mut removed: usize = 0;
    for entry in fs::read_dir(FOLDER)? {
        let Ok(entry) = entry else { continue };
        let name = entry.file_name();
        let Some(name) = name.to_str().and_then(Name::of_lock) else {
            continue;
        };
        // Another user's cannot be opened.
        if let Ok(Some(lock)) = LockFile::try_enter(&name) {
            removed = removed.saturating_add(usize::from(lock.remove_if_unused()));
            lock.leave();
        }
    }
    Ok(removed)
}
