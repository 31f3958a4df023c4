//! `luna model draw`: pictures.

use super::{read, write};
use crate::failure::Failure;
use crate::print::say;
use clap::{Args, ValueEnum};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// The options of `luna model draw`.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Exit codes: 0 drawn, 1 standard output is closed, 2 bad arguments or files."
)]
pub(crate) struct Arguments {
    /// The model (.toml)
    file: PathBuf,
    /// What to make of it
    #[arg(long, value_name = "FORMAT", default_value = "svg")]
    to: Format,
    /// Where to write; - is the standard output [default: beside the model]
    #[arg(long, short, value_name = "FILE")]
    output: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    /// A picture for browsers, with its own layout
    Svg,
    /// For Graphviz
    Dot,
    /// For Markdown that is drawn by Mermaid
    Mermaid,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let model = read(&arguments.file)?;
    let (text, extension) = match arguments.to {
        Format::Svg => (model.to_svg(), "svg"),
        Format::Dot => (model.to_dot(), "dot"),
        Format::Mermaid => (model.to_mermaid(), "mmd"),
    };
    let beside = arguments.file.with_extension(extension);
    let output = arguments.output.as_ref().unwrap_or(&beside);
    if output == Path::new("-") {
        say(&text)?;
        return Ok(ExitCode::SUCCESS);
    }
    write(output, &text)?;
    say(&format!("{}\n", output.display()))?;
    Ok(ExitCode::SUCCESS)
}
