//! The package's manifest.

use super::names::KEYWORDS;
use crate::model::Model;
use std::fmt;
use std::path::PathBuf;
use toml::de::DeTable;

/// The library that a generated package depends on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Luna {
    /// A checkout: the folder of the package `luna-rt`.
    Folder(PathBuf),
    /// A version of crates.io.
    Version(String),
    /// A repository: its address.
    Git(String),
}

impl fmt::Display for Luna {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Folder(path) => write!(f, "in {}", path.display()),
            Self::Version(version) => write!(f, "{version} of crates.io"),
            Self::Git(url) => write!(f, "of {url}"),
        }
    }
}

impl Luna {
    /// Where a dependency on the package of `folder` comes from, as in a manifest; `""` is that of
    /// `luna-rt`.
    #[must_use]
    pub fn source(&self, folder: &str) -> String {
        match self {
            Self::Folder(path) => {
                let path = match folder {
                    "" => path.clone(),
                    _ => path.join(folder),
                };
                format!("path = \"{}\"", escaped(&path.display().to_string()))
            }
            Self::Version(version) => format!("version = \"{version}\""),
            // Cargo finds the package by its name.
            Self::Git(url) => format!("git = \"{}\"", escaped(url)),
        }
    }
}

/// As within the quotation marks of a text of TOML.
fn escaped(text: &str) -> String {
    text.replace('\\', "\\\\").replace('"', "\\\"")
}

/// Names of Cargo itself, of Rust's libraries, and of this one.
const TAKEN: [&str; 11] = [
    "build",
    "deps",
    "examples",
    "incremental",
    "test",
    "core",
    "std",
    "alloc",
    "proc-macro",
    "luna",
    "luna-rt",
];

/// Whether the text of a Cargo.toml is that of the library.
#[must_use]
pub fn is_luna(manifest: &str) -> bool {
    let Ok(manifest) = DeTable::parse(manifest) else {
        return false;
    };
    let package = manifest.get_ref().get("package");
    let package = package.and_then(|package| package.get_ref().as_table());
    let name = package.and_then(|package| package.get("name"));
    name.and_then(|name| name.get_ref().as_str()) == Some("luna-rt")
}

/// A name that Cargo takes, made of another: lower-case letters, digits and `-`, a letter first.
/// Where `name` has a meaning already, or begins with no letter, `prefix` comes before it.
#[must_use]
pub fn package_name(name: &str, prefix: &str) -> String {
    let mut found = String::new();
    for letter in name.chars() {
        if letter.is_ascii_alphanumeric() {
            found.push(letter.to_ascii_lowercase());
        } else if !found.is_empty() && !found.ends_with('-') {
            found.push('-');
        }
    }
    let found = found.trim_end_matches('-');
    let is_taken = TAKEN.contains(&found) || KEYWORDS.contains(&found);
    if !found.starts_with(|c: char| c.is_ascii_alphabetic()) || is_taken {
        return format!("{prefix}-{found}").trim_end_matches('-').to_owned();
    }
    found.to_owned()
}

pub(super) fn manifest(model: &Model, luna: &Luna) -> String {
    let name = package_name(model.name(), "model");
    let luna = luna.source("");
    format!(
        "\
# `luna model generate` wrote this once: change it as you like.
[package]
name = \"{name}\"
version = \"0.1.0\"
edition = \"2024\"
publish = false

# `events`: a run can be recorded (LUNA_LOG=run.luna LUNA_LOG_EVENTS=65536) with what its channels do.
[dependencies]
luna-rt = {{ {luna}, features = [\"events\"] }}

# It belongs to no workspace around it.
[workspace]

[profile.dev]
debug = \"line-tables-only\"

# In the model an overflow is an error.
[profile.release]
overflow-checks = true
"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_packages() {
        for (name, package) in [
            ("philosophers, repaired", "philosophers-repaired"),
            ("5 cells", "model-5-cells"),
            ("test", "model-test"),
            ("loop", "model-loop"),
            ("Ω", "model"),
        ] {
            assert_eq!(package_name(name, "model"), package);
        }
    }

    #[test]
    fn the_library_is_known_by_its_name() {
        assert!(is_luna("[package]\nname = \"luna-rt\"\n"));
        assert!(!is_luna(
            "[package]\nname = \"other\"\n# name = \"luna-rt\"\n"
        ));
        assert!(!is_luna("no TOML"));
    }
}
