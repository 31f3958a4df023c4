//! Locks for processes and threads alike: [`Mutex`], [`Condition`], [`Semaphore`].
//!
//! A channel is the right thing wherever a value goes from one process to another. A lock is right where several look at the same state for a moment, and nobody owns
//! it: a table of parameters, a device's registers. All three work between processes of executors, OS-thread processes, tasks of other runtimes and
//! plain threads. Who waits is served by priority, then by arrival. A process that waits is suspended: its executor goes on.
//!
//! ```
//! use luna_channels::lock_sync::Mutex;
//! # luna_executors::block_on(async {
//! let position = Mutex::new(0.0);
//! {
//!     let mut position = position.lock().await.expect("nobody has died with it");
//!     *position += 1.5;
//! } // unlocked by scope
//! assert_eq!(*position.try_lock().expect("nobody holds it"), 1.5);
//! # }).unwrap();
//! ```

// The protocol.
//
// A mutex is a place (its lock, a list of who waits) and a state under that lock: whether it is held, and by which inheritor. It is handed over directly: unlocking pops the
// first who waits, makes that one the holder under the lock, settles its node, and wakes it after. So it is never free while somebody waits, nobody barges in, and whoever
// was settled holds the mutex whether it knows already or not: a future that is dropped then unlocks.
//
// What can break, and what holds it together:
//
// 1. *Who inherits is who holds.* Under the place's lock: the holder's inheritor is lent the priority of the first who waits, no more and no less. Every change of the list or of
//    the holder ends with that (`relend`).
// 2. *A chain.* The holder may wait for another mutex itself. What each process (or thread) waits for is listed with it, under its home's lock. Whoever changes a loan
//    follows these lists without holding a place's lock (`chain`): it takes the next place's lock, puts the node where its process' priority now belongs, and lends on.
//    What is done there depends on the priority as it is then, so of several that follow the same chain at once the last one leaves it right. A node is listed with its
//    process before its priority is read: a loan that comes earlier is seen, one that comes later finds the node.
// 3. *Order of locks*: a condition's place, a mutex's place, a process' home. A chain is followed from no lock. Homes are left by `next_wait` with a counted
//    reference to the mutex, since its future may go at once.
// 4. *Nobody's memory is touched too late.* A settled node belongs to its future. A mutex whose lock is held by somebody without a handle (a notifier, a chain) is
//    kept by a reference.
// 5. *A condition moves who it notifies* to the list of the mutex (or makes it the holder), and wakes nobody who could not go on. The node knows why it was moved, under the
//    condition's lock: who gives up passes a `notify_one` on. Since it is listed before the mutex is unlocked, no notification is lost; since nothing else
//    moves it, none is made up.
// 6. *Restoring*: what was lent lies in the inheritor in the mutex's state. It goes with the hold, after the next holder was woken: earlier, one of middle priority could run in between.
//
// Bounds. Each section under a place's lock is O(1), or O(those who wait at lower priority) to be listed. A chain is followed over at most `chain::HOLDERS` holders
// and `chain::STEPS` places; each costs O(those who wait there).

mod acquire;
mod chain;
mod condition;
mod core;
mod entry;
mod error;
mod guard;
mod lock;
mod mutex;
mod permit;
mod semaphore;
mod wait;

pub use acquire::{AcquireOp, AcquireTimeout};
pub use condition::Condition;
pub use error::{AcquireError, AcquireTimeoutError, LockError, LockTimeoutError, TryLockError};
pub use guard::{MutexGuard, OwnerDied};
pub use lock::{LockOp, LockTimeout};
pub use mutex::Mutex;
pub use permit::Permit;
pub use semaphore::Semaphore;
pub use wait::{WaitOp, WaitTimeout, WaitTimeoutResult};
