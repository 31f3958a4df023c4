//! `luna scope`: a recording in the browser.

use crate::args;
use crate::failure::{Failure, failed, unusable};
use luna_logger::format::Reader;
use luna_scope::{MergeError, ReplayError, Scope, Settings};
use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Seek, Write};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

/// What is played.
enum Source {
    /// It can be read again.
    File(BufReader<File>),
    /// A pipe, which is read once.
    Stream(Box<dyn Read>),
}

/// Plays the recording, or several together.
pub(crate) fn run(arguments: &args::Scope) -> Result<ExitCode, Failure> {
    let (mut source, is_whole) = match &*arguments.files {
        [one] => (open_one(one)?, true),
        several => merged(several)?,
    };
    let path = &arguments.files[0];
    let settings = Settings::default()
        .address(arguments.listen)
        .viewers(arguments.viewers.into());
    let settings = arguments.host.iter().fold(settings, Settings::host);
    let shown = Shown {
        picture: arguments.picture.as_deref(),
        model: arguments.model.as_deref(),
    };
    let settings = shown.add_to(settings)?;
    let scope = open(settings)?;
    let speed = arguments.speed;
    let played = match &mut source {
        Source::File(file) => scope.replay_file(file, speed),
        Source::Stream(input) => scope.replay(input, speed),
    };
    if let Err(error @ ReplayError::Open(_)) = &played {
        return Err(failed(path)(error));
    }
    if let Err(error) = &played {
        eprintln!("luna: {}", failed(path)(error));
    }
    if !arguments.once {
        // Until a signal ends the program.
        loop {
            let Source::File(file) = &mut source else {
                std::thread::park();
                continue;
            };
            // Damage was reported when it was read first.
            let _ = scope.replay_sought(file, speed, Duration::MAX);
        }
    }
    Ok(ExitCode::from(u8::from(played.is_err() || !is_whole)))
}

fn open_one(path: &Path) -> Result<Source, Failure> {
    if path == Path::new("-") {
        return Ok(Source::Stream(Box::new(std::io::stdin().lock())));
    }
    let file = open_file(path)?;
    let is_file = file.get_ref().metadata().is_ok_and(|found| found.is_file());
    Ok(match is_file {
        true => Source::File(checked(path, file)?),
        false => Source::Stream(Box::new(file)),
    })
}

/// The file, if it begins as a recording: what is none is told before an address.
fn checked(path: &Path, mut file: BufReader<File>) -> Result<BufReader<File>, Failure> {
    Reader::new(&mut file).map_err(failed(path))?;
    file.rewind().map_err(failed(path))?;
    Ok(file)
}

fn open_file(path: &Path) -> Result<BufReader<File>, Failure> {
    let file = File::open(path).map_err(failed(path))?;
    Ok(BufReader::with_capacity(1 << 16, file))
}

/// The recordings of several programs as one, and whether all could be read to their ends.
fn merged(paths: &[PathBuf]) -> Result<(Source, bool), Failure> {
    if paths.iter().any(|path| path == Path::new("-")) {
        return Err(Failure::Options(
            "several recordings are read twice: none of them can be the standard input (-)",
        ));
    }
    let opened = paths.iter().map(|path| open_file(path));
    let mut recordings = opened.collect::<Result<Vec<_>, _>>()?;
    let folder = std::env::temp_dir();
    // It goes when the program ends.
    let mut file = tempfile::tempfile().map_err(failed(&folder))?;
    let mut is_whole = true;
    if let Err(error) = luna_scope::merge(&mut recordings, BufWriter::new(&mut file)) {
        let failure = match (&error, error.recording()) {
            (_, Some(number)) => failed(&paths[number])(&error),
            (MergeError::TooMany, None) => {
                Failure::Options("at most 64 recordings can be shown together")
            }
            (_, None) => failed(&folder)(&error),
        };
        if !matches!(error, MergeError::Read(..)) {
            return Err(failure);
        }
        eprintln!("luna: {failure}");
        is_whole = false;
    }
    file.rewind().map_err(failed(&folder))?;
    let file = BufReader::with_capacity(1 << 16, file);
    Ok((Source::File(file), is_whole))
}

/// The scope of received recordings.
pub(crate) fn at(address: SocketAddr, shown: Shown<'_>) -> Result<Scope, Failure> {
    let settings = Settings::default().address(address).together();
    open(shown.add_to(settings)?)
}

/// The files of what a scope shows beside the recording.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shown<'a> {
    pub(crate) picture: Option<&'a Path>,
    /// Its drawing is the picture, if there is no other.
    pub(crate) model: Option<&'a Path>,
}

impl Shown<'_> {
    fn add_to(self, settings: Settings) -> Result<Settings, Failure> {
        if let Some(path) = self.picture {
            let unread = |error| unusable(format_args!("picture {}", path.display()), error);
            let svg = std::fs::read_to_string(path).map_err(unread)?;
            return Ok(settings.picture(svg));
        }
        match self.model {
            None => Ok(settings),
            Some(path) => Ok(settings.picture(crate::model::drawing(path)?)),
        }
    }
}

/// A scope cannot be served there.
pub(crate) fn unserved(address: SocketAddr) -> impl Fn(std::io::Error) -> Failure {
    move |error| unusable(format_args!("scope {address}"), error)
}

/// A scope. Its address is printed on standard error, since standard output is for results.
fn open(settings: Settings) -> Result<Scope, Failure> {
    let address = settings.listens_on();
    let scope = Scope::open(settings).map_err(unserved(address))?;
    let _ = writeln!(std::io::stderr(), "scope: {}", scope.url());
    Ok(scope)
}
