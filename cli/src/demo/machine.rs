//! What the demos of whole machines share: their common options, how one runs, and its output.

use super::{Show, print_json, print_parts, watch};
use crate::failure::Failure;
use crate::{args, exit};
use clap::Args;
use luna::prelude::*;
use luna::{Error, Report};
use serde::Serialize;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;

/// The options that each of these demos has.
#[derive(Debug, Clone, Args)]
pub(crate) struct Options {
    /// On a virtual clock; within this program
    #[arg(long = "virtual")]
    pub(crate) on_virtual_clock: bool,
    /// Record signals, messages and events (.luna), of this program
    #[arg(long, value_name = "FILE")]
    pub(crate) log: Option<PathBuf>,
    /// Serve the live scope while it runs, of this program; ADDR is host:port
    #[arg(long, value_name = "ADDR", num_args = 0..=1, default_missing_value = args::SCOPE)]
    pub(crate) scope: Option<SocketAddr>,
    /// Print one JSON object and nothing else
    #[arg(long)]
    json: bool,
}

impl Options {
    /// Runs what `build` puts into a system of this name, shown with `picture`. What `build` gave
    /// comes back with the report.
    pub(crate) fn run<M>(
        &self,
        name: &str,
        picture: &'static str,
        build: impl FnOnce(&mut System) -> Result<M, Failure>,
    ) -> Result<(M, Report), Failure> {
        let mut system = System::new(name);
        if self.on_virtual_clock {
            system.virtual_clock();
        }
        let show = Show {
            log: self.log.as_deref(),
            scope: self.scope,
            picture: Some(picture),
            ..Show::default()
        };
        let watched = watch(&mut system, show)?;
        let machine = build(&mut system)?;
        let report = system.run();
        watched.ended(&report);
        Ok((machine, report.map_err(Failure::Luna)?))
    }

    /// Prints the run, or these parts of text about it, and gives the exit code.
    pub(crate) fn print(
        &self,
        run: &impl Serialize,
        text: impl FnOnce() -> [String; 3],
        is_good: bool,
    ) -> Result<ExitCode, Failure> {
        let mut out = std::io::stdout().lock();
        match self.json {
            true => print_json(&mut out, run),
            false => print_parts(&mut out, text()),
        }
        .map_err(Failure::Output)?;
        Ok(exit::of_a_run(is_good))
    }
}

/// The run ended before there was anything to find.
pub(crate) fn too_early(report: &Report) -> Failure {
    let cause = format!("the run ended before its time: {}", report.end);
    Failure::Luna(Error::other(cause))
}
