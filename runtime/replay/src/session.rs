//! The recording or the replay of one run, as a system begins and ends it. For LUNA's own crates:
//! it may change with each release.

pub use crate::recorder::ROOM;

use crate::error::RecordError;
use crate::recorder::{self, RecordReport, Recorder};
use crate::recording::Recording;
use crate::replayer::{self, Replayer};
use luna_core::ProcessSpec;
use luna_core::current;
use luna_core::replay_log::LogInstaller;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::task::{Context, Poll};

/// Whether a system is to be recorded or replayed.
#[derive(Default)]
pub struct SessionPlan {
    mode: Mode,
    /// What the recording is to keep.
    pub note: String,
    /// What parameters begin with, unless it is their default: names and values.
    pub parameters: Vec<(String, String)>,
}

#[derive(Default)]
enum Mode {
    #[default]
    None,
    /// To this file, with so much room of each process.
    Record(PathBuf, usize),
    Replay(Arc<Replayer>),
}

/// Makes the file of a recording: where it may keep the start waiting, on another thread.
pub type MakeFile = Box<dyn FnOnce() -> Result<ReplayLogs, RecordError> + Send>;

impl SessionPlan {
    /// Records to this file, with so much room of each process.
    pub fn record(&mut self, path: PathBuf, room: usize) {
        self.mode = Mode::Record(path, room);
    }

    /// Replays this.
    pub fn replay(&mut self, recording: &Recording) {
        self.mode = Mode::Replay(Replayer::new(recording));
    }

    /// What the parameters of a recorded run began with.
    pub fn recorded_parameters(&self) -> Option<Vec<(String, String)>> {
        match &self.mode {
            Mode::Replay(replayer) => Some(replayer.parameters().to_vec()),
            _ => None,
        }
    }

    /// Begins the recording or replay of `system`. `open` calls what makes the file, whose path it
    /// is given for messages.
    ///
    /// # Errors
    ///
    /// That of `open`, or a recording of another system.
    pub fn start<E: From<RecordError>>(
        self,
        system: &str,
        replaces: bool,
        open: impl FnOnce(&Path, MakeFile) -> Result<ReplayLogs, E>,
    ) -> Result<ReplayLogs, E> {
        match self.mode {
            Mode::None => Ok(ReplayLogs(Logs::None)),
            Mode::Record(path, room) => {
                let (note, parameters, system) = (self.note, self.parameters, system.to_owned());
                let shown = path.clone();
                let make = move || {
                    let file = Recorder::file(&path, replaces)?;
                    let recorder = Recorder::start(&path, file, room, &system, &note, &parameters)?;
                    Ok(ReplayLogs(Logs::Record(recorder)))
                };
                open(&shown, Box::new(make))
            }
            Mode::Replay(replayer) => {
                replayer.check_system(system)?;
                Ok(ReplayLogs(Logs::Replay(replayer)))
            }
        }
    }
}

luna_platform::debug_fields!(SessionPlan);
luna_platform::debug_fields!(ReplayLogs);

/// What records or replays a system that runs, if anything does.
pub struct ReplayLogs(Logs);

enum Logs {
    None,
    Record(Arc<Recorder>),
    Replay(Arc<Replayer>),
}

impl ReplayLogs {
    /// Gives the process its replay log, if it is to have one.
    pub fn give_log(&self, spec: ProcessSpec) -> ProcessSpec {
        let parent = || current::replay_log(|log| log.process()).unwrap_or_default();
        let track = match &self.0 {
            Logs::None => return spec,
            Logs::Record(recorder) => Track::Record(recorder.track(parent(), spec.name())),
            Logs::Replay(replayer) => Track::Replay(replayer.track(parent(), spec.name())),
        };
        spec.with_replay_log(Arc::new(track))
    }

    /// Whether the system is replayed.
    pub fn is_replay(&self) -> bool {
        matches!(self.0, Logs::Replay(_))
    }

    /// What was done in a recorded run that is not recorded.
    pub fn outside(&self) -> Option<RecordError> {
        match &self.0 {
            Logs::Record(recorder) => recorder.outside(),
            _ => None,
        }
    }

    /// To be called when all processes have ended. Waits for the file, but not once it
    /// `is_hurried`.
    ///
    /// # Errors
    ///
    /// The file cannot be written; the replay differs.
    pub fn finish(
        &self,
        is_hurried: &dyn Fn() -> bool,
    ) -> Result<Option<RecordReport>, RecordError> {
        match &self.0 {
            Logs::None => Ok(None),
            Logs::Record(recorder) => recorder.finish(is_hurried).map(Some),
            Logs::Replay(replayer) => replayer.finish().map(Some),
        }
    }
}

/// What records or replays a process: used in its polls, and as its body goes.
#[expect(
    clippy::large_enum_variant,
    reason = "there is one in an allocation of its own for each process"
)]
enum Track {
    Record(recorder::Track),
    Replay(replayer::Track),
}

// SAFETY: a process is polled, and its body dropped, by one thread at a time, and nothing else uses
// its track.
unsafe impl Send for Track {}
// SAFETY: the record of the process is the only owner, and uses the track within polls and as the
// body goes alone: so no two threads use it at the same time.
unsafe impl Sync for Track {}

impl LogInstaller for Track {
    fn poll(
        &self,
        cx: &mut Context<'_>,
        poll: &mut dyn FnMut(&mut Context<'_>) -> Poll<()>,
    ) -> Poll<()> {
        match self {
            Track::Record(track) => current::with_replay_log(track, || poll(cx)),
            Track::Replay(track) => {
                if !track.begins(cx) {
                    return Poll::Pending;
                }
                let polled = match track.rests() {
                    true => Poll::Pending,
                    false => current::with_replay_log(track, || poll(cx)),
                };
                if polled.is_pending() && track.is_over(cx) {
                    return Poll::Ready(());
                }
                polled
            }
        }
    }

    fn completed(&self) {
        match self {
            Track::Record(track) => track.end(),
            Track::Replay(track) => track.end(),
        }
    }

    fn end(&self) {
        if let Track::Record(track) = self {
            track.cut();
        }
    }
}
