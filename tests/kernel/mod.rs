//! What the kernel says of this program's threads.

#![allow(dead_code, reason = "each test file uses some of it")]

use nix::sys::resource::{UsageWho, getrusage};
use nix::time::{ClockId, clock_gettime};
use std::fs::{self, File};
use std::os::unix::fs::FileExt;
use std::time::Duration;

/// The calling thread's number.
pub(crate) fn thread_id() -> i32 {
    nix::unistd::gettid().as_raw()
}

/// The processor time that a thread of this program has used; none of one that has ended.
pub(crate) fn processor_time(thread: i32) -> Duration {
    // The clock of a thread is its inverted number above the bits that mark a thread's clock:
    // `pthread_getcpuclockid`(3) makes the same one.
    const OF_THREAD: i32 = 4 | 2;
    clock_gettime(ClockId::from_raw(!thread << 3 | OF_THREAD))
        .map(Duration::from)
        .unwrap_or_default()
}

/// The processor time that the calling thread has used.
pub(crate) fn own_processor_time() -> Duration {
    clock_gettime(ClockId::CLOCK_THREAD_CPUTIME_ID)
        .map(Duration::from)
        .unwrap_or_default()
}

/// Keeps the processor busy until the calling thread has used so much more of it.
pub(crate) fn burn(time: Duration) {
    let end = own_processor_time() + time;
    while own_processor_time() < end {
        std::hint::spin_loop();
    }
}

/// The priority that the kernel schedules a thread by, boosts included: `-1 - p` for a real-time
/// priority p, 0 or more for others. It is field 18 of the thread's `stat`.
pub(crate) fn scheduled_priority(thread: i32) -> i64 {
    let stat = fs::read_to_string(format!("/proc/self/task/{thread}/stat")).unwrap();
    // Counted after the name, which may hold spaces.
    let after_name = stat.rsplit_once(')').unwrap().1;
    after_name
        .split_whitespace()
        .nth(15)
        .unwrap()
        .parse()
        .unwrap()
}

/// How that priority is written for SCHED_FIFO at `priority`.
pub(crate) fn as_scheduled(priority: u8) -> i64 {
    -1 - i64::from(priority)
}

/// The time that the hypervisor has taken from a core, in all.
pub(crate) fn stolen(core: usize) -> Duration {
    /// Of a second, which `/proc/stat` counts in.
    const TICK: Duration = Duration::from_millis(10);
    let stat = fs::read_to_string("/proc/stat").unwrap_or_default();
    let name = format!("cpu{core}");
    let ticks = stat.lines().find_map(|line| {
        let mut fields = line.split_whitespace();
        (fields.next() == Some(&name)).then(|| fields.nth(7)?.parse::<u32>().ok())?
    });
    TICK * ticks.unwrap_or(0)
}

/// How many of so many observations may be spoilt without a trace in the kernel's counters. A
/// hypervisor that has to fetch a page lets the guest run another thread meanwhile (asynchronous
/// page faults), whatever its priority, and no counter of the thread shows it. An error in the
/// program spoils many.
pub(crate) fn spoilt(of: u64) -> u64 {
    1 + of / 5_000
}

/// How often, and for how long, the kernel kept the calling thread from running, as far as its
/// counters show.
#[derive(Debug)]
pub(crate) struct KeptOff {
    schedstat: Option<File>,
}

/// What was counted until a moment.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Kept {
    preempted: i64,
    faults: i64,
    waited: Duration,
}

impl KeptOff {
    pub(crate) fn new() -> Self {
        Self {
            schedstat: File::open("/proc/thread-self/schedstat").ok(),
        }
    }

    pub(crate) fn so_far(&self) -> Kept {
        let (preempted, faults) = getrusage(UsageWho::RUSAGE_THREAD).map_or((0, 0), |usage| {
            let faults = usage.minor_page_faults() + usage.major_page_faults();
            (usage.involuntary_context_switches(), faults)
        });
        // Its time on a processor, and its time in a run queue.
        let mut text = [0; 64];
        let length = self
            .schedstat
            .as_ref()
            .and_then(|file| file.read_at(&mut text, 0).ok())
            .unwrap_or(0);
        let waited = std::str::from_utf8(&text[..length])
            .ok()
            .and_then(|text| text.split_whitespace().nth(1)?.parse().ok())
            .map_or(Duration::ZERO, Duration::from_nanos);
        Kept {
            preempted,
            faults,
            waited,
        }
    }
}

impl Kept {
    /// Whether since `before` the thread was preempted, had to wait for memory, or waited for its
    /// core for longer than a switch takes.
    pub(crate) fn differs_from(&self, before: &Kept) -> bool {
        const SWITCHES: Duration = Duration::from_micros(100);
        self.preempted != before.preempted
            || self.faults != before.faults
            || self.waited - before.waited > SWITCHES
    }
}
