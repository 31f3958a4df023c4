//! Where a sender's blocks go: its file, the scope, and its messages to the screen.

use super::messages::Shown;
use crate::args::Messages;
use luna_logger::{FileSink, Peer, Sink};
use luna_scope::ScopeSink;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// The sink of a sender.
pub(super) struct File {
    file: FileSink,
    shown: Option<Shown>,
    scope: Option<ScopeSink>,
    /// How many bytes it may have still.
    left: u64,
    /// Set when something could not be written.
    has_failed: Arc<AtomicBool>,
}

impl File {
    pub(super) fn new(
        file: FileSink,
        peer: &Peer,
        show: Messages,
        limit: u64,
        has_failed: Arc<AtomicBool>,
    ) -> Self {
        let Messages(show) = show;
        Self {
            file,
            shown: show.map(|most| Shown::new(peer, most)),
            scope: None,
            left: limit,
            has_failed,
        }
    }

    /// And to the scope.
    pub(super) fn and(mut self, scope: ScopeSink) -> Self {
        self.scope = Some(scope.patient());
        self
    }

    /// What the file gave: an error is noted.
    fn noted<T>(&self, written: io::Result<T>) -> io::Result<T> {
        written.inspect_err(|_| self.has_failed.store(true, Ordering::Relaxed))
    }

    fn take(&mut self, bytes: &[u8]) -> io::Result<()> {
        let left = self.left.checked_sub(bytes.len() as u64);
        self.left =
            left.ok_or_else(|| io::Error::other("the file has as many MiB as --limit allows"))?;
        Ok(())
    }
}

impl Sink for File {
    fn begin(&mut self, head: &[u8]) -> io::Result<()> {
        self.take(head)?;
        let begun = self.file.begin(head);
        self.noted(begun)?;
        if let Some(scope) = &mut self.scope {
            // The scope has failed: the file is kept all the same.
            let _ = scope.begin(head);
        }
        Ok(())
    }

    fn block(&mut self, block: &[u8]) -> io::Result<()> {
        self.take(block)?;
        let written = self.file.block(block);
        self.noted(written)?;
        if let Some(shown) = &mut self.shown {
            shown.block(block);
        }
        if let Some(scope) = &mut self.scope {
            let _ = scope.block(block);
        }
        Ok(())
    }

    fn end(&mut self, limit: Duration) -> io::Result<()> {
        let ended = self.file.end(limit);
        self.noted(ended)
    }
}
