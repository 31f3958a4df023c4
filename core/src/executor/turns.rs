//! The loop of an executor's thread: turns, looks outside, rest.

use super::{Phase, Serves, Shared};
use crate::call_count;
use crate::current;
use crate::deadlines::Deadlines;
use crate::events;
use crate::file_watch;
use crate::inbound::Signals;
use crate::interference;
use crate::park;
use crate::process::{self, Enrolled, prepare_thread, turns};
use crate::spin;
use crate::timer_queue::TimerQueue;
use alloc::sync::Arc;
use core::sync::atomic::Ordering;
use core::time::Duration;
use luna_platform::clock::Instant;
#[cfg(feature = "std")]
use luna_platform::clock::processor_time;
use luna_platform::panics::catch_unwind;

/// How much earlier than a deadline the kernel is to end a sleep, in nanoseconds: what the thread
/// takes from there to the process that waits. If the kernel is quicker than that, the thread reads
/// the clock for the rest.
const EARLY: u64 = 1_000;

/// A shorter sleep, in nanoseconds, is none: the way into the kernel and back may take longer, and
/// a deadline that comes meanwhile is late by it. The thread reads the clock until the deadline
/// instead.
const SHORTEST_SLEEP: u64 = 10_000;

/// The thread of an executor.
pub(super) fn run(shared: Arc<Shared>, _enrolled: Enrolled) {
    let timers = Arc::new(TimerQueue::attended(shared.clone()));
    let deadlines = Deadlines::new(shared.clone(), timers.clone());
    let may_block = shared.serves == Serves::One;
    let _entered = current::enter_executor(shared.executor_id, timers, may_block);
    if may_block {
        // A first blocking call must not allocate.
        park::prepare();
    }
    let _files = file_watch::enter(shared.inbound.bell(), Some(shared.clone()));
    let _calls = call_count::enter(
        shared.quiescence.clone(),
        Some(shared.registry.clone()),
        None,
    );
    prepare_thread();
    let _looking = (shared.spin.load(Ordering::Relaxed) > 0).then(|| spin::enter(shared.clone()));
    let lived = catch_unwind(|| live(&shared, &deadlines));
    // Panics of bodies are caught where they are polled. This one comes from elsewhere: a foreign
    // waker, say.
    if let Err(payload) = lived {
        current::set_on_path(false);
        shared.give_up(payload);
    }
}

/// From the set-up to the end of all processes.
pub(super) fn live(shared: &Arc<Shared>, deadlines: &Deadlines) {
    shared.take_in();
    while shared.phase() == Phase::HELD {
        shared.inbound.sleep(Instant::NEVER);
        shared.take_in();
    }
    current::set_on_path(false);
    // A held executor is not told of arrivals: one that is stopped now builds and cancels them.
    shared.build_arrivals();
    #[cfg(feature = "std")]
    let before = processor_time();
    // Not through the `Arc`, which would be read at each turn.
    let shared = &**shared;
    current::set_on_path(true);
    while let Phase::RELEASED = shared.phase() {
        turns(|| while round(shared, deadlines, true) {});
    }
    current::set_on_path(false);
    #[cfg(feature = "std")]
    if let Some((before, after)) = before.zip(processor_time()) {
        // It runs once.
        let _ = shared.processor_time.set(after.saturating_sub(before));
    }
    shared.close();
    for record in process::records() {
        record.cancel();
    }
    while process::count() > 0 {
        turns(|| while round(shared, deadlines, false) && process::count() > 0 {});
    }
}

/// Polls the first process of the run queue, and while a process yields to another one also that;
/// or sleeps if none is ready. `false` if the phase may be another.
#[inline(always)]
pub(super) fn round(shared: &Shared, deadlines: &Deadlines, builds_arrivals: bool) -> bool {
    let signals = shared.inbound.signals();
    if !signals.is_empty() && !look_outside(shared, deadlines, builds_arrivals, signals) {
        return false;
    }
    // SAFETY: each dequeued process is given a turn at once, or retired.
    let Some(mut process) = (unsafe { current::next_ready() }) else {
        rest(shared, deadlines);
        return true;
    };
    // SAFETY: each was just taken from this thread's queue.
    while let Some(next) = unsafe { process::run(process) } {
        if !shared.inbound.signals().is_empty() {
            // SAFETY: it was taken for a turn that is not given, and nothing was done with it.
            unsafe { current::put_back(next) };
            break;
        }
        process = next;
    }
    true
}

/// Takes in the requests of other threads, and looks at the deadlines and the files. `false` if
/// that has changed the phase.
#[cold]
pub(super) fn look_outside(
    shared: &Shared,
    deadlines: &Deadlines,
    builds_arrivals: bool,
    signals: Signals,
) -> bool {
    // SAFETY: this is between two polls.
    unsafe { process::end_turns() };
    file_watch::glance(shared.inbound.bell());
    if signals.attention() {
        shared.inbound.take_attention();
        if builds_arrivals {
            current::set_on_path(false);
            shared.build_arrivals();
            current::set_on_path(true);
            interference::rest();
            if shared.phase() != Phase::RELEASED {
                return false;
            }
        }
    }
    // Take the level in unless something above it is ready here; its bit then stays set.
    if let Some(level) = signals.highest_level()
        && current::ready_levels() >> level <= 1
    {
        process::queue_woken(shared, level);
    }
    if signals.deadline() {
        deadlines.look();
    }
    true
}

#[cold]
#[inline(never)]
pub(super) fn rest(shared: &Shared, deadlines: &Deadlines) {
    // SAFETY: this is between two polls.
    unsafe { process::end_turns() };
    if shared.serves != Serves::Many && process::count() == 0 {
        // An interrupt may have spawned a process since the signals were read.
        #[cfg(not(feature = "std"))]
        if !shared.close_if_none_waits() {
            return;
        }
        return shared.advance(Phase::STOPPING);
    }
    sleep(shared, deadlines.rest());
    interference::rest();
}

/// Sleeps until a wake or `deadline`, after having looked for one if that was asked for or the
/// deadline is near. Without a deadline or files only other threads can end the sleep; the observer
/// of quiescence is notified of that.
pub(super) fn sleep(shared: &Shared, deadline: Instant) {
    let spin = match is_near(deadline) {
        true => SHORTEST_SLEEP,
        false => shared.spin.load(Ordering::Relaxed),
    };
    if spin > 0 {
        let found = || {
            file_watch::glance(shared.inbound.bell());
            current::ready_levels() != 0
        };
        let time = Duration::from_nanos(spin);
        if shared.inbound.spin(time, deadline, found) {
            return;
        }
    }
    events::report_executor(events::code::ASLEEP);
    if deadline != Instant::NEVER {
        shared.inbound.sleep(deadline - Duration::from_nanos(EARLY));
    } else if file_watch::is_waiting(shared.inbound.bell()) {
        shared.inbound.sleep(deadline);
    } else {
        shared
            .inbound
            .sleep_quiescent(&shared.quiescence, || shared.registry.announce());
    }
    events::report_executor(events::code::AWAKE);
}

/// Whether it comes sooner than a sleep would end. Without an operating system a sleep ends at
/// once.
fn is_near(deadline: Instant) -> bool {
    cfg!(feature = "std")
        && deadline != Instant::NEVER
        && deadline.nanos_since(Instant::now()) < SHORTEST_SLEEP
}
