//! Calls cargo for this workspace.

use crate::place::checkout;
use nix::unistd::Pid;
use serde_json::Value;
use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Cargo, in this workspace.
pub(crate) fn cargo() -> Command {
    let mut command = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.current_dir(checkout());
    command
}

/// A program that was built.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Program {
    /// The target's name, such as `it`.
    pub(crate) target: String,
    /// The package's name.
    pub(crate) package: String,
    /// Its file.
    pub(crate) path: PathBuf,
    /// Whether it was built to test.
    pub(crate) is_test: bool,
}

impl Program {
    /// Whether it is one of libtest's programs, and takes their options.
    pub(crate) fn has_harness(&self) -> bool {
        // The one of this workspace that has none.
        (&*self.package, &*self.target) != ("luna-rt", "guardian")
    }
}

/// Builds with `command`, which is cargo with its arguments, and returns the programs.
///
/// # Errors
///
/// It cannot be built; cargo has printed why.
pub(crate) fn programs(mut command: Command) -> Result<Vec<Program>, String> {
    command.arg("--message-format=json-render-diagnostics");
    let said = command
        .stderr(Stdio::inherit())
        .output()
        .map_err(|error| format!("cargo: {error}"))?;
    if !said.status.success() {
        return Err(format!("cargo ended with {}", said.status));
    }
    Ok(parse(&String::from_utf8_lossy(&said.stdout)))
}

fn parse(messages: &str) -> Vec<Program> {
    let mut programs = Vec::new();
    for line in messages.lines() {
        let Ok(message) = serde_json::from_str::<Value>(line) else {
            continue;
        };
        if let (Some(path), Some(target), Some(id)) = (
            message["executable"].as_str(),
            message["target"]["name"].as_str(),
            message["package_id"].as_str(),
        ) {
            // `path+file:///folder#name@version`, without the name where the folder has it.
            let (folder, rest) = id.split_once('#').unwrap_or((id, ""));
            let package = match rest.split_once('@') {
                Some((name, _)) => name,
                None => folder.rsplit('/').next().unwrap_or(folder),
            };
            programs.push(Program {
                target: target.to_owned(),
                package: package.to_owned(),
                path: PathBuf::from(path),
                is_test: message["profile"]["test"] == true,
            });
        }
    }
    programs
}

/// The compiler that cargo calls, with its version.
///
/// # Errors
///
/// It cannot be called.
pub(crate) fn compiler() -> Result<String, String> {
    let rustc = env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let said = Command::new(rustc)
        .arg("--version")
        .current_dir(checkout())
        .output()
        .map_err(|error| format!("rustc: {error}"))?;
    Ok(String::from_utf8_lossy(&said.stdout).trim().to_owned())
}

/// A copy without debug information, which makes a boot quicker.
///
/// # Errors
///
/// There is no `strip` for it, or it cannot be written.
pub(crate) fn strip(strip: &str, from: &Path, to: &Path) -> Result<(), String> {
    // A process that reads it sees the old copy or the new one.
    let new = to.with_extension(format!("new-{}", Pid::this()));
    let said = Command::new(strip)
        .arg("-o")
        .args([&new, from])
        .output()
        .map_err(|error| format!("{strip} (Debian: binutils): {error}"))?;
    if !said.status.success() {
        let text = String::from_utf8_lossy(&said.stderr);
        return Err(format!("{strip} {}: {}", from.display(), text.trim()));
    }
    fs::rename(&new, to).map_err(|error| format!("{}: {error}", to.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn programs_are_read_from_cargos_messages() {
        let messages = "\
{\"reason\":\"compiler-artifact\",\"package_id\":\"path+file:///w/core#luna-core@0.2.0\",\"target\":{\"name\":\"it\"},\"executable\":\"/t/it-1\"}
{\"reason\":\"compiler-artifact\",\"package_id\":\"path+file:///w/busy#0.2.0\",\"target\":{\"name\":\"busy\"},\"executable\":\"/t/busy\"}
{\"reason\":\"compiler-artifact\",\"package_id\":\"registry+x#libc@0.2.1\",\"target\":{\"name\":\"libc\"},\"executable\":null}
running 1 test
";
        let all = parse(messages);
        let all: Vec<_> = all
            .iter()
            .map(|one| (&*one.package, &*one.target))
            .collect();
        assert_eq!(all, [("luna-core", "it"), ("busy", "busy")]);
    }
}
