//! Programs of their own that `luna` starts, as cargo and git start theirs: `luna demo` is the
//! program `luna-demo`.

use crate::failure::{Failure, unusable};
use std::env;
use std::ffi::OsString;
use std::path::PathBuf;
use std::process::{Command, ExitCode};

/// Where programs are looked for first.
const FOLDER: &str = "LUNA_PROGRAMS";

/// The commands that are programs of their own.
const APART: [&str; 1] = ["demo"];

/// Runs the program of the command `name` in the place of this one.
pub(crate) fn run(name: &str, words: &[OsString]) -> Result<ExitCode, Failure> {
    let program = format!("luna-{name}");
    let Some(path) = find(&program) else {
        return Err(unusable(format_args!("luna {name}"), missing(&program)));
    };
    let mut command = Command::new(&path);
    command.args(words);
    #[cfg(unix)]
    {
        use std::os::unix::process::CommandExt;
        // It returns only if it failed.
        Err(unusable(path.display(), command.exec()))
    }
    #[cfg(not(unix))]
    {
        let status = command.status();
        let status = status.map_err(|error| unusable(path.display(), error))?;
        Ok(ExitCode::from(status.code().unwrap_or(1) as u8))
    }
}

/// What `luna help` says of them.
pub(crate) fn help() -> String {
    let mut text = String::from(
        "Commands that are programs of their own, beside `luna`, in the PATH, or in the folder \
         LUNA_PROGRAMS:\n",
    );
    for name in APART {
        let program = format!("luna-{name}");
        text += &match find(&program) {
            Some(path) => format!("  {name}: {}\n", path.display()),
            None => format!("  {name}: {}\n", missing(&program)),
        };
    }
    text
}

fn missing(program: &str) -> String {
    format!(
        "the program `{program}` is not there; get it by `cargo install {program}`, or, in a checkout \
         of LUNA, by `cargo install --path examples/demo`"
    )
}

/// The file of a program.
fn find(program: &str) -> Option<PathBuf> {
    let stated = env::var_os(FOLDER).map(PathBuf::from);
    let here = env::current_exe().ok();
    let beside = here.as_deref().and_then(|path| path.parent());
    let search = env::var_os("PATH").unwrap_or_default();
    let folders = stated
        .into_iter()
        .chain(beside.map(PathBuf::from))
        .chain(env::split_paths(&search));
    let file = format!("{program}{}", env::consts::EXE_SUFFIX);
    folders
        .map(|folder| folder.join(&file))
        .find(|path| path.is_file())
}
