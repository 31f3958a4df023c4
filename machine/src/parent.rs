//! The end of the program that started this one.
//!
//! ```
//! use luna_machine::parent::{ParentWatch, Watched};
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
pub use backend::ParentWatch;

/// What a wait came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Watched {
    /// The parent has ended.
    HasEnded,
    /// [`ParentWatch::stop`] was called.
    Stopped,
}

/// Makes this process ignore SIGINT, SIGTERM, SIGHUP, SIGQUIT and SIGPIPE, and leave its session,
/// so that it survives what ends its parent program: for a process with that purpose. There is no
/// way back. Not for the real-time path; does nothing on systems without sessions.
pub fn outlive_requests() {
    backend::outlive_requests();
}
