//! Facts about the machine that affect its timing.
//!
//! Every fact may be missing: another system, a container that hides a file, a user without
//! permission to read it. Nothing here fails.

pub mod control_group;
pub mod parse;
mod share;
mod source;
pub mod task;

pub use share::RealTimeShare;
pub use source::{Source, Unread, UnreadReason};

use crate::backend::facts as backend;
use std::fmt;

/// How the kernel lets threads preempt each other. The later, the shorter a real-time thread waits
/// for the kernel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum PreemptionModel {
    /// Not within a system call.
    None,
    /// Not within a system call, or at some points of it: the kernel does not say which.
    NoneOrVoluntary,
    /// At some points within a system call.
    Voluntary,
    /// One of the others, chosen when it booted, and hidden.
    Dynamic,
    /// Real-time threads anywhere, as `Full`; others at the next tick.
    Lazy,
    /// Anywhere but where the kernel holds a spinning lock or handles an interrupt.
    Full,
    /// Nearly anywhere: `PREEMPT_RT`.
    RealTime,
}

impl fmt::Display for PreemptionModel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            PreemptionModel::None => "none",
            PreemptionModel::NoneOrVoluntary => "none or voluntary",
            PreemptionModel::Voluntary => "voluntary",
            PreemptionModel::Dynamic => "dynamic (which one cannot be read)",
            PreemptionModel::Lazy => "lazy",
            PreemptionModel::Full => "full",
            PreemptionModel::RealTime => "real-time",
        })
    }
}

impl PreemptionModel {
    /// The setting in effect, as far as `source` shows it; [`Dynamic`](Self::Dynamic) where it does
    /// not.
    ///
    /// # Errors
    ///
    /// The file that could not be read.
    pub fn read(source: &Source) -> Result<PreemptionModel, Unread> {
        Self::read_with_file(source).map(|(model, _)| model)
    }

    /// As [`read`](Self::read), with the file that says so. Of a kernel that chooses when it boots,
    /// `/proc/cmdline` says the choice at that time; root may have changed it since.
    ///
    /// # Errors
    ///
    /// The file that could not be read.
    pub fn read_with_file(source: &Source) -> Result<(PreemptionModel, &'static str), Unread> {
        let real_time = "/sys/kernel/realtime";
        if source.word(real_time).as_deref() == Ok("1") {
            return Ok((PreemptionModel::RealTime, real_time));
        }
        let version = "/proc/sys/kernel/version";
        let built = parse::preemption_of_version(&source.word(version)?);
        if built != PreemptionModel::Dynamic {
            return Ok((built, version));
        }
        // Only root sees the one in effect, and only where debugfs is mounted.
        let (debug, boot) = ("/sys/kernel/debug/sched/preempt", "/proc/cmdline");
        let in_effect = source.parse(debug, parse::preemption_in_effect);
        let in_effect = in_effect.ok().map(|model| (model, debug));
        let asked = || Some((parse::preemption_asked(&source.read(boot).ok()?)?, boot));
        Ok(in_effect.or_else(asked).unwrap_or((built, version)))
    }
}

/// How finely the kernel keeps time, in nanoseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct ClockResolution {
    /// To which a timer can be set: 1 with high-resolution timers, else as the tick.
    pub timer_ns: u64,
    /// From one tick to the next: 1 000 000 000 / CONFIG_HZ.
    pub tick_ns: u64,
}

impl ClockResolution {
    /// This machine's; `None` on a backend that cannot ask. Two system calls.
    ///
    /// ```
    /// if let Some(clock) = luna_machine::facts::ClockResolution::of_this_machine() {
    ///     assert!(clock.timer_ns <= clock.tick_ns);
    /// }
    /// ```
    pub fn of_this_machine() -> Option<ClockResolution> {
        backend::clock_resolution()
    }
}
