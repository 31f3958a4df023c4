//! One branch_log of a replayed process: its events, and how far it has come in them.

use super::stamps::after;
use crate::event::{Event as Noted, Kind};
use luna_core::replay_log::Turn;
use luna_core::timer_queue::Sleep;
use luna_platform::clock::Instant;
use std::collections::VecDeque;
use std::pin::Pin;
use std::task::{Context, Poll};

#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Stage {
    Idle,
    Entering,
    Running(Turn),
}

/// A branch_log of a process.
pub(super) struct BranchLog {
    pub(super) events: VecDeque<Noted>,
    pub(super) operations: u64,
    pub(super) stage: Stage,
    /// The present operation does not wait, and has taken its event.
    pub(super) is_call: bool,
    /// What it sleeps in.
    sleep: Option<Pin<Box<Sleep>>>,
}

impl BranchLog {
    pub(super) fn new(events: VecDeque<Noted>) -> Self {
        Self {
            events,
            operations: 0,
            stage: Stage::Idle,
            is_call: false,
            sleep: None,
        }
    }

    /// Sleeps until all before this instant has happened.
    pub(super) fn wait_for(&mut self, until: Instant, cx: &mut Context<'_>) -> Poll<()> {
        let same = self.sleep.take_if(|sleep| sleep.deadline() == until);
        let sleep = self
            .sleep
            .insert(same.unwrap_or_else(|| Box::pin(Sleep::until(until))));
        let polled = sleep.as_mut().poll(cx);
        if polled.is_ready() {
            self.sleep = None;
        }
        polled
    }

    /// Sleeps until the calls can happen that follow the present operation and take something.
    pub(super) fn wait_for_calls(&mut self, cx: &mut Context<'_>) -> Poll<()> {
        let mut stamp = 0;
        for (event, number) in self.events.iter().zip(self.operations + 1..) {
            if event.operation != number || !event.is_call {
                break;
            }
            if let Kind::Outcome(outcome) = event.kind
                && outcome.stamp != 0
            {
                // Of several in a row the last: nothing else runs between them here, so what they
                // take has to be there before the first.
                stamp = outcome.stamp;
            }
        }
        match stamp {
            0 => Poll::Ready(()),
            stamp => self.wait_for(after(stamp), cx),
        }
    }

    /// As [`wait_for_calls`](Self::wait_for_calls), when the present operation's own event is the
    /// first.
    pub(super) fn wait_for_calls_after_this(&mut self, cx: &mut Context<'_>) -> Poll<()> {
        let own = self.events.pop_front();
        let polled = self.wait_for_calls(cx);
        if let Some(own) = own {
            self.events.push_front(own);
        }
        polled
    }
}
