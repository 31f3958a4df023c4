//! Another page than the scope's, by the same server.

use std::fmt;
use std::sync::Arc;

/// A page with its own files that talks with its program: [`Settings::site`] serves it.
///
/// The scope's server takes its requests: the names of hosts and origins are checked, connections
/// are limited, nothing from elsewhere can be loaded. A page opens the WebSocket `/live` and sends
/// the token first, as `{"type":"token","token":"…"}`, which is answered by `{"type":"authorized"}`.
/// A connection that sends anything else is closed. Then each message has one answer.
///
/// [`Settings::site`]: crate::Settings::site
pub trait Site: Send + Sync {
    /// The kind (as `text/css; charset=utf-8`) and content of a path, as `/` or `/main.js`. Without
    /// one the scope's own file is served, if there is one: `/style.css`, `/icon.svg`.
    fn file(&self, path: &str) -> Option<(&'static str, &'static [u8])>;

    /// The answer to a message of at most 1 MiB. It is called on a thread of the connection, and may
    /// block.
    fn answer(&self, message: &str) -> String;
}

/// Which cannot be shown.
#[derive(Clone)]
pub(crate) struct Shown(pub(crate) Arc<dyn Site>);

impl fmt::Debug for Shown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Site(..)")
    }
}
