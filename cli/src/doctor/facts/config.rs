//! The kernel's configuration, as distributions leave it in `/boot/config-RELEASE`.

use luna_machine::facts::{PreemptionModel, Source, Unread, UnreadReason};

/// The configuration of the running kernel, packed by gzip, where it has one
/// (`CONFIG_IKCONFIG_PROC`).
pub(crate) const PACKED: &str = "/proc/config.gz";

/// The value of an option: `CONFIG_HZ=250` gives `250`, `# CONFIG_RT_GROUP_SCHED is not set` gives
/// `n`, one that is not there nothing.
pub(crate) fn option<'a>(config: &'a str, name: &str) -> Option<&'a str> {
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
pub(crate) fn text(source: &Source) -> Result<(String, String), Unread> {
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

/// The preemption model that a kernel with this configuration boots with, unless its command line
/// asks for another.
pub(crate) fn preemption(config: &str) -> Option<PreemptionModel> {
    let options = [
        ("CONFIG_PREEMPT_RT", PreemptionModel::RealTime),
        ("CONFIG_PREEMPT_NONE", PreemptionModel::None),
        ("CONFIG_PREEMPT_VOLUNTARY", PreemptionModel::Voluntary),
        ("CONFIG_PREEMPT_LAZY", PreemptionModel::Lazy),
        ("CONFIG_PREEMPT", PreemptionModel::Full),
    ];
    let mut options = options.into_iter();
    let set = options.find(|(name, _)| option(config, name) == Some("y"));
    set.map(|(_, model)| model)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_of_a_configuration() {
        let config = "CONFIG_PREEMPT_NONE=y\n# CONFIG_PREEMPT is not set\n\
                      CONFIG_PREEMPT_DYNAMIC=y\nCONFIG_HZ=1000\n";
        assert_eq!(option(config, "CONFIG_HZ"), Some("1000"));
        assert_eq!(option(config, "CONFIG_PREEMPT"), Some("n"));
        assert_eq!(option(config, "CONFIG_H"), None);
        assert_eq!(preemption(config), Some(PreemptionModel::None));
        assert_eq!(preemption("CONFIG_HZ=100\n"), None);
    }
}
