//! Where received frames go.

use super::{CanError, Event, OnBusOff};
use crate::{BusReport, Counts, Filter, Frame, Incoming, Port, PortError, State};
use luna::Sender;
use luna::channel::{ChannelEnd, Ended, TrySendError};
use std::future::Future;
use std::pin::Pin;
use std::task::{Context, Poll};

/// A receiver of frames, or of what they stand for.
pub(super) struct Route {
    pub(super) filters: Vec<Filter>,
    pub(super) to: Box<dyn Take>,
}

pub(super) trait Take: Send {
    fn take(&self, frame: &Frame) -> Taken;
    fn ended(&self) -> Ended<'_>;
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

/// What received frames and reports go to.
pub(super) struct Routing<'a> {
    pub(super) receivers: &'a [Route],
    /// Of each receiver: whether its channel had no room for the last frame.
    pub(super) is_full: Vec<bool>,
    pub(super) events: Option<&'a Sender<Event>>,
    pub(super) on_bus_off: OnBusOff,
    pub(super) counts: Counts,
}

impl Routing<'_> {
    /// Until something fails.
    pub(super) async fn receive_all<P: Port>(&mut self, port: &P) -> Stop {
        loop {
            let taken = match port.receive().await {
                Ok(Incoming::Frame(frame)) => self.give(&frame),
                Ok(Incoming::Report(report)) => self.note(report),
                Err(error) => Err(error.into()),
            };
            if let Err(stop) = taken {
                return stop;
            }
        }
    }

    fn give(&mut self, frame: &Frame) -> Result<(), Stop> {
        for (number, receiver) in self.receivers.iter().enumerate() {
            if !receiver.filters.iter().any(|filter| filter.matches(frame)) {
                continue;
            }
            match receiver.to.take(frame) {
                Taken::Yes => {
                    self.is_full[number] = false;
                    self.counts.add_received();
                }
                Taken::Full => {
                    self.counts.add_overrun();
                    if !std::mem::replace(&mut self.is_full[number], true) {
                        self.report(Event::Overrun { receiver: number });
                    }
                }
                Taken::Malformed => {
                    self.counts.add_malformed();
                    self.report(Event::Malformed { receiver: number });
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
            self.counts.add_error();
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
            self.counts.add_unreported();
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

/// Forgets those that have ended. Returns whether one is poisoned.
pub(super) fn poll_ends(ends: &mut Vec<Pin<Box<Ended<'_>>>>, cx: &mut Context<'_>) -> bool {
    let mut is_poisoned = false;
    ends.retain_mut(|end| match end.as_mut().poll(cx) {
        Poll::Pending => true,
        Poll::Ready(end) => {
            is_poisoned |= end == ChannelEnd::Poisoned;
            false
        }
    });
    is_poisoned
}
