//! `luna record`: receives what other programs record, a file for each, and shows their messages.
//!
//! `file` is where a sender's blocks go, `messages` what is shown of them, `name` how the files are
//! called.

mod file;
mod messages;
mod name;
pub(crate) mod signals;

use crate::args::{Messages, Record};
use crate::exit;
use crate::failure::{Failure, failed, unusable};
use crate::result_file::is_there;
use crate::scope::Shown;
use crate::text::Count;
use file::File;
use luna_logger::{Departure, FileSink, Handler, Peer, PeerError, Receiver, Sink};
use luna_scope::Scope;
use std::collections::HashMap;
use std::fmt::Display;
use std::io::{self, Write};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};

/// Receives as the command line asks.
pub(crate) fn run(arguments: &Record) -> Result<ExitCode, Failure> {
    if arguments.once
        && let Some(path) = &arguments.output
    {
        FileSink::check_name(path).map_err(failed(path))?;
        // Now, and not when a sender comes.
        let has_content = |there: std::fs::Metadata| there.is_file() && there.len() > 0;
        if !arguments.replace && path.metadata().is_ok_and(has_content) {
            return Err(is_there(path));
        }
    }
    let deaf = |error| unusable(format_args!("--listen {}", arguments.listen), error);
    let (end, ends) = channel();
    // Before any thread is made: all threads then leave the signals to the one that waits for them.
    signals::notify(end.clone());
    let shown = Shown {
        picture: arguments.picture.as_deref(),
        model: arguments.model.as_deref(),
    };
    let at = |address| crate::scope::at(address, shown);
    let receiver = match arguments.udp {
        true => Receiver::udp(&*arguments.listen),
        false => Receiver::tcp(&*arguments.listen),
    }
    .map_err(deaf)?;
    // Only now: its address is printed.
    let scope = arguments.scope.map(at).transpose()?;
    let has_failed = Arc::<AtomicBool>::default();
    let desk = Desk {
        has_failed: has_failed.clone(),
        output: arguments.output.clone().unwrap_or_default(),
        once: arguments.once,
        replaces: arguments.replace,
        show: arguments.messages,
        limit: arguments.limit.map_or(u64::MAX, |mib| mib << 20),
        end,
        scope,
        files: Mutex::default(),
    };
    let receiving = receiver.start(Arc::new(desk)).map_err(deaf)?;
    let way = if arguments.udp { "udp" } else { "tcp" };
    say(format_args!(
        "listening on {way}://{}; Ctrl-C ends it",
        receiving.address()
    ));
    // One end is always held by the thread that waits for signals.
    let _ = ends.recv();
    receiving.stop();
    Ok(exit::of_a_run(!has_failed.load(Ordering::Relaxed)))
}

/// A line on standard output. Its reading end may be closed: the recording goes on.
fn say(line: impl Display) {
    let _ = writeln!(io::stdout().lock(), "{line}");
}

struct Desk {
    output: PathBuf,
    once: bool,
    replaces: bool,
    show: Messages,
    limit: u64,
    /// A file could not be made, or not be written.
    has_failed: Arc<AtomicBool>,
    end: Sender<()>,
    /// It shows all senders together.
    scope: Option<Scope>,
    /// The names of those that are known.
    files: Mutex<HashMap<(SocketAddr, u32), PathBuf>>,
}

/// As many names as a receiver knows senders.
const MAX_FILES: usize = 1024;

impl Desk {
    fn path(&self, peer: &Peer) -> PathBuf {
        let files = self.files.lock().unwrap_or_else(PoisonError::into_inner);
        files
            .get(&(peer.address, peer.part))
            .cloned()
            .unwrap_or_default()
    }

    fn create(&self, peer: &Peer) -> io::Result<(PathBuf, FileSink)> {
        let mut files = self.files.lock().unwrap_or_else(PoisonError::into_inner);
        if self.once && !files.is_empty() {
            return Err(io::Error::other("--once: another recording was taken"));
        }
        let failed = |_: &io::Error| self.has_failed.store(true, Ordering::Relaxed);
        let path = match self.once && !self.output.as_os_str().is_empty() {
            true => self.output.clone(),
            false => name::new_file(&self.output, peer).inspect_err(failed)?,
        };
        let sink = match self.replaces {
            true => FileSink::replace(&path),
            false => FileSink::create(&path),
        }
        .inspect_err(failed)?;
        if files.len() >= MAX_FILES {
            files.clear();
        }
        files.insert((peer.address, peer.part), path.clone());
        Ok((path, sink))
    }
}

impl Handler for Desk {
    fn open(&self, peer: &Peer) -> io::Result<Box<dyn Sink>> {
        match self.create(peer) {
            Ok((path, sink)) => {
                say(format_args!("{} has come: {}", who(peer), path.display()));
                let has_failed = self.has_failed.clone();
                let file = File::new(sink, peer, self.show, self.limit, has_failed);
                Ok(match &self.scope {
                    Some(scope) => Box::new(file.and(scope.sink()?)),
                    None => Box::new(file),
                })
            }
            Err(error) => {
                say(format_args!("{} is refused: {error}", who(peer)));
                Err(error)
            }
        }
    }

    fn is_back(&self, peer: &Peer) {
        say(format_args!("{} is back", who(peer)));
    }

    fn has_gone(&self, peer: &Peer, departure: &Departure) {
        let Departure {
            has_ended,
            received,
            missing,
            error,
            ..
        } = departure;
        let samples: u64 = received.samples.values().sum();
        let how = match (has_ended, error) {
            (true, _) => "has ended".to_owned(),
            (false, None) => "has gone without an end".to_owned(),
            (false, Some(error)) => format!("has gone without an end ({error})"),
        };
        let path = self.path(peer);
        say(format_args!(
            "{} {how}: {} and {} are in {}; {} {} missing",
            who(peer),
            Count(samples, "sample"),
            Count(received.messages, "message"),
            path.display(),
            Count(*missing, "block"),
            if *missing == 1 { "is" } else { "are" }
        ));
        if self.once && *has_ended {
            let _ = self.end.send(());
        }
    }

    fn was_refused(&self, address: SocketAddr, error: &PeerError) {
        say(format_args!("{address} is refused: {error}"));
    }
}

/// A sender, as it is called on the screen.
fn who(peer: &Peer) -> String {
    let system = name::plain(&peer.system);
    match peer.process {
        0 => format!("{system} ({})", peer.address),
        process => format!("{system} ({}, process {process})", peer.address),
    }
}
