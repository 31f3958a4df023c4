//! The name of a process: two words, in which most texts lie themselves, since each process has
//! one.

use std::borrow::Borrow;
use std::fmt;
use std::hash::{Hash, Hasher};
use std::ops::Deref;
use std::sync::Arc;

/// The name of a process. Up to 14 bytes lie in the value itself; cloning a longer one counts
/// references, and copies nothing.
///
/// ```
/// use luna_executors::{Name, ProcessSpec};
///
/// let name = Name::from("servo");
/// let spec = ProcessSpec::new(name.clone());
/// assert_eq!((spec.name(), &**spec.name()), (&name, "servo"));
/// ```
#[derive(Clone)]
pub struct Name(Text);

/// # Invariants
///
/// The first bytes of a short text, as many as its length says, are UTF-8.
#[derive(Clone)]
enum Text {
    Short { length: u8, bytes: [u8; SHORT] },
    Long(Arc<Box<str>>),
}

/// The longest text that lies in the name itself.
const SHORT: usize = 14;

impl Deref for Name {
    type Target = str;

    #[inline]
    fn deref(&self) -> &str {
        match &self.0 {
            Text::Long(text) => text,
            Text::Short { length, bytes } => {
                // SAFETY: by the invariant it is a text.
                unsafe { std::str::from_utf8_unchecked(&bytes[..usize::from(*length)]) }
            }
        }
    }
}

impl From<&str> for Name {
    fn from(text: &str) -> Self {
        if text.len() > SHORT {
            return Self(Text::Long(Arc::new(text.into())));
        }
        let mut bytes = [0; SHORT];
        bytes[..text.len()].copy_from_slice(text.as_bytes());
        // INVARIANT: the whole text was copied.
        Self(Text::Short {
            length: text.len() as u8,
            bytes,
        })
    }
}

impl From<String> for Name {
    fn from(text: String) -> Self {
        Self::from(&*text)
    }
}

impl Borrow<str> for Name {
    fn borrow(&self) -> &str {
        self
    }
}

impl PartialEq for Name {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl Eq for Name {}

// As its text, by which it is looked for.
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
                Text::Short { .. } => 1,
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
        let mut names: HashSet<Name> = ["one", "two"].map(Name::from).into();
        assert!(!names.insert(Name::from("one".to_owned())));
        assert!(names.remove("two") && !names.contains("two") && names.contains("one"));
    }

    #[test]
    fn it_takes_two_words() {
        assert_eq!(size_of::<Name>(), 16);
    }
}
