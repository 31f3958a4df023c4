//! The replay log: the recorded results of a replayed process' operations.

use super::branch_log::Stage;
use super::stamps::after;
use super::track::{Track, described, outcome_text};
use crate::error::RecordError;
use crate::event::{Event as Noted, Kind};
use luna_core::replay_log::{About, Event, ReplayLog, Turn, What};
use std::task::{Context, Poll};

/// What a [call](ReplayLog::call) is.
const AT_ONCE: &str = "an operation at once";

impl ReplayLog for Track {
    fn enter(&self, cx: &mut Context<'_>) -> Poll<Turn> {
        if self.is_off() {
            return Poll::Pending;
        }
        self.with_branch_log(|branch_log| {
            match branch_log.stage {
                Stage::Running(turn) => return Poll::Ready(turn),
                Stage::Entering => {}
                Stage::Idle => {
                    branch_log.operations += 1;
                    branch_log.is_call = false;
                    branch_log.stage = Stage::Entering;
                }
            }
            match self.entering(branch_log, cx) {
                Poll::Pending => Poll::Pending,
                Poll::Ready(Ok(turn)) => {
                    branch_log.stage = Stage::Running(turn);
                    Poll::Ready(turn)
                }
                Poll::Ready(Err(found)) => {
                    self.unexpected(branch_log, None, found);
                    Poll::Pending
                }
            }
        })
    }

    fn call(&self, _: bool) -> Turn {
        if self.is_off() {
            return Turn::Look;
        }
        self.with_branch_log(|branch_log| {
            branch_log.operations += 1;
            branch_log.is_call = true;
            branch_log.stage = Stage::Running(Turn::Look);
        });
        let turn = match self.take_event(true) {
            Some(Noted {
                kind: Kind::Outcome(outcome),
                ..
            }) => Turn::Given(outcome),
            Some(event) => {
                self.differ(event.operation, None, described(&event), AT_ONCE);
                Turn::Look
            }
            None => {
                self.nothing_for(None, AT_ONCE);
                Turn::Look
            }
        };
        self.with_branch_log(|branch_log| branch_log.stage = Stage::Running(turn));
        turn
    }

    fn is_replay(&self) -> bool {
        true
    }

    fn leave(&self, event: Event) {
        if self.is_off() {
            return;
        }
        let stage = self
            .with_branch_log(|branch_log| std::mem::replace(&mut branch_log.stage, Stage::Idle));
        let Stage::Running(turn) = stage else { return };
        self.idle_polls.set(0);
        let operation = self.with_branch_log(|branch_log| branch_log.operations);
        match turn {
            Turn::Given(given) => {
                if !self.with_branch_log(|branch_log| branch_log.is_call) {
                    self.take_event(false);
                }
                let is_same = given.what == event.what
                    && (given.number == event.number || given.what == What::Time);
                if !is_same {
                    let (expected, found) = (outcome_text(given, ""), outcome_text(event, ""));
                    self.differ(operation, None, expected, found);
                }
            }
            _ if event.what == What::Done => {}
            _ => self.differ(operation, None, "a success", "another outcome"),
        }
    }

    fn abandon(&self, was_let_in: bool) {
        self.with_branch_log(|branch_log| {
            if was_let_in || branch_log.stage == Stage::Entering {
                branch_log.stage = Stage::Idle;
            }
        });
    }

    fn hold(&self, cx: &mut Context<'_>) -> Poll<()> {
        if self.is_off() {
            return Poll::Pending;
        }
        self.with_branch_log(|branch_log| {
            match branch_log.events.front().map(|event| &event.kind) {
                // What came after it was not recorded any more.
                Some(Kind::Cut(_))
                    if branch_log.events[0].operation == branch_log.operations
                        && !branch_log.events[0].is_call =>
                {
                    Poll::Pending
                }
                _ => branch_log.wait_for_calls(cx),
            }
        })
    }

    fn stamp(&self, _: bool) -> u64 {
        self.with_branch_log(|branch_log| match branch_log.stage {
            Stage::Running(Turn::Given(event)) => event.stamp,
            _ => 0,
        })
    }

    fn own_stamp(&self) -> u64 {
        0
    }

    fn put(&self, about: About, name: u32, bytes: &[u8]) {
        if self.is_off() {
            return;
        }
        self.with_branch_log(|branch_log| branch_log.operations += 1);
        let output = self.outputs.get() + 1;
        self.outputs.set(output);
        let Some(event) = self.take_event(true) else {
            return self.nothing_for(Some(output), "an output");
        };
        if event.bytes_of(about, name) != Some(bytes) {
            let found = format!("the output {bytes:?}");
            self.differ(event.operation, Some(output), described(&event), found);
        }
    }

    fn get(&self, about: About, name: u32, into: &mut [u8]) -> Option<usize> {
        if self.is_off() {
            return None;
        }
        let is_call = matches!(about, About::Input | About::Output);
        self.with_branch_log(|branch_log| match is_call {
            true => branch_log.operations += 1,
            false => branch_log.stage = Stage::Idle,
        });
        let what = match about {
            About::Cycle => "a cycle of a loop",
            About::Read => "bytes from outside",
            _ => "an input",
        };
        let Some(event) = self.take_event(is_call) else {
            self.nothing_for(None, what);
            return None;
        };
        let bytes = event.bytes_of(about, name);
        let Some(bytes) = bytes.filter(|bytes| bytes.len() <= into.len()) else {
            let found = format!("other than {what}");
            self.differ(event.operation, None, described(&event), found);
            return None;
        };
        into[..bytes.len()].copy_from_slice(bytes);
        Some(bytes.len())
    }

    fn branch_log(&self) -> u32 {
        1
    }

    fn process(&self) -> u32 {
        self.number
    }

    fn outside(&self, construct: &'static str) {
        if !self.is_off() {
            self.replayer.note(RecordError::Outside {
                process: self.name.clone(),
                construct: construct.to_owned(),
            });
        }
    }

    fn settle(&self, cx: &mut Context<'_>) -> Poll<()> {
        self.with_branch_log(|branch_log| match branch_log.stage {
            Stage::Running(Turn::Given(Event { stamp, .. })) if stamp != 0 => {
                branch_log.wait_for(after(stamp), cx)
            }
            _ => Poll::Ready(()),
        })
    }

    fn differs(&self, what: &'static str) {
        if !self.is_off() {
            self.with_branch_log(|branch_log| {
                let expected = match branch_log.stage {
                    Stage::Running(Turn::Given(_)) => "that it does",
                    _ => "something else",
                };
                self.differ(branch_log.operations, None, expected, what);
            });
        }
    }
}
