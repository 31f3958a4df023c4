//! The contents of `/proc` for a process or thread: its fields and its capabilities.

/// The value of a field of `/proc/self/status`, such as `Cpus_allowed_list`.
///
/// ```
/// assert_eq!(luna_machine::facts::task::field("Name:\tcat\nThreads:\t1\n", "Threads"), Some("1"));
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
/// use luna_machine::facts::task::{CAP_SYS_NICE, has_capability};
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
/// use luna_machine::facts::task::is_first_user_namespace;
///
/// assert!(is_first_user_namespace("         0          0 4294967295\n"));
/// assert!(!is_first_user_namespace("         0     100000      65536\n"));
/// ```
pub fn is_first_user_namespace(uid_map: &str) -> bool {
    uid_map.split_whitespace().eq(["0", "0", "4294967295"])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn capabilities_are_bits() {
        let status = "CapInh:\t0000000000000000\nCapEff:\t0000000000804000\n";
        assert_eq!(has_capability(status, CAP_IPC_LOCK), Some(true));
        assert_eq!(has_capability(status, 0), Some(false));
        assert_eq!(has_capability("CapEff:\tx\n", CAP_IPC_LOCK), None);
        assert_eq!(has_capability("", CAP_IPC_LOCK), None);
    }
}
