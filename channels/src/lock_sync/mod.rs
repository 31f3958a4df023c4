//! Locks for processes and threads alike: [`Mutex`], [`Condvar`], [`Semaphore`].
//!
//! A channel is the right construct wherever a value goes from one process to another. A lock is
//! right where several processes look at the same state for a moment, and none owns it: a table of
//! parameters, a device's registers. All three work between processes of executors, OS-thread
//! processes, tasks of other runtimes and plain threads. Waiters are served by priority, then by
//! arrival. A process that waits is suspended: its executor goes on.
//!
//! ```
//! use luna_channels::lock_sync::Mutex;
//! # luna_core::block_on(async {
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
// A mutex is a wait point (its lock, a list of waiters) and a state under that lock: how many
// permits are free, which is one or none, and the holder's inheritor. A semaphore is the same with
// any number of permits, and without a holder (`Core`). A mutex is handed over directly: unlocking
// pops the first waiter, makes it the holder under the lock, settles its node, and wakes it after.
// So the mutex is never free while there is a waiter, and no process barges in. A settled waiter
// holds the mutex even if it has not seen so yet: if its future is dropped then, it unlocks.
//
// All futures here are a `Take` of permits. Locking and acquiring wrap one. Waiting at a condition
// unlocks, lists the entry of its take at the condition, and goes on with the take when a notifier
// has moved that entry to the mutex.
//
// What can break, and what holds it together:
//
// 1. *The holder inherits.* Under the wait point's lock: the holder's inheritor is boosted to the
//    priority of the first waiter, no more and no less. Every change of the list or of the holder
//    ends with that (`boost_holder`).
// 2. *A chain.* The holder may wait for another mutex itself. The waits of each process (or thread)
//    are listed with it, under the lock of its executor's boosts. A thread that changes a boost
//    follows these lists without holding a wait point's lock (`follow`): it takes the next wait
//    point's lock, moves the node to where its process' priority now belongs, and boosts the next
//    holder. Each step uses the priority as it is then, so of several threads that follow the same
//    chain at once the last one leaves it right. A node is listed with its process before its
//    priority is read: a boost that comes earlier is seen, one that comes later finds the node.
// 3. *Order of locks*: a condition's wait point, a mutex's wait point, a process' executor. A chain
//    is followed from no lock. `next_wait` leaves the lock of an executor's boosts with a counted
//    reference to the mutex, since its future may go at once.
// 4. *Memory is never touched too late.* A settled node belongs to its future. A thread without a
//    handle (a notifier, a chain) that locks a mutex keeps it by a reference.
// 5. *A condition moves a notified waiter* to the list of the mutex (or makes it the holder), and
//    wakes no process that could not go on. The node stores why it was moved, under the condition's
//    lock: a waiter that gives up passes a `notify_one` on. Since it is listed before the mutex is
//    unlocked, no notification is lost; since nothing else moves it, none is made up.
// 6. *Restoring*: the boost lies in the inheritor in the mutex's state. It ends with the hold,
//    after the next holder was woken: earlier, a process of middle priority could run in between.
//
// Bounds. Each critical section under a wait point's lock is O(1), or O(waiters of lower priority)
// to be listed. A chain is followed over at most `entry::HOLDERS` holders and `entry::STEPS` wait
// points; each costs O(its waiters).

mod condition;
mod core;
mod entry;
mod guard;
mod mutex;
mod semaphore;
mod take;
mod taking;
mod wait;

pub use condition::Condvar;
pub use guard::{
    AcquireError, AcquireTimeoutError, LockError, LockTimeoutError, MutexGuard, OwnerDied,
    TryLockError,
};
pub use mutex::Mutex;
pub use semaphore::{Semaphore, SemaphorePermit};
pub use taking::{AcquireOp, AcquireTimeout, LockOp, LockTimeout, Permits, TakeOp, TakeTimeout};
pub use wait::{WaitOp, WaitTimeout, WaitTimeoutResult};
