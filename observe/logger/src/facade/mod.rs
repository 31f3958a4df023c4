//! Where the `log` and `tracing` facades end.

#[cfg(feature = "log")]
mod log;
#[cfg(feature = "tracing")]
mod tracing;

#[cfg(feature = "tracing")]
pub use self::tracing::TracingSubscriber;

use crate::format::Level;

/// Sends messages of the `log` and `tracing` facades with level `most` or more severe to the
/// logger, as [messages](crate::message()), for the whole program. It covers the facades that are
/// features of this build. A facade that already has a subscriber keeps it. Returns true if none
/// had one.
///
/// Call it once, before the start: it allocates.
///
/// The fields of a `tracing` event follow its text. Spans are not recorded. The first message of
/// each place in the program registers that place with `tracing`, which may allocate and lock.
/// `log` does neither.
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
    // No facade is compiled in.
    let _ = most;
    log && tracing
}
