//! `/proc` of a process or thread: its limits and its policy.

use std::fmt;

/// A limit that the system sets a process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Limit {
    /// None.
    Unlimited,
    /// At most this.
    AtMost(u64),
}

impl fmt::Display for Limit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Limit::Unlimited => f.write_str("unlimited"),
            Limit::AtMost(most) => most.fmt(f),
        }
    }
}

/// A soft limit of `/proc/self/limits`, by the name that the file gives it, such as `Max realtime
/// priority`.
pub(crate) fn soft_limit(limits: &str, name: &str) -> Option<Limit> {
    let line = limits.lines().find_map(|line| line.strip_prefix(name))?;
    match line.split_whitespace().next()? {
        "unlimited" => Some(Limit::Unlimited),
        number => number.parse().ok().map(Limit::AtMost),
    }
}

/// How the kernel schedules a thread, from its `stat` file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Scheduling {
    /// The priority of SCHED_FIFO or SCHED_RR that is in effect, inherited ones included; 0 for
    /// none.
    pub(crate) real_time_priority: u8,
    /// Its own, without inheritance.
    pub(crate) own_real_time_priority: u8,
}

/// Reads `/proc/PID/stat` or `/proc/thread-self/stat`. `None` if it has another form.
pub(crate) fn scheduling(stat: &str) -> Option<Scheduling> {
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
