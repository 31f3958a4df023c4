//! Which process has a device open, as far as the kernel shows it. It stands in the error of a busy
//! device, so that a user sees what to stop; it is looked up only then.

use luna_error::Holder;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// The holder of a lock of the whole file (`flock`).
pub(super) fn of_lock(path: &Path) -> Holder {
    let Ok(inode) = fs::metadata(path).map(|about| about.ino()) else {
        return Holder::Unknown;
    };
    let locks = fs::read_to_string("/proc/locks").unwrap_or_default();
    locks
        .lines()
        .find_map(|line| locker(line, inode))
        .map_or(Holder::Unknown, named)
}

/// The process that holds the lock in a line of `/proc/locks`, if the lock is of this inode. The
/// device numbers are not compared: for the file system of a device file, this file writes them in
/// another way than `stat`.
fn locker(line: &str, inode: u64) -> Option<u32> {
    let mut words = line.split_whitespace().skip(1);
    if words.next() != Some("FLOCK") {
        return None;
    }
    let pid = words.nth(2)?;
    let of = words.next()?.rsplit(':').next()?;
    (of.parse() == Ok(inode)).then(|| pid.parse().ok())?
}

/// Another process that has `path` open, or this one.
pub(super) fn of_file(path: &Path) -> Holder {
    let path = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let mut found = Holder::Unknown;
    for process in fs::read_dir("/proc").into_iter().flatten().flatten() {
        let Some(pid) = process
            .file_name()
            .to_str()
            .and_then(|name| name.parse().ok())
        else {
            continue;
        };
        let files = fs::read_dir(process.path().join("fd"));
        let has_it = files
            .into_iter()
            .flatten()
            .flatten()
            .any(|file| fs::read_link(file.path()).is_ok_and(|target| target == path));
        if has_it {
            found = named(pid);
            if found != Holder::ThisProgram {
                break;
            }
        }
    }
    found
}

fn named(pid: u32) -> Holder {
    if pid == std::process::id() {
        return Holder::ThisProgram;
    }
    let name = fs::read_to_string(format!("/proc/{pid}/comm")).unwrap_or_default();
    Holder::Process {
        pid,
        name: name.trim_end().to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_owner_of_a_lock_is_read_from_its_line() {
        let line = "4: FLOCK  ADVISORY  WRITE 1234 00:05:1063 0 EOF";
        assert_eq!(locker(line, 1063), Some(1234));
        assert_eq!(locker(line, 106), None);
        let of_a_part = "5: POSIX  ADVISORY  WRITE 77 00:05:1063 0 EOF";
        assert_eq!(locker(of_a_part, 1063), None);
        // A process that waits for it.
        assert_eq!(
            locker("4: -> FLOCK  ADVISORY  WRITE 99 00:05:1063 0 EOF", 1063),
            None
        );
        for broken in [
            "",
            "4:",
            "4: FLOCK",
            "4: FLOCK ADVISORY WRITE x 00:05:1063 0 EOF",
        ] {
            assert_eq!(locker(broken, 1063), None, "{broken}");
        }
    }
}
