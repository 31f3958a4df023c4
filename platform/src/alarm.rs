//! An alarm for a thread that is busy: a little before a deadline another thread calls a function
//! that sets a bit of a word which the busy thread reads anyway.
//!
//! So a busy thread sees its deadlines without reading the clock. All alarms of a program have one
//! thread, `luna-alarm`. It has SCHED_FIFO 98 or the user's limit, above the threads that it
//! serves, and sleeps in a futex ([`DeadlineSleep`]): so it runs when its deadline comes, on every
//! preemption model of the kernel, however busy the threads of the user are. Each deadline takes a
//! few microseconds of a processor. Where the kernel keeps other threads before it, there is no
//! alarm ([`Alarm::new`]): the busy thread then reads the clock itself.

use crate::clock::Instant;
use crate::deadline_sleep::DeadlineSleep;
use crate::lock::PiLock;
use crate::thread::{self, Attributes, MINIMUM_STACK_SIZE, Mode, Policy, TIMER_PRIORITY};
use std::convert::Infallible;
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// How many alarms a program may have: one for each executor's thread. A wake-up of the alarms'
/// thread takes O(their number).
pub const MAX_ALARMS: usize = 64;

/// Set in the state of an alarm that has gone off, beside the instant.
const RUNG: u64 = 1 << 63;
/// The state of an alarm that is not armed.
const DISARMED: u64 = RUNG - 1;

/// The alarm of the thread that made it.
pub struct Alarm {
    clock: Arc<AlarmClock>,
    slot: Arc<Slot>,
}

struct Slot {
    /// The deadline in nanoseconds, [`DISARMED`], or [`RUNG`] with the instant at which it rang.
    state: AtomicU64,
    ring: Box<dyn Fn() + Send + Sync>,
}

/// What the alarms of a program and their thread share.
struct AlarmClock {
    sleep: DeadlineSleep,
    slots: PiLock<Vec<Arc<Slot>>>,
}

/// The alarms of a process. A child of a bare `fork` has no thread for its parent's, and makes
/// others.
struct Started {
    process: u32,
    priority: u8,
    /// None if there is no thread that runs before the others.
    clock: Option<Arc<AlarmClock>>,
}

static STARTED: PiLock<Option<Started>> = PiLock::new(None);

impl Alarm {
    /// An alarm for the calling thread. `ring` is called on the alarms' thread: a few stores,
    /// nothing that waits. The first alarm of a program starts that thread. Not for the real-time
    /// path.
    ///
    /// None if the alarms' thread would not run before the caller, or late: the program may not
    /// have SCHED_FIFO above the caller's priority, the caller has SCHED_DEADLINE, or there are
    /// [`MAX_ALARMS`] already.
    ///
    /// ```
    /// use luna_platform::alarm::Alarm;
    /// use luna_platform::clock::Instant;
    /// use std::sync::Arc;
    /// use std::sync::atomic::{AtomicU64, Ordering};
    ///
    /// let word = Arc::new(AtomicU64::new(0));
    /// let rung = word.clone();
    /// if let Some(alarm) = Alarm::new(move || rung.store(1, Ordering::Release)) {
    ///     alarm.arm(Instant::now());
    ///     while word.load(Ordering::Acquire) == 0 {}
    /// }
    /// ```
    pub fn new(ring: impl Fn() + Send + Sync + 'static) -> Option<Alarm> {
        let (clock, priority) = AlarmClock::of_process()?;
        let caller = thread::current_policy();
        if caller.is_deadline() || caller.priority() >= priority {
            return None;
        }
        let slot = Arc::new(Slot {
            state: AtomicU64::new(DISARMED),
            ring: Box::new(ring),
        });
        let mut slots = clock.slots.lock();
        if slots.len() == MAX_ALARMS {
            return None;
        }
        // There is room: nothing is allocated under the lock.
        slots.push(slot.clone());
        drop(slots);
        Some(Alarm { clock, slot })
    }

    /// Rings at `deadline`, which replaces an earlier one; at once if it has passed. Real-time
    /// path: yes; at most one system call.
    pub fn arm(&self, deadline: Instant) {
        let deadline = deadline.as_nanos().min(DISARMED);
        self.slot.state.store(deadline, Ordering::Release);
        self.clock.sleep.wake_by(Instant::from_nanos(deadline));
    }

    /// It rings no more. The call of a ring that has begun may come later. Real-time path: yes; one
    /// store.
    pub fn disarm(&self) {
        self.slot.state.store(DISARMED, Ordering::Release);
    }

    /// When it rang last, if that was not taken before, nor was it armed or disarmed since.
    /// Real-time path: yes; a load and a store.
    pub fn take_rung(&self) -> Option<Instant> {
        let state = self.slot.state.load(Ordering::Acquire);
        (state & RUNG != 0).then(|| {
            self.disarm();
            Instant::from_nanos(state & !RUNG)
        })
    }
}

impl Drop for Alarm {
    fn drop(&mut self) {
        let mut slots = self.clock.slots.lock();
        let number = slots.iter().position(|slot| Arc::ptr_eq(slot, &self.slot));
        let own = number.map(|number| slots.swap_remove(number));
        drop(slots);
        // Behind the lock, since it may free what `ring` has.
        drop(own);
    }
}

impl AlarmClock {
    /// That of this process, and the priority of its thread.
    fn of_process() -> Option<(Arc<AlarmClock>, u8)> {
        let process = std::process::id();
        let mut started = STARTED.lock();
        if started.as_ref().is_none_or(|made| made.process != process) {
            let priority = thread::highest_priority().min(TIMER_PRIORITY);
            *started = Some(Started {
                process,
                priority,
                clock: AlarmClock::start(priority),
            });
        }
        let started = started.as_ref()?;
        Some((started.clock.clone()?, started.priority))
    }

    fn start(priority: u8) -> Option<Arc<AlarmClock>> {
        let clock = Arc::new(AlarmClock {
            sleep: DeadlineSleep::new(),
            slots: PiLock::new(Vec::with_capacity(MAX_ALARMS)),
        });
        let own = clock.clone();
        let attributes = Attributes::framework("luna-alarm", Policy::fifo(priority))
            .mode(Mode::Strict)
            .stack_size(MINIMUM_STACK_SIZE);
        let set_up = |_: &_| Ok::<_, Infallible>(());
        // It lives as long as the program.
        let thread = thread::spawn(attributes, set_up, move |()| {
            loop {
                own.sleep.sleep(|| own.ring_due(Instant::now_real()));
            }
        });
        thread.is_ok().then_some(clock)
    }

    /// Rings what is due; returns the earliest deadline that is left. O(alarms).
    fn ring_due(&self, now: Instant) -> Instant {
        let slots = self.slots.lock();
        let left = slots.iter().map(|slot| slot.ring_if_due(now));
        left.min().unwrap_or(Instant::NEVER)
    }
}

impl Slot {
    /// Rings if its deadline has come; returns the one that is left.
    fn ring_if_due(&self, now: Instant) -> Instant {
        loop {
            let state = self.state.load(Ordering::Acquire);
            if state >= DISARMED {
                return Instant::NEVER;
            }
            if state > now.as_nanos() {
                return Instant::from_nanos(state);
            }
            // It fails if the owner has armed or disarmed it meanwhile, as often as that.
            let rung = now.as_nanos() | RUNG;
            let taken =
                self.state
                    .compare_exchange(state, rung, Ordering::AcqRel, Ordering::Relaxed);
            if taken.is_ok() {
                (self.ring)();
                return Instant::NEVER;
            }
        }
    }
}

crate::debug_fields!(Alarm, |alarm| state: alarm.slot.state);

impl fmt::Debug for Slot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Slot").field(&self.state).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    const BIT: u64 = 1 << 5;

    /// An alarm of this thread with its word. None where there is none.
    fn alarm() -> Option<(Alarm, Arc<AtomicU64>)> {
        let word = Arc::new(AtomicU64::new(1));
        let rung = word.clone();
        let alarm = Alarm::new(move || {
            rung.fetch_or(BIT, Ordering::AcqRel);
        });
        if alarm.is_none() {
            println!("skipped: an alarm needs SCHED_FIFO {TIMER_PRIORITY}");
        }
        Some((alarm?, word))
    }

    /// Spins until the bit is set, and takes it.
    fn wait(word: &AtomicU64) -> Instant {
        while word.load(Ordering::Acquire) & BIT == 0 {
            std::hint::spin_loop();
        }
        assert_eq!(word.swap(1, Ordering::AcqRel), 1 | BIT);
        Instant::now()
    }

    #[test]
    fn it_rings_when_its_deadline_has_come_and_not_before() {
        let Some((alarm, word)) = alarm() else { return };
        assert!(alarm.take_rung().is_none());
        for _ in 0..3 {
            let deadline = Instant::now() + Duration::from_millis(2);
            alarm.arm(deadline);
            let seen = wait(&word);
            let rung = alarm.take_rung().unwrap();
            assert!(deadline <= rung && rung <= seen);
            assert!(alarm.take_rung().is_none(), "it was taken");
        }
        // A deadline that has passed rings at once; one that was brought forward, then.
        alarm.arm(Instant::from_nanos(0));
        wait(&word);
        alarm.arm(Instant::now() + Duration::from_secs(1000));
        alarm.arm(Instant::now() + Duration::from_millis(1));
        wait(&word);
    }

    #[test]
    fn what_is_disarmed_or_gone_does_not_ring() {
        let (Some((gone, gone_word)), Some((alarm, word))) = (alarm(), alarm()) else {
            return;
        };
        let end = Instant::now() + Duration::from_millis(20);
        gone.arm(end);
        drop(gone);
        assert_eq!(
            Arc::strong_count(&gone_word),
            1,
            "the alarm has let go of it"
        );
        alarm.arm(end);
        alarm.disarm();
        if Instant::now() >= end {
            println!("skipped: this thread was kept off its core: the alarms may have rung");
            return;
        }
        let Some((later, later_word)) = self::alarm() else {
            return;
        };
        // The thread rings in the order of deadlines.
        later.arm(end + Duration::from_millis(1));
        wait(&later_word);
        assert_eq!(gone_word.load(Ordering::Relaxed), 1);
        assert_eq!(word.load(Ordering::Relaxed), 1);
        assert!(alarm.take_rung().is_none());
    }

    #[test]
    fn each_thread_has_its_own() {
        let Some((_alarm, word)) = alarm() else {
            return;
        };
        let other = std::thread::spawn(|| {
            let Some((alarm, word)) = alarm() else { return };
            alarm.arm(Instant::now());
            wait(&word);
        });
        other.join().unwrap();
        assert_eq!(word.load(Ordering::Relaxed), 1, "it was another's");
    }

    /// The thread must preempt the caller.
    #[test]
    fn a_thread_of_its_priority_or_above_has_none() {
        let priority = thread::highest_priority().min(TIMER_PRIORITY);
        if priority == 0 {
            println!("skipped: an alarm needs SCHED_FIFO");
            return;
        }
        for (policy, has_alarm) in [(priority, false), (priority - 1, true)] {
            let attributes = Attributes::framework("high", Policy::fifo(policy)).mode(Mode::Strict);
            let set_up = |_: &_| Ok::<_, Infallible>(());
            let thread = thread::spawn(attributes, set_up, |()| alarm().is_some());
            let Ok(thread) = thread else {
                println!("skipped: SCHED_FIFO is refused");
                return;
            };
            assert_eq!(thread.join().unwrap(), has_alarm, "priority {policy}");
        }
    }
}
