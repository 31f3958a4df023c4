//! Requests that the system refused: what, why, and how to get it.
//!
//! One type for all refusals, so that a report is one list and a strict start has one kind of
//! error.

mod means;
mod why;

pub use means::Means;
#[cfg(all(target_os = "linux", not(luna_portable)))]
pub(crate) use why::in_a_user_namespace;

use crate::facts::task::{CAP_IPC_LOCK, CAP_SYS_NICE};
use luna_platform::thread::Policy;
pub use luna_platform::thread::SpinRefusal;
use means::Asked;
use std::fmt;
use std::time::Duration;

/// Something that was asked for and not given.
///
/// `Display` says all in one line; [`what`](Self::what), [`why`](Self::why) and
/// [`remedy`](Self::remedy) are its parts.
///
/// ```
/// use luna_machine::shortfall::{LatencyRefusal, Shortfall};
///
/// let shortfall = Shortfall::DmaLatency(LatencyRefusal::Missing);
/// assert_eq!(shortfall.what(), "short wake-ups (/dev/cpu_dma_latency at 0)");
/// assert_eq!(shortfall.to_string(), format!("no {}: {}; {}", shortfall.what(), shortfall.why(), shortfall.remedy()));
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Shortfall {
    /// A real-time policy; the thread runs under [`Policy::Other`].
    Policy {
        /// The policy asked for.
        asked: Policy,
        /// Why it was refused.
        why: PolicyRefusal,
    },
    /// A core; the thread is not pinned.
    Core {
        /// The core asked for.
        asked: usize,
        /// Why it was refused.
        why: CoreRefusal,
    },
    /// A priority that a thread was to inherit; it runs at its own.
    Inheritance {
        /// The priority, of SCHED_FIFO.
        asked: u8,
        /// Why it was refused.
        why: PolicyRefusal,
    },
    /// To look for work before each sleep; the thread sleeps at once.
    Spin {
        /// The time asked for.
        asked: Duration,
        /// Why it was refused.
        why: SpinRefusal,
    },
    /// Locked memory; a page may have to be fetched when it is used.
    MemoryLock(MemoryRefusal),
    /// Short wake-ups; an idle core may sleep deeply.
    DmaLatency(LatencyRefusal),
}

/// Why a policy was refused.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum PolicyRefusal {
    /// The process may not: it has no CAP_SYS_NICE, and its limit is below the priority.
    NotPermitted {
        /// The process' RLIMIT_RTPRIO, where it could be read.
        limit: Option<u64>,
    },
    /// It may, but its control group (version 1) has no real-time budget.
    NoGroupBudget {
        /// The file that says so.
        file: String,
    },
    /// It may, but the kernel was built with group scheduling of real-time threads, which version 2
    /// cannot give a budget to.
    GroupWithoutBudget {
        /// The control group (version 2).
        group: String,
    },
    /// It has CAP_SYS_NICE in a user namespace, which does not count.
    UserNamespace,
    /// A deadline policy, and the process may not run on all cores: it was started under `taskset`,
    /// or its control group keeps it from some.
    NotAllCores {
        /// Those allowed, as the kernel writes lists.
        allowed: String,
    },
    /// A deadline policy, and the deadline threads together would take more of the processors than
    /// the kernel admits.
    NoBandwidth {
        /// The share that it admits in percent, where it could be read.
        share: Option<u8>,
    },
    /// A deadline policy, and its period is not within the kernel's limits.
    PeriodRange {
        /// The shortest period, in µs.
        least: u64,
        /// The longest.
        most: u64,
    },
    /// Nothing was refused, yet the thread has another policy.
    NotKept {
        /// What it has.
        obtained: Policy,
    },
    /// Another error of the kernel.
    Kernel {
        /// Its words.
        message: String,
    },
    /// This backend has no real-time policies.
    Unsupported,
}

/// Why a core was refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CoreRefusal {
    /// The machine has no such core.
    #[error("the machine has no such core, but {cores}")]
    NoSuchCore {
        /// Those it has, as the kernel writes lists.
        cores: String,
    },
    /// The core is switched off.
    #[error("it is switched off")]
    Offline,
    /// The control group (or container) of this process keeps it from the core.
    #[error("the process' control group does not allow it, but {allowed}")]
    NotAllowed {
        /// Those allowed, as the kernel writes lists.
        allowed: String,
    },
    /// Nothing was refused, yet the thread may run elsewhere.
    #[error("it was set, but the thread may still run elsewhere")]
    NotKept,
    /// Another error of the kernel.
    #[error("the kernel said: {message}")]
    Kernel {
        /// Its words.
        message: String,
    },
    /// This backend cannot pin threads.
    #[error("the portable backend cannot pin threads")]
    Unsupported,
}

/// Why memory was not locked.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MemoryRefusal {
    /// The process has no CAP_IPC_LOCK, and its limit is not unlimited. Under a smaller limit
    /// locking would succeed, and a later thread would fail to start.
    #[error(
        "CAP_IPC_LOCK is missing{}",
        limit.map_or_else(String::new, |limit| {
            format!(" and the limit on locked memory (RLIMIT_MEMLOCK) is {limit} bytes")
        })
    )]
    Limited {
        /// The process' RLIMIT_MEMLOCK in bytes, where it could be read.
        limit: Option<u64>,
    },
    /// Another error of the kernel.
    #[error("the kernel said: {message}")]
    Kernel {
        /// Its words.
        message: String,
    },
    /// This backend cannot lock memory.
    #[error("the portable backend cannot lock memory")]
    Unsupported,
}

/// Why wake-ups are not kept short.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LatencyRefusal {
    /// There is no `/dev/cpu_dma_latency`: a container, or a kernel without power management.
    #[error("/dev/cpu_dma_latency does not exist")]
    Missing,
    /// The process may not write to it.
    #[error("the process may not write to /dev/cpu_dma_latency")]
    NotPermitted,
    /// The process, or the machine, has as many open files as it may have.
    #[error("no file descriptor is left for /dev/cpu_dma_latency")]
    NoDescriptors,
    /// Another error of the kernel.
    #[error("the kernel said: {message}")]
    Kernel {
        /// Its words.
        message: String,
    },
    /// This backend has no such device.
    #[error("the portable backend has no such device")]
    Unsupported,
}

impl Shortfall {
    /// What was asked for, in a few words: `policy fifo:80`, `core 7`.
    pub fn what(&self) -> String {
        match self {
            Shortfall::Policy { asked, .. } => format!("policy {asked}"),
            Shortfall::Core { asked, .. } => format!("core {asked}"),
            Shortfall::Inheritance { asked, .. } => format!("inherited priority {asked}"),
            Shortfall::Spin { asked, .. } => {
                format!("{asked:?} of looking for work before a sleep")
            }
            Shortfall::MemoryLock(_) => "locked memory".to_owned(),
            Shortfall::DmaLatency(_) => "short wake-ups (/dev/cpu_dma_latency at 0)".to_owned(),
        }
    }

    /// Why it was not given.
    pub fn why(&self) -> String {
        match self {
            Shortfall::Policy { asked, why } => why.text(*asked),
            Shortfall::Core { why, .. } => why.to_string(),
            Shortfall::Inheritance { asked, why } => why.text(Policy::fifo(*asked)),
            Shortfall::Spin { why, .. } => why.to_string(),
            Shortfall::MemoryLock(why) => why.to_string(),
            Shortfall::DmaLatency(why) => why.to_string(),
        }
    }

    /// What this process can do to get it. Reads a file; not for the real-time path.
    pub fn remedy(&self) -> String {
        self.remedy_with(Means::here())
    }

    /// What a process with these means can do to get it.
    pub fn remedy_with(&self, means: Means) -> String {
        match self {
            Shortfall::Policy { asked, why } => why.remedy(*asked, means),
            Shortfall::Core { why, .. } => why.remedy(),
            Shortfall::Inheritance { asked, why } => why.remedy(Policy::fifo(*asked), means),
            Shortfall::Spin { why, .. } => spin_remedy(why).to_owned(),
            Shortfall::MemoryLock(why) => why.remedy(means),
            Shortfall::DmaLatency(why) => why.remedy(means),
        }
    }
}

impl fmt::Display for Shortfall {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "no {}: {}; {}", self.what(), self.why(), self.remedy())
    }
}

impl std::error::Error for Shortfall {}

/// What a backend without the thing says to do.
const RUN_ON_LINUX: &str = "run it on Linux, built without `--cfg luna_portable`";

impl PolicyRefusal {
    fn text(&self, asked: Policy) -> String {
        match self {
            Self::NotPermitted { .. } if asked.is_deadline() => {
                "CAP_SYS_NICE is missing, for which no limit stands in".to_owned()
            }
            Self::NotAllCores { allowed } => {
                format!("SCHED_DEADLINE is for threads that may run on all cores, and this process may on {allowed}")
            }
            Self::NoBandwidth { share: Some(share) } => format!(
                "all deadline threads together would take more than the {share} % of the processors that the kernel admits"
            ),
            Self::NoBandwidth { share: None } => {
                "all deadline threads together would take more of the processors than the kernel admits".to_owned()
            }
            Self::PeriodRange { least, most } => {
                format!("the kernel admits periods of {least} to {most} µs")
            }
            Self::NotPermitted { limit: Some(limit) } => {
                format!(
                    "CAP_SYS_NICE is missing and the limit on real-time priorities (RLIMIT_RTPRIO) is {limit}"
                )
            }
            Self::NotPermitted { limit: None } => "CAP_SYS_NICE is missing".to_owned(),
            Self::NoGroupBudget { file } => {
                format!("the process' control group has no real-time budget ({file} is 0)")
            }
            Self::GroupWithoutBudget { group } => format!(
                "the process may, but the kernel refused, probably since it is in the control group `{group}` (version 2) and the \
                 kernel has CONFIG_RT_GROUP_SCHED"
            ),
            Self::UserNamespace => "CAP_SYS_NICE holds in a user namespace only".to_owned(),
            Self::NotKept { obtained } => {
                format!("it was set, but the thread runs under {obtained} instead of {asked}")
            }
            Self::Kernel { message } => format!("the kernel said: {message}"),
            Self::Unsupported => "the portable backend has no real-time policies".to_owned(),
        }
    }

    fn remedy(&self, asked: Policy, means: Means) -> String {
        let capability = |plain, limit| {
            means.remedy(&Asked {
                name: "CAP_SYS_NICE",
                bit: CAP_SYS_NICE,
                plain,
                limit,
            })
        };
        match self {
            Self::NotPermitted { .. } if asked.is_deadline() => {
                let plain = "run as root, or `sudo setcap cap_sys_nice,cap_ipc_lock+ep PROGRAM` (in a container: --cap-add SYS_NICE)";
                capability(plain.to_owned(), None)
            }
            Self::NotAllCores { .. } => {
                "start it without taskset, or make its cpuset a root domain of its own (cpuset.cpus.partition), or choose SCHED_FIFO".to_owned()
            }
            Self::NoBandwidth { .. } => {
                "ask for less runtime or a longer period, end other deadline threads (chrt -p shows them), or raise \
                 /proc/sys/kernel/sched_rt_runtime_us"
                    .to_owned()
            }
            Self::PeriodRange { .. } => {
                "choose a period within them, or change /proc/sys/kernel/sched_deadline_period_min_us and sched_deadline_period_max_us".to_owned()
            }
            Self::UserNamespace if asked.is_deadline() => {
                "start it outside of the namespace (a container that is not rootless)".to_owned()
            }
            Self::NotPermitted { .. } => {
                let plain = format!(
                    "run as root, or `sudo setcap cap_sys_nice,cap_ipc_lock+ep PROGRAM`, or put `USER - rtprio {}` into \
                     /etc/security/limits.d/luna.conf and log in again (in a container: --cap-add SYS_NICE --ulimit rtprio={0})",
                    asked.priority().max(99)
                );
                capability(plain, Some("`ulimit -r 99`, LimitRTPRIO=99, a container's --ulimit rtprio=99"))
            }
            Self::UserNamespace => format!(
                "start it outside of the namespace (a container that is not rootless), or with a limit raised before it starts \
                 (--ulimit rtprio={})",
                asked.priority().max(99)
            ),
            Self::NoGroupBudget { file } => {
                format!("write a budget in µs to it and to those above it (echo 950000 > {file}), or start it in the root group")
            }
            Self::GroupWithoutBudget { .. } => {
                "start it in the root control group (echo PID > /sys/fs/cgroup/cgroup.procs), or boot with rt_group_sched=0".to_owned()
            }
            Self::NotKept { .. } => "see which other program changes the policies of threads (rtkit, a cgroup manager)".to_owned(),
            Self::Kernel { .. } if asked.is_deadline() => "see sched_setattr(2) and sched(7)".to_owned(),
            Self::Kernel { .. } => "see sched_setscheduler(2)".to_owned(),
            Self::Unsupported => RUN_ON_LINUX.to_owned(),
        }
    }
}

impl CoreRefusal {
    fn remedy(&self) -> String {
        match self {
            Self::NoSuchCore { .. } => "choose one of these".to_owned(),
            Self::Offline => {
                "switch it on (echo 1 > /sys/devices/system/cpu/cpuN/online), or choose another".to_owned()
            }
            Self::NotAllowed { .. } => {
                "choose one of these, or add it to the group's cpuset.cpus (in a container: --cpuset-cpus)".to_owned()
            }
            Self::NotKept => "see which other program changes the affinity of threads".to_owned(),
            Self::Kernel { .. } => "see sched_setaffinity(2)".to_owned(),
            Self::Unsupported => RUN_ON_LINUX.to_owned(),
        }
    }
}

fn spin_remedy(why: &SpinRefusal) -> &'static str {
    match why {
        SpinRefusal::SharedCore { .. } => "pin one of them to another core",
        SpinRefusal::UnpinnedNeighbour { .. } => "pin that one to another core",
        _ => "pin it to a core where nothing else runs",
    }
}

impl MemoryRefusal {
    fn remedy(&self, means: Means) -> String {
        match self {
            Self::Limited { .. } => means.remedy(&Asked {
                name: "CAP_IPC_LOCK",
                bit: CAP_IPC_LOCK,
                plain: "run as root, or `sudo setcap cap_sys_nice,cap_ipc_lock+ep PROGRAM`, or put `USER - memlock unlimited` into \
                 /etc/security/limits.d/luna.conf and log in again (in a container: --cap-add IPC_LOCK or --ulimit memlock=-1)"
                    .to_owned(),
                limit: Some("`ulimit -l unlimited`, LimitMEMLOCK=infinity, a container's --ulimit memlock=-1"),
            }),
            Self::Kernel { .. } => "see mlockall(2)".to_owned(),
            Self::Unsupported => RUN_ON_LINUX.to_owned(),
        }
    }
}

impl LatencyRefusal {
    fn remedy(&self, means: Means) -> String {
        match self {
            Self::NoDescriptors => {
                "raise the limit on open files (`ulimit -n`, LimitNOFILE=), or close some".to_owned()
            }
            Self::NotPermitted if means.is_root() => {
                "this is root, which may not here: pass the device into the container (--device /dev/cpu_dma_latency) or allow it to \
                 the service (DeviceAllow=/dev/cpu_dma_latency w), and keep CAP_DAC_OVERRIDE if its mode does not let root write"
                    .to_owned()
            }
            Self::Missing => "build the kernel with CONFIG_PM and CONFIG_CPU_IDLE, or pass the device into the container".to_owned(),
            Self::NotPermitted => {
                "run as root, or let a group write to it (chgrp realtime /dev/cpu_dma_latency && chmod g+w /dev/cpu_dma_latency)"
                    .to_owned()
            }
            Self::Kernel { .. } => "see the kernel's Documentation/power/pm_qos_interface.rst".to_owned(),
            Self::Unsupported => RUN_ON_LINUX.to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As `Display` shows it, whatever user runs the test.
    fn of_plain_user(shortfall: &Shortfall) -> String {
        let remedy = shortfall.remedy_with(Means::default());
        format!("no {}: {}; {remedy}", shortfall.what(), shortfall.why())
    }

    #[test]
    fn a_refusal_says_what_why_and_how() {
        let why = PolicyRefusal::NotPermitted { limit: Some(0) };
        let text = of_plain_user(&Shortfall::Policy {
            asked: Policy::fifo(80),
            why,
        });
        for part in [
            "fifo:80",
            "CAP_SYS_NICE",
            "RLIMIT_RTPRIO",
            "is 0",
            "limits.d",
            "setcap",
        ] {
            assert!(text.contains(part), "{part} in: {text}");
        }
        let why = CoreRefusal::NoSuchCore {
            cores: "0-1".to_owned(),
        };
        let text = Shortfall::Core { asked: 77, why }.to_string();
        assert!(text.contains("core 77") && text.contains("0-1"), "{text}");
        let text = of_plain_user(&Shortfall::MemoryLock(MemoryRefusal::Limited {
            limit: Some(8 << 20),
        }));
        assert!(
            text.contains("8388608") && text.contains("memlock unlimited"),
            "{text}"
        );
    }
}
