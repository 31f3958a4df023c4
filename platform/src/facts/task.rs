//! The contents of `/proc` for a process or thread: its limits, its capabilities, its policy.

use super::Limit;

/// A soft limit of `/proc/self/limits`, by the name that the file gives it, such as `Max realtime
/// priority`.
///
/// ```
/// use luna_platform::facts::{Limit, task::soft_limit};
///
/// let text = "Limit                     Soft Limit  Hard Limit  Units\nMax locked memory         8388608  unlimited  bytes\n";
/// assert_eq!(soft_limit(text, "Max locked memory"), Some(Limit::AtMost(8_388_608)));
/// assert_eq!(soft_limit(text, "Max realtime timeout"), None);
/// ```
pub fn soft_limit(limits: &str, name: &str) -> Option<Limit> {
    let line = limits.lines().find_map(|line| line.strip_prefix(name))?;
    match line.split_whitespace().next()? {
        "unlimited" => Some(Limit::Unlimited),
        number => number.parse().ok().map(Limit::AtMost),
    }
}

/// The value of a field of `/proc/self/status`, such as `Cpus_allowed_list`.
///
/// ```
/// assert_eq!(luna_platform::facts::task::field("Name:\tcat\nThreads:\t1\n", "Threads"), Some("1"));
/// ```
pub fn field<'a>(status: &'a str, name: &str) -> Option<&'a str> {
    let value = |line: &'a str| line.strip_prefix(name)?.strip_prefix(':');
    status.lines().find_map(value).map(str::trim)
}

/// The bit of CAP_IPC_LOCK: may lock any amount of memory.
pub const CAP_IPC_LOCK: u32 = 14;
/// The bit of CAP_SYS_NICE: may take any policy and priority.
pub const CAP_SYS_NICE: u32 = 23;

/// Whether `/proc/self/status` says that the capability of this bit, below 64, is in effect.
///
/// ```
/// use luna_platform::facts::task::{CAP_SYS_NICE, has_capability};
///
/// assert_eq!(has_capability("CapEff:\t0000000000800000\n", CAP_SYS_NICE), Some(true));
/// ```
pub fn has_capability(status: &str, bit: u32) -> Option<bool> {
    let bits = u64::from_str_radix(field(status, "CapEff")?, 16).ok()?;
    Some(bits.checked_shr(bit).unwrap_or(0) & 1 == 1)
}

/// Whether `/proc/self/uid_map` is that of the first user namespace, which maps every number to
/// itself: in another, capabilities do not reach scheduling and locked memory.
///
/// ```
/// use luna_platform::facts::task::is_first_user_namespace;
///
/// assert!(is_first_user_namespace("         0          0 4294967295\n"));
/// assert!(!is_first_user_namespace("         0     100000      65536\n"));
/// ```
pub fn is_first_user_namespace(uid_map: &str) -> bool {
    uid_map.split_whitespace().eq(["0", "0", "4294967295"])
}

/// How the kernel schedules a thread, from its `stat` file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Scheduling {
    /// The priority of SCHED_FIFO or SCHED_RR that is in effect, inherited ones included; 0 for
    /// none.
    pub real_time_priority: u8,
    /// Its own, without inheritance.
    pub own_real_time_priority: u8,
}

/// Reads `/proc/PID/stat` or `/proc/thread-self/stat`. `None` if it has another form.
///
/// ```
/// use luna_platform::facts::task::scheduling;
///
/// let before = "16 (ksoftirqd/1) S 2 0 0 0 -1 69238848 0 0 0 0 0 1 0 0";
/// let after = "0 1 0 8 0 0 18446744073709551615 0 0 0 0 0 0 0 2147483647 0 0 0 0 17 1";
/// let fifo_50 = scheduling(&format!("{before} -51 {after} 50 1 0 0 0")).unwrap();
/// assert_eq!((fifo_50.real_time_priority, fifo_50.own_real_time_priority), (50, 50));
/// ```
pub fn scheduling(stat: &str) -> Option<Scheduling> {
    // The name may hold spaces and parentheses; what follows its last one are numbers, from the
    // third field on.
    let (_, fields) = stat.rsplit_once(") ")?;
    let field = |number: usize| {
        let word = fields.split_whitespace().nth(number - 3)?;
        word.parse::<i64>().ok()
    };
    // The eighteenth is the kernel's priority: -1 - p for a real-time one in effect, -101 for
    // SCHED_DEADLINE.
    let in_effect = match field(18)? {
        negative @ -100..=-2 => -1 - negative,
        _ => 0,
    };
    Some(Scheduling {
        real_time_priority: u8::try_from(in_effect).ok()?,
        own_real_time_priority: u8::try_from(field(40)?).ok()?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_of_the_kernel() {
        let text = "Limit                     Soft Limit           Hard Limit           Units     \n\
                    Max realtime priority     0                    99                   \n\
                    Max realtime timeout      unlimited            unlimited            us        \n\
                    Max locked memory\n";
        assert_eq!(
            soft_limit(text, "Max realtime priority"),
            Some(Limit::AtMost(0))
        );
        assert_eq!(
            soft_limit(text, "Max realtime timeout"),
            Some(Limit::Unlimited)
        );
        assert_eq!(soft_limit(text, "Max locked memory"), None);
    }

    #[test]
    fn capabilities_are_bits() {
        let status = "CapInh:\t0000000000000000\nCapEff:\t0000000000804000\n";
        assert_eq!(has_capability(status, CAP_IPC_LOCK), Some(true));
        assert_eq!(has_capability(status, 0), Some(false));
        assert_eq!(has_capability("CapEff:\tx\n", CAP_IPC_LOCK), None);
        assert_eq!(has_capability("", CAP_IPC_LOCK), None);
    }

    #[test]
    fn a_name_with_parentheses_and_a_boost() {
        let stat = |priority: &str| {
            let zeros = |count: usize| vec!["0"; count].join(" ");
            format!("7 (a) b) S {} {priority} {} 20 1", zeros(14), zeros(21))
        };
        let boosted = scheduling(&stat("-91")).unwrap();
        assert_eq!(
            (boosted.real_time_priority, boosted.own_real_time_priority),
            (90, 20)
        );
        assert_eq!(scheduling(&stat("20")).unwrap().real_time_priority, 0);
        assert_eq!(scheduling(&stat("-101")).unwrap().real_time_priority, 0);
        for bad in ["", "7 (a)", "7 (a) S 1", &stat("x")] {
            assert_eq!(scheduling(bad), None, "{bad:?}");
        }
    }
}
