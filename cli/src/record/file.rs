//! Where a sender's blocks go: its file, and its messages to the screen.

use super::messages::Shown;
use crate::args::Messages;
use luna_logger::{FileSink, Peer, Sink};
use std::io;
use std::time::Duration;

/// The sink of a sender.
pub(super) struct File {
    file: FileSink,
    shown: Option<Shown>,
    /// How many bytes it may have still.
    left: u64,
}

impl File {
    pub(super) fn new(file: FileSink, peer: &Peer, show: Messages, limit: u64) -> Self {
        let Messages(show) = show;
        Self {
            file,
            shown: show.map(|most| Shown::new(peer, most)),
            left: limit,
        }
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
        self.file.begin(head)
    }

    fn block(&mut self, block: &[u8]) -> io::Result<()> {
        self.take(block)?;
        self.file.block(block)?;
        if let Some(shown) = &mut self.shown {
            shown.block(block);
        }
        Ok(())
    }

    fn end(&mut self, limit: Duration) -> io::Result<()> {
        self.file.end(limit)
    }
}
