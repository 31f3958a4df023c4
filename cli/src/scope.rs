//! `luna scope`: a recording in the browser, and the scope of `luna demo --scope`.

use crate::args;
use crate::demo::Show;
use crate::failure::Failure;
use crate::scope_parameters::OfSystem;
use luna_scope::{ReplayError, Scope, Settings};
use std::fs::File;
use std::io::{BufReader, Read, Write};
use std::net::SocketAddr;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

/// Plays the recording.
pub(crate) fn run(arguments: &args::Scope) -> Result<ExitCode, Failure> {
    let failed = |error: String| Failure::Log {
        path: arguments.file.clone(),
        error,
    };
    let (mut file, mut input): (_, Box<dyn Read>) = if arguments.file == Path::new("-") {
        (None, Box::new(std::io::stdin().lock()))
    } else {
        let file = File::open(&arguments.file).map_err(|error| failed(error.to_string()))?;
        // Others, as pipes, are read once.
        let is_file = file.metadata().is_ok_and(|found| found.is_file());
        let file = BufReader::with_capacity(1 << 16, file);
        match is_file {
            true => (Some(file), Box::new(std::io::empty())),
            false => (None, Box::new(file)),
        }
    };
    let settings = Settings::default()
        .address(arguments.listen)
        .viewers(arguments.viewers.into());
    let settings = arguments.host.iter().fold(settings, Settings::host);
    let settings = with_picture(settings, arguments.picture.as_deref())?;
    let scope = open(settings)?;
    let speed = arguments.speed;
    let played = match &mut file {
        Some(file) => scope.replay_file(file, speed),
        None => scope.replay(&mut input, speed),
    };
    if let Err(error @ ReplayError::Open(_)) = &played {
        return Err(failed(error.to_string()));
    }
    if let Err(error) = &played {
        eprintln!("luna: {}", failed(error.to_string()));
    }
    if !arguments.once {
        // Until a signal ends the program.
        loop {
            let Some(file) = &mut file else {
                std::thread::park();
                continue;
            };
            // Damage was reported when it was read first.
            let _ = scope.replay_sought(file, speed, Duration::MAX);
        }
    }
    Ok(ExitCode::from(u8::from(played.is_err())))
}

/// The scope of received recordings.
pub(crate) fn at(address: SocketAddr, picture: Option<&Path>) -> Result<Scope, Failure> {
    open(with_picture(Settings::default().address(address), picture)?)
}

/// Adds the picture in a file, if there is one.
fn with_picture(settings: Settings, picture: Option<&Path>) -> Result<Settings, Failure> {
    let Some(path) = picture else {
        return Ok(settings);
    };
    match std::fs::read_to_string(path) {
        Ok(svg) => Ok(settings.picture(svg)),
        Err(error) => Err(Failure::Picture {
            path: path.to_owned(),
            error,
        }),
    }
}

/// The scope of a run of a demo, which shows its parameters and its picture. A viewer with the
/// token, if there is one, may set them.
pub(crate) fn of_demo(
    address: SocketAddr,
    parameters: luna::parameters::Parameters,
    show: Show<'_>,
) -> Result<Scope, Failure> {
    let settings = Settings::default()
        .address(address)
        .parameters(Arc::new(OfSystem(parameters)));
    let settings = show.picture.into_iter().fold(settings, Settings::picture);
    open(match show.scope_token {
        true => settings
            .allow_setting()
            .map_err(|error| Failure::Scope { address, error })?,
        false => settings,
    })
}

/// A scope. Its address is printed on standard error, since standard output is for results.
fn open(settings: Settings) -> Result<Scope, Failure> {
    let address = settings.listens_on();
    let scope = Scope::open(settings).map_err(|error| Failure::Scope { address, error })?;
    let _ = writeln!(std::io::stderr(), "scope: {}", scope.url());
    Ok(scope)
}
