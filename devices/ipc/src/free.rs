//! How much memory can be had for a file of shared memory. The kernel refuses what a file system
//! has not, and no more: where the memory itself runs out it ends a process.

use luna_machine::facts::control_group::{file, group_two, mount_of_two};
use nix::sys::statvfs::fstatvfs;
use std::fs::{self, File};
use std::io;
use std::path::Path;

/// The bytes that can be had, and whether the file system is what bounds them. What the system does
/// not say bounds nothing.
pub(crate) fn here(file: &File) -> io::Result<(u64, bool)> {
    let found = fstatvfs(file)?;
    // A tmpfs without a limit says that it has no blocks at all.
    let folder = match found.blocks() {
        0 => u64::MAX,
        _ => (found.blocks_available()).saturating_mul(found.fragment_size()),
    };
    let memory = fs::read_to_string("/proc/meminfo").ok();
    let memory = memory.as_deref().and_then(available).unwrap_or(u64::MAX);
    let memory = memory.min(of_groups().unwrap_or(u64::MAX));
    Ok((folder.min(memory), folder <= memory))
}

/// `MemAvailable:    7654321 kB`, in bytes.
fn available(text: &str) -> Option<u64> {
    let line = text
        .lines()
        .find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let number: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    number.checked_mul(1024)
}

/// What is left to this program's control group, and to those around it: a container has one.
fn of_groups() -> Option<u64> {
    let groups = fs::read_to_string("/proc/self/cgroup").ok()?;
    let mounts = fs::read_to_string("/proc/self/mounts").ok()?;
    let (group, mount) = (group_two(&groups)?, mount_of_two(&mounts)?);
    let left = Path::new(group).ancestors().filter_map(|group| {
        let read = |name| fs::read_to_string(file(mount, group.to_str()?, name)).ok();
        left(
            &read("memory.max")?,
            &read("memory.current")?,
            &read("memory.stat")?,
        )
    });
    left.min()
}

/// The bytes that a group may have still. The pages of files that it has count, and are given up
/// for others; those of shared memory are not.
fn left(most: &str, current: &str, stat: &str) -> Option<u64> {
    let most: u64 = most.trim().parse().ok()?;
    let current: u64 = current.trim().parse().ok()?;
    let files = stat.lines().filter_map(|line| {
        let (name, bytes) = line.split_once(' ')?;
        let is_file = ["active_file", "inactive_file"].contains(&name);
        is_file.then(|| bytes.parse::<u64>().ok()).flatten()
    });
    let files = files.fold(0, u64::saturating_add);
    Some(most.saturating_sub(current.saturating_sub(files)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn free_memory_is_read_in_bytes() {
        let text = "MemTotal:  10 kB\nMemAvailable:   7654321 kB\nBuffers: 1 kB\n";
        assert_eq!(available(text), Some(7_654_321 * 1024));
        assert_eq!(available("MemTotal:  10 kB\n"), None);
    }

    #[test]
    fn a_group_has_its_limit_less_what_it_keeps() {
        let stat = "anon 700\nshmem 50\ninactive_file 100\nactive_file 20\n";
        assert_eq!(left("1000\n", "900\n", stat), Some(1000 - (900 - 120)));
        assert_eq!(left("1000\n", "5000\n", stat), Some(0));
        assert_eq!(left("max\n", "900\n", stat), None, "it has no limit");
    }
}
