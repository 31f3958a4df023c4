//! `luna model edit`: a model in the browser.
//!
//! # Why it is built so
//!
//! The page is served by the scope's server, as a `Site` of it: its checks of hosts and origins,
//! its limits and its token hold here too, and there is no second server. The token keeps other
//! users of the machine from the file.
//!
//! The page has no model of its own. It shows the `View` that the program sends, and sends the
//! edits of `luna_model::edit`. The program changes the text, and sends a new view. So the file is
//! all there is: what the page shows is what the file says, comments and order are those of its
//! authors, and undoing gives back the text to the byte.
//!
//! An edit whose values cannot be read is refused. One that leaves something open (a port that is
//! not bound yet) makes a draft, which the page shows with what is missing. The file is written as
//! soon as the draft is a whole model, and not before: other programs never find a file there that
//! cannot be read as a model.
//!
//! `file` is the file on the disk, `desk` what the page asks for, `findings` the checks.

mod desk;
mod file;
mod findings;
mod page;

use crate::failure::Failure;
use crate::scope::unserved;
use clap::Args;
use desk::Desk;
use luna_scope::{Scope, Settings};
use std::io::Write;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

/// The options of `luna model edit`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "\
Prints the address to open. The file is written after each edit that leaves a whole model; comments and order stay. What another
program writes meanwhile is read again, and never overwritten. docs/model-editor.md describes the page.

Exit codes: it runs until a signal ends it; 2 bad arguments or files, or the address cannot be had.")]
pub(crate) struct Arguments {
    /// The model (.toml)
    file: PathBuf,
    /// Where to listen; there is no encryption, so that what is no loopback is for a network that
    /// one trusts
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:8622")]
    listen: SocketAddr,
    /// Execution times, as of `luna model schedule`: shown in place with the bounds
    #[arg(long, value_name = "RECORDING")]
    costs: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let desk = Desk::open(&arguments.file, arguments.costs.clone())?;
    let address = arguments.listen;
    let settings = Settings::default().address(address);
    let settings = settings.site(Arc::new(desk)).map_err(unserved(address))?;
    let scope = Scope::open(settings).map_err(unserved(address))?;
    let mut out = std::io::stdout().lock();
    let written = writeln!(out, "{}", scope.url()).and_then(|()| out.flush());
    written.map_err(Failure::Output)?;
    drop(out);
    // Until a signal ends the program.
    loop {
        std::thread::park();
    }
}
