//! A receive from one of the channels of an alternative that stays registered.

use super::{Alternative, OwnEntry, State};
use crate::core::Attempted;
use crate::error::RecvError;
use crate::replay::{self, Logged, Stage};
use crate::waiter::{Outcome, Waiter};
use core::fmt;
use core::future::Future;
use core::pin::Pin;
use core::task::{Context, Poll, RawWakerVTable, ready};
use luna_core::current::{self, PlainTurn, WakeHandle};
use luna_core::events;
use luna_core::replay_log::{Event, Turn, What};
use luna_platform::sync::atomic::Ordering;

/// A receive under way from one of many channels: see [`Alternative::recv`].
#[must_use = "an operation does nothing unless awaited"]
pub struct AlternativeRecv<'b, 'a, T> {
    pub(super) alternative: &'b mut Alternative<'a, T>,
}

impl<T> Future for AlternativeRecv<'_, '_, T> {
    type Output = (usize, Result<T, RecvError>);

    #[inline(always)]
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

impl<T> fmt::Debug for AlternativeRecv<'_, '_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("AlternativeRecv")
            .field(&self.alternative)
            .finish()
    }
}

impl<T> Alternative<'_, T> {
    #[inline(always)]
    fn poll_recv(&mut self, cx: &mut Context<'_>) -> Poll<(usize, Result<T, RecvError>)> {
        // A process whose communication is recorded has no plain turn.
        if let Some(turn) = PlainTurn::of(cx)
            && let Some(polled) = self.poll_fast(turn, cx)
        {
            return polled;
        }
        self.poll_slow_path(cx)
    }

    /// Polls wherever the process is, and whatever is asked of the channels.
    #[inline(never)]
    fn poll_slow_path(&mut self, cx: &mut Context<'_>) -> Poll<(usize, Result<T, RecvError>)> {
        let polled = match replay::is_on() {
            true => replay::poll(self, cx),
            false => self.poll_without_log(cx),
        };
        if events::is_on() {
            match &polled {
                Poll::Ready((index, _)) => self.report(*index),
                Poll::Pending => events::waits_for_several(),
            }
        }
        polled
    }

    fn poll_without_log(&mut self, cx: &mut Context<'_>) -> Poll<(usize, Result<T, RecvError>)> {
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
            if !has_failed && self.polled_by == identity && self.hub().select_state.is_open() {
                return Poll::Pending;
            }
            // What would have woken this one is dropped when its state is consistent.
            let closed = self.hub().select_state.close();
            match (&closed, self.holds()) {
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
                // Its drop records in the replay log that it had no result.
                self.state = State::Begun;
                return Poll::Pending;
            };
            current::stay_in_branch();
            return self.fails(first, RecvError::Poisoned, cx);
        }
        if self.listed == 0 {
            // A replayed process may have left one, which is listed now.
            self.ready.clear_all();
        }
        while self.listed < self.entries.len() {
            self.listed += 1;
            self.list(self.listed - 1);
        }
        self.choose(cx)
    }

    /// Receives from the ready channel that comes first, or starts to wait. The selection is
    /// closed.
    fn choose(&mut self, cx: &mut Context<'_>) -> Poll<(usize, Result<T, RecvError>)> {
        loop {
            self.drain();
            while let Some(index) = self.ready.first() {
                match self.try_recv(index) {
                    None => {}
                    Some(Ok(())) if crate::yield_after_operation(cx) => return Poll::Pending,
                    Some(Ok(())) => {
                        if let Some(received) = self.take_held(index) {
                            return Poll::Ready((index, received));
                        }
                    }
                    Some(Err(error)) => {
                        self.leave_out(index, error);
                        self.note_choice(index);
                        return self.fails(index, error, cx);
                    }
                }
            }
            self.polled_by = (cx.waker().data(), cx.waker().vtable());
            // Cloning a waker is its owner's code, so it comes before the commit lock.
            let wake_handle = WakeHandle::of(cx);
            let hub = self.hub();
            let mut opening = hub.select_state.commit_lock();
            if !hub.has_news() {
                hub.select_state.open_again(&mut opening, wake_handle);
                drop(opening);
                self.state = State::Open;
                return Poll::Pending;
            }
            // A channel became ready meanwhile. Each channel can report so once, and the next look
            // sees all that reported before it.
            drop(opening);
            drop(wake_handle);
        }
    }

    /// Receives into the entry of a channel that has reported that it is ready; nothing if others
    /// have emptied it, or a better one turns up. The select state is closed.
    fn try_recv(&mut self, index: usize) -> Option<Result<(), RecvError>> {
        let entry = self.entries[index]?;
        if let Some(error) = entry.ended() {
            return Some(Err(error));
        }
        let channel = entry.channel();
        let mut locked = channel.lock();
        // What became ready before this lock was taken may come before this one.
        if self.drain() && self.ready.first() != Some(index) {
            return None;
        }
        // SAFETY: the select state is closed, so the entry's value is the owner's. There is none.
        let attempted = unsafe { locked.recv_now(entry.node(), false) };
        let is_ready = locked.is_ready();
        if !is_ready {
            // SAFETY: the lock that guards it is held.
            unsafe { (*entry.pointer().as_ptr()).is_queued = false };
            self.ready.clear(index);
        }
        drop(locked);
        match attempted {
            Attempted::NotNow => None,
            Attempted::Ended(ending) => Some(Err(RecvError::of(ending))),
            Attempted::Broken(ready) => {
                channel.poison();
                ready.wake();
                Some(Err(RecvError::Poisoned))
            }
            Attempted::Done(ready) => {
                // Before the sender's waker can panic: the value is that of the next call then.
                self.hold(index, entry);
                ready.wake();
                Some(Ok(()))
            }
            other => unreachable!("a receive that holds no sender came to {other:?}"),
        }
    }

    /// The entry has received a value, which is yet to be handed on.
    fn hold(&mut self, index: usize, entry: OwnEntry<'_, T>) {
        // SAFETY: the select state is closed, so the entry's outcome is the owner's.
        unsafe {
            (*Waiter::link(entry.node()))
                .outcome
                .store(Outcome::Done as u8, Ordering::Relaxed);
        }
        self.state = State::Holds(index);
    }

    /// Keeps a received value for the next poll. The select state is closed.
    pub(super) fn keep_value(&mut self, index: usize, value: T) {
        if let Some(entry) = self.entries[index] {
            // SAFETY: the select state is closed, so the entry's value is the owner's. There is
            // none.
            unsafe { Waiter::put_value_of(entry.node(), value) };
            self.hold(index, entry);
        }
    }

    /// Records that the current process has received from this channel.
    #[cold]
    fn report(&self, index: usize) {
        let channel = self.entries[index];
        let channel = channel.map_or(0, |entry| entry.channel().wait_point().identity.number());
        let process = events::current_process() as u32;
        events::report(events::code::ALTERNATIVE, process, || {
            [index as u64, channel.into()]
        });
    }

    /// A receive is dropped which is not over, or which gave way.
    #[inline(never)]
    fn end_recv(&mut self) {
        match self.state {
            State::Open => {
                replay::abandon(false);
                let closed = self.hub().select_state.close();
                if closed.is_some() {
                    self.state = State::Closed;
                }
            }
            State::Begun => {
                replay::abandon(false);
                self.state = State::Closed;
            }
            State::Fails(index, _) => {
                // No caller has the report of this one yet. The next call reports an end; a later
                // caller has no use for a failure of this branch.
                if self.entries[index].and_then(OwnEntry::ended).is_none() {
                    self.state = State::Closed;
                }
            }
            State::Closed | State::Holds(_) => {}
        }
    }
}

impl<T> Logged for Alternative<'_, T> {
    type Output = (usize, Result<T, RecvError>);

    const KEEPS: bool = true;

    fn stage(&self) -> Stage {
        match self.state {
            State::Closed | State::Begun | State::Open => Stage::New,
            State::Holds(_) | State::Fails(..) => Stage::GaveWay,
        }
    }

    fn approach(&mut self) {
        if self.state == State::Closed {
            self.state = State::Begun;
        }
    }

    /// A replayed one receives what the recorded one did. It is not registered anywhere: every
    /// sender lists itself, and is there when its stamp has come.
    fn come(&mut self, turn: Turn, cx: &mut Context<'_>) -> Poll<()> {
        let number = match turn {
            Turn::Record if self.state == State::Begun => {
                self.state = State::Closed;
                return Poll::Ready(());
            }
            Turn::Record => return Poll::Ready(()),
            Turn::Look => return replay::differs("an `Alternative` receives"),
            Turn::Given(event) => event.number,
        };
        let index = usize::try_from(number >> 2).unwrap_or(usize::MAX);
        let Some(entry) = self.entries.get(index).copied().flatten() else {
            return replay::differs("an `Alternative` has no such channel");
        };
        ready!(replay::settle(cx));
        let error = match number & 3 {
            replay::failure::NOTHING => {
                entry.channel().note_alternative();
                self.ready.clear_all();
                self.ready.set(index);
                return match self.try_recv(index) {
                    Some(Ok(())) => Poll::Ready(()),
                    _ => replay::differs("an `Alternative` finds nothing"),
                };
            }
            replay::failure::POISONED => RecvError::Poisoned,
            _ => RecvError::Closed,
        };
        self.state = State::Fails(index, error);
        Poll::Ready(())
    }

    fn poll_unlogged(&mut self, cx: &mut Context<'_>) -> Poll<Self::Output> {
        self.poll_without_log(cx)
    }

    unsafe fn success(&self, output: Option<&Self::Output>, own: u64) -> Event {
        let (index, error) = match (output, self.state) {
            (Some((index, received)), _) => (*index, received.as_ref().err().copied()),
            (None, State::Holds(index)) => (index, None),
            (None, State::Fails(index, error)) => (index, Some(error)),
            (None, _) => unreachable!("it has its output, or has given it"),
        };
        let (failure, stamp) = match error {
            Some(RecvError::Poisoned) => (replay::failure::POISONED, 0),
            Some(_) => (replay::failure::CLOSED, 0),
            // The entry may have the stamp of an earlier result.
            None if own != 0 => (replay::failure::NOTHING, own),
            None => (
                replay::failure::NOTHING,
                replay::stamp(self.order(index), 0),
            ),
        };
        Event::new(What::Chosen, (index as u64) << 2 | failure, stamp)
    }

    fn keep(&mut self, (index, received): Self::Output) {
        match received {
            Err(error) => self.state = State::Fails(index, error),
            Ok(value) => self.keep_value(index, value),
        }
    }
}

impl<T> Alternative<'_, T> {
    /// The stamp of an entry's result.
    fn order(&self, index: usize) -> u64 {
        self.entries[index].map_or(0, |entry| {
            // SAFETY: the entry is this alternative's, and was begun when it was made.
            unsafe { Waiter::order(entry.node()) }
        })
    }
}
