//! What events are there. `docs/events.md` says what their subjects and numbers are.

pub use luna_core::events::code::*;

/// A loop begins a cycle.
pub const SLOT: u16 = 10;
/// A cycle began late.
pub const LATE: u16 = 11;
/// The safety state has changed.
pub const EMERGENCY: u16 = 12;
/// A turn of a named sub-process begins, within one of its process.
pub const SUB_RUNNING: u16 = 14;
/// A turn of a named sub-process ends, and it waits.
pub const SUB_WAITING: u16 = 15;
/// A named sub-process has ended.
pub const SUB_DONE: u16 = 16;
/// A hypervisor has run something else on a core.
pub const STOLEN: u16 = 17;
/// A value goes to another program, or comes from one.
pub const LINK: u16 = 18;

/// All of them, with their names.
pub const NAMES: [(u16, &str); 18] = [
    (READY, "ready"),
    (RUNNING, "running"),
    (WAITING, "waiting"),
    (DONE, "done"),
    (COMMUNICATION, "communication"),
    (ALTERNATIVE, "alternative"),
    (ASLEEP, "executor asleep"),
    (AWAKE, "executor awake"),
    (PRIORITY, "priority"),
    (SLOT, "slot"),
    (LATE, "late cycle"),
    (EMERGENCY, "emergency"),
    (SPAWNED, "spawned"),
    (SUB_RUNNING, "sub-process running"),
    (SUB_WAITING, "sub-process waiting"),
    (SUB_DONE, "sub-process done"),
    (STOLEN, "stolen"),
    (LINK, "link"),
];

/// In [`SUB_DONE`]: how a sub-process has ended.
pub mod sub_ended {
    /// It has returned, whatever.
    pub const RETURNED: u64 = 0;
    /// It was dropped before, or has panicked, or goes on elsewhere.
    pub const DROPPED: u64 = 1;
}

/// In [`LATE`]: the second argument, which is why, as far as it is known when the cycle begins.
///
/// Bits 0 to 7 are the cause that explains most, bits 8 to 15 how many per cent of the lateness it
/// explains, bits 16 to 47 the core on which the cycle began, plus one; 0 where it is not known. A
/// cause that explains less than half is not named.
///
/// ```
/// use luna_events::code::late;
///
/// let argument = late::argument(late::OTHER_PROCESS, 98, Some(3));
/// assert_eq!(late::cause(argument), late::OTHER_PROCESS);
/// assert_eq!(late::percent(argument), 98);
/// assert_eq!(late::core(argument), Some(3));
/// assert_eq!(late::named_percent(999, 2000), None);
/// assert_eq!(late::named_percent(1000, 2000), Some(50));
/// ```
pub mod late {
    /// No known cause explains half of it. It may be an interrupt, the core's sleep, a hypervisor.
    pub const UNKNOWN: u64 = 0;
    /// The loop's own process was busy, most often with the cycle before.
    pub const LOOP_ITSELF: u64 = 1;
    /// Another process of its executor ran instead.
    pub const OTHER_PROCESS: u64 = 2;
    /// The kernel gave the core to another thread meanwhile.
    pub const OTHER_THREAD: u64 = 3;

    /// The least part of the lateness, in per cent, that a cause explains that is named.
    pub const NAMED_FROM: u64 = 50;

    /// Both in nanoseconds: how many per cent of `lateness` are explained, if it is enough for the
    /// cause to be named.
    pub fn named_percent(explained: u64, lateness: u64) -> Option<u64> {
        let explained = u128::from(explained.min(lateness));
        let percent = (explained * 100).checked_div(lateness.into())? as u64;
        (percent >= NAMED_FROM).then_some(percent)
    }

    /// The argument that says all three.
    pub fn argument(cause: u64, percent: u64, core: Option<usize>) -> u64 {
        let core = core.and_then(|core| u32::try_from(core + 1).ok());
        cause & 0xff | (percent & 0xff) << 8 | u64::from(core.unwrap_or(0)) << 16
    }

    /// The cause.
    pub fn cause(argument: u64) -> u64 {
        argument & 0xff
    }

    /// How many per cent of the lateness it explains; 0 where it is not known.
    pub fn percent(argument: u64) -> u64 {
        argument >> 8 & 0xff
    }

    /// The core on which the cycle began, if it is known.
    pub fn core(argument: u64) -> Option<usize> {
        usize::try_from((argument >> 16 & 0xffff_ffff).checked_sub(1)?).ok()
    }
}

/// In [`LINK`]: the second argument. Bit 0 says whether the value was taken from the other program,
/// else it was sent. The other bits name the session: they are the same in both programs.
///
/// ```
/// use luna_events::code::link;
///
/// let [sent, taken] = [false, true].map(|is_taken| link::argument(0x1234, is_taken));
/// assert!(!link::is_taken(sent) && link::is_taken(taken));
/// assert_eq!(link::session(sent), link::session(taken));
/// ```
pub mod link {
    /// The argument that says both; of `session` the lowest bit is left out.
    pub fn argument(session: u64, is_taken: bool) -> u64 {
        session & !1 | u64::from(is_taken)
    }

    /// Whether the value was taken from the other program.
    pub fn is_taken(argument: u64) -> bool {
        argument & 1 == 1
    }

    /// The session between the two programs.
    pub fn session(argument: u64) -> u64 {
        argument >> 1
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    #[test]
    fn each_code_has_one_name() {
        for (index, (number, name)) in NAMES.iter().enumerate() {
            assert_eq!(usize::from(*number), index + 1);
            assert!(!name.is_empty());
        }
    }
}
