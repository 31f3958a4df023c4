//! Wakes the watcher when the first function may have taken too long.
//!
//! Waking a thread on another core costs its waker about 20 µs on a virtual machine, and woken
//! threads contend for the same locks. So only one worker is woken, by a signal that is handled on
//! its thread or by a call on its core, and it runs the first function at once. A watcher has
//! nothing to do before the shortest limit has passed. By then the first worker may compute for
//! ever, or be stuck in the kernel. So the kernel's timer interrupts a watcher. Where the timer
//! needs a kernel thread [of lower priority than the function](wakes_beside_a_function), the
//! watchers are woken before the function begins.

use super::{Emergency, EmergencyWorkers};
use luna_platform::alarm::EventAlarm;
use luna_platform::clock::Instant;
use luna_platform::facts::{PreemptionModel, Source};
use luna_platform::signals;
use std::sync::atomic::Ordering;

/// Whether a timer expires on the core on which a function computes. With PREEMPT_RT a kernel
/// thread of priority 1 handles it, which waits for the function. If the model is not known, it is
/// taken for PREEMPT_RT.
pub(super) fn wakes_beside_a_function(source: &Source) -> bool {
    PreemptionModel::read(source).is_ok_and(|model| model != PreemptionModel::RealTime)
}

impl EmergencyWorkers {
    /// Makes the alarm of `member`, the calling thread, which is on duty from the start.
    pub(super) fn make_watch_alarm(&self, member: u8) {
        if let Some(alarm) = EventAlarm::here() {
            // Each member is made once.
            let _ = self.watch_alarms[usize::from(member)].set(alarm);
        }
    }
}

impl Emergency {
    /// `member` is about to call the first function since the trigger; the others may not know of
    /// it. Those on duty are woken at `at`, when one is to check it, or now if they cannot be woken
    /// then.
    pub(super) fn wake_watchers(&self, member: u8, at: Instant) {
        let workers = &self.workers;
        // One that runs a function of the safe state may hang, and one that was left behind may
        // never run again.
        let all_wait = !self.at_safe_state.failover().is_under_way()
            && workers.left_behind.load(Ordering::Acquire) == 0;
        // The alarm of a thread that is stuck in the kernel does not ring.
        let other = &workers.watch_alarms[usize::from(member == 0)];
        if !(all_wait && other.get().is_some_and(|alarm| alarm.arm(at))) {
            signals::announce_event();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn the_alarm_is_left_to_kernels_whose_timers_need_no_thread() {
        let folder = std::env::temp_dir().join(format!("luna-watch-alarm-{}", std::process::id()));
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
