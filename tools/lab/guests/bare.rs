//! How late a bare system call wakes a thread under SCHED_FIFO 80, each ms.
//!
//! ```text
//! bare clock|futex|timerfd|epoll [CYCLES]
//! ```
//!
//! `clock`: clock_nanosleep with an absolute time, as cyclictest does. `futex`: FUTEX_WAIT_BITSET
//! with an absolute timeout. `timerfd`: read of a periodic timerfd. `epoll`: epoll_wait for one, and
//! its read.

#[path = "latencies.rs"]
mod latencies;

use latencies::Latencies;
use nix::errno::Errno;
use nix::sys::epoll::{Epoll, EpollCreateFlags, EpollEvent, EpollFlags, EpollTimeout};
use nix::sys::time::TimeSpec;
use nix::sys::timerfd::{
    ClockId as TimerClock, Expiration, TimerFd, TimerFlags, TimerSetTimeFlags,
};
use nix::time::{ClockId, ClockNanosleepFlags, clock_gettime, clock_nanosleep};
use std::env;
use std::ptr;
use std::sync::atomic::AtomicU32;
use std::time::Duration;

const CLOCK: ClockId = ClockId::CLOCK_MONOTONIC;
const PERIOD: Duration = Duration::from_millis(1);
/// From the start to the first cycle.
const HEAD_START: Duration = Duration::from_millis(10);

fn main() -> Result<(), String> {
    let mode = env::args().nth(1).unwrap_or_default();
    let cycles = latencies::cycles(2)?;
    latencies::become_real_time()?;
    let mut late = Latencies::new(cycles);
    let begin = now()? + HEAD_START;
    let due = (0u32..).map(|cycle| begin + PERIOD * cycle).take(cycles);
    match mode.as_str() {
        "clock" => run(due, &mut late, sleep)?,
        "futex" => run(due, &mut late, futex)?,
        "timerfd" => {
            let timer = timer(begin)?;
            run(due, &mut late, |_| timer.wait())?;
        }
        "epoll" => {
            let timer = timer(begin)?;
            let epoll = Epoll::new(EpollCreateFlags::empty()).map_err(|error| error.to_string())?;
            let event = EpollEvent::new(EpollFlags::EPOLLIN, 0);
            epoll
                .add(&timer, event)
                .map_err(|error| error.to_string())?;
            let mut events = [EpollEvent::empty()];
            run(due, &mut late, |_| {
                epoll.wait(&mut events, EpollTimeout::NONE)?;
                timer.wait()
            })?;
        }
        _ => {
            return Err(format!(
                "no mode `{mode}`: there are clock, futex, timerfd and epoll"
            ));
        }
    }
    late.print(&format!("bare {mode}"));
    Ok(())
}

fn run(
    due: impl Iterator<Item = Duration>,
    late: &mut Latencies,
    mut wait: impl FnMut(Duration) -> Result<(), Errno>,
) -> Result<(), String> {
    for due in due {
        wait(due).map_err(|error| format!("waiting: {error}"))?;
        late.add(now()?.saturating_sub(due));
    }
    Ok(())
}

fn now() -> Result<Duration, String> {
    let now = clock_gettime(CLOCK).map_err(|error| format!("the clock: {error}"))?;
    Ok(Duration::from(now))
}

fn timer(begin: Duration) -> Result<TimerFd, String> {
    let said = |error: Errno| format!("timerfd: {error}");
    let timer = TimerFd::new(TimerClock::CLOCK_MONOTONIC, TimerFlags::empty()).map_err(said)?;
    let expiration = Expiration::IntervalDelayed(begin.into(), PERIOD.into());
    let flags = TimerSetTimeFlags::TFD_TIMER_ABSTIME;
    timer.set(expiration, flags).map_err(said)?;
    Ok(timer)
}

fn sleep(due: Duration) -> Result<(), Errno> {
    let flags = ClockNanosleepFlags::TIMER_ABSTIME;
    clock_nanosleep(CLOCK, flags, &TimeSpec::from(due)).map(drop)
}

fn futex(due: Duration) -> Result<(), Errno> {
    static WORD: AtomicU32 = AtomicU32::new(0);
    let due = TimeSpec::from(due);
    // SAFETY: the word is static, and the time lives as long as the call, which only reads both.
    let ended = unsafe {
        libc::syscall(
            libc::SYS_futex,
            WORD.as_ptr(),
            libc::FUTEX_WAIT_BITSET | libc::FUTEX_PRIVATE_FLAG,
            0,
            due.as_ref() as *const libc::timespec,
            ptr::null::<u32>(),
            u32::MAX,
        )
    };
    match Errno::result(ended) {
        Err(Errno::ETIMEDOUT) => Ok(()),
        Err(error) => Err(error),
        // Nothing wakes it.
        Ok(_) => Err(Errno::EINTR),
    }
}
