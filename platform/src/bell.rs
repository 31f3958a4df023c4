//! The bell of a thread: the thread sleeps in it until a deadline, and other threads ring it.

use crate::clock::Instant;
use crate::futex::{Futex, Waited};
use crate::path::{self, Call};
use crate::sync::atomic::Ordering;
use core::fmt;
#[cfg(feature = "std")]
use std::sync::{Arc, OnceLock};

/// A source of events besides the bell, for a thread that waits for files too.
pub trait Watch: Send + Sync + fmt::Debug {
    /// Sleeps until a watched event, until [`ring`](Self::ring), or until `deadline`. A ring that
    /// came first ends it at once.
    fn sleep(&self, deadline: Instant) -> Waited;

    /// Ends the present sleep, or else the next. From any thread.
    fn ring(&self);

    /// Polls the watched sources without sleeping. A busy thread calls it now and then.
    fn glance(&self);
}

/// Wakes one thread from its sleep: through a futex, or through a [`Watch`] once it has one.
///
/// The bell alone loses rings: it is the second half of a protocol. The first half is a word of the
/// thread's own, in which others set their requests.
///
/// ```text
///   thread                                            others
///   1 quiet the bell                                  a change the word (read-modify-write)
///   2 say ASLEEP in the word, in one step  <------>   b did the word say ASLEEP? ring
///     that fails if the word was changed
///   3 wait
/// ```
///
/// The steps on the word are read-modify-write operations, 2 releases and a acquires. So either a
/// comes first, and 2 fails; or a reads what 2 wrote, and then sees all that the thread did before
/// it: the ring comes after the quieting, and goes to the watch if there is one, because the thread
/// sets a watch only while awake. A ring for an earlier sleep can come at any time, to the futex or
/// to the watch. At worst it ends one sleep early, so a waiting thread checks its condition again.
///
/// It lies in its owner, best beside the word: a thread that changes the word then has the bell in
/// its cache.
#[derive(Debug)]
pub struct Bell {
    rung: Futex,
    #[cfg(feature = "std")]
    hook: Hook,
}

/// The place of a [`Bell`]'s [`Watch`]. Its owner sets it, while awake: it then sleeps in the
/// watch, for good. Clones refer to the same place. Without `std` there is none.
#[cfg(feature = "std")]
pub type Hook = Arc<OnceLock<Arc<dyn Watch>>>;

impl Bell {
    /// A bell without a ring and without a watch.
    pub fn new() -> Self {
        Self {
            rung: Futex::new(0),
            #[cfg(feature = "std")]
            hook: Hook::default(),
        }
    }

    /// The place of the watch.
    #[cfg(feature = "std")]
    pub fn hook(&self) -> &Hook {
        &self.hook
    }

    /// Forgets earlier rings: step 1. Owner only.
    #[inline]
    pub fn quiet(&self) {
        self.rung.word().store(0, Ordering::Relaxed);
    }

    /// Sleeps until a ring, or until `deadline`, or without a cause: step 3. Owner only. One system
    /// call; with a watch, its own.
    pub fn wait(&self, deadline: Instant) -> Waited {
        #[cfg(feature = "std")]
        if let Some(watch) = self.hook.get() {
            return watch.sleep(deadline);
        }
        path::expected(Call::Sleep, || self.rung.wait(0, deadline))
    }

    /// Ends the wait: step b. From any thread; lock-free, one system call.
    pub fn ring(&self) {
        #[cfg(feature = "std")]
        if let Some(watch) = self.hook.get() {
            return watch.ring();
        }
        self.rung.word().store(1, Ordering::Release);
        path::expected(Call::Wake, || self.rung.wake_one());
    }

    /// Polls the watch, if there is one. Owner only; without a watch one load and one branch.
    #[inline]
    pub fn glance(&self) {
        #[cfg(feature = "std")]
        if let Some(watch) = self.hook.get() {
            watch.glance();
        }
    }
}
