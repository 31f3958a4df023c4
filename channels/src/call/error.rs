//! What can go wrong with a call.

use crate::error::Ended;
use thiserror::Error;

/// A call failed. A request that no server has taken is given back.
///
/// ```
/// let (client, server) = luna_channels::call_channel::<u32, ()>();
/// drop(server);
/// let error = client.blocking_call(7).unwrap_err();
/// assert!(error.is_closed());
/// assert_eq!(error.into_request(), Some(7));
/// ```
#[derive(Clone, PartialEq, Eq, Error)]
pub enum CallError<Q> {
    /// The last server is gone, and did not take the request.
    #[error("calling on a channel whose last server is gone")]
    Closed(Q),
    /// The channel, or the branch that called, was poisoned before a server took the request.
    #[error("calling on a poisoned channel")]
    Poisoned(Q),
    /// A server took the request and did not reply: it has dropped the call, or panicked.
    #[error(
        "the server has dropped the call without a reply: it has ended or panicked, or does not reply to all"
    )]
    Unanswered,
    /// A server took the request, and the channel, or the branch that called, was poisoned before
    /// the reply.
    #[error("the channel was poisoned before the server replied")]
    Interrupted,
}

impl<Q> CallError<Q> {
    /// The request, if no server has taken it.
    pub fn into_request(self) -> Option<Q> {
        match self {
            CallError::Closed(request) | CallError::Poisoned(request) => Some(request),
            CallError::Unanswered | CallError::Interrupted => None,
        }
    }

    /// Whether the last server is gone.
    pub fn is_closed(&self) -> bool {
        matches!(self, CallError::Closed(_))
    }

    /// Whether the channel, or the branch that called, was poisoned.
    pub fn is_poisoned(&self) -> bool {
        matches!(self, CallError::Poisoned(_) | CallError::Interrupted)
    }

    /// Whether a server has dropped the call.
    pub fn is_unanswered(&self) -> bool {
        matches!(self, CallError::Unanswered)
    }
}

impl<Q> Ended for CallError<Q> {
    fn poisoned(&self) -> Option<bool> {
        Some(self.is_poisoned())
    }

    fn has_communicated(&self) -> bool {
        matches!(self, CallError::Unanswered | CallError::Interrupted)
    }
}

// Without the request, so that it need not be `Debug`.
luna_platform::debug_fields!(impl[Q] CallError<Q>, |error| reason: format_args!("{error}"));
