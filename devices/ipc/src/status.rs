//! What a link has done.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering::Relaxed};

/// What a link has done in its session. It can be read at any time, by any thread, also after the
/// link's end.
///
/// ```
/// let name = format!("doc/{}/status", std::process::id());
/// let (sender, link) = luna_ipc::sender::<u32>(&name)?;
/// let status = link.status();
/// assert!(!status.has_joined());
/// assert_eq!((status.acknowledged(), status.missing()), (0, 0));
/// # drop(sender);
/// # Ok::<(), luna_ipc::IpcError>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct Status(Arc<Counts>);

#[derive(Debug, Default)]
struct Counts {
    locked: AtomicBool,
    joined: AtomicBool,
    pid: AtomicU32,
    number: AtomicU64,
    acknowledged: AtomicU64,
    missing: AtomicU64,
    refused_priorities: AtomicU64,
}

impl Status {
    pub(crate) fn opened(&self, is_locked: bool) {
        self.0.locked.store(is_locked, Relaxed);
    }

    pub(crate) fn joined(&self, pid: u32, start: u64, missing: u64) {
        self.0.pid.store(pid, Relaxed);
        self.0.number.store(start, Relaxed);
        self.0.missing.store(missing, Relaxed);
        self.0.joined.store(true, Relaxed);
    }

    pub(crate) fn acknowledge(&self, number: u64) {
        self.0.number.store(number, Relaxed);
        self.0.acknowledged.fetch_add(1, Relaxed);
    }

    pub(crate) fn refuse_priority(&self) {
        self.0.refused_priorities.fetch_add(1, Relaxed);
    }

    /// Calls whose server did not inherit the caller's priority, since the system refused it: see
    /// RLIMIT_RTPRIO and CAP_SYS_NICE, of both programs.
    pub fn refused_priorities(&self) -> u64 {
        self.0.refused_priorities.load(Relaxed)
    }

    /// Whether the channel's shared memory was locked as it was opened, so that it is never swapped
    /// out. If not, RLIMIT_MEMLOCK is too low for it; it is in memory all the same, and stays where
    /// the computer does not swap, or where [`lock_memory`](luna::System::lock_memory) locks all.
    pub fn is_locked(&self) -> bool {
        self.0.locked.load(Relaxed)
    }

    /// Whether the other program has joined the session.
    pub fn has_joined(&self) -> bool {
        self.0.joined.load(Relaxed)
    }

    /// The other program's process, once it has joined.
    pub fn partner(&self) -> Option<u32> {
        self.has_joined().then(|| self.0.pid.load(Relaxed))
    }

    /// The number of the last value that was acknowledged: the same in both programs. The numbers
    /// go on from session to session as long as either program has the channel open. 0 before the
    /// first.
    pub fn number(&self) -> u64 {
        self.0.number.load(Relaxed)
    }

    /// Values of this session that were acknowledged: taken by a process of the receiving program.
    pub fn acknowledged(&self) -> u64 {
        self.0.acknowledged.load(Relaxed)
    }

    /// Values that were sent in earlier sessions, after the last one that was acknowledged: their
    /// sends have failed, or their sender was killed. Each was taken once or not at all, and none
    /// comes any more.
    pub fn missing(&self) -> u64 {
        self.0.missing.load(Relaxed)
    }
}
