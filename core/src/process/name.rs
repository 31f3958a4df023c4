//! The name of a process: two words, in which most texts lie themselves, since each process has
//! one.

use alloc::boxed::Box;
use alloc::string::String;
use alloc::sync::Arc;
use core::fmt;
use core::hash::{Hash, Hasher};
use core::ops::Deref;

/// The name of a process. Up to 14 bytes lie in the value itself; cloning a longer one counts
/// references, and copies nothing.
///
/// ```
/// use luna_core::{Name, ProcessSpec};
///
/// let name = Name::from("servo");
/// let spec = ProcessSpec::new(name.clone());
/// assert_eq!((spec.name(), &**spec.name()), (&name, "servo"));
/// ```
#[derive(Clone, PartialEq, Eq)]
pub struct Name(Text);

/// # Invariants
///
/// The first byte of a short one is a number of at most `SHORT`: so many bytes behind it are a
/// text, and the others are zeros.
#[derive(Clone, PartialEq, Eq)]
enum Text {
    Short([u8; SHORT + 1]),
    Long(Arc<Box<str>>),
}

/// The longest text that lies in the name itself.
const SHORT: usize = 14;

impl Name {
    fn new(text: &str) -> Self {
        if text.len() > SHORT {
            return Self(Text::Long(Arc::new(text.into())));
        }
        let mut short = [0; SHORT + 1];
        short[0] = text.len() as u8;
        short[1..=text.len()].copy_from_slice(text.as_bytes());
        Self(Text::Short(short))
    }
}

impl Deref for Name {
    type Target = str;

    #[inline]
    fn deref(&self) -> &str {
        match &self.0 {
            Text::Long(text) => text,
            // SAFETY: by the invariant there are so many bytes, and they are a text.
            Text::Short([length, text @ ..]) => unsafe {
                core::str::from_utf8_unchecked(text.get_unchecked(..usize::from(*length)))
            },
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

// All bytes of a short name: a constant number of bytes is hashed in fewer instructions.
impl Hash for Name {
    #[inline]
    fn hash<H: Hasher>(&self, state: &mut H) {
        match &self.0 {
            Text::Long(text) => text.hash(state),
            Text::Short(bytes) => state.write(bytes),
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
            "of 14 bytes ..",
            "of 15 bytes ...",
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
            let references = match &name.0 {
                Text::Long(text) => Arc::strong_count(text),
                Text::Short(_) => 1,
            };
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
