//! What a program states of itself.

use crate::Peer;
use std::fs;
use std::hash::{BuildHasher, DefaultHasher, Hash, Hasher, RandomState};
use std::os::unix::fs::MetadataExt;

/// This process.
pub(crate) fn here() -> Peer {
    let host = fs::read_to_string("/proc/sys/kernel/hostname");
    let host = host.map(|host| host.trim().to_owned());
    Peer {
        pid: std::process::id(),
        host: host.unwrap_or_else(|_| "unknown".to_owned()),
    }
}

/// A number that no other opening has: never 0. Its key is of the system's source of randomness.
pub(crate) fn random() -> u64 {
    RandomState::new().hash_one(std::process::id()).max(1)
}

/// Equal for two programs if CLOCK_MONOTONIC is one clock for both: the same boot of the same
/// computer, and the same namespace of time. Unequal if that is unknown.
pub(crate) fn clock() -> u64 {
    let boot = fs::read_to_string("/proc/sys/kernel/random/boot_id");
    let namespace = fs::metadata("/proc/self/ns/time").map_or(0, |about| about.ino());
    let Ok(boot) = boot else {
        return random();
    };
    let mut hasher = DefaultHasher::new();
    (boot.trim(), namespace).hash(&mut hasher);
    hasher.finish()
}
