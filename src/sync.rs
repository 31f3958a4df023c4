//! Synchronization without values: barriers, and locks for processes and threads alike
//! ([`Mutex`], [`Condvar`], [`Semaphore`]); and a newest value for many readers ([`Watch`]).
//!
//! A channel is the right construct wherever a value goes from one process to another. A lock is
//! right where several processes look at the same state for a moment, and none owns it: a table of
//! parameters, a device's registers. Locks work between processes of executors, OS-thread
//! processes, tasks of other runtimes and plain threads. Waiters are served by priority, then by
//! arrival. A process that waits is suspended: its executor goes on.
//!
//! ```
//! use luna::sync::Mutex;
//!
//! luna::run(async {
//!     let position = Mutex::new(0.0);
//!     {
//!         let mut position = position.lock().await?;
//!         *position += 1.5;
//!     } // unlocked by scope
//!     assert_eq!(*position.try_lock()?, 1.5);
//!     Ok(())
//! })?;
//! # Ok::<(), luna::Error>(())
//! ```

mod watch;

pub use luna_channels::lock_sync::{
    AcquireError, AcquireOp, AcquireTimeout, AcquireTimeoutError, Condvar, LockError, LockOp,
    LockTimeout, LockTimeoutError, Mutex, MutexGuard, OwnerDied, Semaphore, SemaphorePermit,
    TryLockError, WaitOp, WaitTimeout, WaitTimeoutResult,
};
pub use luna_channels::{Barrier, Party, SyncOp};
pub use watch::{Watch, WatchReader};

#[doc(hidden)]
#[deprecated(since = "0.1.0", note = "`Barrier::local` returns a `luna::Barrier`")]
pub type LocalBarrier = Barrier;
#[doc(hidden)]
#[deprecated(since = "0.1.0", note = "use `luna::sync::SyncOp`")]
pub type LocalSync<'a> = SyncOp<'a>;
