//! Where the `log` and `tracing` facades end.

#[cfg(feature = "log")]
mod log;
#[cfg(feature = "tracing")]
mod tracing;

#[cfg(feature = "tracing")]
pub use self::tracing::TracingSubscriber;

use crate::format::Level;

/// Makes messages of the `log` and `tracing` facades, of `most` and what matters more, [messages](crate::message()) of the logger, for the whole program: of those facades that are
/// features of this build. A facade that has another end already keeps it; says whether none had.
///
/// Call it once, before the start: it allocates.
///
/// The fields of a `tracing` event stand behind its text; spans are not recorded. The first message of each place in the program registers that place with `tracing`,
/// which may allocate and lock; of `log` nothing does.
///
/// ```
/// luna_logger::install(luna_logger::Level::Info);
/// ```
pub fn install(most: Level) -> bool {
    #[cfg(feature = "log")]
    let log = log::install(most);
    #[cfg(not(feature = "log"))]
    let log = true;
    #[cfg(feature = "tracing")]
    let tracing = tracing::install(most);
    #[cfg(not(feature = "tracing"))]
    let tracing = true;
    // Without a facade nobody asks for it.
    let _ = most;
    log && tracing
}
