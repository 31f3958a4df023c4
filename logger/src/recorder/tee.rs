//! One recording to several sinks.

use super::sink::Sink;
use crate::format::{Encoder, seal};
use std::fmt;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// A recording to several sinks: a file and a scope, say.
///
/// The first sink decides what is recorded: what it refuses is lost, counted in the report, and the others do not get it. What one of the others refuses is missing there alone, and counted by
/// [`refused`](Self::refused); it goes on with the next block that declares all, which it soon gets. They all work on one thread: one that waits keeps the others waiting, so a file
/// comes first, and what may stall has a buffer of its own, as [`TcpSink`](crate::TcpSink) has. The smallest block size is that of all.
///
/// ```
/// use luna_logger::{Hub, Logging, Recorder, Tee, WriterSink};
///
/// let both = Tee::new(WriterSink::new(std::io::sink())).and(WriterSink::new(std::io::sink()));
/// let hub = Hub::new("bench", Default::default());
/// let report = Recorder::start(&hub, Logging::to_sink(both)).unwrap().finish();
/// assert_eq!(report.error, None);
/// ```
pub struct Tee {
    first: Box<dyn Sink>,
    others: Vec<Other>,
    wants_declarations: bool,
}

struct Other {
    sink: Box<dyn Sink>,
    /// The number of its next block.
    sequence: u32,
    /// It has refused a block, and waits for the next one that declares all.
    is_behind: bool,
    refused: Arc<AtomicU64>,
    block: Vec<u8>,
}

impl Tee {
    /// To `first`, and others that [`and`](Self::and) names.
    pub fn new(first: impl Sink + 'static) -> Self {
        Self {
            first: Box::new(first),
            others: Vec::new(),
            wants_declarations: false,
        }
    }

    /// And to `other`.
    pub fn and(mut self, other: impl Sink + 'static) -> Self {
        self.others.push(Other {
            sink: Box::new(other),
            sequence: 0,
            is_behind: false,
            refused: Arc::default(),
            block: Vec::new(),
        });
        self
    }

    /// Of each of the others, in their order, how many blocks are missing there: counters that go on while it records.
    pub fn refused(&self) -> Vec<Arc<AtomicU64>> {
        let others = self.others.iter();
        others.map(|other| other.refused.clone()).collect()
    }
}

impl Other {
    fn block(&mut self, block: &[u8]) {
        if self.is_behind && !Encoder::is_session(block) {
            self.refused.fetch_add(1, Ordering::Relaxed);
            return;
        }
        self.block.clear();
        self.block.extend_from_slice(block);
        seal(&mut self.block, self.sequence);
        let is_taken = self.sink.block(&self.block).is_ok();
        self.is_behind = !is_taken;
        self.refused
            .fetch_add((!is_taken).into(), Ordering::Relaxed);
        self.sequence = self.sequence.wrapping_add(is_taken.into());
    }
}

impl Sink for Tee {
    fn begin(&mut self, head: &[u8]) -> io::Result<()> {
        self.first.begin(head)?;
        self.others
            .iter_mut()
            .try_for_each(|other| other.sink.begin(head))
    }

    fn block(&mut self, block: &[u8]) -> io::Result<()> {
        self.first.block(block)?;
        for other in &mut self.others {
            other.block(block);
            self.wants_declarations |= other.is_behind;
        }
        Ok(())
    }

    fn is_of(&mut self, system: &str) {
        self.first.is_of(system);
        for other in &mut self.others {
            other.sink.is_of(system);
        }
    }

    fn block_size(&self) -> usize {
        let sizes = self.others.iter().map(|other| other.sink.block_size());
        sizes.fold(self.first.block_size(), usize::min)
    }

    fn wants_declarations(&mut self) -> bool {
        let others = self.others.iter_mut();
        let of_others = others.fold(false, |any, other| any | other.sink.wants_declarations());
        std::mem::take(&mut self.wants_declarations) | self.first.wants_declarations() | of_others
    }

    fn take_lost(&mut self) -> crate::format::Tally {
        for other in &mut self.others {
            let lost = other.sink.take_lost().blocks;
            other.refused.fetch_add(lost, Ordering::Relaxed);
        }
        self.first.take_lost()
    }

    fn end(&mut self, limit: Duration) -> io::Result<()> {
        let begin = Instant::now();
        let outcome = self.first.end(limit);
        for other in &mut self.others {
            // What it could not do is its own affair.
            let _ = other.sink.end(limit.saturating_sub(begin.elapsed()));
        }
        outcome
    }
}

impl fmt::Debug for Tee {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Tee")
            .field("others", &self.others.len())
            .finish_non_exhaustive()
    }
}
