//! `lab cargo`: builds for 64-bit Arm.

use crate::arch::Arch;
use crate::build;
use crate::place::{Place, which};
use std::env;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Rust's name of the target.
const TARGET: &str = "aarch64-unknown-linux-gnu";
/// Links programs for it.
pub(crate) const LINKER: &str = "aarch64-linux-gnu-gcc";

/// Runs cargo. Returns its exit code.
///
/// # Errors
///
/// The compiler or the linker is missing, or no subcommand is given.
pub(crate) fn command(place: &Place, arguments: &[String]) -> Result<u8, String> {
    let Some((subcommand, rest)) = arguments.split_first() else {
        return Err(
            "lab cargo: what is cargo to do? `lab cargo build --package luna-core`".to_owned(),
        );
    };
    let mut cargo = arm_cargo(place, subcommand)?;
    // The user's own workspace, if that is where the command is called.
    if let Ok(folder) = env::current_dir() {
        cargo.current_dir(folder);
    }
    let status = cargo
        .args(rest)
        .status()
        .map_err(|error| format!("cargo: {error}"))?;
    Ok(status
        .code()
        .and_then(|code| u8::try_from(code).ok())
        .unwrap_or(1))
}

/// The compiler in the folder that its packages are unpacked to.
pub(crate) fn rustc(rust: &Path) -> PathBuf {
    rust.join("usr/bin/rustc")
}

/// Its shared libraries.
pub(crate) fn libraries(rust: &Path) -> PathBuf {
    rust.join("usr/lib/x86_64-linux-gnu")
}

/// What is missing before Arm programs can be built.
pub(crate) fn hindrance(place: &Place) -> Option<String> {
    let rustc = rustc(&place.rust());
    if !rustc.is_file() {
        return Some(format!(
            "{} is missing: run `lab setup --arm`",
            rustc.display()
        ));
    }
    if which(LINKER).is_none() {
        return Some(format!(
            "{LINKER} is missing (Debian: {})",
            Arch::Arm64.host_packages()[1]
        ));
    }
    None
}

/// Cargo in this workspace, with the compiler whose standard library is there for Arm.
///
/// # Errors
///
/// As [`hindrance`] says.
pub(crate) fn arm_cargo(place: &Place, subcommand: &str) -> Result<Command, String> {
    if let Some(reason) = hindrance(place) {
        return Err(reason);
    }
    let rust = place.rust();
    let mut all = vec![libraries(&rust)];
    if let Some(path) = env::var_os("LD_LIBRARY_PATH") {
        all.extend(env::split_paths(&path));
    }
    let all = env::join_paths(all).map_err(|error| error.to_string())?;
    let mut cargo = build::cargo();
    cargo
        .args([subcommand, "--target", TARGET])
        .env("LD_LIBRARY_PATH", all)
        .env("RUSTC", rustc(&rust))
        .env("CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER", LINKER);
    // Its artefacts are those of another compiler.
    if env::var_os("CARGO_TARGET_DIR").is_none() {
        cargo.env("CARGO_TARGET_DIR", place.folder().join("target"));
    }
    Ok(cargo)
}
