//! The name of a process: one word, and what it leads to eight bytes longer than the text, since
//! each process has one.

use std::alloc::{Layout, alloc, dealloc, handle_alloc_error};
use std::borrow::Borrow;
use std::fmt;
use std::hash::{Hash, Hasher};
use std::ops::Deref;
use std::ptr::NonNull;
use std::sync::atomic::{AtomicU32, Ordering};

/// The name of a process. Cloning it counts references, and copies nothing.
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
/// It leads to a head that `layout` of its length was allocated for, with that much text behind it,
/// and is counted in it.
pub struct Name(NonNull<Head>);

struct Head {
    references: AtomicU32,
    length: u32,
}

// SAFETY: it is counted by atomics, and its text does not change.
unsafe impl Send for Name {}
// SAFETY: as above.
unsafe impl Sync for Name {}

/// A head with so much text behind it.
fn layout(length: usize) -> Layout {
    let size = size_of::<Head>().checked_add(length);
    let layout = size.and_then(|size| Layout::from_size_align(size, align_of::<Head>()).ok());
    layout.expect("a text that is in memory has room there")
}

impl Name {
    fn new(text: &str) -> Self {
        let length = u32::try_from(text.len()).expect("a name has less than 4 GiB");
        let layout = layout(text.len());
        // SAFETY: the layout is that of a head at least.
        let Some(head) = NonNull::new(unsafe { alloc(layout) }.cast::<Head>()) else {
            handle_alloc_error(layout)
        };
        // SAFETY: it is room for the head and for the text behind it, and owned by this call alone.
        unsafe {
            head.write(Head {
                references: AtomicU32::new(1),
                length,
            });
            let behind = head.add(1).cast::<u8>();
            behind.copy_from_nonoverlapping(NonNull::from(text).cast(), text.len());
        }
        Self(head)
    }

    fn head(&self) -> &Head {
        // SAFETY: the invariant.
        unsafe { self.0.as_ref() }
    }
}

impl Deref for Name {
    type Target = str;

    #[inline]
    fn deref(&self) -> &str {
        // SAFETY: the invariant: the text has the length in the head, and was a `str`.
        unsafe {
            let text = self.0.add(1).cast::<u8>();
            let text = NonNull::slice_from_raw_parts(text, self.head().length as usize);
            std::str::from_utf8_unchecked(text.as_ref())
        }
    }
}

impl Clone for Name {
    #[inline]
    fn clone(&self) -> Self {
        // Relaxed: the one that is here keeps the text.
        if self.head().references.fetch_add(1, Ordering::Relaxed) > i32::MAX as u32 {
            // So many were leaked: to wrap would be to free what is owned.
            std::process::abort();
        }
        Self(self.0)
    }
}

impl Drop for Name {
    #[inline]
    fn drop(&mut self) {
        // AcqRel, and no fence, which ThreadSanitizer does not know: the thread that frees it does
        // so after all that others did with it.
        if self.head().references.fetch_sub(1, Ordering::AcqRel) == 1 {
            let layout = layout(self.head().length as usize);
            // SAFETY: it was the last one; by the invariant this was allocated.
            unsafe { dealloc(self.0.as_ptr().cast(), layout) };
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
            assert_eq!(name.head().references.load(Ordering::Acquire), 1);
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
    fn it_takes_one_word() {
        assert_eq!(size_of::<Option<Name>>(), size_of::<usize>());
    }
}
