//! Packages that the command writes, and Cargo in them.

use crate::run::{luna, path, text};
use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

pub(crate) fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn temporary(kind: &str) -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join(kind)
}

/// A folder of one test, which is not there.
pub(crate) fn folder(name: &str) -> PathBuf {
    let path = temporary("generated").join(name);
    let _ = fs::remove_dir_all(&path);
    let _ = fs::remove_dir_all(target(&path));
    path
}

/// The versions that are there without a network.
pub(crate) fn lock(folder: &Path) {
    let lock = folder.join("Cargo.lock");
    if !lock.exists() {
        fs::copy(workspace().join("Cargo.lock"), lock).expect("the versions are copied");
    }
}

/// Cargo's folders of what the packages depend on. Built once, since that takes longer than all of
/// the packages.
fn dependencies() -> &'static Path {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    BUILT.get_or_init(|| {
        let package = folder("dependencies");
        let (luna_here, to) = (workspace(), path(&package));
        let made = luna(&["new", "--template", "axis", "--luna", path(&luna_here), to]);
        assert!(made.status.success(), "{}", text(&made.stderr));
        lock(&package);
        let target = temporary("generated-target");
        let mut build = cargo_with_target(&package, "build", &target);
        let built = build.output().expect("cargo starts");
        assert!(built.status.success(), "{}", text(&built.stderr));
        target.join("debug")
    })
}

/// The target folder of a package. It is its own, so that Cargo's lock makes no test wait for
/// another.
fn target(folder: &Path) -> PathBuf {
    let name = folder.file_name().expect("a folder has a name");
    temporary("generated-targets").join(name)
}

/// Links of the files of a folder, at the same places in another.
fn link(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("the folder is made");
    for entry in fs::read_dir(from).expect("it was built") {
        let entry = entry.expect("it can be read");
        let (from, to) = (entry.path(), to.join(entry.file_name()));
        if entry.file_type().expect("it has one").is_dir() {
            link(&from, &to);
        } else {
            fs::hard_link(&from, &to).expect("both are in one file system");
        }
    }
}

/// Sets the target folder of a package, in which its dependencies are built, for a command that
/// runs Cargo.
pub(crate) fn with_target(command: &mut Command, folder: &Path) {
    let target = target(folder);
    if !target.exists() {
        for kind in [".fingerprint", "build", "deps"] {
            link(&dependencies().join(kind), &target.join("debug").join(kind));
        }
    }
    set_target(command, &target);
}

/// The profile is the same for all, since what is built is not the same for another.
fn set_target(command: &mut Command, target: &Path) {
    command
        .env("CARGO_TARGET_DIR", target)
        .env("CARGO_INCREMENTAL", "0")
        .env("CARGO_PROFILE_DEV_DEBUG", "false")
        .env("CARGO_PROFILE_DEV_STRIP", "debuginfo");
}

fn cargo_with_target(folder: &Path, command: &str, target: &Path) -> Command {
    let mut cargo = Command::new(env::var_os("CARGO").unwrap_or("cargo".into()));
    cargo
        .args([command, "--offline", "--manifest-path"])
        .arg(folder.join("Cargo.toml"))
        .current_dir(folder);
    set_target(&mut cargo, target);
    cargo
}

/// Cargo in a package.
pub(crate) fn cargo(folder: &Path, command: &str) -> Command {
    let mut cargo = cargo_with_target(folder, command, &target(folder));
    with_target(&mut cargo, folder);
    cargo
}

/// The same, run to its end.
pub(crate) fn run_cargo(folder: &Path, command: &str, arguments: &[&str]) -> Output {
    cargo(folder, command)
        .args(arguments)
        .output()
        .expect("cargo starts")
}
