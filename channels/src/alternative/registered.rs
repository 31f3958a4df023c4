//! An alternative over any number of channels that stays registered between its selections.
//!
//! Each channel keeps a node of the alternative in its list of those who are *registered*. While the alternative waits, its selection is open,
//! and a sender that comes claims it through the node and hands its value over, as to any receiver. While it does not wait, a claim fails,
//! and the node stays: who makes the channel ready (a sender that lists itself, a value in the buffer, the channel's end) pushes the node onto the alternative's
//! stack of ready channels, under the channel's lock, once until the alternative has looked. So a selection costs nothing for the channels
//! where nothing happened.
//!
//! ```text
//!   sender, under the lock:  claim? no --> list itself; in the gate: push the node, was it open? ring;  release;  rung for: close it, ready its owner
//!   owner:                   drain the stack; choose; nothing?  in the gate: is the stack still empty? open the selection
//! ```
//!
//! The selection's gate is held around both, so one of both sees the other. It is a lock that favours a home: where senders and owner are processes of
//! one, none of this takes a read-modify-write. It is held for O(1) steps.

mod at_home;

use super::ready_set::ReadySet;
use crate::core::{Channel, Ending, Received, Taken};
use crate::error::RecvError;
use crate::recv::Receiver;
use crate::selection::Selection;
use crate::taped;
use crate::waiter::{Outcome, Waiter};
use luna_platform::current::{self, PlainReady, Wakeup};
use luna_platform::events;
use luna_platform::sync::atomic::{AtomicPtr, Ordering};
use luna_platform::tape::{Event, Turn, What};
use std::fmt;
use std::future::Future;
use std::marker::PhantomData;
use std::pin::Pin;
use std::ptr::{self, NonNull};
use std::task::{Context, Poll, RawWakerVTable};

/// What partners reach of an alternative.
pub(crate) struct Hub<T> {
    pub(crate) selection: Selection,
    /// The entries whose channels have become ready since the owner looked. Changed within the selection's gate.
    stack: AtomicPtr<Entry<T>>,
}

impl<T> Hub<T> {
    /// Pushes an entry.
    ///
    /// # Safety
    ///
    /// The gate is held, and the entry, whose lock is held too, is not on the stack.
    #[inline]
    unsafe fn push(&self, entry: *mut Entry<T>) {
        // SAFETY: the contract.
        unsafe { (*entry).next = self.stack.load(Ordering::Relaxed) };
        self.stack.store(entry, Ordering::Release);
    }

    /// Takes all that are on the stack.
    ///
    /// # Safety
    ///
    /// The gate is held.
    #[inline]
    unsafe fn take_stack(&self) -> *mut Entry<T> {
        let first = self.stack.load(Ordering::Relaxed);
        self.stack.store(ptr::null_mut(), Ordering::Relaxed);
        first
    }

    /// Whether the owner was told of something that it has not looked at. For an answer that still holds afterwards, within the gate.
    #[inline]
    fn has_news(&self) -> bool {
        !self.stack.load(Ordering::Acquire).is_null()
    }
}

/// A channel's registration.
///
/// # Invariants
///
/// While its node is in the channel's list, that lock guards `waiter.wait`, `is_queued`, and `rings`; the rest of `waiter` belongs to whoever claimed
/// the selection through it, then to the owner. `next` belongs to who pushes it, then to who drains the stack.
#[repr(C)]
pub(crate) struct Entry<T> {
    /// First, so that the list's node leads back to this.
    pub(crate) waiter: Waiter<T>,
    hub: NonNull<Hub<T>>,
    channel: NonNull<Channel<T>>,
    next: *mut Entry<T>,
    /// Whether it is on the stack, or known to its owner as ready.
    pub(crate) is_queued: bool,
    /// Whether the owner is yet to be readied for it.
    pub(crate) rings: bool,
    /// How its channel has ended, once its owner was told: then it is not listed any more. The owner's alone.
    ended: Option<RecvError>,
}

impl<T> Entry<T> {
    /// Says that the channel is ready, unless the owner knows. Whether it is then to be rung for.
    ///
    /// # Safety
    ///
    /// `entry` is in its channel's list, and that lock is held.
    pub(crate) unsafe fn announce(entry: NonNull<Entry<T>>) -> bool {
        let entry = entry.as_ptr();
        // SAFETY: the contract; the hub outlives its entries' being listed.
        unsafe {
            if (*entry).is_queued {
                return false;
            }
            (*entry).is_queued = true;
            let hub = (*entry).hub.as_ref();
            let _gate = hub.selection.gate();
            hub.push(entry);
            // An owner that does not wait looks at the stack before it does.
            (*entry).rings |= hub.selection.is_open();
            (*entry).rings
        }
    }

    /// Whether its alternative was told of something that it has not looked at: then it does not wait, though it may not know yet. What came
    /// before is to be chosen before what comes now.
    ///
    /// # Safety
    ///
    /// `entry` is in its channel's list, and that lock is held.
    pub(crate) unsafe fn has_news(entry: NonNull<Entry<T>>) -> bool {
        // SAFETY: the contract; the hub outlives its entries' being listed.
        unsafe { (*entry.as_ptr()).hub.as_ref().has_news() }
    }

    /// For a sender at home, where nobody else waits: claims the alternative, if it waits and knows of no other; if it does not wait, tells it of the
    /// channel. `None` if neither can be done here.
    ///
    /// # Safety
    ///
    /// `entry` is in its channel's list, that lock is held, and this thread is the home of that number. Unless the claim succeeds, the sender waits.
    #[inline(always)]
    pub(crate) unsafe fn claim_or_announce(
        entry: NonNull<Entry<T>>,
        home: u64,
    ) -> Option<Option<PlainReady>> {
        let node = entry.cast::<Waiter<T>>();
        let entry = entry.as_ptr();
        // SAFETY: the contract; the hub outlives its entries' being listed. The gate is held around what it guards.
        unsafe {
            let hub = (*entry).hub.as_ref();
            let _gate = hub.selection.gate_if_favoured(home)?;
            if !hub.selection.is_open() {
                if !(*entry).is_queued {
                    (*entry).is_queued = true;
                    hub.push(entry);
                }
                return Some(None);
            }
            if hub.has_news() {
                return None;
            }
            let (_, index) = Waiter::selection(node)?;
            hub.selection.claim_plainly(index).map(Some)
        }
    }

    /// The selection of its alternative.
    ///
    /// # Safety
    ///
    /// `entry` is in its channel's list, and that lock is held.
    pub(crate) unsafe fn selection<'a>(entry: NonNull<Entry<T>>) -> &'a Selection {
        // SAFETY: the contract; the hub outlives its entries' being listed.
        unsafe { &(*(*entry.as_ptr()).hub.as_ptr()).selection }
    }
}

/// Receives from any number of channels, whichever is ready: fair, or by priority.
///
/// What `alt!` is for a few different guards, this is for many channels of one type: it stays registered with all of them between its
/// selections, so that [`recv`](Self::recv) costs the same for two channels and for two thousand. Channels can be [added](Self::add) and
/// [removed](Self::remove) while it lives.
///
/// A channel that has ended (closed, and nothing left in it; or poisoned) says so once, and is left out from then on: the others are chosen among
/// as before, by priority too. When all have ended there is nothing left to wait for, and each selection gives the error of one of them: by priority of the
/// first, fairly in turn. So a server that counts the ends, or stops at the first, needs no [`remove`](Self::remove).
///
/// ```
/// use luna_channels::{Alternative, channel};
/// # luna_executors::block_on(async {
/// let (senders, receivers): (Vec<_>, Vec<_>) = (0..100).map(|_| channel::<u32>()).unzip();
/// let thread = std::thread::spawn(move || senders[42].blocking_send(7));
/// let mut inputs = Alternative::fair(&receivers);
/// assert_eq!(inputs.recv().await, (42, Ok(7)));
/// # thread.join().unwrap().unwrap();
/// # }).unwrap();
/// ```
pub struct Alternative<'a, T> {
    entries: Vec<Option<NonNull<Entry<T>>>>,
    hub: NonNull<Hub<T>>,
    ready: ReadySet,
    is_fair: bool,
    /// How many channels there are.
    count: usize,
    /// How many of them have said that they have ended. Once all have, all are ready.
    ended: usize,
    /// How many of the entries are listed in their channels: those before, since that happens with the first `recv`.
    listed: usize,
    state: State,
    polled_by: (*const (), *const RawWakerVTable),
    _receivers: PhantomData<&'a Receiver<T>>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// Nobody can claim the selection.
    Closed,
    /// It was opened: look whether it was claimed.
    Open,
    /// This entry holds a value that was received and not handed on yet.
    Holds(usize),
    /// The error of this entry's channel was not handed on yet.
    Fails(usize, RecvError),
    /// As `Closed`, and the process' tape has not let it in.
    Entering,
}

// SAFETY: what partners reach is guarded by the channels' locks, or passed on by the selection; values pass between threads anyway.
unsafe impl<T: Send> Send for Alternative<'_, T> {}
// SAFETY: `&Alternative` gives access to nothing.
unsafe impl<T: Send> Sync for Alternative<'_, T> {}

impl<'a, T> Alternative<'a, T> {
    /// Over `inputs`, choosing of those that are ready the least recently chosen. Allocates; not for the real-time path. O(n).
    pub fn fair(inputs: &'a [Receiver<T>]) -> Self {
        Self::new(inputs, true)
    }

    /// Over `inputs`, choosing of those that are ready the first in this order. Allocates; not for the real-time path. O(n).
    pub fn prioritized(inputs: &'a [Receiver<T>]) -> Self {
        Self::new(inputs, false)
    }

    fn new(inputs: &'a [Receiver<T>], is_fair: bool) -> Self {
        let mut selection = Selection::new();
        // Who tells of something closes it for its owner.
        selection.set_gated();
        let hub = Box::new(Hub {
            selection,
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

    /// Adds a channel, behind all others in order of preference, and gives its index: a free one, so perhaps that of one that was
    /// removed. Allocates; not for the real-time path.
    ///
    /// ```
    /// use luna_channels::{Alternative, Buffer, buffered};
    /// # luna_executors::block_on(async {
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
        if self.state == State::Open && self.hub().selection.close().is_some() {
            self.state = State::Closed;
        }
        let index = match self.entries.iter().position(Option::is_none) {
            Some(free) => free,
            None => {
                self.entries.push(None);
                self.entries.len() - 1
            }
        };
        let entry = Box::new(Entry {
            waiter: Waiter::empty(),
            hub: self.hub,
            channel: NonNull::from(input.channel()),
            next: ptr::null_mut(),
            is_queued: false,
            rings: false,
            ended: None,
        });
        if self.all_ended() {
            // They have said so, and now there is one to wait for.
            (0..self.entries.len())
                .filter(|&other| self.entries[other].is_some())
                .for_each(|other| self.ready.clear(other));
        }
        self.count += 1;
        let entry = NonNull::from(Box::leak(entry));
        // SAFETY: the hub lives as long as this alternative. The new entry is known to nobody else; its waiter is its first field.
        unsafe {
            let selection = NonNull::new_unchecked(&raw mut (*self.hub.as_ptr()).selection);
            Waiter::begin(
                entry.cast::<Waiter<T>>(),
                false,
                Some((selection, index as u32)),
                None,
            );
        }
        self.entries[index] = Some(entry);
        self.ready.add(index);
        if index < self.listed {
            self.list(index);
        }
        index
    }

    /// Removes a channel; says whether it was there. A value that was received from it and not handed on goes back to its head. Frees; not for
    /// the real-time path. O(1).
    pub fn remove(&mut self, index: usize) -> bool {
        let Some(entry) = self.entries.get_mut(index).and_then(Option::take) else {
            return false;
        };
        // SAFETY: the entry is this alternative's, and its channel is borrowed.
        let (channel, has_ended): (&Channel<T>, _) = unsafe {
            let has_ended = (*entry.as_ptr()).ended.is_some();
            (&*(*entry.as_ptr()).channel.as_ptr(), has_ended)
        };
        if index < self.listed && !has_ended {
            // SAFETY: it is listed.
            unsafe { channel.unregister(entry) };
        }
        // Nobody pushes it any more; whoever was pushed before is known now, and this one is not on the stack.
        self.drain();
        self.ready.remove(index);
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
            // SAFETY: the selection was chosen through it, and this is the owner.
            unsafe { Self::settled(entry) }
        });
        // SAFETY: it is known to nobody else any more.
        drop(unsafe { Box::from_raw(entry.as_ptr()) });
        if let Some(Ok(value)) = held {
            channel.give_back(value);
        }
        true
    }

    /// How many channels there are, those that have ended too.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether there is none: then `recv` waits for ever.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Waits until a channel is ready, and receives from it: which one, and what it gave, or that it has ended, which each says once, and all say again and
    /// again when none is left that could give anything.
    ///
    /// In a branch of a parallel construct one of whose siblings has failed, it fails as poisoned instead of waiting; over no channels the branch ends there.
    ///
    /// It is no guard itself: a server that waits for a tick or a stop too has them come over a channel that is one of its inputs.
    /// Cancel-safe: a value that was received and not handed on is what the next call gives first. Real-time path: yes, but for the first
    /// call, which registers with all channels, at the priority of the process that makes it: O(n). After that O(1) a selection (the levels
    /// of a tree with 64 branches; a fair one renumbers its n channels once in at least n selections), and O(1) for each channel
    /// that has become ready and was emptied by others since. The selection that tells of the last channel's end is O(n).
    ///
    /// ```
    /// use luna_channels::{Alternative, Buffer, buffered};
    /// # luna_executors::block_on(async {
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
            self.state = match self.hub().selection.chosen() {
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
            // SAFETY: the entry is this alternative's.
            && unsafe { (*entry.as_ptr()).ended }.is_none()
        {
            // SAFETY: the entry is this alternative's and stays where it is until it is unregistered; its channel is borrowed.
            let channel = unsafe { &*(*entry.as_ptr()).channel.as_ptr() };
            if current::is_taped() {
                channel.note_alternative();
            }
            // SAFETY: as above.
            let is_ready = unsafe { channel.register(entry) };
            if is_ready {
                self.ready.set(index);
            }
        }
    }

    /// Takes all that have become ready off the stack. O(those). Says whether there were any.
    fn drain(&mut self) -> bool {
        let hub = self.hub();
        if !hub.has_news() {
            return false;
        }
        let gate = hub.selection.gate();
        // SAFETY: the gate is held.
        let taken = unsafe { hub.take_stack() };
        drop(gate);
        self.note_ready(taken);
        true
    }

    /// Notes who was on the stack. O(those).
    fn note_ready(&mut self, taken: *mut Entry<T>) {
        let mut next = taken;
        while let Some(entry) = NonNull::new(next) {
            // SAFETY: an entry on the stack is live, and what was taken off it is this thread's.
            let index = unsafe {
                next = (*entry.as_ptr()).next;
                Waiter::selection(entry.cast::<Waiter<T>>()).map(|(_, index)| index)
            };
            if let Some(index) = index
                && self.entries[index as usize] == Some(entry)
            {
                self.ready.set(index as usize);
            }
        }
    }

    fn note_choice(&mut self, index: usize) {
        if self.is_fair {
            self.ready.put_behind(index);
        }
    }

    /// Hands on what an entry holds.
    fn take_held(&mut self, index: usize) -> Option<Result<T, RecvError>> {
        let entry = self.entries[index]?;
        // SAFETY: the selection was chosen through this entry, so it was claimed; its settled value is the owner's. Who claims holds the
        // channel's lock until it has settled.
        let received = unsafe { Self::settled(entry) };
        self.state = State::Closed;
        self.note_choice(index);
        if let Err(error) = received {
            self.leave_out(index, error);
        }
        Some(received)
    }

    /// Whether none is left that could give a value.
    fn all_ended(&self) -> bool {
        self.ended != 0 && self.ended == self.count
    }

    /// Once all have ended, each is ready to say so again. O(n) then.
    fn ready_if_all_ended(&mut self) {
        if self.all_ended() {
            (0..self.entries.len())
                .filter(|&index| self.entries[index].is_some())
                .for_each(|index| self.ready.set(index));
        }
    }

    /// Notes that the owner is told of a channel's end: it is waited for no more. O(1), and O(n) for the last one.
    #[cold]
    fn leave_out(&mut self, index: usize, error: RecvError) {
        let Some(entry) = self.entries[index] else {
            return;
        };
        // SAFETY: the entry is this alternative's, and its channel is borrowed; what is said of its end is the owner's.
        unsafe {
            if (*entry.as_ptr()).ended.replace(error).is_some() {
                return;
            }
            if index < self.listed {
                (*(*entry.as_ptr()).channel.as_ptr()).unregister(entry);
            }
        }
        // Nobody pushes it any more; whoever was pushed before is known now.
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
        Poll::Ready((index, Err(error)))
    }

    /// The first channel that has not ended, or else the first.
    fn first_to_fail(&self) -> Option<usize> {
        // SAFETY: the entries are this alternative's.
        let is_open = |entry: &NonNull<Entry<T>>| unsafe { (*entry.as_ptr()).ended }.is_none();
        let of_open = |entry: &Option<NonNull<Entry<T>>>| entry.as_ref().is_some_and(is_open);
        let first_open = self.entries.iter().position(of_open);
        first_open.or_else(|| self.entries.iter().position(Option::is_some))
    }

    /// What the entry came to through which the selection was chosen. It can be chosen again afterwards.
    ///
    /// # Safety
    ///
    /// It was, and this is the owner.
    unsafe fn settled(entry: NonNull<Entry<T>>) -> Result<T, RecvError> {
        let node = entry.cast::<Waiter<T>>();
        // SAFETY: the contract: the settled value is the owner's. Only single fields of a listed node are looked at.
        unsafe {
            if Waiter::outcome(node) == Outcome::Waiting {
                // Who claims holds the channel's lock until it has settled.
                drop((*(*entry.as_ptr()).channel.as_ptr()).lock());
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

    #[inline]
    fn poll_recv(&mut self, cx: &mut Context<'_>) -> Poll<(usize, Result<T, RecvError>)> {
        if let Some(process) = current::unrecorded_turn(cx)
            && let Some(polled) = self.poll_at_home::<false>(process, cx)
        {
            return polled;
        }
        match events::is_on() {
            true => self.poll_recorded(cx),
            false => self.poll_generally(cx),
        }
    }

    /// Polls, and tells what comes of it.
    #[cold]
    #[inline(never)]
    fn poll_recorded(&mut self, cx: &mut Context<'_>) -> Poll<(usize, Result<T, RecvError>)> {
        let at_home = match current::plain_turn(cx) {
            Some(process) => self.poll_at_home::<true>(process, cx),
            None => None,
        };
        let polled = at_home.unwrap_or_else(|| self.poll_generally(cx));
        match &polled {
            Poll::Ready((index, _)) => self.tell(*index),
            Poll::Pending => events::waits_for_several(),
        }
        polled
    }

    /// Polls wherever the process is, and whatever is asked of the channels.
    #[inline(never)]
    fn poll_generally(&mut self, cx: &mut Context<'_>) -> Poll<(usize, Result<T, RecvError>)> {
        match current::is_taped() {
            true => self.poll_taped(cx),
            false => self.poll_untaped(cx),
        }
    }

    /// Polls as the process' tape says, and tells it what comes of it.
    #[cold]
    fn poll_taped(&mut self, cx: &mut Context<'_>) -> Poll<(usize, Result<T, RecvError>)> {
        if let State::Holds(index) = self.state
            && taped::is_replayed()
        {
            if !taped::is_held(cx)
                && let Some(received) = self.take_held(index)
            {
                return Poll::Ready((index, received));
            }
            return Poll::Pending;
        }
        let entered = current::tape(|tape| tape.enter(cx)).unwrap_or(Poll::Ready(Turn::Record));
        if entered != Poll::Ready(Turn::Record) {
            self.state = State::Entering;
            let turn = std::task::ready!(entered);
            return self.poll_replayed(turn, cx);
        }
        let mut holds = None;
        let polled = self.poll_untaped(cx);
        if let State::Holds(index) = self.state {
            holds = Some(index);
        }
        let own = current::tape(|tape| tape.own_stamp()).unwrap_or_default();
        if let Some(index) = holds {
            // It lets others run before it hands on what it has received.
            self.put_order(index, own);
        }
        let (index, received) = std::task::ready!(polled);
        let (number, stamp) = match &received {
            Ok(_) if own != 0 => (0, own),
            Ok(_) => (0, self.order(index)),
            Err(RecvError::Poisoned) => (taped::failure::POISONED, 0),
            Err(_) => (taped::failure::CLOSED, 0),
        };
        current::tape(|tape| {
            let number = (index as u64) << 2 | number;
            tape.leave(Event::new(What::Chosen, number, taped::known(tape, stamp)));
        });
        Poll::Ready((index, received))
    }

    /// Receives what the recorded one did. It is not registered anywhere: whoever sends lists itself, and is there when its stamp has come.
    fn poll_replayed(
        &mut self,
        turn: Turn,
        cx: &mut Context<'_>,
    ) -> Poll<(usize, Result<T, RecvError>)> {
        let differs = |what| {
            current::tape(|tape| tape.differs(what));
            Poll::Pending
        };
        let Turn::Given(Event { number, stamp, .. }) = turn else {
            return differs("an `Alternative` receives");
        };
        let index = usize::try_from(number >> 2).unwrap_or(usize::MAX);
        let Some(entry) = self.entries.get(index).copied().flatten() else {
            return differs("an `Alternative` has no such channel");
        };
        let settled = current::tape(|tape| tape.settle(cx));
        std::task::ready!(settled.unwrap_or(Poll::Ready(())));
        let event = Event::new(What::Chosen, number, stamp);
        let received = match number & 3 {
            0 => {
                // SAFETY: the entry is this alternative's, and its channel is borrowed for longer than this alternative lives.
                let channel: &Channel<T> = unsafe { &*(*entry.as_ptr()).channel.as_ptr() };
                channel.note_alternative();
                match channel.lock().recv_unusually(false) {
                    Received::Done(value, ready, _) => {
                        let taken = Taken::new(channel, value, 0);
                        ready.wake();
                        Ok(taken.keep())
                    }
                    _ => return differs("an `Alternative` finds nothing"),
                }
            }
            taped::failure::POISONED => Err(RecvError::Poisoned),
            _ => Err(RecvError::Closed),
        };
        self.state = State::Closed;
        taped::leave(event);
        let is_held = received.is_ok() && taped::is_held(cx);
        self.hand_on(index, received, is_held)
    }

    /// The stamp of what an entry came to.
    fn order(&self, index: usize) -> u64 {
        self.entries[index].map_or(0, |entry| {
            // SAFETY: the entry is this alternative's, and was begun when it was made.
            unsafe { Waiter::order(entry.cast::<Waiter<T>>()) }
        })
    }

    fn put_order(&self, index: usize, stamp: u64) {
        if let Some(entry) = self.entries[index]
            && stamp != 0
        {
            // SAFETY: the selection is closed, so the entry is the owner's.
            unsafe { Waiter::put_order(entry.cast::<Waiter<T>>(), stamp) };
        }
    }

    fn poll_untaped(&mut self, cx: &mut Context<'_>) -> Poll<(usize, Result<T, RecvError>)> {
        let identity: (_, *const RawWakerVTable) = (cx.waker().data(), cx.waker().vtable());
        if let Some(index) = self.holds()
            && let Some(received) = self.take_held(index)
        {
            return Poll::Ready((index, received));
        }
        let has_failed = current::branch_failed();
        if let State::Fails(index, error) = self.state {
            if has_failed {
                current::stay_in_branch();
            }
            self.state = State::Closed;
            return Poll::Ready((index, Err(error)));
        }
        if self.state == State::Open {
            if !has_failed && self.polled_by == identity && self.hub().selection.is_open() {
                return Poll::Pending;
            }
            match (self.hub().selection.close(), self.holds()) {
                (None, Some(index)) => {
                    if let Some(received) = self.take_held(index) {
                        return Poll::Ready((index, received));
                    }
                }
                _ => self.state = State::Closed,
            }
        }
        if has_failed {
            let Some(first) = self.first_to_fail() else {
                // As STOP, it has no error to give.
                current::end_branch(cx);
                if current::is_taped() {
                    // Its drop tells the tape that it came to nothing.
                    self.state = State::Entering;
                }
                return Poll::Pending;
            };
            current::stay_in_branch();
            return self.fails(first, RecvError::Poisoned, cx);
        }
        while self.listed < self.entries.len() {
            self.listed += 1;
            self.list(self.listed - 1);
        }
        self.choose(cx)
    }

    /// Receives from the ready channel that comes first, or starts to wait. The selection is closed.
    fn choose(&mut self, cx: &mut Context<'_>) -> Poll<(usize, Result<T, RecvError>)> {
        loop {
            self.drain();
            while let Some(index) = self.ready.first() {
                if let Some(received) = self.try_recv(index) {
                    self.note_choice(index);
                    if let Err(error) = received {
                        self.leave_out(index, error);
                        return self.fails(index, error, cx);
                    }
                    let gives_way = crate::gives_way(cx);
                    return self.hand_on(index, received, gives_way);
                }
            }
            self.polled_by = (cx.waker().data(), cx.waker().vtable());
            // Cloning a waker is its owner's code, so it comes before the gate.
            let wakeup = Wakeup::of(cx);
            let hub = self.hub();
            let gate = hub.selection.gate();
            if !hub.has_news() {
                // SAFETY: this is the owner, the selection is closed, and its gate is held.
                unsafe { hub.selection.open_gated(wakeup) };
                drop(gate);
                self.state = State::Open;
                return Poll::Pending;
            }
            // Something became ready meanwhile. Each channel can say so once, and the next look sees all who said it before it.
            drop(gate);
            drop(wakeup);
        }
    }

    /// Receives from a channel that has said that it is ready; nothing if others have emptied it, or a better one turns up.
    fn try_recv(&mut self, index: usize) -> Option<Result<T, RecvError>> {
        let entry = self.entries[index]?;
        // SAFETY: the entry is this alternative's.
        if let Some(error) = unsafe { (*entry.as_ptr()).ended } {
            return Some(Err(error));
        }
        // SAFETY: as above, and its channel is borrowed for longer than this alternative lives.
        let channel: &Channel<T> = unsafe { &*(*entry.as_ptr()).channel.as_ptr() };
        let mut section = channel.lock();
        // What became ready before this lock was taken may come before this one.
        if self.drain() && self.ready.first() != Some(index) {
            return None;
        }
        let received = section.recv_now(false);
        let is_ready = section.is_ready();
        if !is_ready {
            // SAFETY: the lock that guards it is held.
            unsafe { (*entry.as_ptr()).is_queued = false };
            self.ready.clear(index);
        }
        drop(section);
        match received {
            Received::Done(value, ready, _) => {
                let taken = Taken::new(channel, value, 0);
                ready.wake();
                Some(Ok(taken.keep()))
            }
            Received::Empty => None,
            Received::Ended(Ending::Poisoned) => Some(Err(RecvError::Poisoned)),
            Received::Ended(_) => Some(Err(RecvError::Closed)),
            Received::Broken(ready) => {
                channel.poison();
                ready.wake();
                Some(Err(RecvError::Poisoned))
            }
        }
    }

    /// Gives what was received, or keeps it for the next poll while others run.
    fn hand_on(
        &mut self,
        index: usize,
        received: Result<T, RecvError>,
        gives_way: bool,
    ) -> Poll<(usize, Result<T, RecvError>)> {
        if !gives_way {
            return Poll::Ready((index, received));
        }
        if let (Ok(value), Some(entry)) = (received, self.entries[index]) {
            // SAFETY: the selection is closed, so the entry's value is the owner's, and there is none.
            unsafe {
                let node = entry.cast::<Waiter<T>>();
                Waiter::put_value_of(node, value);
                (*Waiter::link(node))
                    .outcome
                    .store(Outcome::Done as u8, Ordering::Relaxed);
            }
            self.state = State::Holds(index);
        }
        Poll::Pending
    }
}

impl<T> Drop for Alternative<'_, T> {
    fn drop(&mut self) {
        if self.state == State::Open && self.hub().selection.close().is_some() {
            self.state = State::Closed;
        }
        for index in 0..self.entries.len() {
            self.remove(index);
        }
        // SAFETY: no entry leads to it any more.
        drop(unsafe { Box::from_raw(self.hub.as_ptr()) });
    }
}

impl<T> fmt::Debug for Alternative<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Alternative")
            .field("channels", &self.len())
            .field("is_fair", &self.is_fair)
            .finish_non_exhaustive()
    }
}

/// A receive under way from one of many channels: see [`Alternative::recv`].
#[must_use = "an operation does nothing unless awaited"]
pub struct AlternativeRecv<'b, 'a, T> {
    alternative: &'b mut Alternative<'a, T>,
}

impl<T> Future for AlternativeRecv<'_, '_, T> {
    type Output = (usize, Result<T, RecvError>);

    fn poll(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        self.alternative.poll_recv(cx)
    }
}

impl<T> Drop for AlternativeRecv<'_, '_, T> {
    fn drop(&mut self) {
        if self.alternative.state != State::Closed {
            self.alternative.end_recv();
        }
    }
}

impl<T> Alternative<'_, T> {
    /// Tells that the current process has received from this channel.
    #[cold]
    fn tell(&self, index: usize) {
        let channel = self.entries[index].map_or(0, |entry| {
            // SAFETY: the entry is this alternative's, and its channel is borrowed for longer than this alternative lives.
            let channel: &Channel<T> = unsafe { &*(*entry.as_ptr()).channel.as_ptr() };
            channel.place().identity.number()
        });
        let process = events::current_process() as u32;
        events::tell(events::code::ALTERNATIVE, process, || {
            [index as u64, channel.into()]
        });
    }

    /// A receive is dropped which is not over, or which gave way.
    #[inline(never)]
    fn end_recv(&mut self) {
        match self.state {
            State::Open => {
                if current::is_taped() {
                    taped::abandoned();
                }
                if self.hub().selection.close().is_some() {
                    self.state = State::Closed;
                }
            }
            State::Entering => {
                taped::abandoned();
                self.state = State::Closed;
            }
            State::Fails(index, _) => {
                if current::is_taped() {
                    taped::abandoned();
                }
                // This one has told nobody. Of an end the next one tells; that its branch had failed is nothing to who comes later.
                // SAFETY: the entries are this alternative's.
                let has_ended = |entry: NonNull<Entry<T>>| unsafe { (*entry.as_ptr()).ended };
                if self.entries[index].and_then(has_ended).is_none() {
                    self.state = State::Closed;
                }
            }
            State::Closed | State::Holds(_) => {}
        }
    }
}

impl<T> fmt::Debug for AlternativeRecv<'_, '_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("AlternativeRecv")
            .field(&self.alternative)
            .finish()
    }
}
