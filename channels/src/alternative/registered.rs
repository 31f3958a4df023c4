//! An alternative over any number of channels that stays registered between its selections.
//!
//! Each channel keeps a node of the alternative in its list of *registered* nodes. While the
//! alternative waits, its select state is open. A sender that comes commits it through the node and
//! hands its value over, as to any receiver. While it does not wait, a commit fails and the node
//! stays. The operation that makes the channel ready (a sender that lists itself, a value in the
//! buffer, the channel's end) pushes the node onto the alternative's stack of ready channels, under
//! the channel's lock, once until the alternative has looked. So a selection costs nothing for
//! channels without activity.
//!
//! ```text
//!   sender, under the lock:  can it commit? no: list itself, push the node under the commit
//!                            lock, release; if it was open: close it, ready its owner
//!   owner:                   drain the stack; choose; nothing to choose: open the select state
//!                            under the commit lock, if the stack is still empty
//! ```
//!
//! Both steps hold the commit lock of the select state, so one of the two sees the other. It is a
//! biased lock: if the senders and the owner are processes of one executor, no step takes a
//! read-modify-write. It is held for O(1) steps.

mod entry;
mod fast_path;
mod recv;

use alloc::boxed::Box;
use alloc::vec::Vec;
pub(crate) use entry::Entry;
use entry::{Hub, OwnEntry};
pub use recv::AlternativeRecv;

use super::ready_set::ReadySet;
use crate::error::RecvError;
use crate::inspect;
use crate::receiver::Receiver;
use crate::replay;
use crate::select_state::SelectState;
use crate::waiter::{Outcome, Waiter};
use core::marker::PhantomData;
use core::ptr::{self, NonNull};
use core::task::{Context, Poll, RawWakerVTable};
use luna_platform::sync::atomic::{AtomicPtr, Ordering};

/// Receives from any number of channels, whichever is ready: fair, or by priority.
///
/// `alt!` is for a few different guards, this is for many channels of one type: it stays registered
/// with all of them between its selections, so that [`recv`](Self::recv) costs the same for two
/// channels and for two thousand. Channels can be [added](Self::add) and [removed](Self::remove)
/// while it lives.
///
/// A channel that has ended (closed and empty; or poisoned) reports that once, and is left out from
/// then on: the choice among the others is as before, by priority too. When all have ended there is
/// nothing left to wait for, and each selection returns the error of one of them: by priority of
/// the first, fairly in turn. So a server that counts the ends, or stops at the first, needs no
/// [`remove`](Self::remove).
///
/// ```
/// use luna_channels::{Alternative, channel};
/// # luna_core::block_on(async {
/// let (senders, receivers): (Vec<_>, Vec<_>) = (0..100).map(|_| channel::<u32>()).unzip();
/// let thread = std::thread::spawn(move || senders[42].blocking_send(7));
/// let mut inputs = Alternative::fair(&receivers);
/// assert_eq!(inputs.recv().await, (42, Ok(7)));
/// # thread.join().unwrap().unwrap();
/// # }).unwrap();
/// ```
pub struct Alternative<'a, T> {
    entries: Vec<Option<OwnEntry<'a, T>>>,
    hub: NonNull<Hub<T>>,
    ready: ReadySet,
    is_fair: bool,
    /// How many channels there are.
    count: usize,
    /// Number of entries that have reported their end. Once all have, all are ready.
    ended: usize,
    /// Number of entries that are listed in their channels: a prefix, since listing happens in the
    /// first `recv`.
    listed: usize,
    state: State,
    polled_by: (*const (), *const RawWakerVTable),
    _receivers: PhantomData<&'a Receiver<T>>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// The select state cannot be committed.
    Closed,
    /// It was opened: look whether it was committed.
    Open,
    /// This entry holds a value that was received and not handed on yet.
    Holds(usize),
    /// The error of this entry's channel was not handed on yet.
    Fails(usize, RecvError),
    /// As `Closed`, and a receive is under way that has come to nothing yet.
    Begun,
}

// SAFETY: what partners reach is guarded by the channels' locks, or passed on by the select state;
// values pass between threads anyway.
unsafe impl<T: Send> Send for Alternative<'_, T> {}
// SAFETY: `&Alternative` gives access to nothing.
unsafe impl<T: Send> Sync for Alternative<'_, T> {}

impl<'a, T> Alternative<'a, T> {
    /// Over `inputs`: chooses the least recently chosen of the ready channels. Allocates; not for
    /// the real-time path. O(n).
    pub fn fair(inputs: &'a [Receiver<T>]) -> Self {
        Self::new(inputs, true)
    }

    /// Over `inputs`: chooses the first ready channel in this order. Allocates; not for the
    /// real-time path. O(n).
    pub fn prioritized(inputs: &'a [Receiver<T>]) -> Self {
        Self::new(inputs, false)
    }

    fn new(inputs: &'a [Receiver<T>], is_fair: bool) -> Self {
        let hub = Box::new(Hub {
            select_state: SelectState::new(),
            stack: AtomicPtr::new(ptr::null_mut()),
        });
        let mut alternative = Self {
            entries: Vec::with_capacity(inputs.len()),
            hub: NonNull::from(Box::leak(hub)),
            ready: ReadySet::new(),
            is_fair,
            count: 0,
            ended: 0,
            listed: 0,
            state: State::Closed,
            polled_by: (ptr::null(), ptr::null()),
            _receivers: PhantomData,
        };
        for input in inputs {
            alternative.add(input);
        }
        alternative
    }

    /// Adds a channel, behind all others in order of preference, and returns its index, perhaps the
    /// index of a removed channel. Allocates; not for the real-time path.
    ///
    /// ```
    /// use luna_channels::{Alternative, Buffer, buffered};
    /// # luna_core::block_on(async {
    /// let (sender, receiver) = buffered(Buffer::fifo(1));
    /// let mut inputs = Alternative::fair(&[]);
    /// let index = inputs.add(&receiver);
    /// sender.send(1).await.unwrap();
    /// assert_eq!(inputs.recv().await, (index, Ok(1)));
    /// assert!(inputs.remove(index) && !inputs.remove(index));
    /// # }).unwrap();
    /// ```
    pub fn add(&mut self, input: &'a Receiver<T>) -> usize {
        // A `recv` that was forgotten may have left it open: it is to look at the new channel too.
        let closed = match self.state {
            State::Open => self.hub().select_state.close(),
            _ => None,
        };
        if closed.is_some() {
            self.state = State::Closed;
        }
        let index = match self.entries.iter().position(Option::is_none) {
            Some(free) => free,
            None => {
                self.entries.push(None);
                self.entries.len() - 1
            }
        };
        if self.all_ended() {
            // They have reported their end, and now there is one to wait for.
            self.ready.clear_all();
        }
        self.count += 1;
        // SAFETY: the hub lives as long as this alternative, which alone has the entry.
        let entry = unsafe { OwnEntry::new(self.hub, input.channel(), index as u32) };
        self.entries[index] = Some(entry);
        self.ready.add(index);
        if index < self.listed {
            self.list(index);
        }
        index
    }

    /// Removes a channel; returns whether it was there. A value that was received from it and not
    /// handed on goes back to its head. Frees; not for the real-time path. O(n).
    pub fn remove(&mut self, index: usize) -> bool {
        let Some(entry) = self.entries.get_mut(index).and_then(Option::take) else {
            return false;
        };
        let (channel, has_ended) = (entry.channel(), entry.ended().is_some());
        if index < self.listed && !has_ended {
            // SAFETY: it is listed.
            unsafe { channel.unregister(entry.pointer()) };
        }
        // No thread pushes it from here on. All entries pushed before are known now, and this one
        // is not on the stack.
        self.drain();
        self.ready.clear(index);
        let had_all_ended = self.all_ended();
        self.count -= 1;
        self.ended -= usize::from(has_ended);
        if !had_all_ended {
            self.ready_if_all_ended();
        }
        if matches!(self.state, State::Fails(failed, _) if failed == index) {
            self.state = State::Closed;
        }
        let held = (self.holds() == Some(index)).then(|| {
            self.state = State::Closed;
            // SAFETY: the select state was chosen through it, and this is the owner.
            unsafe { Self::settled(entry) }
        });
        // SAFETY: it is listed nowhere, and was taken out of the entries.
        unsafe { entry.free() };
        if let Some(Ok(value)) = held {
            channel.return_value(value);
        }
        true
    }

    /// Number of channels, ended ones included.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether there is none: then `recv` waits for ever.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Waits until a channel is ready, and receives from it. Returns the channel's index, and its
    /// value or its end. Each channel reports its end once. When all have ended, every call reports
    /// an end.
    ///
    /// In a branch of a parallel construct, after a sibling has failed, it fails as poisoned
    /// instead of waiting; over no channels the branch ends there.
    ///
    /// It is not itself a guard: a server that also waits for a tick or a stop receives them over
    /// one of its input channels. Cancel-safe: a value that was received and not handed on is the
    /// result of the next call. Real-time path: yes, but for the first call, which registers with
    /// all channels, at the priority of the process that makes it: O(n). After that O(log r) a
    /// selection among r ready channels, and as much for each channel that has become ready or was
    /// emptied by other receivers since. A selection that reports a channel's end is O(n).
    ///
    /// ```
    /// use luna_channels::{Alternative, Buffer, buffered};
    /// # luna_core::block_on(async {
    /// let (left, from_left) = buffered(Buffer::fifo(2));
    /// let (right, from_right) = buffered(Buffer::fifo(2));
    /// left.send(1).await.unwrap();
    /// right.send(10).await.unwrap();
    /// right.send(20).await.unwrap();
    /// drop((left, right));
    /// let inputs = [from_left, from_right];
    /// let mut merged = Alternative::prioritized(&inputs);
    /// let (mut sum, mut open) = (0, inputs.len());
    /// while open > 0 {
    ///     match merged.recv().await.1 {
    ///         Ok(n) => sum += n,
    ///         Err(_) => open -= 1, // it is left out from now on
    ///     }
    /// }
    /// assert_eq!(sum, 31);
    /// # }).unwrap();
    /// ```
    pub fn recv(&mut self) -> AlternativeRecv<'_, 'a, T> {
        AlternativeRecv { alternative: self }
    }

    fn hub(&self) -> &Hub<T> {
        // SAFETY: it lives as long as this alternative.
        unsafe { self.hub.as_ref() }
    }

    /// The entry that holds a value, if one does.
    fn holds(&mut self) -> Option<usize> {
        if self.state == State::Open {
            self.state = match self.hub().select_state.chosen() {
                Some(index) => State::Holds(index as usize),
                None => return None,
            };
        }
        match self.state {
            State::Holds(index) => Some(index),
            _ => None,
        }
    }

    /// Registers with a channel.
    fn list(&mut self, index: usize) {
        if let Some(entry) = self.entries[index]
            && entry.ended().is_none()
        {
            let channel = entry.channel();
            if replay::is_on() {
                channel.note_alternative();
            }
            // SAFETY: the entry is for this channel and in no list: this is called once for each,
            // before it has ended. It stays in its box until it is unregistered.
            let is_ready = unsafe { channel.register(entry.pointer()) };
            if is_ready {
                self.ready.set(index);
            }
        }
    }

    /// Takes all entries that have become ready off the stack. O(their number). Returns whether
    /// there were any.
    fn drain(&mut self) -> bool {
        let hub = self.hub();
        if !hub.has_news() {
            return false;
        }
        let commit_lock = hub.select_state.commit_lock();
        // SAFETY: the commit lock is held.
        let taken = unsafe { hub.take_stack() };
        drop(commit_lock);
        self.note_ready(taken);
        true
    }

    /// Notes the entries that were on the stack. O(their number).
    #[inline(always)]
    fn note_ready(&mut self, taken: *mut Entry<T>) {
        let mut next = taken;
        while let Some(entry) = NonNull::new(next) {
            // SAFETY: an entry on the stack is live, and what was taken off it is this thread's. It
            // was begun with its select state, which never changes.
            let index = unsafe {
                next = (*entry.as_ptr()).next;
                Waiter::guard_of(entry.cast::<Waiter<T>>()).1
            };
            // One that is about to be removed is a member of the set until its pushes are drained.
            self.ready.set(index as usize);
        }
    }

    #[inline]
    fn note_choice(&mut self, index: usize) {
        if self.is_fair {
            self.ready.put_behind(index);
        }
    }

    /// Hands on what an entry holds.
    #[inline(always)]
    fn take_held(&mut self, index: usize) -> Option<Result<T, RecvError>> {
        let entry = self.entries[index]?;
        // SAFETY: the select state was chosen through this entry, so it was committed; its settled
        // value is the owner's. The committing thread holds the channel's lock until it has
        // settled.
        let received = unsafe { Self::settled(entry) };
        self.state = State::Closed;
        self.note_choice(index);
        if let Err(error) = received {
            self.leave_out(index, error);
        }
        Some(received)
    }

    /// Whether no channel is left that could give a value.
    fn all_ended(&self) -> bool {
        self.ended != 0 && self.ended == self.count
    }

    /// Once all have ended, each is ready to report that again. O(n log n) then.
    fn ready_if_all_ended(&mut self) {
        if self.all_ended() {
            self.ready.clear_all();
            (0..self.entries.len())
                .filter(|&index| self.entries[index].is_some())
                .for_each(|index| self.ready.set(index));
        }
    }

    /// Notes that the owner has the report of a channel's end: the channel is not waited for any
    /// more. O(n); O(n log n) for the last one.
    #[cold]
    fn leave_out(&mut self, index: usize, error: RecvError) {
        let Some(entry) = self.entries[index] else {
            return;
        };
        if entry.set_ended(error).is_some() {
            return;
        }
        if index < self.listed {
            // SAFETY: it is registered with this channel, since its end was not set.
            unsafe { entry.channel().unregister(entry.pointer()) };
        }
        // No thread pushes it from here on. All entries pushed before are known now.
        self.drain();
        self.ready.clear(index);
        self.ended += 1;
        self.ready_if_all_ended();
    }

    /// Fails with a channel's error, after others if it is their turn.
    #[cold]
    fn fails(
        &mut self,
        index: usize,
        error: RecvError,
        cx: &Context<'_>,
    ) -> Poll<(usize, Result<T, RecvError>)> {
        if crate::fails_later(cx) {
            self.state = State::Fails(index, error);
            return Poll::Pending;
        }
        if let Some(entry) = self.entries[index] {
            let wait_point = entry.channel().wait_point();
            inspect::note_failure(wait_point, false, error.is_poisoned());
        }
        Poll::Ready((index, Err(error)))
    }

    /// The first channel that has not ended, or else the first.
    fn first_to_fail(&self) -> Option<usize> {
        let of_open =
            |entry: &Option<OwnEntry<'_, T>>| entry.is_some_and(|entry| entry.ended().is_none());
        let first_open = self.entries.iter().position(of_open);
        first_open.or_else(|| self.entries.iter().position(Option::is_some))
    }

    /// Takes the result of the entry through which the select state was chosen. The entry can be
    /// chosen again afterwards.
    ///
    /// # Safety
    ///
    /// It was, and this is the owner.
    #[inline(always)]
    unsafe fn settled(entry: OwnEntry<'_, T>) -> Result<T, RecvError> {
        let node = entry.node();
        // SAFETY: the select state was chosen through the entry, and the caller is the owner, so
        // the settled value is the caller's. The committing thread holds the lock until it has
        // settled, and touches nothing after. Only single fields of the listed node are borrowed.
        unsafe {
            if Waiter::outcome(node) == Outcome::Waiting {
                // The committing thread holds the channel's lock until it has settled.
                drop(entry.channel().lock());
            }
            let received = match Waiter::outcome(node) {
                Outcome::Done => Ok(Waiter::take_value_of(node)),
                // The sender's closure has panicked.
                _ => Err(RecvError::Poisoned),
            };
            (*Waiter::link(node))
                .outcome
                .store(Outcome::Waiting as u8, Ordering::Relaxed);
            received
        }
    }
}

impl<T> Drop for Alternative<'_, T> {
    fn drop(&mut self) {
        let closed = match self.state {
            State::Open => self.hub().select_state.close(),
            _ => None,
        };
        if closed.is_some() {
            self.state = State::Closed;
        }
        // Given back when nothing leads here any more, since that wakes others.
        let held = self.holds().and_then(|index| self.entries[index]);
        let held = held.map(|entry| {
            self.state = State::Closed;
            // SAFETY: the select state was chosen through the entry, and this is the owner.
            (entry.channel(), unsafe { Self::settled(entry) })
        });
        for index in 0..self.entries.len() {
            self.remove(index);
        }
        // SAFETY: no entry leads to it any more.
        drop(unsafe { Box::from_raw(self.hub.as_ptr()) });
        if let Some((channel, Ok(value))) = held {
            channel.return_value(value);
        }
    }
}

luna_platform::debug_fields!(
    impl[T] Alternative<'_, T>, |alternative|
    channels: alternative.len(),
    is_fair: alternative.is_fair
);
