//! Rust types from `.msg` and `.srv` files, for build scripts.
//!
//! The folder is laid out as ROS 2 lays out packages: `PACKAGE/msg/NAME.msg` and
//! `PACKAGE/srv/NAME.srv`. In `build.rs`:
//!
//! ```no_run
//! let out = std::path::Path::new(&std::env::var("OUT_DIR")?).join("interfaces.rs");
//! println!("cargo::rerun-if-changed=interfaces");
//! luna_ros2::generate::folder("interfaces", out)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! and in the program `include!(concat!(env!("OUT_DIR"), "/interfaces.rs"));`. Each package is a
//! module. A message `Level` is a `struct Level`; a service `Fill` is a type `Fill` that implements
//! `Service`, with `FillRequest` and `FillReply`. A build script needs no DDS:
//! `luna-ros2 = { version = "…", default-features = false }` among the build dependencies.
//!
//! | in the file | in Rust |
//! | --- | --- |
//! | `bool`, `int8` … `uint64`, `float32`, `float64` | `bool`, `i8` … `u64`, `f32`, `f64` |
//! | `byte`, `char` | `u8` |
//! | `string`, `T[]` | `String`, `Vec<T>`: on the heap |
//! | `T[N]` | `[T; N]` |
//! | `string<=N`, `T[<=N]` | `ArrayString<N>`, `ArrayVec<T, N>`: in place, for the real-time path |
//! | `package/Name`, `Name` | a type of this folder, else of `luna_ros2::msg` |
//! | a constant | an associated constant |
//! | a default | the value in `Default` |
//!
//! Refused, with file and line: `wstring`, actions, types that are neither in the folder nor in
//! `luna_ros2::msg`, and what is no ROS 2 interface at all.

mod parse;
mod types;
mod write;

use parse::Interface;
use std::path::{Path, PathBuf};
use std::{fs, io};
use thiserror::Error;

/// Why no types were generated.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum GenerateError {
    /// A file or folder cannot be read or written.
    #[error("{path}: {error}")]
    File {
        /// Which.
        path: PathBuf,
        /// Why.
        #[source]
        error: io::Error,
    },
    /// A line of a file has no Rust type, or is wrong.
    #[error("{path}:{line}: {what}")]
    Refused {
        /// The file.
        path: PathBuf,
        /// Its line, from 1.
        line: usize,
        /// What is wrong, and what to do.
        what: String,
    },
    /// There is no interface in the folder.
    #[error("{path}: there is no PACKAGE/msg/NAME.msg and no PACKAGE/srv/NAME.srv below it")]
    Empty {
        /// The folder.
        path: PathBuf,
    },
}

/// Reads all packages below `folder` and writes their types into the file `out`: see the module's
/// documentation. The same files give the same text.
///
/// # Errors
///
/// [`GenerateError`]. Nothing is written then.
pub fn folder(folder: impl AsRef<Path>, out: impl AsRef<Path>) -> Result<(), GenerateError> {
    let text = packages(folder.as_ref())?
        .into_iter()
        .map(|(name, body)| {
            format!("/// Interfaces of the package `{name}`.\npub mod {name} {{\n{body}}}\n")
        })
        .collect::<String>();
    let out = out.as_ref();
    fs::write(out, text).map_err(|error| failed(out, error))
}

/// The packages below `folder`, by name, each with the body of its module.
///
/// # Errors
///
/// As for [`folder()`].
///
/// ```
/// let folder = std::env::temp_dir().join(format!("luna-ros2-doc-{}", std::process::id()));
/// std::fs::create_dir_all(folder.join("tank_msgs/msg"))?;
/// std::fs::write(folder.join("tank_msgs/msg/Level.msg"), "float64 metres\n")?;
/// let packages = luna_ros2::generate::packages(&folder)?;
/// assert_eq!(packages[0].0, "tank_msgs");
/// assert!(packages[0].1.contains("pub metres: f64,"));
/// # std::fs::remove_dir_all(folder)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn packages(folder: impl AsRef<Path>) -> Result<Vec<(String, String)>, GenerateError> {
    let folder = folder.as_ref();
    let mut interfaces = Vec::new();
    for package in entries(folder)? {
        for kind in ["msg", "srv"] {
            let inner = package.join(kind);
            if !inner.is_dir() {
                continue;
            }
            for file in entries(&inner)? {
                if file.extension().is_some_and(|extension| extension == kind) {
                    let text = fs::read_to_string(&file).map_err(|error| failed(&file, error))?;
                    interfaces.push(Interface::parse(&file, &stem(&package), kind, &text)?);
                }
            }
        }
    }
    if interfaces.is_empty() {
        return Err(GenerateError::Empty {
            path: folder.to_owned(),
        });
    }
    write::packages(&interfaces)
}

/// What is in a folder, sorted.
fn entries(folder: &Path) -> Result<Vec<PathBuf>, GenerateError> {
    let list = fs::read_dir(folder).and_then(|entries| {
        entries
            .map(|entry| entry.map(|entry| entry.path()))
            .collect::<io::Result<Vec<_>>>()
    });
    let mut list = list.map_err(|error| failed(folder, error))?;
    list.sort();
    Ok(list)
}

fn stem(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default();
    stem.to_string_lossy().into_owned()
}

fn failed(path: &Path, error: io::Error) -> GenerateError {
    GenerateError::File {
        path: path.to_owned(),
        error,
    }
}
