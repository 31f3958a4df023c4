//! The replay log: the recorded results of a replayed process' operations.

use super::branch_log::Stage;
use super::stamps::after;
use super::track::{Track, described};
use crate::replay::error::RecordError;
use crate::replay::event::{Event as Noted, Kind};
use luna_core::replay_log::{About, Event, ReplayLog, Turn, What};
use std::task::{Context, Poll};

impl ReplayLog for Track {
    fn enter(&self, cx: &mut Context<'_>) -> Poll<Turn> {
        if self.is_off() {
            return Poll::Pending;
        }
        let entered = self.with_branch_log(|branch_log| {
            match branch_log.stage {
                Stage::Running(turn) => return Poll::Ready(Ok(turn)),
                Stage::Entering => {}
                Stage::Idle => {
                    branch_log.operations += 1;
                    branch_log.is_call = false;
                    branch_log.stage = Stage::Entering;
                }
            }
            let entered = self.entering(branch_log, cx);
            if let Poll::Ready(Ok(turn)) = entered {
                branch_log.stage = Stage::Running(turn);
            }
            entered.map_err(|found| {
                (
                    branch_log.operations,
                    branch_log.events.front().map(described),
                    found,
                )
            })
        });
        match entered {
            Poll::Pending => Poll::Pending,
            Poll::Ready(Ok(turn)) => Poll::Ready(turn),
            Poll::Ready(Err((operation, expected, found))) => {
                match expected {
                    Some(expected) => self.differ(operation, None, expected, found.into()),
                    None => self.beyond(operation, found),
                }
                Poll::Pending
            }
        }
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
                let operation = event.operation;
                self.differ(
                    operation,
                    None,
                    described(&event),
                    "an operation at once".into(),
                );
                Turn::Look
            }
            None => {
                self.nothing_for(None, "an operation at once");
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
                    let words = |event: Event| {
                        described(&Noted {
                            path: 0,
                            operation,
                            is_call: false,
                            kind: Kind::Outcome(event),
                        })
                    };
                    self.differ(operation, None, words(given), words(event));
                }
            }
            _ if event.what == What::Done => {}
            _ => self.differ(
                operation,
                None,
                "a success".into(),
                "another outcome".into(),
            ),
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
        match self.take_event(true) {
            Some(Noted {
                kind:
                    Kind::Bytes {
                        about: of,
                        name: named,
                        bytes: recorded,
                    },
                ..
            }) if of == about && named == name && recorded == bytes => {}
            Some(event) => {
                let found = format!("the output {bytes:?}");
                self.differ(event.operation, Some(output), described(&event), found);
            }
            None => self.nothing_for(Some(output), "an output"),
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
        match self.take_event(is_call) {
            Some(Noted {
                kind:
                    Kind::Bytes {
                        about: of,
                        name: named,
                        bytes,
                    },
                ..
            }) if of == about && named == name && bytes.len() <= into.len() => {
                into[..bytes.len()].copy_from_slice(&bytes);
                Some(bytes.len())
            }
            Some(event) => {
                self.differ(
                    event.operation,
                    None,
                    described(&event),
                    format!("other than {what}"),
                );
                None
            }
            None => {
                self.nothing_for(None, what);
                None
            }
        }
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
            let (operation, expected) = self.with_branch_log(|branch_log| {
                (
                    branch_log.operations,
                    match branch_log.stage {
                        Stage::Running(Turn::Given(_)) => "that it does",
                        _ => "something else",
                    },
                )
            });
            self.differ(operation, None, expected.into(), what.into());
        }
    }
}
