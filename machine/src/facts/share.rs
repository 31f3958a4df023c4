//! How much of a core real-time threads may take.

use super::parse::kernel_version;
use super::{Source, Unread};
use std::fmt;
use std::time::Duration;

/// The share of a core that the kernel leaves to real-time threads that never sleep. When they have
/// used it up they stand still until the period is over.
///
/// ```
/// use luna_machine::facts::{RealTimeShare, Source};
///
/// match RealTimeShare::read(&Source::machine(), 0) {
///     Ok(Some(share)) => assert!(share.runtime < share.period),
///     Ok(None) => println!("all of it"),
///     Err(unread) => println!("{unread}"),
/// }
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct RealTimeShare {
    /// What they may take of each period.
    pub runtime: Duration,
    /// The period.
    pub period: Duration,
    /// The file that sets it.
    pub setting: String,
}

impl RealTimeShare {
    /// That of `core`, as far as `source` shows it; `None` if they may take all. Before Linux 6.12
    /// the kernel throttles real-time threads; since then a server of ordinary threads precedes
    /// them, and root alone can read how much it takes. Budgets of control groups are not looked
    /// at.
    ///
    /// Not for the real-time path.
    ///
    /// # Errors
    ///
    /// The file that could not be read.
    pub fn read(source: &Source, core: usize) -> Result<Option<RealTimeShare>, Unread> {
        let number = |text: &str| text.trim().parse::<i64>().ok();
        let version = source.parse("/proc/sys/kernel/osrelease", kernel_version)?;
        let (runtime, period, setting) = if version < (6, 12) {
            let setting = "/proc/sys/kernel/sched_rt_runtime_us".to_owned();
            let runtime = source.parse(&setting, number)?;
            let period = source.parse("/proc/sys/kernel/sched_rt_period_us", number)?;
            // -1 says that there is no limit.
            let runtime = u64::try_from(runtime).unwrap_or(u64::MAX);
            let period = u64::try_from(period).unwrap_or(0);
            let runtime = runtime.min(period);
            (
                Duration::from_micros(runtime),
                Duration::from_micros(period),
                setting,
            )
        } else {
            let folder = format!("/sys/kernel/debug/sched/fair_server/cpu{core}");
            let setting = format!("{folder}/runtime");
            let others = source.parse(&setting, |text| text.trim().parse::<u64>().ok())?;
            let period = format!("{folder}/period");
            let period = source.parse(&period, |text| text.trim().parse::<u64>().ok())?;
            let runtime = period.saturating_sub(others);
            (
                Duration::from_nanos(runtime),
                Duration::from_nanos(period),
                setting,
            )
        };
        let share = RealTimeShare {
            runtime,
            period,
            setting,
        };
        Ok((share.runtime < share.period).then_some(share))
    }

    /// Whether a thread that had the core for `processor_time` in `elapsed` came to the limit, or
    /// to within 2 % of it. A shorter time than a period shows nothing.
    pub fn is_reached(&self, processor_time: Duration, elapsed: Duration) -> bool {
        let share = self.runtime.as_secs_f64() / self.period.as_secs_f64();
        elapsed >= self.period
            && processor_time.as_secs_f64() >= elapsed.as_secs_f64() * share * 0.98
    }
}

/// As a part of a sentence: `950 ms of each 1 s (/proc/sys/kernel/sched_rt_runtime_us)`.
impl fmt::Display for RealTimeShare {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:?} of each {:?} ({})",
            self.runtime, self.period, self.setting
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn share(version: &str, files: &[(&str, &str)]) -> Option<RealTimeShare> {
        let root = std::env::temp_dir().join(format!("luna-share-{}", std::process::id()));
        let write = |path: &str, text: &str| {
            let path = root.join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        };
        write("proc/sys/kernel/osrelease", version);
        for (path, text) in files {
            write(path, text);
        }
        let share = RealTimeShare::read(&Source::folder(&root), 1);
        fs::remove_dir_all(root).unwrap();
        share.unwrap()
    }

    #[test]
    fn throttling_and_the_fair_server_leave_a_share() {
        let throttled = |runtime: &str| {
            let files = [
                ("proc/sys/kernel/sched_rt_runtime_us", runtime),
                ("proc/sys/kernel/sched_rt_period_us", "1000000\n"),
            ];
            share("6.1.0-56-rt-amd64\n", &files)
        };
        let limit = throttled("950000\n").unwrap();
        assert_eq!(
            limit.to_string(),
            "950ms of each 1s (/proc/sys/kernel/sched_rt_runtime_us)"
        );
        assert_eq!(throttled("-1\n"), None);
        assert_eq!(throttled("1000000\n"), None);

        let served = |runtime: &str| {
            let folder = "sys/kernel/debug/sched/fair_server/cpu1";
            let (own, period) = (format!("{folder}/runtime"), format!("{folder}/period"));
            share("6.18.1\n", &[(&own, runtime), (&period, "1000000000\n")])
        };
        assert_eq!(served("50000000\n").unwrap().runtime, limit.runtime);
        assert_eq!(served("0\n"), None);
    }

    #[test]
    fn it_is_reached_by_a_thread_that_never_sleeps_for_a_period() {
        let limit = RealTimeShare {
            runtime: Duration::from_millis(950),
            period: Duration::from_secs(1),
            setting: "x".to_owned(),
        };
        let is_reached = |took: u64, of: u64| {
            limit.is_reached(Duration::from_millis(took), Duration::from_millis(of))
        };
        assert!(is_reached(950, 1000) && is_reached(2500, 2600) && is_reached(931, 1000));
        assert!(!is_reached(929, 1000) && !is_reached(100, 10_000));
        assert!(!is_reached(990, 990), "the limit was not come to yet");
    }
}
