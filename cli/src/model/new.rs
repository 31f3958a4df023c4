//! `luna model new`: a model to begin with.

use crate::failure::Failure;
use crate::print::say;
use clap::Args;
use std::fs::File;
use std::io::Write;
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
    let failed = |error| Failure::ModelFile {
        path: path.clone(),
        error,
    };
    let mut file = File::create_new(path).map_err(failed)?;
    let written = file.write_all(luna_model::TEMPLATE.as_bytes());
    written.map_err(failed)?;
    let path = path.display();
    say(&format!(
        "{path}: check it with `luna model check {path}`\n"
    ))?;
    Ok(ExitCode::SUCCESS)
}
