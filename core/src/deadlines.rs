//! How an executor finds out that a deadline is due, without reading the clock before each poll.
//!
//! A bit of the word that each round looks at anyway ([`Inbound`](crate::inbound::Inbound))
//! requests a look at the deadlines. It is set in one of two ways:
//!
//! ```text
//!               a deadline is armed, or the executor wakes and has one
//!   calm -----------------------------> looking: the bit stays set, each round reads the clock
//!     ^                                    |  ^
//!     | the thread sleeps                  |  | the alarm rang; a loop's cycle begins
//!     |    after 32 rounds, if none is near v  |
//!     '---------------------------------- busy: the alarm sets the bit
//! ```
//!
//! *Looking* costs a clock read a round, which is less than an alarm as long as the thread soon
//! sleeps again. A thread that has not slept for [`ROUNDS_OF_LOOKING`] rounds is *busy*: then the
//! [`Alarm`] is armed for [`LEAD`] before the earliest deadline. From then on the executor looks
//! until the deadline has come. So it notices each deadline at the first turn boundary behind it,
//! and the time in which the alarm's thread wakes makes no process late.
//!
//! The timer queue announces an earlier deadline
//! ([`DeadlineListener`](crate::timer_queue::DeadlineListener)), which arms the alarm again. A
//! later one does not, and after a cancelled one it rings without effect. So any number of timeouts
//! that are set and dropped costs one system call. The thread disarms it before it sleeps, since it
//! then has the deadline from its sleep.
//!
//! After a deadline, too, the executor reads the clock for [`ROUNDS_OF_LOOKING`] rounds. It then
//! knows the begin and the end of each turn that delays the woken process ([`interference`]). Of
//! the turn in which the alarm rings it knows the end, and the time of the ring.
//!
//! Without an alarm (the program may have no thread of a higher priority, or a process on a thread
//! of its own) the executor looks as long as any deadline is armed.

use crate::executor::{Serves, Shared};
use crate::interference;
use crate::timer_queue::TimerQueue;
use core::cell::Cell;
use luna_platform::alarm::Alarm;
use luna_platform::clock::Instant;
use luna_platform::sync::Arc;

/// How long before a deadline the alarm rings, in nanoseconds: what its thread takes to run, with a
/// margin. The executor's rounds are slower for so long.
const LEAD: u64 = 20_000;

/// For how many rounds the executor looks at the clock: together they cost about as much as an
/// alarm that is armed, rings, and is disarmed.
const ROUNDS_OF_LOOKING: u32 = 32;

/// The deadlines of an executor's thread.
///
/// # Invariants
///
/// While `looks` is not 0 the bit is set, and the queue announces nothing. While the executor is
/// busy, it announces what comes before [`LEAD`] after `armed`. The alarm is armed for `armed`, or
/// has rung for it; [`Instant::NEVER`] if it is not armed.
pub(crate) struct Deadlines {
    shared: Arc<Shared>,
    timers: Arc<TimerQueue>,
    alarm: Option<Alarm>,
    armed: Cell<Instant>,
    /// For how many more rounds the executor looks; 0: it does not.
    looks: Cell<u32>,
    is_busy: Cell<bool>,
}

impl Deadlines {
    /// For the executor `shared`, on its thread.
    pub(crate) fn new(shared: Arc<Shared>, timers: Arc<TimerQueue>) -> Self {
        let alarm = || {
            let shared = shared.clone();
            Alarm::new(move || shared.inbound.ring())
        };
        let has_alarm = shared.serves == Serves::Many;
        Self {
            alarm: has_alarm.then(alarm).flatten(),
            shared,
            timers,
            armed: Cell::new(Instant::NEVER),
            looks: Cell::new(0),
            is_busy: Cell::new(false),
        }
    }

    /// Wakes all processes with a deadline that has come. Called between two polls, when the bit is
    /// set.
    #[inline(never)]
    pub(crate) fn look(&self) {
        if self.looks.get() == 0 && !self.begin() {
            return;
        }
        let now = Instant::now();
        interference::look(now);
        let next = self.timers.next_deadline();
        if next <= now {
            self.timers.expire(now);
            self.looks.set(ROUNDS_OF_LOOKING);
        } else if next.nanos_since(now) > LEAD {
            self.looks.set(self.looks.get() - 1);
            if self.looks.get() == 0 {
                self.end();
            }
        }
    }

    /// Begins to look. `false`: only the alarm was to be armed.
    fn begin(&self) -> bool {
        let inbound = &self.shared.inbound;
        // First: what comes from here on sets the bit again.
        inbound.take_look();
        let rung = self.take_rung();
        if self.is_busy.get() && rung.is_none() && !interference::is_looking() {
            // Triggered by a new deadline, which may have come in the turn that has just ended.
            let deadline = self.timers.provided();
            if deadline.nanos_since(Instant::now()) > LEAD && self.arm(deadline) {
                return false;
            }
        }
        inbound.ask_look();
        self.timers.provide(Instant::from_nanos(0));
        self.looks.set(ROUNDS_OF_LOOKING);
        if let Some(rung) = rung {
            interference::looked(rung);
        }
        true
    }

    /// Looks no more, and sets the alarm to the next deadline. Without an alarm it looks on.
    #[cold]
    fn end(&self) {
        let inbound = &self.shared.inbound;
        // First: if the alarm rings from here on, it sets the bit.
        inbound.take_look();
        self.take_rung();
        if self.arm(self.timers.next_deadline()) {
            self.is_busy.set(true);
            let rings = self.armed.get();
            self.timers.provide(rings.plus_nanos(LEAD));
            interference::look_no_more();
        } else {
            inbound.ask_look();
            self.looks.set(ROUNDS_OF_LOOKING);
        }
    }

    /// The thread is about to sleep. Gives when it is to wake.
    pub(crate) fn rest(&self) -> Instant {
        if self.armed.replace(Instant::NEVER) != Instant::NEVER
            && let Some(alarm) = &self.alarm
        {
            alarm.disarm();
        }
        self.is_busy.set(false);
        let inbound = &self.shared.inbound;
        let next = self.timers.next_deadline();
        if next == Instant::NEVER {
            if inbound.signals().deadline() {
                inbound.take_look();
            }
            self.looks.set(0);
            self.timers.provide(Instant::NEVER);
        } else {
            inbound.ask_look();
            self.looks.set(ROUNDS_OF_LOOKING);
            self.timers.provide(Instant::from_nanos(0));
        }
        next
    }

    /// Has the alarm ring [`LEAD`] before `deadline`, or earlier. `false`: there is none.
    fn arm(&self, deadline: Instant) -> bool {
        let Some(alarm) = &self.alarm else {
            return false;
        };
        let at = Instant::from_nanos(deadline.as_nanos().saturating_sub(LEAD));
        if deadline != Instant::NEVER && at < self.armed.get() {
            alarm.arm(at);
            self.armed.set(at);
            #[cfg(test)]
            tests::ARMED.set(tests::ARMED.get() + 1);
        }
        true
    }

    /// When the alarm rang, if it has.
    fn take_rung(&self) -> Option<Instant> {
        let rung = self.alarm.as_ref()?.take_rung()?;
        self.armed.set(Instant::NEVER);
        Some(rung)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::timer_queue::Sleep;
    use crate::{Executor, Exit, OsThread, ProcessSpec, yield_now};
    use alloc::rc::Rc;
    use core::pin::{Pin, pin};
    use core::task::{Context, Waker};
    use core::time::Duration;
    use luna_platform::thread::Attributes;

    thread_local! {
        /// How often an alarm of this thread was armed: the system calls that deadlines have cost.
        pub(super) static ARMED: Cell<u32> = const { Cell::new(0) };
    }

    fn has_alarm() -> bool {
        let has_alarm = Alarm::new(|| ()).is_some();
        if !has_alarm {
            println!("skipped: an alarm needs SCHED_FIFO");
        }
        has_alarm
    }

    /// Runs a process on an executor that is busy already.
    fn on_busy_executor<F: Future<Output = ()> + 'static>(
        body: impl FnOnce() -> F + Send + 'static,
    ) {
        let executor = Executor::start(Attributes::new("main")).unwrap();
        let process = executor.spawn(ProcessSpec::new("busy"), move || async move {
            // The first deadline makes it look, for so long.
            let mut sleep = pin!(Sleep::until(Instant::now() + Duration::from_secs(1000)));
            poll(sleep.as_mut());
            for _ in 0..2 * ROUNDS_OF_LOOKING {
                yield_now().await;
            }
            body().await;
        });
        executor.release();
        assert_eq!(process.wait(), Exit::Completed);
    }

    fn poll(sleep: Pin<&mut Sleep>) {
        assert!(
            sleep
                .poll(&mut Context::from_waker(Waker::noop()))
                .is_pending()
        );
    }

    #[test]
    fn timeouts_that_are_set_and_dropped_cost_one_system_call() {
        if !has_alarm() {
            return;
        }
        on_busy_executor(|| async {
            let before = ARMED.get();
            let first = Instant::now() + Duration::from_secs(500);
            for number in 0..100_000 {
                let mut sleep = pin!(Sleep::until(first.plus_nanos(number)));
                poll(sleep.as_mut());
                if number % 100 == 0 {
                    yield_now().await;
                }
            }
            assert_eq!(ARMED.get() - before, 1);
        });
    }

    #[test]
    fn an_earlier_deadline_arms_anew_and_a_later_one_does_not() {
        if !has_alarm() {
            return;
        }
        on_busy_executor(|| async {
            let before = ARMED.get();
            assert!(before >= 1, "the executor is busy, with a deadline");
            let now = Instant::now();
            for (seconds, armed) in [(500, 1), (600, 1), (400, 2), (450, 2), (300, 3)] {
                let mut sleep = pin!(Sleep::until(now + Duration::from_secs(seconds)));
                poll(sleep.as_mut());
                yield_now().await;
                assert_eq!(ARMED.get() - before, armed, "{seconds}");
            }
        });
    }

    /// The alarm rings before a deadline, and so must it before one that is a little earlier.
    #[test]
    fn a_deadline_within_the_lead_of_another_arms_anew() {
        if !has_alarm() {
            return;
        }
        on_busy_executor(|| async {
            let base = Instant::now() + Duration::from_secs(500);
            let mut later = pin!(Sleep::until(base));
            poll(later.as_mut());
            // The executor looks behind a deadline, and then no more.
            Sleep::until(Instant::now() + Duration::from_millis(1)).await;
            for _ in 0..2 * ROUNDS_OF_LOOKING {
                yield_now().await;
            }
            let before = ARMED.get();
            let mut sooner = pin!(Sleep::until(base - Duration::from_nanos(LEAD / 2)));
            poll(sooner.as_mut());
            yield_now().await;
            assert_eq!(ARMED.get() - before, 1);
        });
    }

    #[test]
    fn a_process_that_may_block_has_no_alarm_and_keeps_its_deadlines() {
        let spec = ProcessSpec::new("blocks");
        let thread = OsThread::start(Attributes::new("test"), spec, || async {
            let mut sleep = pin!(Sleep::until(Instant::now() + Duration::from_millis(1)));
            poll(sleep.as_mut());
            for _ in 0..2 * ROUNDS_OF_LOOKING {
                yield_now().await;
            }
            sleep.await;
            assert_eq!(ARMED.get(), 0);
        });
        let thread = thread.unwrap();
        thread.release();
        assert_eq!(thread.process().wait(), Exit::Completed);
    }

    /// It is announced at the end of the turn that sets it, and is due by then.
    #[test]
    fn a_deadline_that_comes_in_the_turn_that_sets_it_is_noticed_after_that_turn() {
        const SHORT: Duration = Duration::from_micros(200);
        on_busy_executor(|| async {
            for _ in 0..20 {
                for _ in 0..2 * ROUNDS_OF_LOOKING {
                    yield_now().await;
                }
                let deadline = Instant::now() + SHORT;
                let mut sleep = pin!(Sleep::until(deadline));
                // Another thread may take the core away until the deadline has passed.
                let polled = sleep.as_mut().poll(&mut Context::from_waker(Waker::noop()));
                if polled.is_ready() {
                    continue;
                }
                while Instant::now() < deadline + SHORT {}
                yield_now().await;
                let again = sleep.poll(&mut Context::from_waker(Waker::noop()));
                assert!(again.is_ready());
            }
        });
    }

    /// The first poll boundary after a deadline notices it, also if an alarm rang without
    /// effect before.
    #[test]
    fn a_busy_executor_notices_a_deadline_after_the_turn_in_which_it_comes() {
        /// A turn, and what an interrupt may be late by.
        const TURN: Duration = Duration::from_millis(2);
        on_busy_executor(|| async {
            // It rings without effect.
            drop({
                let mut sleep = Box::pin(Sleep::until(Instant::now() + TURN));
                poll(sleep.as_mut());
                yield_now().await;
                sleep
            });
            for _ in 0..5 {
                for _ in 0..2 * ROUNDS_OF_LOOKING {
                    yield_now().await;
                }
                let deadline = Instant::now() + 5 * TURN;
                let has_come = Rc::new(Cell::new(false));
                let come = has_come.clone();
                let mut sleep = pin!(async move {
                    Sleep::until(deadline).await;
                    come.set(true);
                });
                let mut late = 0;
                core::future::poll_fn(|cx| {
                    let begin = Instant::now();
                    if sleep.as_mut().poll(cx).is_ready() || late > 1 {
                        return core::task::Poll::Ready(());
                    }
                    // This turn began when the deadline had come long before. That may be once:
                    // another thread may take the core away just before the turn begins.
                    late += u32::from(begin > deadline + TURN);
                    while Instant::now() < begin + TURN {}
                    cx.waker().wake_by_ref();
                    core::task::Poll::Pending
                })
                .await;
                assert!(has_come.get() && late <= 1, "{late} turns too late");
            }
        });
    }
}
