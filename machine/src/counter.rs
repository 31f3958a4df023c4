//! The processor's time-stamp counter, where it can stand for a clock: that of x86-64, and the
//! virtual counter of 64-bit Arm.

use luna_platform::clock::Instant;
use std::sync::OnceLock;

/// The time-stamp counter of the processor: read in half the time that [`Instant::now`] takes, in
/// ticks of its own.
///
/// It is available only where the kernel itself keeps time by it: then its rate is constant, and it
/// is the same on all cores. A user reads it [beside the clock](Self::beside_clock) from time to
/// time, to convert ticks to instants.
///
/// ```
/// use luna_machine::counter::Counter;
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

    /// Its ticks: some 10^9 a second on x86-64, 10^7 to 10^9 on Arm. Real-time path: yes; 10 ns on
    /// the reference machine (x86-64), no system call.
    #[inline(always)]
    pub fn read(self) -> u64 {
        #[cfg(target_arch = "x86_64")]
        {
            // SAFETY: every processor of this architecture has the instruction, and a kernel that
            // forbade it to programs could not offer its clock to them without a system call by it,
            // which `is_kept` has found that it does.
            unsafe { core::arch::x86_64::_rdtsc() }
        }
        #[cfg(target_arch = "aarch64")]
        {
            let ticks: u64;
            // SAFETY: Linux opens the register to programs where it keeps time by it, which
            // `is_kept` has found, or reads it for them. Reading it changes nothing. The barrier
            // keeps the reading from being made before what stands before it.
            unsafe {
                core::arch::asm!("isb", "mrs {}, cntvct_el0", out(reg) ticks, options(nostack));
            }
            ticks
        }
        #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
        unreachable!("nothing is known of this processor's counter")
    }

    /// How many ticks it has a second, where the processor says so: on Arm. Real-time path: yes.
    pub fn ticks_per_second(self) -> Option<u64> {
        #[cfg(target_arch = "aarch64")]
        {
            let frequency: u64;
            // SAFETY: as in `read`; this register is open wherever the counter is.
            unsafe {
                core::arch::asm!(
                    "mrs {}, cntfrq_el0",
                    out(reg) frequency,
                    options(nomem, nostack, preserves_flags)
                );
            }
            Some(frequency).filter(|frequency| *frequency > 0)
        }
        #[cfg(not(target_arch = "aarch64"))]
        None
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
    KEPT_BY.is_some() && clock_of_kernel().as_deref().map(str::trim) == KEPT_BY
}

/// The kernel's clock; `None` if it cannot be read.
fn clock_of_kernel() -> Option<String> {
    std::fs::read_to_string("/sys/devices/system/clocksource/clocksource0/current_clocksource").ok()
}

/// The kernel's name for the clock that reads the counter of this processor.
const KEPT_BY: Option<&str> = if cfg!(target_arch = "x86_64") {
    Some("tsc")
} else if cfg!(target_arch = "aarch64") {
    Some("arch_sys_counter")
} else {
    None
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kernel_that_keeps_time_by_the_counter_offers_it() {
        let clock = clock_of_kernel().unwrap_or_default();
        let is_known = matches!(
            (std::env::consts::ARCH, clock.trim()),
            ("x86_64", "tsc") | ("aarch64", "arch_sys_counter")
        );
        assert_eq!(Counter::of_machine().is_some(), is_known, "{clock}");
    }

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
        if let Some(frequency) = counter.ticks_per_second() {
            let seconds = (ended - began).as_secs_f64();
            let measured = (ticks - first) as f64 / seconds;
            let ratio = measured / frequency as f64;
            assert!((0.9..1.1).contains(&ratio), "{measured} and {frequency} Hz");
        }
    }
}
