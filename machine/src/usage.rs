//! Resources that the kernel counts for a thread: page faults, context switches, processor time.

use crate::backend::usage as backend;
use std::time::Duration;

/// What the kernel has counted of a thread since it began. The numbers only rise; two readings have
/// a [difference](Self::since).
///
/// ```
/// use luna_machine::usage::ThreadUsage;
///
/// if let Some(before) = ThreadUsage::of_current_thread() {
///     std::thread::sleep(std::time::Duration::from_millis(1));
///     let slept = ThreadUsage::of_current_thread().unwrap().since(&before);
///     assert!(slept.voluntary_switches >= 1);
/// }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub struct ThreadUsage {
    /// Page faults that were served from memory: the first touch of a fresh page is one. Each costs
    /// about a microsecond.
    pub minor_faults: u64,
    /// Page faults that had to wait for a disk.
    pub major_faults: u64,
    /// How often the thread blocked.
    pub voluntary_switches: u64,
    /// How often the thread was taken off the processor while it had work: by a thread of higher
    /// priority, or at the end of its slice.
    pub involuntary_switches: u64,
    /// How long it ran.
    pub cpu_time: Duration,
    /// How long it was ready to run and waited for a core, because other threads had them; `None`
    /// where the kernel does not count it.
    pub run_delay: Option<Duration>,
}

impl ThreadUsage {
    /// Reads what is counted of the calling thread; `None` where the system does not report it.
    ///
    /// O(1), no allocation on a thread that was [prepared](Self::prepare_thread). Three system
    /// calls that never wait, about two microseconds in all, and a fourth the first time: on the
    /// real-time path only where something has gone wrong already, or where it was asked for.
    pub fn of_current_thread() -> Option<ThreadUsage> {
        backend::of_current_thread()
    }

    /// Allocates what the readings on the calling thread need. Without it the first reading may
    /// allocate.
    pub fn prepare_thread() {
        backend::prepare_thread();
    }

    /// What was counted from `earlier`, a reading on the same thread, to here.
    pub fn since(&self, earlier: &ThreadUsage) -> ThreadUsage {
        ThreadUsage {
            minor_faults: self.minor_faults.saturating_sub(earlier.minor_faults),
            major_faults: self.major_faults.saturating_sub(earlier.major_faults),
            voluntary_switches: self
                .voluntary_switches
                .saturating_sub(earlier.voluntary_switches),
            involuntary_switches: self
                .involuntary_switches
                .saturating_sub(earlier.involuntary_switches),
            cpu_time: self.cpu_time.saturating_sub(earlier.cpu_time),
            run_delay: self
                .run_delay
                .zip(earlier.run_delay)
                .map(|(later, earlier)| later.saturating_sub(earlier)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_difference_saturates() {
        let later = ThreadUsage {
            minor_faults: 5,
            cpu_time: Duration::from_nanos(7),
            run_delay: Some(Duration::from_nanos(9)),
            ..ThreadUsage::default()
        };
        let earlier = ThreadUsage {
            run_delay: Some(Duration::ZERO),
            ..ThreadUsage::default()
        };
        assert_eq!(later.since(&earlier), later);
        assert_eq!(earlier.since(&later), earlier);
        assert_eq!(later.since(&ThreadUsage::default()).run_delay, None);
    }
}
