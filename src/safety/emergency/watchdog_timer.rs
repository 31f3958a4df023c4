//! Wakes the watching workers when the first function may have taken too long.
//!
//! Waking a thread on another core costs its waker about 20 µs on a virtual machine, and woken
//! threads contend for the same locks. So only one worker is woken, and it runs the first function
//! at once. The others have nothing to do before the shortest limit has passed. By then the first
//! worker may compute for ever. So the kernel's timer wakes the others, through a thread that does
//! nothing else. Where the timer needs a kernel thread [of lower priority than the
//! function](wakes_beside_a_function), they are woken beforehand.

use crate::error::{Error, Result, SetupError};
use luna_platform::clock::Instant;
use luna_platform::facts::{PreemptionModel, Source};
use luna_platform::signals;
use luna_platform::thread::{self, Attributes, MINIMUM_STACK_SIZE, Policy, Thread};
use luna_platform::timer_fd::{TimerError, TimerFd};
use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether a timer expires on the core on which a function computes. With PREEMPT_RT a kernel
/// thread of priority 1 handles it, which waits for the function. If the model is not known, it is
/// taken for PREEMPT_RT.
pub(super) fn wakes_beside_a_function(source: &Source) -> bool {
    PreemptionModel::read(source).is_ok_and(|model| model != PreemptionModel::RealTime)
}

/// The timer, as the workers see it.
#[derive(Debug)]
pub(super) struct WatchdogTimer {
    timer: TimerFd,
    /// The thread has ended, or is to end.
    is_over: AtomicBool,
}

impl WatchdogTimer {
    /// Wakes all workers at `at`. Returns whether it will. One system call.
    pub(super) fn rouse(&self, at: Instant) -> bool {
        !self.is_over.load(Ordering::Acquire) && self.timer.arm_at(at).is_ok()
    }

    /// The thread's body.
    fn serve(&self) {
        while self.timer.wait().is_ok() && !self.is_over.load(Ordering::Acquire) {
            signals::announce_event();
        }
        self.is_over.store(true, Ordering::Release);
    }
}

/// Its thread. Dropping it ends it.
#[derive(Debug)]
pub(super) struct RouserThread {
    watchdog_timer: Arc<WatchdogTimer>,
    thread: Option<Thread<()>>,
}

impl RouserThread {
    /// Starts it with the workers' policy; none where there are no such timers. It takes signals as
    /// the workers do: it is there also when all of those hang.
    pub(super) fn start(policy: Policy, hears_signals: bool) -> Result<Option<Self>> {
        let timer = match TimerFd::new() {
            Ok(timer) => timer,
            Err(TimerError::Unsupported) => return Ok(None),
            Err(error) => {
                let message = error.to_string();
                return Err(SetupError::System { message }.into());
            }
        };
        let watchdog_timer = Arc::new(WatchdogTimer {
            timer,
            is_over: AtomicBool::new(false),
        });
        let own = watchdog_timer.clone();
        let thread = thread::spawn(
            Attributes::framework("luna-watchdog_timer", policy).stack_size(MINIMUM_STACK_SIZE),
            move |_| {
                if hears_signals {
                    signals::accept_ends_here();
                }
                Ok::<_, Infallible>(())
            },
            move |()| own.serve(),
        )
        .map_err(|error| Error::not_started("the emergency manager", error))?;
        Ok(Some(Self {
            watchdog_timer,
            thread: Some(thread),
        }))
    }

    pub(super) fn watchdog_timer(&self) -> Arc<WatchdogTimer> {
        self.watchdog_timer.clone()
    }
}

impl Drop for RouserThread {
    fn drop(&mut self) {
        self.watchdog_timer.is_over.store(true, Ordering::Release);
        // The instant has passed. If the kernel refuses that, the thread is detached.
        let is_woken = self
            .watchdog_timer
            .timer
            .arm_at(Instant::from_nanos(0))
            .is_ok();
        if let Some(thread) = self.thread.take().filter(|_| is_woken) {
            // It holds no user data.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn the_timer_is_left_to_kernels_whose_timers_need_no_thread() {
        let folder =
            std::env::temp_dir().join(format!("luna-watchdog_timer-{}", std::process::id()));
        let source = Source::folder(&folder);
        assert!(!wakes_beside_a_function(&source), "nothing is known");
        for part in ["proc/sys/kernel", "sys/kernel"] {
            fs::create_dir_all(folder.join(part)).unwrap();
        }
        let version = folder.join("proc/sys/kernel/version");
        fs::write(&version, "#1 SMP PREEMPT_DYNAMIC Debian\n").unwrap();
        assert!(wakes_beside_a_function(&source));
        // Either file is enough.
        fs::write(folder.join("sys/kernel/realtime"), "1\n").unwrap();
        assert!(!wakes_beside_a_function(&source));
        fs::write(folder.join("sys/kernel/realtime"), "0\n").unwrap();
        fs::write(&version, "#1 SMP PREEMPT_RT Debian\n").unwrap();
        assert!(!wakes_beside_a_function(&source));
        fs::remove_dir_all(folder).unwrap();
    }
}
