//! Without the scope.

use std::fmt::Display;

/// The scope of a run: none.
pub(crate) struct Shown;

impl Shown {
    /// Tells who asks for one what is missing.
    #[cfg(feature = "logger")]
    pub(super) fn none() -> Self {
        if std::env::var_os("LUNA_SCOPE").is_some_and(|asked| !asked.is_empty() && asked != "0") {
            crate::notice::notice!(
                "luna: LUNA_SCOPE is set, but this program was built without the feature `scope` of luna-rt"
            );
        }
        Self
    }

    pub(crate) fn ended(self, _: &dyn Display) {}
}
