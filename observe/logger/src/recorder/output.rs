//! Makes blocks of entries, passes them to the sink, and counts what became of each entry.

#[cfg(feature = "events")]
use super::events::Events;
use super::handoff::{Handoff, LATE};
#[cfg(feature = "events")]
use super::report::EventsReport;
use super::report::{LoggingReport, MessagesReport, SignalReport};
use super::show::{self, Show};
use super::timeline::epoch;
use crate::format::{Encoder, Level, Losing, MAX_ELEMENTS, Record, SignalInfo, Values};
use crate::hub::{Begun, Hub};
use crate::lane::{Head, Inlet, MAX_WORDS};
use crate::message::{Lengths, MESSAGE_HEAD};
use crate::registry::Declared;
use luna_platform::clock::Instant;
use std::collections::HashMap;
use std::io;
use std::sync::Arc;
use std::time::Duration;

/// How often the time of day is recorded.
const EPOCHS: Duration = Duration::from_secs(10);

/// Where messages are counted that no thread of the recording lost.
const NO_THREAD: u32 = u32::MAX;

/// What makes blocks.
pub(super) struct Output {
    hub: Arc<Hub>,
    to: String,
    sink: Handoff,
    encoder: Encoder,
    show: Option<(Level, Show)>,
    signals: Vec<Declared>,
    counts: Vec<Count>,
    /// The signals of which the block has samples.
    in_block: Vec<u32>,
    threads: Vec<(u32, String)>,
    /// What has been declared since the recording began or had to start again.
    progress: Progress,
    is_asked_to_declare: bool,
    messages: MessagesReport,
    messages_in_block: MessagesReport,
    #[cfg(feature = "events")]
    events: Events,
    last_time: u64,
    bytes: u64,
    error: Option<String>,
}

/// To the sink.
pub(super) struct Way {
    pub(super) sink: Handoff,
    pub(super) block_size: usize,
    #[cfg_attr(
        not(feature = "events"),
        expect(dead_code, reason = "nothing is in it")
    )]
    pub(super) begun: Begun,
}

#[derive(Default)]
struct Progress {
    session: bool,
    signals: usize,
    threads: usize,
    losses: HashMap<Losing, u64>,
    epoch: Option<Instant>,
}

/// The samples of a signal.
#[derive(Default, Clone)]
struct Count {
    recorded: u64,
    refused: u64,
    in_block: u64,
}

impl Output {
    pub(super) fn new(hub: Arc<Hub>, to: String, way: Way, show: Option<(Level, Show)>) -> Self {
        Self {
            #[cfg(feature = "events")]
            events: Events::new(way.begun.names),
            hub,
            to,
            sink: way.sink,
            encoder: Encoder::with_block_size(way.block_size),
            show,
            signals: Vec::new(),
            counts: Vec::new(),
            in_block: Vec::new(),
            threads: Vec::new(),
            progress: Progress::default(),
            is_asked_to_declare: false,
            messages: MessagesReport::default(),
            messages_in_block: MessagesReport::default(),
            last_time: 0,
            bytes: Encoder::head().len() as u64,
            error: None,
        }
    }

    /// Learns of signals that are new; threads that are go to `inlets`.
    pub(super) fn take_signals(&mut self, inlets: &mut Vec<Inlet>) {
        self.hub.take_news(inlets, &mut self.signals);
        self.counts.resize(self.signals.len(), Count::default());
    }

    pub(super) fn add_thread(&mut self, number: u32, name: String) {
        self.threads.push((number, name));
    }

    /// A ring of events, and its thread, if that is not known otherwise.
    #[cfg(feature = "events")]
    pub(super) fn add_events(&mut self, name: Option<String>, events: &luna_events::Reader) {
        if let Some(name) = name {
            self.add_thread(events.number(), name);
        }
        self.events.add(events.number(), events.losses());
    }

    #[cfg(feature = "events")]
    pub(super) fn take_names(&mut self) {
        self.events.take_names();
    }

    #[cfg(feature = "events")]
    fn event(&mut self, thread: u32, time: u64, entry: &[u64]) {
        if self.declare() {
            let encoder = &mut self.encoder;
            self.events
                .put(thread, time, entry, |record| encoder.put(record));
        } else {
            self.events.refuse(thread, entry);
        }
    }

    #[cfg(feature = "events")]
    pub(super) fn record_losses_of_events(&mut self) {
        let lost: Vec<_> = self.events.lost().collect();
        for (thread, lost) in lost {
            self.record_losses(Losing::Events(thread), lost);
        }
    }

    /// Writes an entry of `thread`.
    pub(super) fn entry(&mut self, thread: u32, time: u64, entry: &[u64]) {
        self.last_time = self.last_time.max(time);
        let head = Head(entry[0]);
        match head.kind() {
            Head::SAMPLE => self.sample(head.signal(), time, &entry[2..]),
            Head::MESSAGE => self.message(thread, time, entry),
            #[cfg(feature = "events")]
            Head::EVENT => self.event(thread, time, entry),
            // Nothing else is written to a ring.
            _ => {}
        }
        if self.encoder.is_full() {
            self.end_block();
        }
    }

    fn sample(&mut self, signal: u32, time: u64, words: &[u64]) {
        let index = signal as usize;
        if index >= self.signals.len() {
            // Registered since the round began. A ring that came with it waits for the next round.
            let mut inlets = Vec::new();
            self.take_signals(&mut inlets);
            self.hub.give_back(inlets);
        }
        if index >= self.signals.len() {
            return;
        }
        if !self.declare() {
            self.counts[index].refused += 1;
            return;
        }
        let declared = &self.signals[index];
        let size = declared.element_type.size();
        let mut bytes = [0; 8 * MAX_ELEMENTS];
        for (place, word) in bytes.chunks_exact_mut(size).zip(words) {
            place.copy_from_slice(&word.to_le_bytes()[..size]);
        }
        let length = size * usize::from(declared.elements);
        self.encoder.put(&Record::Sample {
            signal,
            time,
            values: Values::new(declared.element_type, &bytes[..length]),
        });
        let count = &mut self.counts[index];
        if count.in_block == 0 {
            self.in_block.push(signal);
        }
        count.in_block += 1;
    }

    fn message(&mut self, thread: u32, time: u64, entry: &[u64]) {
        if !self.declare() {
            self.messages.lost += 1;
            return;
        }
        let lengths = Lengths::of(entry[2]);
        let mut bytes = [0; 8 * MAX_WORDS];
        for (eight, word) in bytes.chunks_exact_mut(8).zip(&entry[MESSAGE_HEAD..]) {
            eight.copy_from_slice(&word.to_le_bytes());
        }
        let (target, rest) = bytes.split_at(lengths.target.into());
        let text = rest.get(..lengths.text.into()).unwrap_or_default();
        // Both are made of whole characters.
        let (target, text) = (
            std::str::from_utf8(target).unwrap_or_default(),
            std::str::from_utf8(text).unwrap_or_default(),
        );
        let level = Level::from_byte(lengths.level).unwrap_or(Level::Error);
        self.encoder.put(&Record::Message {
            thread,
            time,
            level,
            process: entry[3] as u32,
            truncated: lengths.is_cut,
            target,
            text,
        });
        self.messages_in_block.recorded += 1;
        self.messages_in_block.truncated += u64::from(lengths.is_cut);
        if let Some((most, show)) = &self.show
            && level <= *most
        {
            let seconds = time as f64 / 1e9;
            show.line(format_args!("{seconds:>12.6} {level:<5} {target}: {text}"));
        }
    }

    /// Declares what is not declared yet. False if the sink refused some of it: later records could
    /// not be read.
    fn declare(&mut self) -> bool {
        if !self.progress.session {
            self.progress.session = true;
            self.encoder.put(&Record::Session {
                system: &self.hub.system,
                clock: self.hub.clock_base(),
                written_by: concat!("luna-logger ", env!("CARGO_PKG_VERSION")),
            });
        }
        #[cfg(feature = "events")]
        {
            let encoder = &mut self.encoder;
            self.events.codes(|record| encoder.put(record));
        }
        while let Some((number, name)) = self.threads.get(self.progress.threads) {
            self.progress.threads += 1;
            self.encoder.put(&Record::Thread {
                number: *number,
                name,
            });
            if self.encoder.is_full() && !self.end_block() {
                return false;
            }
        }
        while let Some(declared) = self.signals.get(self.progress.signals) {
            self.encoder.put(&Record::Signal(SignalInfo {
                number: self.progress.signals as u32,
                element_type: declared.element_type,
                elements: declared.elements,
                name: &declared.name,
                unit: &declared.unit,
                description: &declared.description,
            }));
            self.progress.signals += 1;
            if self.encoder.is_full() && !self.end_block() {
                return false;
            }
        }
        true
    }

    /// Records the time of day, if it is due. Virtual time has none.
    pub(super) fn record_time(&mut self) {
        if std::mem::take(&mut self.is_asked_to_declare) {
            self.progress = Progress::default();
            #[cfg(feature = "events")]
            self.events.declare_again();
        }
        if !self.declare() {
            return;
        }
        let now = Instant::now_real();
        let is_due = self.progress.epoch.is_none_or(|last| now - last >= EPOCHS);
        if !is_due || self.hub.clock_base() != crate::format::ClockBase::Monotonic {
            return;
        }
        self.progress.epoch = Some(now);
        if let Some((unix, time)) = epoch() {
            self.encoder.put(&Record::Epoch { time, unix });
        }
    }

    /// Records that `lost` were lost until now, if that is not recorded yet.
    pub(super) fn record_losses(&mut self, of: Losing, lost: u64) {
        let recorded = self.progress.losses.get(&of).copied().unwrap_or(0);
        // The declaration comes first.
        if lost > recorded && self.declare() {
            self.progress.losses.insert(of, lost);
            self.encoder.put(&Record::Losses { of, lost });
        }
    }

    /// Records the number of lost messages, `elsewhere` of them on no thread of the recording; the
    /// others were refused by the sink.
    pub(super) fn record_losses_of_messages(&mut self, elsewhere: u64) {
        let lost = elsewhere + self.messages.lost;
        self.record_losses(Losing::Messages(NO_THREAD), lost);
    }

    pub(super) fn record_losses_of_signals(&mut self) {
        for index in 0..self.signals.len() {
            let lost = self.lost(index);
            if lost > 0 {
                self.record_losses(Losing::Signal(index as u32), lost);
            }
            if self.encoder.is_full() {
                self.end_block();
            }
        }
    }

    fn lost(&self, index: usize) -> u64 {
        self.signals[index].losses.get() + self.counts[index].refused
    }

    /// Passes the block to the sink, if it is not empty. False if the sink refused it.
    pub(super) fn end_block(&mut self) -> bool {
        if self.encoder.is_empty() {
            return true;
        }
        let block = self.encoder.block();
        let length = block.len() as u64;
        let refused = self.sink.block(block).err();
        let has_failed = refused.is_some();
        if let Some(error) = refused {
            // Its declarations have to be repeated.
            self.encoder.discard();
            self.progress = Progress::default();
            self.fail(&error);
        } else {
            self.encoder.next();
            self.bytes += length;
        }
        for signal in self.in_block.drain(..) {
            let count = &mut self.counts[signal as usize];
            let samples = std::mem::take(&mut count.in_block);
            if has_failed {
                count.refused += samples;
            } else {
                count.recorded += samples;
            }
        }
        let messages = std::mem::take(&mut self.messages_in_block);
        if has_failed {
            self.messages.lost += messages.recorded;
        } else {
            self.messages.recorded += messages.recorded;
            self.messages.truncated += messages.truncated;
        }
        #[cfg(feature = "events")]
        self.events.end_block(has_failed);
        self.heed();
        !has_failed
    }

    /// Keeps the first error, and prefers any error to a timeout.
    fn fail(&mut self, error: &io::Error) {
        if self.error.as_deref().is_none_or(|first| first == LATE) {
            self.error = Some(error.to_string());
        }
    }

    /// Collects the sink's reports without a block.
    pub(super) fn ask(&mut self) {
        self.sink.ask();
        self.heed();
    }

    /// Acts on the sink's reports.
    fn heed(&mut self) {
        // With the next round, which begins a block.
        self.is_asked_to_declare |= self.sink.wants_declarations();
        while let Some(lost) = self.sink.take_lost() {
            // At most the recorded number: a sink that panicked may report the block it was
            // offered, which counts as refused.
            for (signal, samples) in lost.samples {
                if let Some(count) = self.counts.get_mut(signal as usize) {
                    let samples = samples.min(count.recorded);
                    count.recorded -= samples;
                    count.refused += samples;
                }
            }
            let messages = lost.messages.min(self.messages.recorded);
            self.messages.recorded -= messages;
            self.messages.lost += messages;
            #[cfg(feature = "events")]
            self.events.take_back(&lost.events);
            self.bytes = self.bytes.saturating_sub(lost.bytes);
        }
    }

    /// Ends the recording. `lost_messages` were lost before they reached the recorder.
    pub(super) fn end(mut self, lost_messages: u64) -> LoggingReport {
        if self.declare() {
            self.record_losses_of_signals();
            #[cfg(feature = "events")]
            self.record_losses_of_events();
            self.encoder.put(&Record::End {
                time: self.last_time,
            });
            self.end_block();
        }
        if let Err(error) = self.sink.end() {
            self.fail(&error);
        }
        self.heed();
        if let Some((_, show)) = &self.show {
            show.end(show::END_WITHIN);
        }
        self.messages.lost += lost_messages;
        let signals = (0..self.signals.len())
            .map(|index| SignalReport {
                name: self.signals[index].name.to_string(),
                unit: self.signals[index].unit.to_string(),
                recorded: self.counts[index].recorded,
                lost: self.lost(index),
            })
            .collect();
        LoggingReport {
            to: self.to,
            bytes: self.bytes,
            signals,
            messages: self.messages,
            #[cfg(feature = "events")]
            events: EventsReport {
                recorded: self.events.recorded(),
                lost: self.events.lost().map(|(_, lost)| lost).sum(),
            },
            error: self.error,
        }
    }
}
