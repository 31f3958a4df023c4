//! One opening of a side of a channel, and its partner.

use crate::error::TypeInfo;
use crate::files::LockFile;
use crate::memory::{Memory, Side, Words};
use crate::name::Name;
use crate::owned::{self, Access, Kind};
use crate::{IpcError, Role};
use luna_machine::file;
use nix::sys::stat::Mode;
use nix::unistd::mkfifo;
use std::fs::{self, File};
use std::io;
use std::os::fd::{FromRawFd, OwnedFd};
use std::os::unix::fs::MetadataExt;
use std::sync::atomic::Ordering::{Acquire, Relaxed, Release, SeqCst};

/// How a side has ended a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum End {
    /// Its local channel is closed, or its link was dropped.
    Closed = 1,
    /// Its local channel is poisoned.
    Poisoned = 2,
}

pub(crate) const OPEN: u32 = 0;

/// One opening of a role. Closed when dropped.
#[derive(Debug)]
pub(crate) struct Session {
    name: Name,
    role: Role,
    lock: LockFile,
    memory: Memory,
    /// The bell of this side.
    bell: File,
}

impl Session {
    /// Opens the role, in a segment of `size` bytes.
    pub(crate) fn open(
        name: Name,
        role: Role,
        info: TypeInfo,
        size: usize,
    ) -> Result<Self, IpcError> {
        let lock = LockFile::enter(&name)?;
        let opened = Self::open_locked(&name, role, &info, &lock, size);
        match opened {
            Ok((memory, bell)) => {
                lock.leave();
                Ok(Self {
                    name,
                    role,
                    lock,
                    memory,
                    bell,
                })
            }
            Err(error) => {
                if !matches!(error, IpcError::Busy { .. }) {
                    lock.give_up(role);
                }
                lock.remove_if_unused();
                lock.leave();
                Err(error)
            }
        }
    }

    /// The set-up lock is held.
    fn open_locked(
        name: &Name,
        role: Role,
        info: &TypeInfo,
        lock: &LockFile,
        size: usize,
    ) -> Result<(Memory, File), IpcError> {
        if !lock.take(role)? {
            return Err(IpcError::Busy {
                name: name.text().to_owned(),
                role,
                pid: Memory::holder(name, role),
            });
        }
        let is_other_here = lock.is_held(role.other())?;
        let memory = if is_other_here {
            Memory::open(name, info, role, size)?
        } else {
            lock.remove_contents();
            Memory::create(name, info, size)?
        };
        let namespace = namespace(name)?;
        let words = memory.words();
        let (own, other) = (words.side(role), words.side(role.other()));
        if is_other_here && other.namespace.load(Relaxed) != namespace {
            return Err(IpcError::Namespace {
                name: name.text().to_owned(),
                pid: other.pid.load(Relaxed),
            });
        }
        let bell = make_bell(name, role)?;
        own.bound.store(0, SeqCst);
        own.pid.store(std::process::id(), Relaxed);
        own.namespace.store(namespace, Relaxed);
        own.asleep.store(0, Relaxed);
        own.end.store(OPEN, Relaxed);
        own.thread.store(0, Relaxed);
        own.raised.store(0, Relaxed);
        let epoch = own.epoch.fetch_add(1, SeqCst).wrapping_add(1);
        if is_other_here {
            if other.bound.load(SeqCst) == 0 && other.end.load(SeqCst) == OPEN {
                words.start.store(words.published(), SeqCst);
                own.bound.store(other.epoch.load(SeqCst), SeqCst);
                other.bound.store(epoch, SeqCst);
            }
            // Also one that is bound to a session that is over: it is to look.
            if let Ok(Some(bell)) = open_bell(name, role.other()) {
                ring(other, &bell, true);
            }
        }
        Ok((memory, bell))
    }

    pub(crate) fn name(&self) -> &str {
        self.name.text()
    }

    /// Names the bound session in events: the same in both programs, and hardly ever that of
    /// another session.
    pub(crate) fn key(&self) -> u64 {
        // FNV-1a, over what no other session has at this time.
        let mix = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3);
        let hash = self.name().bytes().fold(0xcbf2_9ce4_8422_2325, mix);
        [Role::Sender, Role::Receiver]
            .into_iter()
            .map(|role| self.words().side(role))
            .flat_map(|side| [side.epoch.load(SeqCst), side.pid.load(Relaxed).into()])
            .flat_map(u64::to_ne_bytes)
            .fold(hash, mix)
    }

    pub(crate) fn memory(&self) -> &Memory {
        &self.memory
    }

    pub(crate) fn words(&self) -> &Words {
        self.memory.words()
    }

    pub(crate) fn own(&self) -> &Side {
        self.words().side(self.role)
    }

    pub(crate) fn bell(&self) -> &File {
        &self.bell
    }

    pub(crate) fn other(&self) -> &Side {
        self.words().side(self.role.other())
    }

    /// Whether the session has a partner.
    pub(crate) fn is_bound(&self) -> bool {
        self.own().bound.load(SeqCst) != 0
    }

    /// The partner of a bound session, if it lives.
    pub(crate) fn partner(&self) -> Result<Partner, IpcError> {
        let role = self.role.other();
        let side = self.words().side(role);
        let epoch = self.own().bound.load(SeqCst);
        let pid = side.pid.load(Relaxed);
        let died = || IpcError::PartnerDied {
            name: self.name().to_owned(),
            role,
            pid,
            acknowledged: 0,
        };
        let process = match open_process(pid) {
            Ok(process) => process,
            Err(error) if error.raw_os_error() == Some(libc::ESRCH) => return Err(died()),
            Err(error) => {
                return Err(IpcError::system(
                    self.name(),
                    "watch the other process",
                    error,
                ));
            }
        };
        let Some(bell) = open_bell(&self.name, role)? else {
            return Err(died());
        };
        // It lives after its process was opened: so the number was its own, not a later process'.
        if !self.lock.is_held(role)? || side.epoch.load(SeqCst) != epoch {
            return Err(died());
        }
        Ok(Partner {
            role,
            pid,
            start: self.words().start.load(Acquire),
            bell,
            process,
        })
    }

    /// The end of the partner's side, if it has ended the session.
    pub(crate) fn partners_end(&self) -> Option<End> {
        match self.other().end.load(Acquire) {
            OPEN => None,
            end if end == End::Poisoned as u32 => Some(End::Poisoned),
            _ => Some(End::Closed),
        }
    }

    /// Ends this side of the session. The first end counts.
    pub(crate) fn end(&self, end: End) {
        let own = self.own();
        let _ = own.end.compare_exchange(OPEN, end as u32, Release, Relaxed);
    }

    /// Wakes the partner if it sleeps, after a word of this side was changed.
    pub(crate) fn ring(&self, partner: &Partner) {
        ring(self.words().side(partner.role), &partner.bell, false);
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.end(End::Closed);
        let other = self.role.other();
        // Without the lock the files cannot be removed, nor the role be given up in order: it ends
        // with the file.
        let Ok(set_up) = self.lock.set_up() else {
            return;
        };
        if self.lock.is_held(other).unwrap_or(false)
            && let Ok(Some(bell)) = open_bell(&self.name, other)
        {
            ring(self.words().side(other), &bell, false);
        }
        self.lock.give_up(self.role);
        set_up.remove_if_unused();
    }
}

/// The other side of a session.
#[derive(Debug)]
pub(crate) struct Partner {
    role: Role,
    pub(crate) pid: u32,
    /// Number of the last value before this session.
    pub(crate) start: u64,
    bell: File,
    /// Readable when the process has ended.
    pub(crate) process: OwnedFd,
}

impl Partner {
    pub(crate) fn role(&self) -> Role {
        self.role
    }
}

/// Writes to the bell of `side` if it is asleep, or if it `must`.
fn ring(side: &Side, bell: &File, must: bool) {
    // A read-modify-write, so it is ordered with the change before it, and with the sleeper's store
    // and second look.
    let was_asleep = side.asleep.swap(0, SeqCst) != 0;
    if was_asleep || must {
        // A full FIFO is readable, which is all that is wanted.
        let _ = file::write(bell, &[1]);
    }
}

const MAKE_BELL: &str = "make its bell";

fn make_bell(name: &Name, role: Role) -> Result<File, IpcError> {
    let path = name.bell(role);
    let failed = |error| owned::refused(name, &path, Kind::Fifo, MAKE_BELL, error);
    match fs::remove_file(&path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(failed(error)),
        _ => {}
    }
    mkfifo(&path, Mode::S_IRUSR | Mode::S_IWUSR).map_err(|error| failed(error.into()))?;
    open_bell(name, role)?.ok_or_else(|| failed(io::ErrorKind::NotFound.into()))
}

/// For both directions: so it has a reader and a writer as long as it is open here, and neither
/// side's end shows in it. `None`: there is none.
fn open_bell(name: &Name, role: Role) -> Result<Option<File>, IpcError> {
    let as_bell = (Kind::Fifo, Access::Write);
    owned::open(name, &name.bell(role), as_bell, "open a bell")
}

/// This process' namespace of process numbers.
pub(crate) fn namespace(name: &Name) -> Result<u64, IpcError> {
    let found = fs::metadata("/proc/self/ns/pid");
    let found =
        found.map_err(|error| IpcError::system(name.text(), "find its PID namespace", error))?;
    Ok(found.ino())
}

pub(crate) fn open_process(pid: u32) -> io::Result<OwnedFd> {
    // SAFETY: takes two integers; no memory is passed.
    let opened = unsafe { libc::syscall(libc::SYS_pidfd_open, pid as libc::pid_t, 0) };
    if opened < 0 {
        return Err(io::Error::last_os_error());
    }
    // SAFETY: the kernel has just made it for this call, and no one else owns it.
    Ok(unsafe { OwnedFd::from_raw_fd(opened as i32) })
}
