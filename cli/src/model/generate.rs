//! `luna model generate`: a Rust package that runs a model.

use super::read;
use crate::failure::{Failure, failed};
use crate::package::luna;
use clap::Args;
use luna_model::File;
use std::ffi::OsStr;
use std::fs;
use std::io::{self, ErrorKind, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

/// The options of `luna model generate`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "\
What is below src/generated is written anew each time: channels, processes, where they run. The rest is yours, and is written only where it is missing: src/processes/NAME.rs has the body of each process, begun from the model; src/types.rs the types that the model only names. Each file is shown as written, unchanged or kept.

The package runs at once: cargo run --manifest-path DIR/Cargo.toml -- --seconds 5

Exit codes: 0 generated, 1 standard output is closed, 2 bad arguments or files.")]
pub(crate) struct Arguments {
    /// The model (.toml)
    file: PathBuf,
    /// The package's folder: new, empty, or generated before
    #[arg(long, short, value_name = "DIR")]
    output: PathBuf,
    /// The folder of the LUNA that the package depends on [default: the checkout around the current
    /// folder, else this version of crates.io]; for a new package only
    #[arg(long, value_name = "PATH")]
    luna: Option<PathBuf>,
}

/// Below the package's folder.
const GENERATED: &str = "src/generated";
const PROCESSES: &str = "src/processes";
const MANIFEST: &str = "Cargo.toml";

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let folder = &arguments.output;
    let model = read(&arguments.file)?;
    let luna = luna(arguments.luna.as_deref())?;
    let files = model.generate(&luna).map_err(super::problem)?;
    check(folder, &files)?;
    // All of them before anything is printed: standard output may be closed.
    let mut done = Vec::new();
    for file in &files {
        let path = folder.join(&file.path);
        done.push((write(&path, file)?, path, file));
    }
    let superfluous = superfluous(folder, &files)?;
    let mut out = io::stdout().lock();
    for (done, path, file) in done {
        writeln!(out, "{done:<9} {}", path.display()).map_err(Failure::Output)?;
        if done == KEPT && !file.defines.is_empty() {
            note_missing(&mut out, &path, file)?;
        }
        if done == KEPT && file.path == MANIFEST && arguments.luna.is_some() {
            note_unused_luna(&mut out, &path, file)?;
        }
    }
    for path in superfluous {
        let why = "no process of the model has this file: remove it if nothing else uses it";
        writeln!(out, "{KEPT:<9} {}: {why}", path.display()).map_err(Failure::Output)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Refuses a folder of something else, and what stands in the way of a file, before anything is
/// written.
fn check(folder: &Path, files: &[File]) -> Result<(), Failure> {
    let refused = |path: &Path, why| Err(failed(path)(why));
    let mut entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(failed(folder)(error)),
    };
    // What begins with a dot is of other tools, such as git.
    let is_visible = |entry: &fs::DirEntry| !entry.file_name().as_encoded_bytes().starts_with(b".");
    if entries.any(|entry| entry.is_ok_and(|entry| is_visible(&entry)))
        && !folder.join(GENERATED).is_dir()
    {
        let why =
            "the folder holds something else: give one that is new, empty, or was generated before";
        return refused(folder, why);
    }
    for file in files {
        let path = folder.join(&file.path);
        match fs::metadata(&path) {
            Ok(found) if !found.is_file() => {
                return refused(&path, "this is no file, and one is to be here: move it");
            }
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(failed(&path)(error)),
            _ if !file.is_generated => continue,
            _ => {}
        }
        match fs::read_to_string(&path) {
            Ok(text) if !File::was_generated(&text) => {
                let why = "this file was not generated, and would be overwritten: move it to another folder";
                return refused(&path, why);
            }
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(failed(&path)(error)),
            _ => {}
        }
    }
    Ok(())
}

const KEPT: &str = "kept";

/// Writes a file if it is to be written; says what was done.
fn write(path: &Path, file: &File) -> Result<&'static str, Failure> {
    if !file.is_generated && path.exists() {
        return Ok(KEPT);
    }
    let there = match fs::read_to_string(path) {
        Ok(text) => Some(text),
        Err(error) if error.kind() == ErrorKind::NotFound => None,
        Err(error) => return Err(failed(path)(error)),
    };
    let is_rust = path.extension() == Some(OsStr::new("rs"));
    let formatted = is_rust.then(|| formatted(&file.text)).flatten();
    let text = formatted.as_ref().unwrap_or(&file.text);
    if there.as_ref() == Some(text) {
        return Ok("unchanged");
    }
    if let Some(parent) = path.parent() {
        fs::create_dir_all(parent).map_err(failed(parent))?;
    }
    replace(path, text).map_err(failed(path))?;
    Ok("written")
}

/// Writes a whole file or none of it.
fn replace(path: &Path, text: &str) -> io::Result<()> {
    // A link stays one.
    let path = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let folder = path.parent().unwrap_or(Path::new("."));
    let mut file = tempfile::Builder::new()
        .permissions(fs::Permissions::from_mode(0o666))
        .tempfile_in(folder)?;
    file.write_all(text.as_bytes())?;
    file.as_file().sync_all()?;
    file.persist(&path).map_err(|error| error.error)?;
    Ok(())
}

/// As `rustfmt` lays it out; nothing if that is not installed, or does not take it.
fn formatted(text: &str) -> Option<String> {
    let mut rustfmt = Command::new("rustfmt")
        .args(["--edition", "2024", "--quiet"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .ok()?;
    // It reads to the end before it writes.
    let written = rustfmt.stdin.take()?.write_all(text.as_bytes());
    let output = rustfmt.wait_with_output().ok()?;
    let is_good = written.is_ok() && output.status.success() && !output.stdout.is_empty();
    String::from_utf8(output.stdout).ok().filter(|_| is_good)
}

/// Names what a file that is kept is to define, and does not.
fn note_missing(out: &mut impl Write, path: &Path, file: &File) -> Result<(), Failure> {
    let text = fs::read_to_string(path).map_err(failed(path))?;
    for name in file.missing_in(&text) {
        let wanted = "define it there: the model names this type";
        writeln!(out, "          {}: `{name}`: {wanted}", path.display())
            .map_err(Failure::Output)?;
    }
    Ok(())
}

/// Says that a manifest that is kept does not depend on what `--luna` states.
fn note_unused_luna(out: &mut impl Write, path: &Path, file: &File) -> Result<(), Failure> {
    let text = fs::read_to_string(path).map_err(failed(path))?;
    let dependency = file.text.lines().find(|line| line.starts_with("luna-rt "));
    if let Some(dependency) = dependency.filter(|line| !text.lines().any(|one| one == *line)) {
        let why = "--luna is not used, as this file is yours; for that LUNA write there";
        writeln!(out, "          {}: {why}: {dependency}", path.display())
            .map_err(Failure::Output)?;
    }
    Ok(())
}

/// Files of processes that the model does not have.
fn superfluous(folder: &Path, files: &[File]) -> Result<Vec<PathBuf>, Failure> {
    let processes = folder.join(PROCESSES);
    let mut found = Vec::new();
    for entry in fs::read_dir(&processes).map_err(failed(&processes))? {
        let path = entry.map_err(failed(&processes))?.path();
        let is_known = files.iter().any(|file| folder.join(&file.path) == path);
        if !is_known && path.extension() == Some(OsStr::new("rs")) {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}
