//! The recorder's thread.

use super::output::{Output, Way};
use super::queue::{Queue, merge};
use super::report::LoggingReport;
use super::show::Show;
use super::timeline::Timeline;
use crate::format::{Level, Losing};
use crate::hub::Hub;
use crate::lane::Inlet;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// How often the sink is polled for its reports.
const ASK_EVERY: Duration = Duration::from_millis(100);

/// What moves entries from rings to blocks.
pub(super) struct Drain {
    hub: Arc<Hub>,
    timeline: Timeline,
    queues: Vec<Queue>,
    /// The number of messages that each thread has lost.
    threads: Vec<(u32, Arc<AtomicU64>)>,
    output: Output,
    /// Messages that threads which have ended have lost, by those that did.
    lost_before: Vec<(u32, u64)>,
    news: Vec<Inlet>,
}

impl Drain {
    pub(super) fn new(hub: Arc<Hub>, to: String, way: Way, show: Option<(Level, Show)>) -> Self {
        let timeline = Timeline::begin(hub.stamp());
        let output = Output::new(hub.clone(), to, way, show);
        Self {
            hub,
            timeline,
            queues: Vec::new(),
            threads: Vec::new(),
            output,
            lost_before: Vec::new(),
            news: Vec::new(),
        }
    }

    /// Works in rounds. `wait` waits for the next round, and returns whether it is the last.
    pub(super) fn run(mut self, wait: impl Fn() -> bool) -> LoggingReport {
        // So that a recording declares its session from the beginning.
        self.round(false);
        let mut asked = Instant::now();
        loop {
            let is_last = wait();
            self.round(is_last);
            if is_last {
                break;
            }
            // A quiet system has no blocks for it.
            if asked.elapsed() >= ASK_EVERY {
                asked = Instant::now();
                self.output.ask();
            }
        }
        // The last block may have been refused, with the losses it reported.
        self.record_losses();
        let lost = self.lost();
        self.output.end(lost)
    }

    fn round(&mut self, is_last: bool) {
        self.timeline.advance();
        let limit = if is_last {
            u64::MAX
        } else {
            self.timeline.limit()
        };
        self.take_news();
        let (output, timeline) = (&mut self.output, &self.timeline);
        output.record_time();
        merge(&mut self.queues, limit, |queue| {
            let Some(entry) = queue.first() else { return };
            let time = timeline.nanos(entry[1]).max(queue.last);
            output.entry(queue.thread, time, entry);
            queue.last = time;
        });
        self.record_losses();
        self.output.end_block();
        self.forget_ended();
    }

    /// Records all losses that are not recorded yet.
    fn record_losses(&mut self) {
        self.hub.take_homeless();
        let output = &mut self.output;
        for (thread, lost) in lost(&self.lost_before, &self.threads) {
            output.record_losses(Losing::Messages(thread), lost);
        }
        #[cfg(feature = "events")]
        output.record_losses_of_events();
        output.record_losses_of_signals();
        // Last: a block that was full and refused has cost messages too.
        output.record_losses_of_messages(self.hub.lost_messages.load(Ordering::Relaxed));
    }

    fn take_news(&mut self) {
        // Before the threads of the taken rings: a thread with events is announced first.
        #[cfg(feature = "events")]
        let events = self.hub.take_events();
        self.output.take_signals(&mut self.news);
        #[cfg(feature = "events")]
        {
            for inlet in events {
                self.output.add_events(inlet.name, &inlet.events);
                self.queues.push(Queue::of_events(inlet.events));
            }
            self.output.take_names();
        }
        for inlet in self.news.drain(..) {
            let Inlet {
                number,
                name,
                samples,
                messages,
                lost_messages,
            } = inlet;
            self.output.add_thread(number, name);
            self.queues.push(Queue::new(number, samples));
            self.queues.push(Queue::new(number, messages));
            self.threads.push((number, lost_messages));
        }
    }

    /// Messages that were lost on their way here.
    fn lost(&self) -> u64 {
        let by_threads = lost(&self.lost_before, &self.threads).map(|(_, lost)| lost);
        by_threads.sum::<u64>() + self.hub.lost_messages.load(Ordering::Relaxed)
    }

    /// Lets go of the rings of threads that have ended.
    fn forget_ended(&mut self) {
        if !self.queues.iter().any(Queue::is_over) {
            return;
        }
        self.queues.retain(|queue| !queue.is_over());
        let queues = &self.queues;
        let lost_before = &mut self.lost_before;
        self.threads.retain(|(number, lost)| {
            let lives = queues.iter().any(|queue| queue.thread == *number);
            if !lives {
                let lost = lost.load(Ordering::Relaxed);
                if lost > 0 {
                    lost_before.push((*number, lost));
                }
            }
            lives
        });
    }
}

/// The messages that each thread has lost, those that have ended first.
fn lost(
    ended: &[(u32, u64)],
    threads: &[(u32, Arc<AtomicU64>)],
) -> impl Iterator<Item = (u32, u64)> {
    let threads = threads.iter();
    let living = threads.map(|(thread, lost)| (*thread, lost.load(Ordering::Relaxed)));
    ended.iter().copied().chain(living)
}
