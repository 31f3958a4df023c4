//! Recording a run, and replaying it: see [`System::record`](crate::System::record) and
//! [`System::replay`](crate::System::replay).
//!
//! A process that communicates by channels with one sender and one receiver, and makes no choices,
//! sees the same in every run, however long anything takes (Kahn, 1974). So only nondeterministic
//! events are recorded: which guard an alternative chose, whether an operation at once or with a
//! timeout succeeded, the clock as it was read, how an operation failed, what came from outside
//! ([`input`]), and in which order processes got through where several compete. A replay on a
//! virtual clock reproduces all that, and compares what goes outside ([`output`]).
//! `docs/record-and-replay.md` lists what is recorded, and what is not.
//!
//! ```
//! use luna::prelude::*;
//! use luna::replay::{self, Recording};
//!
//! fn system(read: impl Fn() -> u32 + Send + 'static) -> luna::Result<System> {
//!     let mut system = System::new("thermometer");
//!     let main = system.executor("main").build()?;
//!     main.process("display").spawn(async move {
//!         let degrees = replay::input("sensor", read);
//!         replay::output("display", &(degrees * 10));
//!         Ok(())
//!     })?;
//!     Ok(system)
//! }
//!
//! # let path = std::env::temp_dir().join(format!("luna-record-doc-{}", std::process::id()));
//! let mut recorded = system(|| 21)?;
//! recorded.record(&path);
//! recorded.run()?;
//!
//! let mut replayed = system(|| unreachable!("the outside is not touched"))?;
//! replayed.replay(&Recording::open(&path)?);
//! replayed.run()?;
//! # std::fs::remove_file(&path).unwrap();
//! # Ok::<(), luna::Error>(())
//! ```

pub use luna_replay::{
    Divergence, RecordError, Recording, Value, blocking, input, is_recorded, output,
};

use crate::System;
use luna_replay::session::ROOM;
use std::path::PathBuf;

impl System {
    /// Records the run's nondeterministic inputs into a file: see [`replay`](crate::replay). The
    /// file is made when the system starts.
    ///
    /// Each process has room for 64 KiB of events that are yet to be written
    /// ([`record_room`](Self::record_room)); a thread without real-time priority writes them every
    /// 2 ms. What does not fit is counted in the [report](crate::Report::record): no process waits
    /// for the file. Recorded processes take the slow path for each communication, some tens of
    /// nanoseconds longer than the fast path of one executor. The run's error is
    /// [`Error::Record`](crate::Error::Record) if the file cannot be written, is there already (see
    /// [`replace_recordings`](Self::replace_recordings)), or its name ends in `.luna`, as that of a
    /// recording of the logger.
    pub fn record(&mut self, path: impl Into<PathBuf>) -> &mut Self {
        self.record_room(path, ROOM)
    }

    /// As [`record`](Self::record), with room for `bytes` bytes of each process; at least 256.
    pub fn record_room(&mut self, path: impl Into<PathBuf>, bytes: usize) -> &mut Self {
        self.plan.settings().replay_logs.record(path.into(), bytes);
        self
    }

    /// Lets recordings replace files that are there: their former content is lost. It holds for
    /// [`record`](Self::record), `log_to` and `LUNA_LOG`. Without it a replay log that is there
    /// ends the start, and a recording of the logger goes to a name with a number.
    ///
    /// A file that another program writes is never replaced: that ends the start.
    ///
    /// ```
    /// use luna::prelude::*;
    ///
    /// let file = std::env::temp_dir().join(format!("luna-last-run-{}.replay", std::process::id()));
    /// for _ in 0..2 {
    ///     let mut system = System::new("again and again");
    ///     system.record(&file).replace_recordings();
    ///     let main = system.executor("main").build()?;
    ///     main.process("one").spawn(async { Ok(()) })?;
    ///     system.run()?;
    /// }
    /// # std::fs::remove_file(file).unwrap();
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn replace_recordings(&mut self) -> &mut Self {
        self.plan.settings().replaces = true;
        self
    }

    /// Stores a text in the recording: what the program needs to describe the same system again.
    /// [`Recording::note`] gives it.
    pub fn record_note(&mut self, note: impl Into<String>) -> &mut Self {
        self.plan.settings().replay_logs.note = note.into();
        self
    }

    /// Runs the system as it was recorded, on a [virtual clock](Self::virtual_clock): the same
    /// processes, described in the same way, do the same again, and what they give outside is
    /// compared. The run's error is [`Error::Record`](crate::Error::Record) with the first
    /// difference, if there is one.
    ///
    /// Time moves from event to event, so durations have no meaning: delays, loops and timeouts end
    /// when they ended in the recording. What was under way when the recorded system was ended goes
    /// on as far as it had come, and is ended then.
    pub fn replay(&mut self, recording: &Recording) -> &mut Self {
        self.virtual_clock();
        self.plan.settings().replay_logs.replay(recording);
        self
    }
}
