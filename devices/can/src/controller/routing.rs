//! Where received frames go.

use super::{CanError, Event, OnBusOff};
use crate::{BusReport, Counts, Filter, Frame, Incoming, Port, PortError, State};
use luna::Sender;
use luna::channel::{ChannelEnd, Ended, TrySendError};
use luna::realtime::off_path;
use std::future::Future;
use std::mem::replace;
use std::pin::Pin;
use std::task::{Context, Poll};

/// How many frames are received or sent in one go.
const IN_ONE_GO: u64 = 16;

/// A receiver of frames, or of what they stand for.
pub(super) struct Route {
    pub(super) filters: Vec<Filter>,
    pub(super) to: Box<dyn Take>,
}

pub(super) trait Take: Send {
    fn take(&self, frame: &Frame) -> Taken;
    fn ended(&self) -> Ended<'_>;
    /// The controller has failed: what supervises by its frames must not take that for an end in
    /// order.
    fn fail(&self) {}
}

pub(super) enum Taken {
    Yes,
    Full,
    Malformed,
    Poisoned,
    /// That its receivers have gone is found where it is waited for.
    Closed,
}

pub(super) struct Typed<T, F> {
    pub(super) sender: Sender<T>,
    pub(super) decode: F,
}

impl<T: Send, F: Fn(&Frame) -> Option<T> + Send> Take for Typed<T, F> {
    fn take(&self, frame: &Frame) -> Taken {
        let Some(value) = (self.decode)(frame) else {
            return Taken::Malformed;
        };
        match self.sender.try_send(value) {
            Ok(()) => Taken::Yes,
            Err(TrySendError::Full(_)) => Taken::Full,
            Err(TrySendError::Closed(_)) => Taken::Closed,
            Err(_) => Taken::Poisoned,
        }
    }

    fn ended(&self) -> Ended<'_> {
        self.sender.ended()
    }
}

/// A receiver that passes on to `reader` what it makes of frames.
pub(super) struct PassedOn<T, F, R> {
    pub(super) to: Typed<T, F>,
    pub(super) reader: Sender<R>,
}

impl<T: Send, F: Fn(&Frame) -> Option<T> + Send, R: Send> Take for PassedOn<T, F, R> {
    fn take(&self, frame: &Frame) -> Taken {
        self.to.take(frame)
    }

    fn ended(&self) -> Ended<'_> {
        self.reader.ended()
    }

    fn fail(&self) {
        self.to.sender.poison();
    }
}

/// What was reported of a receiver: not again before it is over.
#[derive(Debug, Default)]
pub(super) struct Reported {
    overrun: bool,
    malformed: bool,
}

/// What received frames and reports go to.
pub(super) struct Routing<'a> {
    pub(super) receivers: &'a [Route],
    pub(super) reported: &'a mut [Reported],
    pub(super) events: Option<&'a Sender<Event>>,
    pub(super) on_bus_off: OnBusOff,
    pub(super) counts: Counts,
}

impl Routing<'_> {
    /// Until something fails.
    pub(super) async fn receive_all<P: Port>(&mut self, port: &P) -> Stop {
        for number in 1_u64.. {
            let taken = match port.receive().await {
                Ok(Incoming::Frame(frame)) => self.give(&frame),
                Ok(Incoming::Report(report)) => self.note(report),
                Err(error) => Err(error.into()),
            };
            if let Err(stop) = taken {
                return stop;
            }
            give_way(number).await;
        }
        Stop::Closed
    }

    fn give(&mut self, frame: &Frame) -> Result<(), Stop> {
        for (number, receiver) in self.receivers.iter().enumerate() {
            if !receiver.filters.iter().any(|filter| filter.matches(frame)) {
                continue;
            }
            match receiver.to.take(frame) {
                Taken::Yes => {
                    self.reported[number] = Reported::default();
                    self.counts.add_received(1);
                }
                Taken::Full => {
                    self.counts.add_overrun(1);
                    self.reported[number].malformed = false;
                    if !replace(&mut self.reported[number].overrun, true) {
                        self.report(Event::Overrun { receiver: number });
                    }
                }
                Taken::Malformed => {
                    self.counts.add_malformed(1);
                    if !replace(&mut self.reported[number].malformed, true) {
                        self.report(Event::Malformed { receiver: number });
                    }
                }
                Taken::Closed => {}
                Taken::Poisoned => return Err(Stop::Poisoned),
            }
        }
        Ok(())
    }

    fn note(&mut self, report: BusReport) -> Result<(), Stop> {
        if report.lost > 0 {
            self.counts.add_lost(report.lost);
            self.report(Event::Lost(report.lost));
        }
        if let Some(error) = report.error {
            self.counts.add_error(1);
            self.report(Event::Error(error));
        }
        if let Some(state) = report.state {
            self.counts.set_state(state);
            self.report(Event::State(state));
            if state == State::BusOff && self.on_bus_off == OnBusOff::Lose {
                return Err(Stop::Lost(CanError::BusOff));
            }
        }
        Ok(())
    }

    fn report(&self, event: Event) {
        let is_reported = match self.events {
            Some(events) => events.try_send(event).is_ok(),
            None => false,
        };
        if !is_reported {
            self.counts.add_unreported(1);
        }
    }
}

/// Why one of the two directions ends.
pub(super) enum Stop {
    Closed,
    Poisoned,
    Lost(CanError),
}

impl From<PortError> for Stop {
    fn from(error: PortError) -> Self {
        Stop::Lost(error.into())
    }
}

/// After some frames other processes have their turn: a port that always has one never waits.
pub(super) async fn give_way(number: u64) {
    if number.is_multiple_of(IN_ONE_GO) {
        luna::yield_now().await;
    }
}

/// Waits for the ends of all receivers. Each is in a box of its own, since it is waited for again
/// and again; boxes are made and dropped off the path.
pub(super) struct Ends<'a>(Vec<Option<Pin<Box<Ended<'a>>>>>);

impl<'a> Ends<'a> {
    pub(super) fn new(receivers: &'a [Route]) -> Self {
        let ends = receivers.iter().map(|receiver| receiver.to.ended());
        Self(off_path(|| ends.map(Box::pin).map(Some).collect()))
    }

    /// Forgets those that have ended. Returns whether one is poisoned.
    pub(super) fn poll(&mut self, cx: &mut Context<'_>) -> bool {
        let mut is_poisoned = false;
        for place in &mut self.0 {
            if let Some(end) = place
                && let Poll::Ready(how) = end.as_mut().poll(cx)
            {
                is_poisoned |= how == ChannelEnd::Poisoned;
                off_path(|| *place = None);
            }
        }
        is_poisoned
    }

    pub(super) fn are_all(&self) -> bool {
        self.0.iter().all(Option::is_none)
    }
}

impl Drop for Ends<'_> {
    fn drop(&mut self) {
        off_path(|| self.0 = Vec::new());
    }
}
