//! The package's manifest.

use crate::model::Model;
use std::path::PathBuf;
use toml::de::DeTable;

/// The library that a generated package depends on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Luna {
    /// A checkout: the folder of the package `luna-rt`.
    Folder(PathBuf),
    /// A version of crates.io.
    Version(String),
}

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

/// A name that Cargo takes: letters, digits and `-`, a letter first.
fn package_name(name: &str) -> String {
    let mut found = String::new();
    for letter in name.chars() {
        if letter.is_ascii_alphanumeric() {
            found.push(letter.to_ascii_lowercase());
        } else if !found.is_empty() && !found.ends_with('-') {
            found.push('-');
        }
    }
    let found = found.trim_end_matches('-');
    // Names of Rust and Cargo themselves, and numbers, with a word before.
    let is_taken = [
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
    if !found.starts_with(|c: char| c.is_ascii_alphabetic()) || is_taken.contains(&found) {
        return format!("model-{found}").trim_end_matches('-').to_owned();
    }
    found.to_owned()
}

pub(super) fn manifest(model: &Model, luna: &Luna) -> String {
    let name = package_name(model.name());
    let luna = match luna {
        Luna::Folder(path) => {
            let path = path.display().to_string();
            let path = path.replace('\\', "\\\\").replace('"', "\\\"");
            format!("path = \"{path}\"")
        }
        Luna::Version(version) => format!("version = \"{version}\""),
    };
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
            ("Ω", "model"),
        ] {
            assert_eq!(package_name(name), package);
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
