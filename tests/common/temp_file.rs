//! Files of tests.

use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};

/// A file that goes with the test. It is not made here.
pub(crate) struct TempFile(pub(crate) PathBuf);

impl TempFile {
    /// One that no other test has.
    pub(crate) fn new(name: &str) -> Self {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let name = format!("luna-{}-{number}-{name}", std::process::id());
        Self(std::env::temp_dir().join(name))
    }

    /// One with this text.
    pub(crate) fn with(name: &str, text: &str) -> Self {
        let file = Self::new(name);
        file.write(text);
        file
    }

    pub(crate) fn write(&self, text: &str) {
        std::fs::write(&self.0, text).unwrap();
    }

    /// As a file that is watched is to be written: it is never there by halves.
    pub(crate) fn replace(&self, text: &str) {
        let new = self.0.with_extension("new");
        std::fs::write(&new, text).unwrap();
        std::fs::rename(new, &self.0).unwrap();
    }
}

impl Drop for TempFile {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}
