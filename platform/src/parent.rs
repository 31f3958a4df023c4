//! The end of the program that started this one.
//!
//! ```
//! use luna_platform::parent::{ParentWatch, Watched};
//!
//! match ParentWatch::new() {
//!     Ok(watch) => {
//!         watch.stop();
//!         assert_eq!(watch.wait(), Watched::Stopped);
//!     }
//!     Err(error) => eprintln!("{error}"),
//! }
//! ```

use crate::backend::parent as backend;
use std::io;

/// What a wait came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Watched {
    /// The parent has ended.
    HasEnded,
    /// [`ParentWatch::stop`] was called.
    Stopped,
}

/// Watches the process that is this one's parent.
#[derive(Debug)]
pub struct ParentWatch(backend::Watch);

impl ParentWatch {
    /// Watches the parent, from now on; one that ends at this very moment is seen too. Not for the
    /// real-time path.
    ///
    /// # Errors
    ///
    /// The system cannot watch a process: Linux does from 5.3.
    pub fn new() -> io::Result<ParentWatch> {
        backend::Watch::new().map(ParentWatch)
    }

    /// Blocks until the parent has ended, or [`stop`](Self::stop) was called. If the true parent
    /// ended before the watch began, another process has taken its place: the end of that one is
    /// not seen.
    pub fn wait(&self) -> Watched {
        self.0.wait()
    }

    /// Ends the wait, from any thread, for good.
    pub fn stop(&self) {
        self.0.stop();
    }
}

/// Makes this process ignore SIGINT, SIGTERM, SIGHUP, SIGQUIT and SIGPIPE, and leave its session,
/// so that it survives what ends its parent program: for a process with that purpose. There is no
/// way back. Not for the real-time path; does nothing on systems without sessions.
pub fn outlive_requests() {
    backend::outlive_requests();
}
