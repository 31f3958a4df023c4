//! The name of a process.

use alloc::string::String;
use alloc::sync::Arc;
use core::fmt;
use core::ops::Deref;

/// The name of a process. Cloning it counts references, and copies nothing.
///
/// ```
/// use luna_core::{Name, ProcessSpec};
///
/// let name = Name::from("servo");
/// let spec = ProcessSpec::new(name.clone());
/// assert_eq!((spec.name(), &**spec.name()), (&name, "servo"));
/// ```
#[derive(Clone, PartialEq, Eq, Hash, Default)]
pub struct Name(Arc<str>);

impl Deref for Name {
    type Target = str;

    #[inline]
    fn deref(&self) -> &str {
        &self.0
    }
}

impl From<&str> for Name {
    fn from(text: &str) -> Self {
        Self(text.into())
    }
}

impl From<String> for Name {
    fn from(text: String) -> Self {
        Self(text.into())
    }
}

impl fmt::Debug for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(&**self, f)
    }
}

impl fmt::Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(&**self, f)
    }
}
