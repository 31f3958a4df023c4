//! How much memory an exploration may take.

use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

/// Where the system does not say what is free.
const UNKNOWN: u64 = 1 << 30;

/// What explorations that run in this program may take.
static RESERVED: AtomicU64 = AtomicU64::new(0);

/// Half of the memory that is free for this program: of the machine, of its control groups, and
/// below its limits of address space and data. What explorations in this program may take already
/// counts as taken. 512 MiB where the system does not say.
///
/// Reads some files; not for the real-time path.
#[must_use]
pub fn default_memory() -> u64 {
    let free = free(Path::new("/")).unwrap_or(UNKNOWN);
    half_of(free, RESERVED.load(Ordering::Relaxed))
}

/// What one exploration may take, where others may take `reserved` bytes of what is free.
fn half_of(free: u64, reserved: u64) -> u64 {
    free.saturating_sub(reserved) / 2
}

/// Memory that an exploration may take, while it runs.
#[derive(Debug)]
pub(crate) struct Reserved(u64);

impl Reserved {
    pub(crate) fn new(bytes: u64) -> Self {
        RESERVED.fetch_add(bytes, Ordering::Relaxed);
        Self(bytes)
    }
}

impl Drop for Reserved {
    fn drop(&mut self) {
        RESERVED.fetch_sub(self.0, Ordering::Relaxed);
    }
}

/// The least of all that is said below `root`.
fn free(root: &Path) -> Option<u64> {
    let read = |path: &str| fs::read_to_string(root.join(path)).ok();
    let machine = read("proc/meminfo").and_then(|text| kib(&text, "MemAvailable:"));
    let groups = read("proc/self/cgroup").unwrap_or_default();
    let groups = groups.lines().filter_map(|line| in_group(root, line));
    let limits = read("proc/self/limits").unwrap_or_default();
    let status = read("proc/self/status").unwrap_or_default();
    let below = |limit: &str, used: &str| {
        let limit = limits.lines().find_map(|line| line.strip_prefix(limit))?;
        let limit: u64 = limit.split_whitespace().next()?.parse().ok()?;
        Some(limit.saturating_sub(kib(&status, used)?))
    };
    let limits = [
        below("Max address space", "VmSize:"),
        below("Max data size", "VmData:"),
    ];
    let all = machine.into_iter().chain(groups);
    all.chain(limits.into_iter().flatten()).min()
}

/// The bytes of a line `NAME: 123 kB`.
fn kib(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    let kib: u64 = line.split_whitespace().next()?.parse().ok()?;
    kib.checked_mul(1024)
}

/// What is free in a control group and those around it, of either version; none without a limit.
fn in_group(root: &Path, line: &str) -> Option<u64> {
    let mut parts = line.splitn(3, ':').skip(1);
    let (controllers, path) = (parts.next()?, parts.next()?);
    let (mount, limits, used, cache): (_, &[&str], _, _) = match controllers {
        "" => (
            "sys/fs/cgroup",
            &["memory.max", "memory.high"],
            "memory.current",
            "inactive_file",
        ),
        _ if controllers.split(',').any(|one| one == "memory") => (
            "sys/fs/cgroup/memory",
            &["memory.limit_in_bytes"],
            "memory.usage_in_bytes",
            "total_inactive_file",
        ),
        _ => return None,
    };
    let mount = root.join(mount);
    let group = mount.join(path.trim_start_matches('/'));
    // In a container the path may be that of the host: the mount itself is the group then.
    let groups = group.ancestors().filter(|one| one.starts_with(&mount));
    let free = groups.filter_map(|group| {
        let read = |name: &str| fs::read_to_string(group.join(name)).ok();
        let number = |name: &&str| read(name)?.trim().parse::<u64>().ok();
        let limit = limits.iter().filter_map(number).min()?;
        // The kernel takes back what it has read of files.
        let stat = read("memory.stat").unwrap_or_default();
        let stat = stat.lines().find_map(|line| {
            let (name, value) = line.split_once(' ')?;
            (name == cache).then(|| value.trim().parse::<u64>().ok())?
        });
        let used = number(&used)?.saturating_sub(stat.unwrap_or(0));
        Some(limit.saturating_sub(used))
    });
    free.min()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn root(files: &[(&str, &str)]) -> tempfile::TempDir {
        let root = tempfile::tempdir().unwrap();
        for (path, text) in files {
            let path = root.path().join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
        root
    }

    const MEMINFO: (&str, &str) = (
        "proc/meminfo",
        "MemTotal:  16000000 kB\nMemAvailable:   8000 kB\n",
    );

    #[test]
    fn the_least_of_machine_groups_and_limits_is_free() {
        assert_eq!(free(root(&[]).path()), None);
        assert_eq!(free(root(&[MEMINFO]).path()), Some(8000 * 1024));
        let mut files = vec![
            MEMINFO,
            ("proc/self/cgroup", "1:cpu:/other\n0::/a/b\n"),
            ("sys/fs/cgroup/a/b/memory.max", "max\n"),
            ("sys/fs/cgroup/a/b/memory.current", "10\n"),
            ("sys/fs/cgroup/a/memory.max", "5000\n"),
            ("sys/fs/cgroup/a/memory.current", "3000\n"),
            ("sys/fs/cgroup/a/memory.stat", "anon 1\ninactive_file 500\n"),
        ];
        assert_eq!(free(root(&files).path()), Some(2500));
        files.push(("sys/fs/cgroup/a/memory.high", "4000\n"));
        assert_eq!(free(root(&files).path()), Some(1500));
        files.push((
            "proc/self/limits",
            "Limit   Soft Limit   Hard Limit  Units\nMax data size   unlimited  unlimited bytes\n\
             Max address space   103424   unlimited   bytes\n",
        ));
        files.push(("proc/self/status", "VmSize:\t     100 kB\nVmData: 1 kB\n"));
        assert_eq!(free(root(&files).path()), Some(1024));
    }

    #[test]
    fn a_group_of_the_first_version_counts_also_by_its_mount_in_a_container() {
        let files = [
            MEMINFO,
            ("proc/self/cgroup", "4:memory:/docker/0123\n"),
            ("sys/fs/cgroup/memory/memory.limit_in_bytes", "7000\n"),
            ("sys/fs/cgroup/memory/memory.usage_in_bytes", "1000\n"),
        ];
        assert_eq!(free(root(&files).path()), Some(6000));
    }

    /// Without a large reservation of its own, which explorations of other tests would count.
    #[test]
    fn what_runs_counts_as_taken() {
        assert_eq!(half_of(1000, 0), 500);
        assert_eq!(half_of(1000, 600), 200);
        assert_eq!(half_of(1000, 2000), 0);
        let runs = Reserved::new(4096);
        assert!(RESERVED.load(Ordering::Relaxed) >= 4096);
        drop(runs);
        assert!(default_memory() > 0);
    }
}
