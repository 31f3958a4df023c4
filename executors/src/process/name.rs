//! The name of a process: two words, in which most texts lie themselves, since each process has
//! one.

use alloc::boxed::Box;
use alloc::string::String;
use alloc::sync::Arc;
use core::fmt;
use core::hash::{Hash, Hasher};
use core::mem::ManuallyDrop;
use core::ops::Deref;

/// The name of a process. Up to 15 bytes lie in the value itself; cloning a longer one counts
/// references, and copies nothing.
///
/// ```
/// use luna_executors::{Name, ProcessSpec};
///
/// let name = Name::from("servo");
/// let spec = ProcessSpec::new(name.clone());
/// assert_eq!((spec.name(), &**spec.name()), (&name, "servo"));
/// ```
///
/// # Invariants
///
/// The last byte is that of `short`: the length of its text, of at most `SHORT` bytes, behind which
/// there are zeros; or `LONG`, and then `long` is valid.
pub struct Name(Text);

#[repr(C)]
union Text {
    short: Short,
    long: ManuallyDrop<Long>,
    /// All of it, whichever it is.
    bytes: [u8; SHORT + 1],
}

/// The longest text that lies in the name itself.
const SHORT: usize = 15;

/// In the place of a length.
const LONG: u8 = u8::MAX;

#[derive(Clone, Copy)]
#[repr(C)]
struct Short {
    text: [u8; SHORT],
    length: u8,
}

#[repr(C)]
struct Long {
    text: Arc<Box<str>>,
    unused: [u8; SHORT - size_of::<usize>()],
    length: u8,
}

// SAFETY: a text does not change, and is counted by atomics.
unsafe impl Send for Name {}
// SAFETY: `&Name` gives a text that does not change, and clones, which are counted by atomics.
unsafe impl Sync for Name {}

impl Name {
    fn new(text: &str) -> Self {
        if text.len() > SHORT {
            return Self::long(Arc::new(text.into()));
        }
        let mut short = Short {
            text: [0; SHORT],
            length: text.len() as u8,
        };
        short.text[..text.len()].copy_from_slice(text.as_bytes());
        Self(Text { short })
    }

    fn long(text: Arc<Box<str>>) -> Self {
        let long = ManuallyDrop::new(Long {
            text,
            unused: [0; SHORT - size_of::<usize>()],
            length: LONG,
        });
        Self(Text { long })
    }

    #[inline]
    fn as_short(&self) -> &Short {
        // SAFETY: all bytes are initialised, whichever it is, and any are a `Short`.
        unsafe { &self.0.short }
    }

    #[inline]
    fn bytes(&self) -> &[u8; SHORT + 1] {
        // SAFETY: all bytes are initialised, whichever it is.
        unsafe { &self.0.bytes }
    }

    /// The text that lies elsewhere, if it does.
    #[inline]
    fn as_long(&self) -> Option<&Arc<Box<str>>> {
        // SAFETY: by the invariant `long` is valid where the last byte is `LONG`.
        (self.as_short().length == LONG).then(|| unsafe { &self.0.long.text })
    }
}

impl Deref for Name {
    type Target = str;

    #[inline]
    fn deref(&self) -> &str {
        if let Some(long) = self.as_long() {
            return long;
        }
        let short = self.as_short();
        // SAFETY: it is not `LONG`, so by the invariant the length is at most `SHORT`, and so many
        // bytes are the text, which was a `str`.
        unsafe {
            let text = short.text.get_unchecked(..usize::from(short.length));
            core::str::from_utf8_unchecked(text)
        }
    }
}

impl Clone for Name {
    #[inline]
    fn clone(&self) -> Self {
        match self.as_long() {
            Some(long) => Self::long(long.clone()),
            None => Self(Text {
                short: *self.as_short(),
            }),
        }
    }
}

impl Drop for Name {
    #[inline]
    fn drop(&mut self) {
        if self.as_long().is_some() {
            // SAFETY: by the invariant `long` is valid where the last byte is `LONG`. It is dropped
            // once, here.
            unsafe { ManuallyDrop::drop(&mut self.0.long) };
        }
    }
}

impl From<&str> for Name {
    fn from(text: &str) -> Self {
        Self::new(text)
    }
}

impl From<String> for Name {
    fn from(text: String) -> Self {
        Self::new(&text)
    }
}

impl PartialEq for Name {
    #[inline]
    fn eq(&self, other: &Self) -> bool {
        self.bytes() == other.bytes() || self.as_long().is_some() && **self == **other
    }
}

impl Eq for Name {}

// All 16 bytes of a short name: a constant number of bytes is hashed in fewer instructions.
impl Hash for Name {
    #[inline]
    fn hash<H: Hasher>(&self, state: &mut H) {
        match self.as_long() {
            Some(long) => long.hash(state),
            None => state.write(self.bytes()),
        }
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
    use std::collections::HashSet;

    #[test]
    fn it_is_its_text_on_any_thread_until_the_last_one_goes() {
        for text in [
            "",
            "a",
            "servo",
            "of 15 bytes ...",
            "of 16 bytes ....",
            "längerer Name mit Umlauten",
            &"x".repeat(1000),
        ] {
            let name = Name::from(text);
            let threads: Vec<_> = (0..4)
                .map(|_| {
                    let (name, text) = (name.clone(), text.to_owned());
                    std::thread::spawn(move || {
                        for _ in 0..100 {
                            assert_eq!(*name.clone(), *text);
                        }
                    })
                })
                .collect();
            threads
                .into_iter()
                .for_each(|thread| thread.join().unwrap());
            let references = name.as_long().map_or(1, Arc::strong_count);
            assert_eq!((references, name.len()), (1, text.len()));
            assert_eq!(
                (name.to_string(), format!("{name:?}")),
                (text.to_owned(), format!("{text:?}"))
            );
        }
    }

    #[test]
    fn it_is_found_by_its_text() {
        let long = ["a text that is long", "a text that is longer"];
        let mut names: HashSet<Name> = ["one", "two", "", "two\0", long[0]].map(Name::from).into();
        assert_eq!(names.len(), 5);
        for text in ["one", long[0]] {
            assert!(!names.insert(Name::from(text.to_owned())));
        }
        assert!(names.remove(&Name::from("two")) && !names.contains(&Name::from("two")));
        assert!(names.contains(&Name::from("two\0")) && !names.contains(&Name::from(long[1])));
    }

    #[test]
    fn it_takes_two_words() {
        assert_eq!(size_of::<Name>(), 16);
    }
}
