//! The processor's time-stamp counter, where it can stand for a clock.

use super::Instant;
use crate::facts::Source;
use std::sync::OnceLock;

/// The time-stamp counter of the processor: read in half the time that [`Instant::now`] takes, in
/// ticks of its own.
///
/// It is available only where the kernel itself keeps time by it: then its rate is constant, and it
/// is the same on all cores. A user reads it [beside the clock](Self::beside_clock) from time to
/// time, to convert ticks to instants.
///
/// ```
/// use luna_platform::clock::Counter;
///
/// if let Some(counter) = Counter::of_machine() {
///     let (ticks, instant) = counter.beside_clock();
///     assert!(counter.read() >= ticks);
///     assert!(luna_platform::clock::Instant::now_real() >= instant);
/// }
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Counter(());

impl Counter {
    /// The machine's counter, if it can stand for a clock. Not for the real-time path: the first
    /// call reads a file.
    pub fn of_machine() -> Option<Counter> {
        static IS_KEPT: OnceLock<bool> = OnceLock::new();
        IS_KEPT.get_or_init(is_kept).then_some(Counter(()))
    }

    /// Its ticks. Real-time path: yes; 10 ns on the reference machine, no system call.
    #[inline(always)]
    pub fn read(self) -> u64 {
        #[cfg(target_arch = "x86_64")]
        {
            // SAFETY: every processor of this architecture has the instruction, and a kernel that
            // forbade it to programs could not offer its clock to them without a system call by it,
            // which `is_kept` has found that it does.
            unsafe { core::arch::x86_64::_rdtsc() }
        }
        #[cfg(not(target_arch = "x86_64"))]
        unreachable!("nothing is known of this processor's counter")
    }

    /// Ticks, and the instant on the machine's clock at which they were read, as closely as a few
    /// tries give: to some 30 ns. O(1).
    pub fn beside_clock(self) -> (u64, Instant) {
        let mut best = (u64::MAX, 0, Instant::from_nanos(0));
        for _ in 0..5 {
            let before = self.read();
            let instant = Instant::now_real();
            let taken = self.read().saturating_sub(before);
            if taken < best.0 {
                best = (taken, before + taken / 2, instant);
            }
        }
        (best.1, best.2)
    }
}

/// Whether the kernel keeps time by the counter. Nothing is known of other processors' counters.
fn is_kept() -> bool {
    // The kernel takes it only if it is invariant and the cores agree, and leaves it when they do
    // no longer.
    let source = "/sys/devices/system/clocksource/clocksource0/current_clocksource";
    cfg!(target_arch = "x86_64") && Source::machine().word(source).as_deref() == Ok("tsc")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_counter_does_not_go_back_and_keeps_step() {
        let Some(counter) = Counter::of_machine() else {
            return;
        };
        let (first, began) = counter.beside_clock();
        let mut last = first;
        while Instant::now_real() - began < core::time::Duration::from_millis(2) {
            let now = counter.read();
            assert!(now >= last);
            last = now;
        }
        let (ticks, ended) = counter.beside_clock();
        assert!(ticks > first && ended > began);
    }
}
