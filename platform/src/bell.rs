//! The bell of a thread: what it sleeps in until a deadline, and what others ring to wake it.

use crate::clock::Instant;
use crate::futex::{Futex, Waited};
use crate::path::{self, Call};
use crate::sync::atomic::Ordering;
use std::fmt;
use std::sync::{Arc, OnceLock};

/// What a thread sleeps in besides its bell, once it waits for more than others: for files.
pub trait Watch: Send + Sync + fmt::Debug {
    /// Sleeps until something watched happens, until [`ring`](Self::ring), or until `deadline`. A ring that came first ends it at once.
    fn sleep(&self, deadline: Instant) -> Waited;

    /// Ends the present sleep, or else the next. From any thread.
    fn ring(&self);

    /// The thread is busy and passes by: looks now and then at what is watched, without sleeping.
    fn glance(&self);
}

/// Wakes one thread from its sleep: through a futex, or through a [`Watch`] from the moment when it has one.
///
/// The bell alone loses rings: it is the second half of a protocol whose first half is a word of the thread's own, to which others
/// add what they want of it.
///
/// ```text
///   thread                                            others
///   1 quiet the bell                                  a change the word (read-modify-write)
///   2 say ASLEEP in the word, in one step  <------>   b did the word say ASLEEP? ring
///     that fails if the word was changed
///   3 wait
/// ```
///
/// The steps on the word are read-modify-write operations, 2 releases and a acquires. So either a comes first, and 2 fails; or a reads what 2
/// wrote, and then sees all that the thread did before it: the ring comes after the quieting, and goes to the watch if there is one,
/// because the thread hangs one up only while awake. A ring from an earlier sleep can come at any time, to the futex
/// or to the watch: it ends at worst one sleep early, so whoever waits looks again.
///
/// It lies in its owner, best beside the word: who changes the one then has the other in its cache.
#[derive(Debug)]
pub struct Bell {
    rung: Futex,
    hook: Hook,
}

/// Where the owner of a [`Bell`] hangs up its [`Watch`]. Clones are the same hook.
#[derive(Debug, Clone)]
pub struct Hook(Arc<OnceLock<Arc<dyn Watch>>>);

impl Bell {
    /// A bell that nobody has rung, without a watch.
    #[expect(
        clippy::new_without_default,
        reason = "belongs to one thread: made on purpose, not by default"
    )]
    pub fn new() -> Self {
        Self {
            rung: Futex::new(0),
            hook: Hook(Arc::new(OnceLock::new())),
        }
    }

    /// Where a watch is hung up.
    pub fn hook(&self) -> &Hook {
        &self.hook
    }

    /// Forgets earlier rings: step 1. Owner only.
    #[inline]
    pub fn quiet(&self) {
        self.rung.word().store(0, Ordering::Relaxed);
    }

    /// Sleeps until a ring, or until `deadline`, or without a cause: step 3. Owner only. One system call; with a watch, its own.
    pub fn wait(&self, deadline: Instant) -> Waited {
        match self.hook.0.get() {
            None => path::expected(Call::Sleep, || self.rung.wait(0, deadline)),
            Some(watch) => watch.sleep(deadline),
        }
    }

    /// Ends the wait: step b. From any thread; lock-free, one system call.
    pub fn ring(&self) {
        match self.hook.0.get() {
            None => {
                self.rung.word().store(1, Ordering::Release);
                path::expected(Call::Wake, || self.rung.wake_one());
            }
            Some(watch) => watch.ring(),
        }
    }

    /// Passes by what is watched, if anything is. Owner only; without a watch one load and one branch.
    #[inline]
    pub fn glance(&self) {
        if let Some(watch) = self.hook.0.get() {
            watch.glance();
        }
    }
}

impl Hook {
    /// From now on the thread sleeps in `watch`. Owner only, awake. There is one for good: a second is dropped.
    pub fn hang(&self, watch: Arc<dyn Watch>) {
        // Only the owner sets it, so nobody ever waits here for another.
        let _ = self.0.set(watch);
    }
}
