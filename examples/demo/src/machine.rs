//! What the demos of whole machines share: their common options, how one runs, and its output.

use crate::exit;
use crate::failure::Failure;
use crate::jiwy::{Show, watch};
use crate::print::print;
use clap::Args;
use luna::prelude::*;
use luna::{Error, Report};
use serde::Serialize;
use std::io::{BufRead, BufReader, Write};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::{Child, Command, ExitCode, Stdio};

/// The options that each of these demos has.
#[derive(Debug, Clone, Args)]
pub(crate) struct Options {
    /// On a virtual clock; within this program
    #[arg(long = "virtual")]
    pub(crate) on_virtual_clock: bool,
    /// Record signals, messages and events (.luna), of this program
    #[arg(long, value_name = "FILE")]
    pub(crate) log: Option<PathBuf>,
    /// Replace files that are there: what is in them is lost
    #[arg(long)]
    pub(crate) replace: bool,
    /// Serve the live scope while it runs, of this program; ADDR is host:port
    #[arg(long, value_name = "ADDR", num_args = 0..=1, default_missing_value = luna_command::SCOPE)]
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
            replaces: self.replace,
            scope: self.scope,
            picture: Some(picture),
            ..Show::default()
        };
        let watched = watch(&mut system, show)?;
        let machine = build(&mut system)?;
        let report = system.run();
        watched.ended(&report);
        Ok((machine, report?))
    }

    /// # Errors
    ///
    /// A virtual clock was asked for: another program does not have it.
    pub(crate) fn needs_real_clock(&self) -> Result<(), Failure> {
        match self.on_virtual_clock {
            true => Err(Failure::Options(
                "--deploy programs: --virtual is for one program; use --deploy executor or threads",
            )),
            false => Ok(()),
        }
    }

    /// Prints the run, or these parts of text about it, and gives the exit code.
    pub(crate) fn print(
        &self,
        run: &impl Serialize,
        report: &Report,
        text: impl FnOnce() -> [String; 3],
        is_good: bool,
    ) -> Result<ExitCode, Failure> {
        print(self.json, run, text)?;
        let is_recorded = exit::is_recorded(report);
        Ok(exit::of_a_run(is_good && is_recorded))
    }
}

/// What a run was, in a line.
pub(crate) fn heading(name: &str, seconds: f64, faults: &[String], is_good: bool) -> String {
    let faults: String = faults.iter().map(|fault| format!(", {fault}")).collect();
    let good = if is_good { "good" } else { "not good" };
    format!("{name}, {seconds:.1} s{faults}: {good}\n")
}

/// A part of a machine as a program of its own: this program, started again. It is killed when this
/// is dropped.
pub(crate) struct Apart {
    child: Child,
    /// Where it listens.
    pub(crate) address: SocketAddr,
}

impl Apart {
    /// Starts it with these words of the command line. Its first line of output is to be the
    /// address that it listens on, as [`print_address`] prints it.
    pub(crate) fn start(words: &[&str]) -> Result<Self, Failure> {
        let failed = |cause: String| {
            let cause = format!("the program `luna demo {}`: {cause}", words.join(" "));
            Failure::Luna(Error::other(cause))
        };
        let file = std::env::current_exe().map_err(|error| failed(error.to_string()))?;
        let child = Command::new(file)
            .args(words)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|error| failed(error.to_string()))?;
        let mut apart = Self {
            child,
            address: SocketAddr::from(([127, 0, 0, 1], 0)),
        };
        let mut line = String::new();
        if let Some(output) = apart.child.stdout.as_mut() {
            let read = BufReader::new(output).read_line(&mut line);
            read.map_err(|error| failed(error.to_string()))?;
        }
        let address = line.trim().rsplit(' ').next().unwrap_or_default();
        apart.address = address
            .parse()
            .map_err(|_| failed(format!("its first line has no address: `{}`", line.trim())))?;
        Ok(apart)
    }
}

impl Drop for Apart {
    fn drop(&mut self) {
        // The machine that it served has ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The system of a program that is started by hand, or by [`Apart`] with `--child`: then it ends
/// with the program that started it.
pub(crate) fn system_of_a_part(name: &str, is_child: bool) -> System {
    let mut system = System::new(name);
    system.announce();
    if is_child {
        system.emergency_at_parents_death();
    }
    system
}

/// Prints where a part listens.
pub(crate) fn print_address(part: &str, address: SocketAddr) {
    let mut out = std::io::stdout().lock();
    // The reader may be gone.
    let _ = writeln!(out, "{part} listens on {address}");
    let _ = out.flush();
}

/// The run ended before its machine had a result.
pub(crate) fn too_early(report: &Report) -> Failure {
    let cause = format!("the run ended before its time: {}", report.end);
    Failure::Luna(Error::other(cause))
}
