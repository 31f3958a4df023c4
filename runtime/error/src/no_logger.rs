//! What can be wrong with a signal in a build without the logger.

/// Why a signal cannot be registered.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RegisterError {
    /// It was not registered in `pre_run` of a process.
    #[error(
        "signal `{signal}` was registered outside of `pre_run`; declare it where its process is spawned (`process.signal({signal:?})`), or register it in `pre_run` of the process (`impl luna::Process`)"
    )]
    NotInPreRun {
        /// The signal's name.
        signal: String,
    },
}
