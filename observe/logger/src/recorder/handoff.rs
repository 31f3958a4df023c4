//! Hands blocks from the recorder's thread to the sink's thread, so that a sink that never returns
//! blocks the program only for a limited time.
//!
//! The recorder hands over a block and waits for its outcome, without limit while the recording
//! goes on. At the end of the recording a limit is set. What the sink has not taken by then counts
//! as refused, and the sink's thread is detached. A sink that panics is ended at once, so that it
//! can report the losses among what it had taken; a sink that never returns cannot.

use super::sink::Sink;
use crate::format::Tally;
use crate::monitor::Monitor;
use crate::thread::start;
use luna_platform::thread::Thread;
use std::collections::VecDeque;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Pause before a block is offered again to a sink that could not take it.
const AGAIN: Duration = Duration::from_millis(10);

/// How much longer than its limit a sink may take to report the last block's outcome. It is also
/// the time to end that a sink has in any case, counted from the request, which comes at the latest
/// when the first has passed.
const GRACE: Duration = Duration::from_secs(5);

/// The error of a block after the time limit.
pub(super) const LATE: &str = "it had not been taken when the time limit at the end had passed";

/// The recorder's end.
pub(super) struct Handoff {
    shared: Arc<Shared>,
    /// None if it is detached.
    thread: Option<Thread<()>>,
    news: News,
}

/// A sink's reports beside the outcome of a block.
#[derive(Default)]
struct News {
    wants_declarations: bool,
    lost: VecDeque<Tally>,
}

impl News {
    fn add(&mut self, lost: Tally) {
        if !lost.is_empty() {
            self.lost.push_back(lost);
        }
    }
}

type Shared = Monitor<State>;

#[derive(Default)]
struct State {
    job: Job,
    /// The current block.
    block: Vec<u8>,
    outcome: Option<io::Result<()>>,
    news: News,
    /// When the sink is to have ended.
    limit: Option<Instant>,
    /// When it is left alone, without the [grace](GRACE) behind its limit.
    gives_up: Option<Instant>,
    is_left_alone: bool,
    /// The sink's thread has ended, also by a panic.
    is_gone: bool,
}

#[derive(Default, Clone, Copy, PartialEq)]
enum Job {
    #[default]
    None,
    Block,
    /// Only collect its reports.
    Ask,
    End,
}

/// Sets the limit from another thread.
#[derive(Clone)]
pub(super) struct Limiter(Arc<Shared>);

impl Limiter {
    /// From now on the sink has this long.
    pub(super) fn end_within(&self, limit: Duration) {
        let at = Instant::now() + limit.min(Duration::from_secs(86_400));
        self.0.change(|state| state.limit = Some(at));
    }

    /// From now on the sink has this long, and no grace.
    pub(super) fn give_up_within(&self, limit: Duration) {
        let at = Instant::now() + limit;
        self.0.change(|state| {
            state.limit = Some(state.limit.map_or(at, |limit| limit.min(at)));
            state.gives_up = Some(at);
        });
    }
}

/// Waits until `is_so`, or the deadline. Returns whether `is_so`. `asked_to_end`: when the sink was
/// asked to end.
fn wait_until(
    shared: &Shared,
    asked_to_end: Option<Instant>,
    is_so: impl Fn(&State) -> bool,
) -> bool {
    let mut state = shared.lock();
    while !is_so(&state) {
        let (limit, gives_up) = (state.limit, state.gives_up);
        let left = limit.map_or(Duration::from_secs(3600), |limit| {
            let deadline = deadline(limit, asked_to_end);
            let until = gives_up.map_or(deadline, |at| at.min(deadline));
            until.saturating_duration_since(Instant::now())
        });
        if left.is_zero() {
            state.is_left_alone = true;
            shared.wake();
            return false;
        }
        // A limit may have been set meanwhile.
        let is_as_before = |state: &State| (state.limit, state.gives_up) == (limit, gives_up);
        state = shared.wait_while_within(state, left, |state| !is_so(state) && is_as_before(state));
    }
    true
}

/// The deadline for the sink: one for all its blocks, and one for its end, which may be requested
/// late.
fn deadline(limit: Instant, asked_to_end: Option<Instant>) -> Instant {
    asked_to_end.map_or(limit, |asked| limit.max(asked)) + GRACE
}

impl Handoff {
    /// Starts a thread for `sink`.
    pub(super) fn start(sink: Box<dyn Sink>) -> io::Result<Self> {
        let shared = Arc::<Shared>::default();
        let theirs = shared.clone();
        let thread = start("luna-recording", move || {
            // Dropped last, after everything that the sink closes.
            let gone = Gone(theirs);
            let mut sink = sink;
            let served = catch_unwind(AssertUnwindSafe(|| serve(&gone.0, &mut *sink)));
            if let Err(panic) = served {
                // The sink may hold blocks that it has taken but not kept for good.
                let ended = AssertUnwindSafe(|| sink.end(Duration::ZERO));
                let _ = catch_unwind(ended);
                let lost = catch_unwind(AssertUnwindSafe(|| sink.take_lost()));
                gone.0.lock().news.add(lost.unwrap_or_default());
                resume_unwind(panic);
            }
        })?;
        Ok(Self {
            shared,
            thread: Some(thread),
            news: News::default(),
        })
    }

    pub(super) fn limiter(&self) -> Limiter {
        Limiter(self.shared.clone())
    }

    /// Hands over a block. Returns its outcome.
    pub(super) fn block(&mut self, block: &[u8]) -> io::Result<()> {
        {
            let mut state = self.shared.lock();
            state.block.clear();
            state.block.extend_from_slice(block);
        }
        self.ask_for(Job::Block, None)
    }

    /// Collects the sink's reports.
    pub(super) fn ask(&mut self) {
        // Without an answer there are no reports.
        let _ = self.ask_for(Job::Ask, None);
    }

    fn ask_for(&mut self, job: Job, asked_to_end: Option<Instant>) -> io::Result<()> {
        let late = || io::Error::new(io::ErrorKind::TimedOut, LATE);
        {
            let mut state = self.shared.lock();
            let last = state.limit.map(|limit| deadline(limit, None));
            let last = state.gives_up.or(last);
            let is_late = last.is_some_and(|last| Instant::now() > last);
            if self.thread.is_none() || is_late && job != Job::End {
                return Err(late());
            }
            state.job = job;
        }
        self.shared.wake();
        wait_until(&self.shared, asked_to_end, |state| {
            state.outcome.is_some() || state.is_gone
        });
        let mut state = self.shared.lock();
        self.news.wants_declarations |= std::mem::take(&mut state.news.wants_declarations);
        self.news.lost.append(&mut state.news.lost);
        // The outcome may have come while the limit passed: then it counts.
        match state.outcome.take() {
            Some(outcome) => outcome,
            None => {
                let is_gone = state.is_gone && !state.is_left_alone;
                drop(state);
                self.thread = None;
                Err(match is_gone {
                    true => io::Error::other("the sink panicked"),
                    false => late(),
                })
            }
        }
    }

    /// Whether everything is to be declared again, since the last call.
    pub(super) fn wants_declarations(&mut self) -> bool {
        std::mem::take(&mut self.news.wants_declarations)
    }

    /// What was taken, and is lost nevertheless.
    pub(super) fn take_lost(&mut self) -> Option<Tally> {
        self.news.lost.pop_front()
    }

    /// Ends the sink within the limit. The error is not of any block.
    pub(super) fn end(&mut self) -> io::Result<()> {
        let asked = Some(Instant::now());
        let outcome = self.ask_for(Job::End, asked);
        let Some(thread) = self.thread.take() else {
            return outcome;
        };
        if wait_until(&self.shared, asked, |state| state.is_gone) {
            let _ = thread.join();
        }
        outcome
    }
}

/// Marks the thread as ended.
struct Gone(Arc<Shared>);

impl Drop for Gone {
    fn drop(&mut self) {
        self.0.change(|state| state.is_gone = true);
    }
}

/// The sink's thread.
fn serve(shared: &Shared, sink: &mut dyn Sink) {
    // Swapped with the current block, so that the sink works on it without the lock.
    let mut block = Vec::new();
    loop {
        let mut state = shared.wait_while(shared.lock(), |state| {
            state.job == Job::None && !state.is_left_alone
        });
        if state.is_left_alone {
            return;
        }
        let job = state.job;
        let limit = state.limit;
        state.job = Job::None;
        std::mem::swap(&mut state.block, &mut block);
        drop(state);
        let outcome = match job {
            Job::Block => match take(shared, sink, &block) {
                Some(outcome) => outcome,
                None => return,
            },
            Job::End => {
                let left = limit.map_or(Duration::MAX, |limit| {
                    limit.saturating_duration_since(Instant::now())
                });
                sink.end(left)
            }
            Job::Ask | Job::None => Ok(()),
        };
        let (wants, lost) = (sink.wants_declarations(), sink.take_lost());
        shared.change(|state| {
            state.news.wants_declarations |= wants;
            state.news.add(lost);
            state.outcome = Some(outcome);
        });
        if job == Job::End {
            return;
        }
    }
}

/// Offers a block until the sink has decided. None if the thread is detached.
fn take(shared: &Shared, sink: &mut dyn Sink, block: &[u8]) -> Option<io::Result<()>> {
    loop {
        match sink.block(block) {
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
            outcome => return Some(outcome),
        }
        let waited = shared.wait_while_within(shared.lock(), AGAIN, |state| !state.is_left_alone);
        if waited.is_left_alone {
            return None;
        }
    }
}

impl Drop for Handoff {
    fn drop(&mut self) {
        self.shared.change(|state| state.is_left_alone = true);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waiting_for_a_sink_at_the_end_is_bounded_in_all() {
        let limit = Instant::now() + Duration::from_secs(100);
        // Independently of when a block is offered.
        let blocks = deadline(limit, None);
        assert_eq!(blocks, limit + GRACE);
        assert_eq!(deadline(limit, Some(limit - GRACE)), blocks);
        // No block is offered after that, so the end is requested then at the latest.
        assert_eq!(deadline(limit, Some(blocks)), limit + 2 * GRACE);
    }
}
