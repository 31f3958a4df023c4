//! Where the figures come from: they mean little without it.

use std::{fs, path::Path, process::Command, time::Duration};

use luna_machine::facts::parse::stolen_ticks;

/// The peers, as `Cargo.lock` names them.
const PEERS: [&str; 7] = [
    "async-channel",
    "async-executor",
    "crossbeam-channel",
    "flume",
    "futures-util",
    "kanal",
    "tokio",
];

/// The lines above a table: machine, kernel, scheduling policy, compiler, commit, peers' versions,
/// and the other languages installed.
pub fn head() -> String {
    let lines = facts().map(|(key, value)| format!("{key:<9} {value}"));
    lines.join("\n")
}

/// The facts of [`head`], by keys.
pub fn facts() -> [(&'static str, String); 7] {
    [
        ("machine", machine()),
        ("kernel", kernel()),
        ("policy", policy()),
        ("compiler", env!("LUNA_BENCHES_COMPILER").to_owned()),
        ("commit", commit()),
        ("peers", peers(include_str!("../../Cargo.lock"))),
        ("others", crate::external::found_and_missing()),
    ]
}

/// CPU time that a virtual machine's host gave to others since the machine's start.
pub fn stolen() -> Option<Duration> {
    let text = fs::read_to_string("/proc/stat").ok()?;
    let ticks = text.lines().filter_map(stolen_ticks);
    // Ticks are hundredths of a second.
    Some(Duration::from_millis(
        10 * ticks.map(|(_, stolen)| stolen).sum::<u64>(),
    ))
}

/// The folder of the workspace.
pub fn workspace() -> &'static Path {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    package.parent().unwrap_or(package)
}

fn machine() -> String {
    let info = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let value = |key: &str| {
        let line = info.lines().find(|line| line.starts_with(key));
        let value = line.and_then(|line| line.split_once(": "));
        value.map_or("unknown", |(_, value)| value.trim())
    };
    let virtual_machine = info.contains(" hypervisor");
    format!(
        "{} (family {} model {}), {} cores usable{}",
        value("model name"),
        value("cpu family"),
        value("model\t"),
        crate::cores::cores().len(),
        if virtual_machine { ", virtual" } else { "" }
    )
}

fn kernel() -> String {
    let read = |name: &str| {
        let text = fs::read_to_string(Path::new("/proc/sys/kernel").join(name));
        text.map_or_else(|_| "unknown".to_owned(), |text| text.trim().to_owned())
    };
    format!(
        "{} {} {}",
        read("ostype"),
        read("osrelease"),
        read("version")
    )
}

fn policy() -> String {
    let stat = fs::read_to_string("/proc/self/stat").unwrap_or_default();
    policy_in(&stat).unwrap_or("unknown").to_owned()
}

/// Fields are counted from behind the name, which may contain anything; the policy is the 41st of
/// the whole line.
fn policy_in(stat: &str) -> Option<&'static str> {
    let (_, fields) = stat.rsplit_once(") ")?;
    Some(match fields.split_whitespace().nth(38)? {
        "0" => "SCHED_OTHER",
        "1" => "SCHED_FIFO",
        "2" => "SCHED_RR",
        "3" => "SCHED_BATCH",
        "5" => "SCHED_IDLE",
        _ => return None,
    })
}

fn commit() -> String {
    let git = |arguments: &[&str]| {
        let output = Command::new("git")
            .arg("--no-optional-locks")
            .args(arguments)
            .current_dir(workspace())
            .output();
        let output = output.ok().filter(|output| output.status.success())?;
        Some(String::from_utf8_lossy(&output.stdout).trim().to_owned())
    };
    let Some(commit) = git(&["rev-parse", "--short", "HEAD"]) else {
        return "unknown".to_owned();
    };
    match git(&["status", "--porcelain"]) {
        Some(changes) if changes.is_empty() => commit,
        _ => commit + " with changes",
    }
}

fn peers(lock: &str) -> String {
    let version = |peer: &str| {
        // The newest, which stands last: an older one is that of another package.
        let (_, package) = lock.rsplit_once(&format!("name = \"{peer}\"\nversion = \""))?;
        let (version, _) = package.split_once('"')?;
        Some(format!("{peer} {version}"))
    };
    let versions: Vec<String> = PEERS.iter().filter_map(|peer| version(peer)).collect();
    versions.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn policy_is_found_behind_an_odd_name() {
        let fields: Vec<String> = (3..=52).map(|field| field.to_string()).collect();
        let stat = |policy: &str| {
            let mut fields = fields.clone();
            fields[41 - 3] = policy.to_owned();
            format!("17 (a) b (c) {}", fields.join(" "))
        };
        assert_eq!(policy_in(&stat("1")), Some("SCHED_FIFO"));
        assert_eq!(policy_in(&stat("0")), Some("SCHED_OTHER"));
        assert_eq!(policy_in(""), None);
    }

    #[test]
    fn peers_are_in_the_lock_file() {
        let peers = peers(include_str!("../../Cargo.lock"));
        assert_eq!(peers.split(", ").count(), PEERS.len(), "{peers}");
    }
}
