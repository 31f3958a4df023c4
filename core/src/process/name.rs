//! The name of a process.

use alloc::string::String;
use alloc::sync::Arc;
use core::fmt;
use core::hash::{Hash, Hasher};
use core::ops::Deref;

/// Bytes of a name that needs no allocation.
const SHORT: usize = 22;

/// The name of a process. Cloning it allocates nothing: a short name is copied, of a long one the
/// references are counted.
///
/// ```
/// use luna_core::{Name, ProcessSpec};
///
/// let name = Name::from("servo");
/// let spec = ProcessSpec::new(name.clone());
/// assert_eq!((spec.name(), &**spec.name()), (&name, "servo"));
/// ```
#[derive(Clone)]
pub struct Name(Text);

/// # Invariants
///
/// Of a short one the first `length` bytes are valid UTF-8.
#[derive(Clone)]
enum Text {
    Short { length: u8, bytes: [u8; SHORT] },
    Long(Arc<str>),
}

#[cfg(target_pointer_width = "64")]
const _: () = assert!(size_of::<Name>() == 24);

impl Deref for Name {
    type Target = str;

    #[inline]
    fn deref(&self) -> &str {
        match &self.0 {
            // SAFETY: by the invariant these bytes are there, and a text.
            Text::Short { length, bytes } => unsafe {
                str::from_utf8_unchecked(bytes.get_unchecked(..usize::from(*length)))
            },
            Text::Long(text) => text,
        }
    }
}

impl From<&str> for Name {
    #[inline]
    fn from(text: &str) -> Self {
        let mut bytes = [0; SHORT];
        Self(match bytes.get_mut(..text.len()) {
            Some(start) => {
                start.copy_from_slice(text.as_bytes());
                let length = text.len() as u8;
                Text::Short { length, bytes }
            }
            None => Text::Long(text.into()),
        })
    }
}

impl From<String> for Name {
    fn from(text: String) -> Self {
        Self::from(&*text)
    }
}

impl Default for Name {
    fn default() -> Self {
        Self::from("")
    }
}

impl PartialEq for Name {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl Eq for Name {}

impl Hash for Name {
    fn hash<H: Hasher>(&self, state: &mut H) {
        (**self).hash(state);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_all_lengths_are_what_they_were_made_of() {
        for length in 0..2 * SHORT {
            let text = "ä".repeat(length / 2) + &"x".repeat(length % 2);
            let name = Name::from(&*text);
            assert_eq!(
                (&*name, &*name.clone(), name.len()),
                (&*text, &*text, length)
            );
            assert_eq!(name, Name::from(text));
        }
    }
}
