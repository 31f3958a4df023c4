//! The newest value, for many readers: a mutex and a condition under one name.

use super::{Condvar, LockError, Mutex, MutexGuard, OwnerDied};
use crate::error::{Error, Result};

/// The newest value for many readers: a set-point, a mode, a state estimate. As tokio's `watch`, or
/// a blackboard within a program.
///
/// Each value that is set replaces the one before it. A reader takes the present value at any time
/// ([`get`](Self::get)), or waits for one that it has not seen ([`WatchReader::changed`]); values
/// that came meanwhile it misses. Clones are handles to the same value, for writers and readers
/// alike, on executors and threads. Where each value counts, use a channel; for one reader, a
/// channel with [`Buffer::overwrite_oldest`](crate::Buffer::overwrite_oldest) does the same.
///
/// The value is copied under a [`Mutex`], so no reader sees half of one, and a writer of high
/// priority waits for at most one copy of each reader that was there before. It has no end: when
/// the writers have gone, `changed` waits.
///
/// Real-time path: `set`, `get` and `changed` are O(1) and the size of the value, and O(waiting
/// readers) for a `set` that wakes them; they allocate nothing. Making one allocates.
///
/// ```
/// use luna::prelude::*;
/// use luna::sync::Watch;
///
/// let speed = Watch::new(0.0).named("speed");
/// let mut system = System::new("drive");
/// let main = system.executor("main").build()?;
/// for axis in ["x", "y"] {
///     let mut speeds = speed.reader();
///     main.process(axis).spawn(async move {
///         while speeds.changed().await? < 2.0 {} // each value that it comes to see
///         Ok(())
///     })?;
/// }
/// main.process("planner").spawn(async move {
///     speed.set(1.0).await?;
///     speed.set(2.0).await?;
///     assert_eq!(speed.get().await?, 2.0);
///     Ok(())
/// })?;
/// system.run()?;
/// # Ok::<(), luna::Error>(())
/// ```
#[doc(alias = "blackboard")]
#[derive(Clone)]
pub struct Watch<T> {
    newest: Mutex<Newest<T>>,
    changed: Condvar,
}

struct Newest<T> {
    value: T,
    /// How many were set, this one included.
    number: u64,
}

impl<T: Copy + Send + 'static> Watch<T> {
    /// With its first value. Allocates; not for the real-time path.
    #[track_caller]
    pub fn new(first: T) -> Self {
        let newest = Newest {
            value: first,
            number: 1,
        };
        Self {
            newest: Mutex::new(newest),
            changed: Condvar::new(),
        }
    }

    /// The same with a name, for reports and the scope.
    #[must_use]
    pub fn named(self, name: &str) -> Self {
        Self {
            newest: self.newest.named(name),
            changed: self.changed.named(name),
        }
    }

    /// Sets the newest value, and wakes the readers that wait for one.
    ///
    /// Cancel-safe: a future that is dropped before its end has set nothing, or all.
    ///
    /// # Errors
    ///
    /// [`Error::Poisoned`] if a sibling in a parallel construct has failed.
    pub async fn set(&self, value: T) -> Result<()> {
        self.put(held(self.newest.lock().await)?, value);
        Ok(())
    }

    /// The newest value.
    ///
    /// # Errors
    ///
    /// As [`set`](Self::set).
    pub async fn get(&self) -> Result<T> {
        Ok(held(self.newest.lock().await)?.value)
    }

    /// [`set`](Self::set) from a thread that runs no process: it blocks.
    ///
    /// # Errors
    ///
    /// As [`set`](Self::set).
    pub fn blocking_set(&self, value: T) -> Result<()> {
        self.put(held(self.newest.blocking_lock())?, value);
        Ok(())
    }

    /// [`get`](Self::get) from a thread that runs no process: it blocks.
    ///
    /// # Errors
    ///
    /// As [`set`](Self::set).
    pub fn blocking_get(&self) -> Result<T> {
        Ok(held(self.newest.blocking_lock())?.value)
    }

    /// A reader of its own, which has seen nothing yet.
    pub fn reader(&self) -> WatchReader<T> {
        WatchReader {
            of: self.clone(),
            seen: 0,
        }
    }

    fn put(&self, mut newest: MutexGuard<'_, Newest<T>>, value: T) {
        newest.value = value;
        newest.number += 1;
        self.changed.notify_all();
    }
}

/// The lock was obtained. The value is whole also if its last holder has died: a holder only
/// copies.
fn held<'a, T>(locked: Result<MutexGuard<'a, T>, LockError<'a, T>>) -> Result<MutexGuard<'a, T>> {
    match locked {
        Ok(held) => Ok(held),
        Err(LockError::OwnerDied(died)) => Ok(OwnerDied::recover(died)),
        Err(_) => Err(Error::Poisoned),
    }
}

luna_platform::debug_fields!(impl[T] Watch<T>);

/// One reader of a [`Watch`], which knows what it has seen.
#[derive(Clone)]
pub struct WatchReader<T> {
    of: Watch<T>,
    /// The number of the value that it took last.
    seen: u64,
}

impl<T: Copy + Send + 'static> WatchReader<T> {
    /// Waits until there is a value that this reader has not seen, and takes the newest. The first
    /// time it is there at once.
    ///
    /// Cancel-safe: a future that is dropped before its end has seen nothing.
    ///
    /// # Errors
    ///
    /// [`Error::Poisoned`] if a sibling in a parallel construct has failed.
    pub async fn changed(&mut self) -> Result<T> {
        let newest = held(self.of.newest.lock().await)?;
        let seen = self.seen;
        let is_seen = |newest: &mut Newest<T>| newest.number == seen;
        let newest = held(self.of.changed.wait_while(newest, is_seen).await)?;
        self.seen = newest.number;
        Ok(newest.value)
    }

    /// The newest value, which counts as seen.
    ///
    /// # Errors
    ///
    /// As [`changed`](Self::changed).
    pub async fn get(&mut self) -> Result<T> {
        let newest = held(self.of.newest.lock().await)?;
        self.seen = newest.number;
        Ok(newest.value)
    }
}

luna_platform::debug_fields!(impl[T] WatchReader<T>, |reader| seen: reader.seen);
