//! The operations to be counted, as listed by their program, which is always built in release mode.

use crate::callgrind::is_there;
use std::env;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// An operation that can be counted.
#[derive(Debug, PartialEq)]
pub(crate) struct Operation {
    /// What it is called.
    pub(crate) name: String,
    /// By how many operations its last two laps differ.
    pub(crate) count: u64,
}

/// The program with the operations.
#[derive(Debug, PartialEq)]
pub(crate) struct Operations {
    /// What built it.
    pub(crate) compiler: String,
    /// What it is linked with.
    pub(crate) c_library: String,
    /// Where it is.
    pub(crate) program: PathBuf,
    /// What it can do, in the order of the tables.
    pub(crate) all: Vec<Operation>,
}

impl Operations {
    /// Builds the program with these features, and runs its `list`. Its path does not depend on the
    /// features.
    ///
    /// # Errors
    ///
    /// When it cannot be built or run.
    pub(crate) fn build(features: &[&str]) -> Result<Operations, String> {
        let cargo = env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
        let said = Command::new(cargo)
            .args(["run", "--release", "--package", "luna-hot-operations"])
            .args(["--features", &features.join(",")])
            .args(["--", "list"])
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .stderr(Stdio::inherit())
            .output()
            .map_err(|error| format!("cargo: {error}"))?;
        if !said.status.success() {
            return Err(format!("the operations' program: {}", said.status));
        }
        let text = String::from_utf8_lossy(&said.stdout);
        Self::parse(&text).ok_or_else(|| format!("not a list of operations:\n{text}"))
    }

    fn parse(text: &str) -> Option<Operations> {
        let mut lines = text.lines();
        Some(Operations {
            compiler: lines.next()?.to_owned(),
            c_library: lines.next()?.to_owned(),
            program: Path::new(lines.next()?).to_owned(),
            all: lines
                .map(|line| {
                    let (count, name) = line.split_once(' ')?;
                    Some(Operation {
                        name: name.to_owned(),
                        count: count.parse().ok()?,
                    })
                })
                .collect::<Option<_>>()?,
        })
    }

    /// The operations with one of `parts` in their name, or all.
    ///
    /// # Errors
    ///
    /// There is none.
    pub(crate) fn select(&self, parts: &[String]) -> Result<Vec<&Operation>, String> {
        let is_chosen = |operation: &&Operation| {
            parts.is_empty()
                || parts
                    .iter()
                    .any(|part| operation.name.contains(part.as_str()))
        };
        let chosen: Vec<_> = self.all.iter().filter(is_chosen).collect();
        if chosen.is_empty() {
            return Err(format!("no operation's name contains {}", parts.join(", ")));
        }
        Ok(chosen)
    }
}

/// Why counts on this machine would be meaningless.
pub(crate) fn hindrance() -> Option<&'static str> {
    if !cfg!(all(target_os = "linux", target_arch = "x86_64")) {
        Some("the figures are those of x86-64 Linux")
    } else if !is_there() {
        Some("valgrind is not installed")
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIST: &str = "rustc 1.95.0\nglibc 2.36\n/target/release/program\n500 rendezvous\n3000 ring of 1000, a hop\n";

    #[test]
    fn a_list_is_read_and_selected_from() {
        let operations = Operations::parse(LIST).unwrap();
        assert_eq!(operations.compiler, "rustc 1.95.0");
        assert_eq!(operations.c_library, "glibc 2.36");
        assert_eq!(operations.program, Path::new("/target/release/program"));
        let counts: Vec<_> = operations.all.iter().map(|one| one.count).collect();
        assert_eq!(counts, [500, 3000]);
        let chosen = operations.select(&["ring".to_owned()]).unwrap();
        assert_eq!(chosen, [&operations.all[1]]);
        assert_eq!(operations.select(&[]).unwrap().len(), 2);
        assert!(operations.select(&["barrier".to_owned()]).is_err());
        assert!(Operations::parse("rustc\nglibc\nprogram\nmany rings\n").is_none());
    }
}
