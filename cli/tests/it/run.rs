//! The command, run as its users run it, and its files.

use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

pub(crate) fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_luna"));
    command.args(arguments).env("LUNA_PROGRAMS", programs());
    command
}

/// The folder of the programs that `luna` starts: those that are built with these tests, and not
/// what another build has left beside it.
pub(crate) fn programs() -> PathBuf {
    Path::new(env!("CARGO_BIN_EXE_luna")).with_file_name("examples")
}

/// A conversion may replace what an earlier run of the tests has left.
pub(crate) fn luna(arguments: &[&str]) -> Output {
    let mut command = command(arguments);
    if arguments.first() == Some(&"convert") {
        command.arg("--replace");
    }
    command.output().expect("the program starts")
}

/// `luna model`.
pub(crate) fn luna_model(arguments: &[&str]) -> Output {
    luna(&[&["model"], arguments].concat())
}

pub(crate) fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).expect("output is text")
}

/// The one JSON object that it has printed.
pub(crate) fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).expect("one JSON object and nothing else")
}

/// A file that one test alone has, and that is not there.
pub(crate) fn file(name: &str) -> PathBuf {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_file(&path);
    path
}

pub(crate) fn path(path: &Path) -> &str {
    path.to_str().expect("a path of this test")
}

/// A model of the examples.
pub(crate) fn example(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../examples/models")
        .join(name)
}
