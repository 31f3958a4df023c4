//! The processes and threads of one system: how many processes live, and whether all threads sleep for good.

use crate::presence::{Look, Sleeper, Stretch, look, watch_all};
use luna_platform::clock::Instant;
use luna_platform::current::Home;
use luna_platform::futex::Futex;
use luna_platform::path::{self, Call};
use std::fmt;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Counts the processes that have not ended, so that one thread can wait for the last; and knows their threads, so that it can see when
/// none of them will ever wake by itself.
pub struct Living {
    count: AtomicUsize,
    ended: Futex,
    /// The threads that live, in the order of their start. A plain lock: threads take it as they start and end, off the path.
    threads: Mutex<Vec<(Home, Arc<dyn Sleeper>)>>,
}

/// All threads of a [`Living`] slept at one instant, without deadlines, files, calls on the pool or wakes under way.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stillness(Vec<(Home, Stretch)>);

impl Living {
    /// Nobody lives yet.
    #[expect(
        clippy::new_without_default,
        reason = "shared on purpose, not by default"
    )]
    pub fn new() -> Self {
        Self {
            count: AtomicUsize::new(0),
            ended: Futex::new(0),
            threads: Mutex::new(Vec::new()),
        }
    }

    /// How many have not ended.
    pub fn count(&self) -> usize {
        self.count.load(Ordering::Acquire)
    }

    /// A number that changes whenever a process ends, [`announce`](Self::announce) is called, or a thread falls still that
    /// [`still`](Self::still) or [`watch`](Self::watch) waits for.
    pub fn changes(&self) -> u32 {
        self.ended.word().load(Ordering::Acquire)
    }

    /// Sleeps until the number is no longer `seen`, or until `deadline`. May return without a cause.
    pub fn wait(&self, seen: u32, deadline: Instant) {
        self.ended.wait(seen, deadline);
    }

    /// Wakes who waits. One system call.
    pub fn announce(&self) {
        self.ended.word().fetch_add(1, Ordering::Release);
        path::expected(Call::Wake, || self.ended.wake_all());
    }

    /// Whether there was an instant during this call at which all threads slept with nothing of their own to wake them: no deadline, no
    /// file that is waited for, no call on the pool under way, and no wake under way from one to another. If not, the number of
    /// [`changes`](Self::changes) changes as soon as it is worth another look.
    ///
    /// Threads that have ended do not count; one that blocks within a poll, as in a blocking receive, counts as busy. What other
    /// threads do meanwhile (plain ones, those of other systems) may end the stillness at any time: [`is_yet`](Self::is_yet).
    /// Not for the real-time path: O(threads), and it allocates.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use luna_executors::{Executor, Living, ProcessSpec};
    /// use luna_platform::{clock::Instant, thread::Attributes};
    /// use std::sync::Arc;
    ///
    /// let living = Arc::new(Living::new());
    /// let executor = Executor::start_counted(Attributes::new("main"), living.clone())?;
    /// let stuck = executor.spawn(ProcessSpec::new("stuck"), || std::future::pending());
    /// executor.release();
    /// let stillness = loop {
    ///     let seen = living.changes();
    ///     if let Some(stillness) = living.still() {
    ///         break stillness;
    ///     }
    ///     living.wait(seen, Instant::NEVER); // until it is worth another look
    /// };
    /// assert!(living.is_yet(&stillness) && living.count() == 1);
    /// stuck.cancel();
    /// stuck.wait();
    /// assert!(!living.is_yet(&stillness));
    /// # Ok(()) }
    /// ```
    pub fn still(&self) -> Option<Stillness> {
        let threads = self.threads();
        match look(&sleepers(&threads)) {
            Look::Still(stretches) => {
                let homes = threads.iter().map(|(home, _)| *home);
                Some(Stillness(homes.zip(stretches).collect()))
            }
            Look::Stirring => None,
            Look::Unclear => {
                drop(threads);
                self.announce();
                None
            }
        }
    }

    /// Whether the threads have slept on since `stillness`, nobody having woken one of them. Not for the real-time path: O(threads).
    pub fn is_yet(&self, stillness: &Stillness) -> bool {
        let threads = self.threads();
        let now = threads.iter().map(|(home, thread)| {
            let stretch = thread.presence().stretch();
            (*home, stretch.filter(|_| !thread.is_woken()))
        });
        now.eq(stillness
            .0
            .iter()
            .map(|&(home, stretch)| (home, Some(stretch))))
    }

    /// From now on each thread's next falling still changes the number of [`changes`](Self::changes), once.
    pub fn watch(&self) {
        watch_all(&sleepers(&self.threads()));
    }

    /// Counts a thread in until the guard is dropped.
    pub(crate) fn enroll(self: &Arc<Self>, home: Home, thread: Arc<dyn Sleeper>) -> Enrolled {
        // Who waits for another look may not know of it yet.
        thread.presence().watch();
        self.threads().push((home, thread));
        Enrolled {
            living: self.clone(),
            home,
        }
    }

    fn threads(&self) -> MutexGuard<'_, Vec<(Home, Arc<dyn Sleeper>)>> {
        self.threads.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn enter(&self) {
        self.count.fetch_add(1, Ordering::AcqRel);
    }

    pub(super) fn leave(&self) {
        self.count.fetch_sub(1, Ordering::AcqRel);
        self.announce();
    }
}

fn sleepers(threads: &[(Home, Arc<dyn Sleeper>)]) -> Vec<&dyn Sleeper> {
    threads.iter().map(|(_, thread)| &**thread).collect()
}

/// A thread that is counted in.
pub(crate) struct Enrolled {
    living: Arc<Living>,
    home: Home,
}

impl Drop for Enrolled {
    fn drop(&mut self) {
        let gone = {
            let mut threads = self.living.threads();
            let place = threads.iter().position(|(home, _)| *home == self.home);
            place.map(|place| threads.remove(place))
        };
        drop(gone);
        // It may have been the only one that stirred.
        self.living.announce();
    }
}

impl fmt::Debug for Living {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Living")
            .field("count", &self.count())
            .finish_non_exhaustive()
    }
}
