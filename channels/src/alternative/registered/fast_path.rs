//! A selection by a process of an executor, over channels that connect it with processes of the
//! same executor.
//!
//! The locks are biased to the executor, so each step consists of plain stores. Everything else is
//! left to the slow path, with no state changed.

use super::{Alternative, State};
use crate::core::{FastPath, wake_partner};
use crate::error::RecvError;
use core::task::{Context, Poll};
use luna_core::current::PlainTurn;

impl<T> Alternative<'_, T> {
    /// Polls in a plain turn. `None`: take the slow path.
    #[inline(always)]
    pub(super) fn poll_fast(
        &mut self,
        turn: PlainTurn<'_>,
        cx: &Context<'_>,
    ) -> Option<Poll<(usize, Result<T, RecvError>)>> {
        if self.state != State::Closed {
            let index = self.holds()?;
            let received = self.take_held(index)?;
            return Some(Poll::Ready((index, received)));
        }
        if self.listed != self.entries.len() {
            return None;
        }
        if self.hub().has_news() {
            let hub = self.hub();
            let commit_lock = hub.select_state.commit_lock_if_biased(turn.here())?;
            // SAFETY: the commit lock is held.
            let taken = unsafe { hub.take_stack() };
            drop(commit_lock);
            self.note_ready(taken);
        }
        let Some(index) = self.ready.first() else {
            return self.wait_fast(turn, cx);
        };
        let entry = self.entries[index]?;
        let mut is_ready = false;
        // What became ready before the lock was taken may come before this one.
        let is_first = || !self.hub().has_news();
        let note = |is_empty: bool| {
            is_ready = !is_empty;
            if is_empty {
                // SAFETY: the lock that guards it is held.
                unsafe { (*entry.pointer().as_ptr()).is_queued = false };
            }
        };
        let (value, ready) = entry.channel().take_sender_if(turn, is_first, note)?;
        if !is_ready {
            self.ready.clear_first();
        }
        self.note_choice(index);
        // SAFETY: the sender was listed by the executor to which the lock is biased: this thread.
        if unsafe { wake_partner(ready, turn) } == FastPath::GaveWay {
            self.keep_value(index, value);
            return Some(Poll::Pending);
        }
        Some(Poll::Ready((index, Ok(value))))
    }

    /// Starts to wait, if nothing has become ready meanwhile.
    fn wait_fast(
        &mut self,
        turn: PlainTurn<'_>,
        cx: &Context<'_>,
    ) -> Option<Poll<(usize, Result<T, RecvError>)>> {
        let hub = self.hub();
        let mut opening = hub.select_state.commit_lock_if_biased(turn.here())?;
        if hub.has_news() {
            return None;
        }
        hub.select_state.open_plainly(&mut opening, turn);
        drop(opening);
        self.polled_by = (cx.waker().data(), cx.waker().vtable());
        self.state = State::Open;
        Some(Poll::Pending)
    }
}
