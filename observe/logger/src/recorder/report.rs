//! What became of a recording.

use std::fmt;

/// The outcome of a recording. Every sample recorded meanwhile is counted once: as recorded or as
/// lost. Its `Display` is one line, and one more for each signal that lost samples.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct LoggingReport {
    /// Where it went.
    pub to: String,
    /// How many bytes that are.
    pub bytes: u64,
    /// The signals, in the order of their registration.
    pub signals: Vec<SignalReport>,
    /// The messages.
    pub messages: MessagesReport,
    /// The events.
    #[cfg(feature = "events")]
    pub events: EventsReport,
    /// Why something could not be written, if so: the first reason.
    pub error: Option<String>,
}

/// What became of a signal's samples.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct SignalReport {
    /// Its name.
    pub name: String,
    /// Its unit; empty if none was stated.
    pub unit: String,
    /// How many samples are in the recording.
    pub recorded: u64,
    /// How many were lost: the ring or the sink had no room.
    pub lost: u64,
}

/// What became of messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct MessagesReport {
    /// How many are in the recording.
    pub recorded: u64,
    /// How many are not.
    pub lost: u64,
    /// How many of those in the recording had no room for their whole text.
    pub truncated: u64,
}

/// What became of events.
#[cfg(feature = "events")]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct EventsReport {
    /// How many are in the recording.
    pub recorded: u64,
    /// How many were lost: a ring or the sink had no room.
    pub lost: u64,
}

impl LoggingReport {
    /// The report after a panic of the recorder's thread.
    pub(super) fn broken(to: String) -> Self {
        Self {
            to,
            error: Some("the recorder's thread panicked".to_owned()),
            ..Self::default()
        }
    }

    /// How many samples of all signals were lost.
    pub fn lost_samples(&self) -> u64 {
        self.signals.iter().map(|signal| signal.lost).sum()
    }
}

/// A number of things.
struct Count(u64, &'static str);

impl fmt::Display for Count {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Count(number, what) = self;
        write!(f, "{number} {what}{}", if *number == 1 { "" } else { "s" })
    }
}

impl fmt::Display for LoggingReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let samples: u64 = self.signals.iter().map(|signal| signal.recorded).sum();
        write!(
            f,
            "recorded {} of {} and {} to {} ({} bytes)",
            Count(samples, "sample"),
            Count(self.signals.len() as u64, "signal"),
            Count(self.messages.recorded, "message"),
            self.to,
            self.bytes
        )?;
        if self.messages.lost > 0 {
            write!(f, ", lost {}", Count(self.messages.lost, "message"))?;
        }
        #[cfg(feature = "events")]
        if self.events != EventsReport::default() {
            let EventsReport { recorded, lost } = self.events;
            write!(f, ", {recorded} events, lost {lost}")?;
        }
        for signal in self.signals.iter().filter(|signal| signal.lost > 0) {
            let SignalReport {
                name,
                recorded,
                lost,
                ..
            } = signal;
            let of = recorded + lost;
            write!(
                f,
                "\nsignal `{name}`: lost {lost} of {}",
                Count(of, "sample")
            )?;
        }
        if let Some(error) = &self.error {
            write!(f, "\nnot all could be written: {error}")?;
        }
        Ok(())
    }
}
