//! `luna model new`: a model to begin with.

use super::write_new;
use crate::failure::Failure;
use crate::print::say;
use clap::Args;
use std::path::PathBuf;
use std::process::ExitCode;

/// The options of `luna model new`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Exit codes: 0 written, 2 the file is there already, or cannot be written.")]
pub(crate) struct Arguments {
    /// The file to write (.toml); it must not be there yet
    file: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let path = &arguments.file;
    write_new(path, luna_model::TEMPLATE)?;
    let path = path.display();
    say(&format!(
        "{path}: check it with `luna model check {path}`\n"
    ))?;
    Ok(ExitCode::SUCCESS)
}
