//! One recording to several sinks.

use super::sink::Sink;
use crate::format::{Encoder, seal};
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// A recording to several sinks, such as a file and a scope.
///
/// The first sink is the one that the report names, and decides what is recorded: what it refuses
/// is lost, counted in the report, and not passed to the others. A block that another sink refuses
/// is missing only there, and counted by [`refused`](Self::refused); that sink continues with the
/// next block that declares everything, which follows soon. Another sink that panics is ended. All
/// sinks work on one thread, so one that blocks delays the others: put a file first, and give a
/// sink that may stall a buffer, as [`TcpSink`](crate::TcpSink) has. The smallest block size of all
/// is used.
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
    /// None when it has panicked.
    sink: Option<Box<dyn Sink>>,
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
        Self::of(Box::new(first))
    }

    pub(super) fn of(first: Box<dyn Sink>) -> Self {
        Self {
            first,
            others: Vec::new(),
            wants_declarations: false,
        }
    }

    /// And to `other`.
    pub fn and(self, other: impl Sink + 'static) -> Self {
        self.and_boxed(Box::new(other))
    }

    pub(super) fn and_boxed(mut self, other: Box<dyn Sink>) -> Self {
        self.others.push(Other {
            sink: Some(other),
            sequence: 0,
            is_behind: false,
            refused: Arc::default(),
            block: Vec::new(),
        });
        self
    }

    /// For each of the other sinks, in order, the number of blocks missing there. The counters keep
    /// counting while it records.
    pub fn refused(&self) -> Vec<Arc<AtomicU64>> {
        let others = self.others.iter();
        others.map(|other| other.refused.clone()).collect()
    }
}

impl Other {
    /// The sink's result of `call`. None if it has panicked, now or before; that affects only this
    /// sink.
    fn call<T>(&mut self, call: impl FnOnce(&mut dyn Sink) -> T) -> Option<T> {
        let mut sink = self.sink.take()?;
        if let Ok(said) = catch_unwind(AssertUnwindSafe(|| call(&mut *sink))) {
            self.sink = Some(sink);
            return Some(said);
        }
        // It may hold blocks that it has taken.
        let end = AssertUnwindSafe(|| {
            let _ = sink.end(Duration::ZERO);
            sink.take_lost().blocks
        });
        let lost = catch_unwind(end).unwrap_or(0);
        self.refused.fetch_add(lost, Ordering::Relaxed);
        let _ = catch_unwind(AssertUnwindSafe(|| drop(sink)));
        None
    }

    fn block(&mut self, block: &[u8]) {
        if self.is_behind && !Encoder::is_session(block) {
            self.refused.fetch_add(1, Ordering::Relaxed);
            return;
        }
        let mut own = std::mem::take(&mut self.block);
        own.clear();
        own.extend_from_slice(block);
        seal(&mut own, self.sequence);
        let is_taken = self.call(|sink| sink.block(&own).is_ok()) == Some(true);
        self.block = own;
        self.is_behind = !is_taken;
        self.refused
            .fetch_add((!is_taken).into(), Ordering::Relaxed);
        self.sequence = self.sequence.wrapping_add(is_taken.into());
    }
}

impl Sink for Tee {
    fn place(&self) -> String {
        self.first.place()
    }

    fn begin(&mut self, head: &[u8]) -> io::Result<()> {
        self.first.begin(head)?;
        self.others.iter_mut().try_for_each(|other| {
            let begun = other.call(|sink| sink.begin(head));
            begun.unwrap_or_else(|| Err(io::Error::other("the sink panicked")))
        })
    }

    fn block(&mut self, block: &[u8]) -> io::Result<()> {
        self.first.block(block)?;
        for other in &mut self.others {
            other.block(block);
            self.wants_declarations |= other.is_behind && other.sink.is_some();
        }
        Ok(())
    }

    fn is_of(&mut self, system: &str) {
        self.first.is_of(system);
        for other in &mut self.others {
            other.call(|sink| sink.is_of(system));
        }
    }

    fn block_size(&self) -> usize {
        let others = self.others.iter().filter_map(|other| other.sink.as_ref());
        let sizes = others.map(|sink| sink.block_size());
        sizes.fold(self.first.block_size(), usize::min)
    }

    fn wants_declarations(&mut self) -> bool {
        let others = self.others.iter_mut();
        let of_others = others.fold(false, |any, other| {
            any | (other.call(|sink| sink.wants_declarations()) == Some(true))
        });
        std::mem::take(&mut self.wants_declarations) | self.first.wants_declarations() | of_others
    }

    fn take_lost(&mut self) -> crate::format::Tally {
        for other in &mut self.others {
            let lost = other.call(|sink| sink.take_lost().blocks).unwrap_or(0);
            other.refused.fetch_add(lost, Ordering::Relaxed);
        }
        self.first.take_lost()
    }

    fn end(&mut self, limit: Duration) -> io::Result<()> {
        let begin = Instant::now();
        let outcome = self.first.end(limit);
        for other in &mut self.others {
            // What it could not do is its own affair.
            let _ = other.call(|sink| sink.end(limit.saturating_sub(begin.elapsed())));
        }
        outcome
    }
}

luna_platform::debug_fields!(Tee, |tee| others: tee.others.len());
