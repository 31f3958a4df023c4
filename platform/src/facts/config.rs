//! The kernel's configuration, as distributions leave it in `/boot/config-RELEASE`.

use super::{Source, Unread, UnreadReason};

/// The configuration of the running kernel, packed by gzip, where it has one
/// (`CONFIG_IKCONFIG_PROC`).
pub const PACKED: &str = "/proc/config.gz";

/// The value of an option: `CONFIG_HZ=250` gives `250`, `# CONFIG_RT_GROUP_SCHED is not set` gives
/// `n`, one that is not there nothing.
///
/// ```
/// use luna_platform::facts::config::option;
///
/// let config = "CONFIG_PREEMPT_RT=y\n# CONFIG_RT_GROUP_SCHED is not set\nCONFIG_HZ=1000\n";
/// assert_eq!(option(config, "CONFIG_HZ"), Some("1000"));
/// assert_eq!(option(config, "CONFIG_RT_GROUP_SCHED"), Some("n"));
/// assert_eq!(option(config, "CONFIG_H"), None);
/// ```
pub fn option<'a>(config: &'a str, name: &str) -> Option<&'a str> {
    config.lines().find_map(|line| {
        if let Some(value) = line.strip_prefix(name) {
            return value.strip_prefix('=').map(str::trim);
        }
        let unset = line.strip_prefix("# ")?.strip_suffix(" is not set")?;
        (unset == name).then_some("n")
    })
}

/// The text of the configuration, and the file that it is from.
///
/// # Errors
///
/// That of the last place looked at. [`PACKED`] is not read: its bytes are a caller's to unpack, as
/// `luna doctor` does.
pub fn text(source: &Source) -> Result<(String, String), Unread> {
    let release = source.word("/proc/sys/kernel/osrelease")?;
    // A file of that name lies in one folder.
    if release.contains('/') {
        return Err(Unread::new(
            "/proc/sys/kernel/osrelease",
            UnreadReason::Malformed,
        ));
    }
    let mut last = None;
    for file in [
        format!("/boot/config-{release}"),
        format!("/lib/modules/{release}/config"),
        format!("/usr/lib/modules/{release}/config"),
    ] {
        match source.read(&file) {
            Ok(text) => return Ok((text, file)),
            // That of the place where most distributions have it.
            Err(unread) => last = last.or(Some(unread)),
        }
    }
    Err(last.unwrap_or_else(|| Unread::new("/boot", UnreadReason::Missing)))
}
