//! The replay of one process. It detects where the process differs from the recording.

use super::Replayer;
use super::branch_log::BranchLog;
use super::stamps::{LATE, at};
use crate::error::{Divergence, RecordError};
use crate::event::{Event as Noted, Kind};
use luna_core::current;
use luna_core::replay_log::{About, Event, Turn, What};
use luna_core::timer_queue::Sleep;
use std::cell::{Cell, RefCell};
use std::collections::{HashMap, VecDeque};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::task::{Context, Poll};

/// Highest number of polls of a process without an event, when one of its branch logs is past what
/// was recorded: the others may have some left.
const MAX_IDLE_POLLS: u32 = 1000;

/// The replay of one process.
pub(crate) struct Track {
    pub(super) replayer: Arc<Replayer>,
    pub(super) name: String,
    /// In the recording, from 1.
    pub(super) number: u32,
    pub(super) branch_logs: RefCell<HashMap<u32, BranchLog>>,
    pub(super) end: RefCell<Pin<Box<Sleep>>>,
    pub(super) begun: Cell<bool>,
    pub(super) outputs: Cell<u64>,
    /// The recording has nothing more of it.
    pub(super) past_end: Cell<bool>,
    /// It returned in the recording. Otherwise operations of a branch log after its last event were
    /// not recorded.
    pub(super) returns: bool,
    /// A branch log has completed an operation at once after that: it cannot be made to wait for
    /// that.
    pub(super) has_overrun: Cell<bool>,
    /// How often it was polled since the last event or operation.
    pub(super) idle_polls: Cell<u32>,
}

impl Track {
    /// Whether the body is not to be polled any more: it has come further than the recording, or
    /// the replay has come to a difference, and it would only go on.
    pub(crate) fn rests(&self) -> bool {
        let is_at_cut = |branch_log: &BranchLog| {
            let next = branch_log.events.front();
            next.is_some_and(|event| {
                matches!(event.kind, Kind::Cut(_)) && event.operation <= branch_log.operations
            })
        };
        if self.has_overrun.get() || self.branch_logs.borrow().get(&0).is_some_and(is_at_cut) {
            let polls = self.idle_polls.get() + 1;
            self.idle_polls.set(polls);
            if polls > MAX_IDLE_POLLS {
                self.past_end.set(true);
            }
        }
        self.past_end.get() || self.replayer.differs()
    }

    /// Whether the body may be polled for the first time.
    pub(crate) fn begins(&self, cx: &mut Context<'_>) -> bool {
        if !self.begun.get() {
            let mut branch_logs = self.branch_logs.borrow_mut();
            let polled = branch_logs
                .get_mut(&0)
                .map_or(Poll::Ready(()), |branch_log| branch_log.wait_for_calls(cx));
            self.begun.set(polled.is_ready());
        }
        self.begun.get()
    }

    /// Whether nothing more comes, so that the body, which is at rest, is to be dropped.
    pub(crate) fn is_over(&self, cx: &mut Context<'_>) -> bool {
        let is_over = self.end.borrow_mut().as_mut().poll(cx).is_ready();
        if is_over {
            self.replayer.is_over.store(true, Ordering::Relaxed);
            self.check_rest();
        }
        is_over
    }

    /// The process has returned.
    pub(crate) fn end(&self) {
        if self.is_off() {
            return;
        }
        let mut branch_logs = self.branch_logs.borrow_mut();
        let branch_log = branch_logs
            .entry(0)
            .or_insert_with(|| BranchLog::new(VecDeque::new()));
        let operation = branch_log.operations;
        let is_end = |event: &mut Noted| event.kind == Kind::Ended && event.operation == operation;
        if branch_log.events.pop_front_if(is_end).is_none() {
            return self.unexpected(branch_log, None, "the process returns");
        }
        drop(branch_logs);
        self.replayer.replayed.fetch_add(1, Ordering::Relaxed);
        self.check_rest();
    }

    /// Checks that all recorded events were replayed.
    pub(super) fn check_rest(&self) {
        if self.replayer.differs() || !self.replayer.is_whole || self.past_end.get() {
            return;
        }
        let branch_logs = self.branch_logs.borrow();
        for branch_log in branch_logs.values() {
            let next = branch_log.events.front();
            if let Some(event) = next.filter(|event| !matches!(event.kind, Kind::Cut(_))) {
                let (expected, operation) = (described(event), event.operation);
                return self.differ(operation, None, expected, "nothing");
            }
        }
    }

    pub(super) fn differ(
        &self,
        operation: u64,
        output: Option<u64>,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) {
        self.replayer
            .note(RecordError::Diverged(Box::new(Divergence {
                event: self.replayer.replayed.load(Ordering::Relaxed),
                process: self.name.clone(),
                operation,
                output,
                expected: expected.into(),
                found: found.into(),
            })));
    }

    /// The process does something else than the next event of the branch log.
    pub(super) fn unexpected(&self, branch_log: &BranchLog, output: Option<u64>, found: &str) {
        let operation = branch_log.operations;
        match branch_log.events.front() {
            Some(event) => self.differ(operation, output, described(event), found),
            None => self.beyond(operation, found),
        }
    }

    /// The process does something that is beyond the end of the recording.
    fn beyond(&self, operation: u64, found: &str) {
        if self.replayer.is_whole {
            self.differ(operation, None, "nothing more", found);
        }
        self.past_end.set(true);
    }

    pub(super) fn is_off(&self) -> bool {
        self.past_end.get()
            || self.replayer.differs()
            || self.replayer.is_over.load(Ordering::Relaxed)
    }

    pub(super) fn with_branch_log<R>(&self, f: impl FnOnce(&mut BranchLog) -> R) -> R {
        let mut branch_logs = self.branch_logs.borrow_mut();
        let branch_log = branch_logs
            .entry(current::branch_path())
            .or_insert_with(|| BranchLog::new(VecDeque::new()));
        f(branch_log)
    }

    /// Takes the branch log's next event, if it belongs to the present operation and is a call
    /// exactly if `is_call`.
    pub(super) fn take_event(&self, is_call: bool) -> Option<Noted> {
        self.with_branch_log(|branch_log| {
            let operation = branch_log.operations;
            branch_log.events.pop_front_if(|event| {
                let is_same = event.operation == operation && event.is_call == is_call;
                is_same && !matches!(event.kind, Kind::Cut(_))
            })
        })
        .inspect(|_| {
            self.idle_polls.set(0);
            self.replayer.replayed.fetch_add(1, Ordering::Relaxed);
        })
    }

    pub(super) fn entering(
        &self,
        branch_log: &mut BranchLog,
        cx: &mut Context<'_>,
    ) -> Poll<Result<Turn, &'static str>> {
        let operation = branch_log.operations;
        let Some(event) = branch_log.events.front() else {
            return match current::branch_path() {
                0 => Poll::Ready(Err("it goes on")),
                // A branch that has no events, or none any more, foresees all, as its process goes
                // on to its end.
                _ if self.returns => Poll::Ready(Ok(Turn::Look)),
                // How far it had come was not recorded.
                _ => Poll::Pending,
            };
        };
        if event.operation < operation {
            return match event.kind {
                Kind::Cut(_) => Poll::Pending,
                Kind::Ended => Poll::Ready(Err("it goes on")),
                _ => Poll::Ready(Err("another operation")),
            };
        }
        if event.operation > operation {
            return Poll::Ready(Ok(Turn::Look));
        }
        let is_cut = matches!(event.kind, Kind::Cut(_));
        if event.is_call && !is_cut {
            return Poll::Ready(Err("an operation that may wait"));
        }
        match event.kind {
            Kind::Outcome(outcome) => {
                let polled = match outcome.what {
                    What::Done | What::Chosen if outcome.stamp != 0 => {
                        branch_log.wait_for(at(outcome.stamp), cx)
                    }
                    What::Failed | What::TimedOut => branch_log.wait_for_calls_after_this(cx),
                    _ => Poll::Ready(()),
                };
                polled.map(|()| Ok(Turn::Given(outcome)))
            }
            // A partner may have had it all the same: so it is offered, when all else has happened.
            Kind::Cut(true) => branch_log.wait_for(at(LATE), cx).map(|()| Ok(Turn::Look)),
            // The end is the last event.
            Kind::Bytes { .. } | Kind::Ended | Kind::Cut(false) => Poll::Ready(Ok(Turn::Look)),
        }
    }

    /// There is no event for what is done now.
    pub(super) fn nothing_for(&self, output: Option<u64>, found: &str) {
        self.with_branch_log(|branch_log| {
            let is_cut = match branch_log.events.front() {
                Some(event) => {
                    matches!(event.kind, Kind::Cut(_)) && event.operation < branch_log.operations
                }
                None => current::branch_path() != 0 && !self.returns,
            };
            match is_cut {
                true => self.has_overrun.set(true),
                false => self.unexpected(branch_log, output, found),
            }
        });
    }
}

/// An event as text.
pub(super) fn described(event: &Noted) -> String {
    let call = if event.is_call { " at once" } else { "" };
    match &event.kind {
        Kind::Outcome(outcome) => outcome_text(*outcome, call),
        Kind::Bytes { about, bytes, .. } => match about {
            About::Input => "an input".to_owned(),
            About::Output => format!("the output {bytes:?}"),
            About::Cycle => "a cycle of a loop".to_owned(),
            About::Read => "bytes from outside".to_owned(),
        },
        Kind::Ended => "that the process returns".to_owned(),
        Kind::Cut(_) => "that the process is ended".to_owned(),
    }
}

/// An outcome as text, of a `call` or of an operation that waits.
pub(super) fn outcome_text(Event { what, number, .. }: Event, call: &str) -> String {
    match what {
        What::Done => format!("a success{call}"),
        What::Failed => format!("a failure{call} ({number})"),
        What::TimedOut => "a timeout".to_owned(),
        What::Chosen => format!("guard {number}"),
        What::Time => "a look at the clock".to_owned(),
    }
}
