//! Where a sender's blocks go: its file, the scope, and its messages to the screen.

use super::messages::Shown;
use crate::args::Messages;
use luna_logger::{FileSink, Peer, Sink};
use luna_scope::ScopeSink;
use std::io;
use std::time::Duration;

/// The sink of a sender.
pub(super) struct File {
    file: FileSink,
    shown: Option<Shown>,
    scope: Option<ScopeSink>,
    /// How many bytes it may have still.
    left: u64,
}

impl File {
    pub(super) fn new(file: FileSink, peer: &Peer, show: Messages, limit: u64) -> Self {
        let Messages(show) = show;
        Self {
            file,
            shown: show.map(|most| Shown::new(peer, most)),
            scope: None,
            left: limit,
        }
    }

    /// And to the scope.
    pub(super) fn and(mut self, scope: ScopeSink) -> Self {
        self.scope = Some(scope.patient());
        self
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
        self.file.begin(head)?;
        if let Some(scope) = &mut self.scope {
            // The scope has failed: the file is kept all the same.
            let _ = scope.begin(head);
        }
        Ok(())
    }

    fn block(&mut self, block: &[u8]) -> io::Result<()> {
        self.take(block)?;
        self.file.block(block)?;
        if let Some(shown) = &mut self.shown {
            shown.block(block);
        }
        if let Some(scope) = &mut self.scope {
            let _ = scope.block(block);
        }
        Ok(())
    }

    fn end(&mut self, limit: Duration) -> io::Result<()> {
        self.file.end(limit)
    }
}
