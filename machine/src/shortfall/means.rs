//! What a process has to get privileges with: a remedy that it has already used is none.

use crate::facts::task::field;
use std::fmt::Display;

/// The user, the capabilities and the flags of a process, as far as they decide which remedy helps.
///
/// ```
/// use luna_machine::shortfall::{LatencyRefusal, Means, Shortfall};
///
/// let shortfall = Shortfall::DmaLatency(LatencyRefusal::NotPermitted);
/// let user = Means::of("Uid:\t1000\t1000\t1000\t1000\n");
/// let root = Means::of("Uid:\t0\t0\t0\t0\n");
/// assert!(shortfall.remedy_with(user).starts_with("run as root"));
/// assert!(!shortfall.remedy_with(root).contains("run as root"));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Means {
    is_root: bool,
    /// Capabilities in effect: a refusal for want of one was that of another process.
    effective: u64,
    /// Capabilities that no program started here can have; none where it is not known.
    unbounded: u64,
    /// Neither `sudo` nor `setcap` has an effect.
    no_new_privileges: bool,
}

/// A capability, and what else gives what it gives.
pub(super) struct Asked {
    pub(super) name: &'static str,
    pub(super) bit: u32,
    /// What helps a plain user.
    pub(super) plain: String,
    /// How a limit that stands in for it is raised before the start; none if none does.
    pub(super) limit: Option<&'static str>,
}

impl Means {
    /// Those that `/proc/PID/status` shows, of this machine or another.
    pub fn of(status: &str) -> Means {
        let user = field(status, "Uid").and_then(|uids| uids.split_whitespace().nth(1));
        let bits = |name| u64::from_str_radix(field(status, name)?, 16).ok();
        Means {
            is_root: user == Some("0"),
            effective: bits("CapEff").unwrap_or(0),
            unbounded: bits("CapBnd").map_or(0, |bounding| !bounding),
            no_new_privileges: field(status, "NoNewPrivs") == Some("1"),
        }
    }

    /// Those of this process; as of a plain user where they cannot be read. Reads a file.
    pub fn here() -> Means {
        std::fs::read_to_string("/proc/self/status")
            .map_or(Means::default(), |status| Means::of(&status))
    }

    /// Whether it is root.
    pub fn is_root(self) -> bool {
        self.is_root
    }

    /// What to do to get what the capability gives.
    pub(super) fn remedy(self, asked: &Asked) -> String {
        let Asked {
            name,
            bit,
            plain,
            limit,
        } = asked;
        let short = name.trim_start_matches("CAP_");
        let limit = limit.map_or_else(String::new, |limit| {
            format!(", or raise the limit before it starts ({limit})")
        });
        let has = |bits: u64| bits.checked_shr(*bit).unwrap_or(0) & 1 == 1;
        if has(self.effective) {
            plain.clone()
        } else if has(self.unbounded) {
            let who: &dyn Display = if self.is_root {
                &"this is root, but"
            } else {
                &"here"
            };
            format!(
                "{who} no program can have {name}: give it to the container (--cap-add {short}) or the service \
                 (CapabilityBoundingSet=, AmbientCapabilities={name}){limit}"
            )
        } else if self.is_root {
            format!(
                "this is root without {name}: start it without what takes that away (setpriv, capsh, a supervisor's \
                 capability settings){limit}"
            )
        } else if self.no_new_privileges {
            format!(
                "start it without no_new_privs, under which sudo and setcap have no effect (systemd's NoNewPrivileges=, a \
                 container's no-new-privileges), or by a service with AmbientCapabilities={name}{limit}"
            )
        } else {
            plain.clone()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::facts::task::{CAP_IPC_LOCK, CAP_SYS_NICE};
    use crate::shortfall::{LatencyRefusal, MemoryRefusal, PolicyRefusal, Shortfall};
    use luna_platform::thread::Policy;

    fn status(user: u32, bounding: u64, no_new_privileges: u8) -> Means {
        Means::of(&format!(
            "Uid:\t{user}\t{user}\t{user}\t{user}\nCapBnd:\t{bounding:016x}\nNoNewPrivs:\t{no_new_privileges}\n"
        ))
    }

    fn all() -> [Shortfall; 4] {
        let policy = |asked| Shortfall::Policy {
            asked,
            why: PolicyRefusal::NotPermitted { limit: Some(0) },
        };
        let millisecond = std::time::Duration::from_millis(1);
        [
            policy(Policy::fifo(80)),
            policy(Policy::deadline(millisecond, millisecond, millisecond)),
            Shortfall::MemoryLock(MemoryRefusal::Limited { limit: Some(0) }),
            Shortfall::DmaLatency(LatencyRefusal::NotPermitted),
        ]
    }

    #[test]
    fn root_is_not_told_to_become_root() {
        for bounding in [u64::MAX, 0] {
            for shortfall in all() {
                let remedy = shortfall.remedy_with(status(0, bounding, 0));
                assert!(!remedy.contains("as root"), "{remedy}");
                assert!(!remedy.contains("setcap"), "{remedy}");
            }
        }
    }

    #[test]
    fn a_remedy_looks_at_what_is_there() {
        let [policy, deadline, memory, _] = all();
        let plain = policy.remedy_with(status(1000, u64::MAX, 0));
        assert!(plain.starts_with("run as root") && plain.contains("limits.d"));
        let bare = !(1 << CAP_SYS_NICE | 1 << CAP_IPC_LOCK);
        for user in [0, 1000] {
            let remedy = policy.remedy_with(status(user, bare, 0));
            assert!(remedy.contains("--cap-add SYS_NICE"), "{remedy}");
            assert!(remedy.contains("ulimit -r"), "{remedy}");
            let remedy = memory.remedy_with(status(user, bare, 0));
            assert!(remedy.contains("--cap-add IPC_LOCK"), "{remedy}");
            // No limit stands in for it.
            let remedy = deadline.remedy_with(status(user, bare, 0));
            assert!(!remedy.contains("limit"), "{remedy}");
        }
        let remedy = memory.remedy_with(status(1000, u64::MAX, 1));
        assert!(
            remedy.contains("no_new_privs") && remedy.contains("memlock"),
            "{remedy}"
        );
    }
}
