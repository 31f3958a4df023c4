//! The channels of LUNA: processes communicate over them, and nothing else.
//!
//! A *channel* made by [`channel`] is a rendezvous: a send ends when a receiver has taken the
//! value. One made by [`buffered`] holds some values in between. Both have the same two ends,
//! [`Sender`] and [`Receiver`], which can be cloned and used from any thread: any number of
//! processes may send, any number receive, and the most urgent waiter is served first.
//!
//! ```
//! # use futures_lite::future::{block_on, zip};
//! let (numbers, printer) = luna_channels::channel::<u32>();
//! let send = async move {
//!     for n in 0..3 {
//!         numbers.send(n).await?; // returns once the value was taken
//!     }
//!     Ok::<_, luna_channels::SendError<u32>>(()) // dropping the last sender closes the channel
//! };
//! let print = async move {
//!     let mut sum = 0;
//!     while let Ok(n) = printer.recv().await {
//!         sum += n;
//!     }
//!     sum
//! };
//! assert_eq!(block_on(zip(send, print)), (Ok(()), 3));
//! ```
//!
//! An operation allocates nothing, and holds a priority-inheriting lock for a bounded number of
//! steps. It waits for another thread only while that holds such a lock. What was communicated is
//! never lost or doubled: a future that is dropped takes its offer back, and a value that it was
//! already given goes to the next receiver.
//!
//! The crate works under any executor: LUNA's, where waiting lists are ordered by priority and
//! waking costs no atomic reference counts, and tokio, smol, or plain threads, where wakers do the
//! waking.

#![cfg_attr(
    not(feature = "std"),
    no_std,
    allow(
        rustdoc::broken_intra_doc_links,
        reason = "the pages speak of what `std` has"
    )
)]

// loom and shuttle check the same models: shuttle has loom's names.
#[cfg(all(test, shuttle))]
extern crate shuttle as loom;

extern crate alloc;

#[cfg(all(test, not(feature = "std")))]
compile_error!("the unit tests need `std`: tests without it are in the package `luna-bare`");

mod alternative;
mod barrier;
mod buffer;
mod call;
mod core;
mod end;
mod ended;
mod error;
mod extended;
mod finally;
mod guarded_wait_point;
mod in_place;
pub mod inspect;
pub mod lock_sync;
mod operation;
mod receiver;
mod replay;
mod select_state;
mod sender;
#[cfg(feature = "sink")]
mod sink;
mod source;
mod stamp;
mod stream;
mod wait_point;
mod waiter;

#[cfg(all(test, loom))]
mod loom_tests;

#[doc(hidden)]
pub use alternative::Due;
pub use alternative::{After, Alternative, AlternativeRecv, Guard, When, after, at};
pub use barrier::{Barrier, Party, SyncOp};
pub use buffer::Buffer;
pub use call::{AcceptOp, Call, CallError, CallOp, Client, Reply, Server, call_channel};
pub use ended::{ChannelEnd, Ended};
pub use error::{
    BufferError, RecvError, RecvTimeoutError, SendError, SendTimeoutError, TryRecvError,
    TrySendError,
};
pub use extended::{Extended, Held};
pub use operation::{
    Direction, GivesUp, Operation, Receiving, RecvOp, RecvTimeout, SendOp, SendTimeout, Sending,
    Timed,
};
pub use receiver::Receiver;
pub use sender::Sender;
#[doc(hidden)]
pub use stamp::Stamp;
pub use stream::Incoming;

#[doc(hidden)]
pub mod __private {
    //! What the macros name.
    pub use crate::alternative::{
        Choice, Either, Never, Offer, Place, Seed, choose, guard, no_guard,
    };
}

use crate::inspect::{BufferCode, Identity, WaitPointKind};
use ::core::task::Context;
use luna_core::current::{self, QueueEnd};

/// Makes a rendezvous channel: a send ends when a receiver has taken the value. Allocates the
/// channel; not for the real-time path.
///
/// ```
/// let (sender, receiver) = luna_channels::channel();
/// let thread = std::thread::spawn(move || receiver.blocking_recv());
/// sender.blocking_send(1)?;
/// assert_eq!(thread.join().unwrap(), Ok(1));
/// # Ok::<(), luna_channels::SendError<i32>>(())
/// ```
#[track_caller]
pub fn channel<T: Send>() -> (Sender<T>, Receiver<T>) {
    ends(Buffer::RENDEZVOUS)
}

/// Makes a channel with a buffer, which is allocated here; not for the real-time path.
///
/// # Panics
///
/// If the buffer's capacity is 0; [`try_buffered`] returns an error instead. A channel without a
/// buffer is made by [`channel`].
///
/// ```
/// let (sender, receiver) = luna_channels::buffered(luna_channels::Buffer::fifo(2));
/// sender.try_send(1)?;
/// sender.try_send(2)?;
/// assert!(sender.try_send(3).unwrap_err().is_full());
/// assert_eq!(receiver.try_recv(), Ok(1));
/// # Ok::<(), luna_channels::TrySendError<i32>>(())
/// ```
#[track_caller]
pub fn buffered<T: Send>(buffer: Buffer) -> (Sender<T>, Receiver<T>) {
    match try_buffered(buffer) {
        Ok(ends) => ends,
        Err(error) => panic!("{error}"),
    }
}

/// Like [`buffered`], for a capacity that comes from outside.
///
/// # Errors
///
/// [`BufferError::ZeroCapacity`].
///
/// ```
/// use luna_channels::{Buffer, BufferError, try_buffered};
/// assert_eq!(try_buffered::<u8>(Buffer::fifo(0)).unwrap_err(), BufferError::ZeroCapacity);
/// ```
#[track_caller]
pub fn try_buffered<T: Send>(buffer: Buffer) -> Result<(Sender<T>, Receiver<T>), BufferError> {
    let buffer = buffer.validate()?;
    Ok(ends(buffer))
}

#[track_caller]
fn ends<T: Send>(buffer: Buffer) -> (Sender<T>, Receiver<T>) {
    let kind = match buffer.capacity {
        0 => WaitPointKind::Rendezvous,
        capacity => WaitPointKind::Buffered(capacity),
    };
    let channel =
        core::Channel::allocate(buffer, Identity::of_channel(kind, BufferCode::of(buffer)));
    // SAFETY: a new channel counts one end of each kind.
    unsafe { (Sender::new(channel), Receiver::new(channel)) }
}

/// As [`yield_after_operation`], of an operation that may be replayed: its process may be held
/// then.
#[inline]
fn completes_later(cx: &mut Context<'_>) -> bool {
    if current::is_outranked() {
        current::ready_again(cx, QueueEnd::Front);
        true
    } else if current::spend_operation() {
        false
    } else {
        completes_later_after_many(cx)
    }
}

#[cold]
fn completes_later_after_many(cx: &mut Context<'_>) -> bool {
    if replay::is_replayed() {
        return replay::is_held_after(cx);
    }
    current::ready_again(cx, QueueEnd::Back);
    true
}

/// As [`yield_after_operation`], of an operation that fails without having waited: a loop over
/// errors must not keep other processes from running either. A replayed one fails when the recorded
/// one did.
#[cold]
fn fails_later(cx: &Context<'_>) -> bool {
    !replay::is_replayed() && yield_after_operation(cx)
}

/// Whether an operation that has just completed lets others run before its process continues: more
/// urgent ones, since a communication is a scheduling point; or all, when the process has completed
/// too many operations in one turn. The process is then queued again already.
#[inline]
fn yield_after_operation(cx: &Context<'_>) -> bool {
    if current::is_outranked() {
        current::ready_again(cx, QueueEnd::Front);
        true
    } else if current::count_operation() {
        false
    } else {
        current::ready_again(cx, QueueEnd::Back);
        true
    }
}
