//! Which processes read a blackboard: its readers write nothing, so the kernel is asked which
//! processes hold their lock.

use super::Found;
use crate::files::byte_of;
use crate::name::Name;
use crate::{IpcError, Role};
use std::fs;
use std::path::Path;

/// The processes that have the receiving side open, in the order of their numbers. Those of other
/// users, and programs with privileges of their own, do not show what they have open, and are left
/// out.
///
/// It looks through the open files of all processes: some milliseconds.
///
/// # Errors
///
/// [`IpcError`]: the name of `found` is none.
///
/// ```
/// use luna_ipc::{Blackboard, look};
///
/// let name = format!("doc/{}/readers", std::process::id());
/// let writer = Blackboard::new(&name).entry("speed", 0.0_f64).write()?;
/// let reader = Blackboard::new(&name).read()?;
/// let found = look::at(&name)?.unwrap();
/// assert!(found.receiver.is_some());
/// assert_eq!(look::readers(&found)?, [std::process::id()]);
/// # drop((writer, reader));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn readers(found: &Found) -> Result<Vec<u32>, IpcError> {
    let lock = Name::new(&found.name)?.lock();
    let Ok(processes) = fs::read_dir("/proc") else {
        return Ok(Vec::new());
    };
    let mut readers: Vec<u32> = processes
        .flatten()
        .filter_map(|entry| entry.file_name().to_str()?.parse().ok())
        .filter(|pid| holds(*pid, &lock, byte_of(Role::Receiver)))
        .collect();
    readers.sort_unstable();
    Ok(readers)
}

fn holds(pid: u32, lock: &Path, byte: i64) -> bool {
    let Ok(files) = fs::read_dir(format!("/proc/{pid}/fd")) else {
        return false;
    };
    files.flatten().any(|entry| {
        if !fs::read_link(entry.path()).is_ok_and(|path| path == lock) {
            return false;
        }
        let number = entry.file_name();
        let info = Path::new("/proc").join(pid.to_string()).join("fdinfo");
        let info = fs::read_to_string(info.join(number)).unwrap_or_default();
        info.lines().any(|line| is_lock_of(line, byte))
    })
}

/// `lock: 1: OFDLCK ADVISORY  READ -1 00:1b:51 2 2`: the last two are its first and last byte.
fn is_lock_of(line: &str, byte: i64) -> bool {
    let mut words = line.split_whitespace();
    words.next() == Some("lock:") && {
        let mut words: Vec<&str> = words.collect();
        words.pop();
        words.pop().and_then(|first| first.parse().ok()) == Some(byte)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn locks_are_known_by_their_byte() {
        let line = "lock:\t1: OFDLCK ADVISORY  READ -1 00:1b:51 2 2";
        assert!(is_lock_of(line, 2) && !is_lock_of(line, 1));
        assert!(!is_lock_of("flags:\t02100002", 2) && !is_lock_of("lock:", 2));
    }
}
