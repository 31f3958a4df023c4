//! From a recorder's blocks to the topics.

use crate::topics::Topics;
use foxglove::Context;
use luna_logger::Sink;
use luna_logger::format::Reader;
use std::collections::VecDeque;
use std::fmt;
use std::io;
use std::sync::Arc;

/// Takes a recording's blocks for the viewers of a [`Foxglove`](crate::Foxglove).
///
/// It decodes on the thread of the recording's sinks, and never waits for a viewer.
pub struct FoxgloveSink {
    topics: Topics,
    /// From the recording's beginning on.
    reader: Option<Reader<VecDeque<u8>>>,
}

impl FoxgloveSink {
    pub(crate) fn new(context: &Arc<Context>) -> Self {
        Self {
            topics: Topics::new(context),
            reader: None,
        }
    }
}

impl Sink for FoxgloveSink {
    fn begin(&mut self, head: &[u8]) -> io::Result<()> {
        let head = VecDeque::from(head.to_vec());
        self.reader = Some(Reader::new(head).map_err(io::Error::other)?);
        self.topics.begin().map_err(io::Error::other)
    }

    fn block(&mut self, block: &[u8]) -> io::Result<()> {
        let Some(reader) = &mut self.reader else {
            return Err(io::Error::other("a block before the recording has begun"));
        };
        reader.input().extend(block);
        while let Some(record) = reader.next().map_err(io::Error::other)? {
            self.topics.take(&record).map_err(io::Error::other)?;
        }
        Ok(())
    }
}

impl fmt::Debug for FoxgloveSink {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("FoxgloveSink").finish_non_exhaustive()
    }
}
