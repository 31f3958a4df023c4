//! Packages that the command writes, and Cargo in them.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

pub(crate) fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

pub(crate) fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).expect("output is text")
}

/// A folder of one test, which is not there.
pub(crate) fn folder(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("generated")
        .join(name);
    let _ = fs::remove_dir_all(&path);
    path
}

/// The versions that are there without a network.
pub(crate) fn lock(folder: &Path) {
    let lock = folder.join("Cargo.lock");
    if !lock.exists() {
        fs::copy(workspace().join("Cargo.lock"), lock).expect("the versions are copied");
    }
}

/// Cargo in a package; all of them share what they depend on.
pub(crate) fn cargo(folder: &Path, command: &str) -> Command {
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).join("generated-target");
    let mut cargo = Command::new(env::var_os("CARGO").unwrap_or("cargo".into()));
    cargo
        .args([command, "--offline", "--manifest-path"])
        .arg(folder.join("Cargo.toml"))
        .current_dir(folder)
        .env("CARGO_TARGET_DIR", target);
    cargo
}

/// The same, run to its end.
pub(crate) fn run_cargo(folder: &Path, command: &str, arguments: &[&str]) -> Output {
    cargo(folder, command)
        .args(arguments)
        .output()
        .expect("cargo starts")
}
