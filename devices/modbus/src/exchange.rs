//! The cycles of a running client.

use crate::connection::Connection;
use crate::frame::Frame;
use crate::point::Place;
use crate::points::{Points, Taken};
use crate::{AnswerUnit, Counts, Event, ModbusServer, RequestError};
use luna::devices::Device;
use luna::external::LinkError;
use luna::{Error, Sender};
use luna_links::tcp::Connector;
use std::collections::VecDeque;
use std::future::{Future, poll_fn};
use std::pin::pin;
use std::task::Poll;
use std::time::Duration;

/// What a running client works with.
pub(crate) struct Exchange {
    connection: Option<Connection>,
    connector: Connector,
    frame: Frame,
    /// Of the last read.
    values: Vec<u16>,
    timeout: Duration,
    events: Sender<Event>,
    /// Why the last connection ended.
    broken_by: Option<RequestError>,
    /// Reports that are still to be sent, the oldest first.
    pending: VecDeque<Event>,
    counts: Counts,
}

/// The connection is closed; its reports are pending.
struct Broken;

impl Exchange {
    pub(crate) fn new(
        connector: Connector,
        (unit, answers): (u8, AnswerUnit),
        timeout: Duration,
        events: Sender<Event>,
        counts: Counts,
    ) -> Self {
        Self {
            connection: None,
            connector,
            frame: Frame::new(unit, answers),
            values: Vec::new(),
            timeout,
            events,
            broken_by: None,
            pending: VecDeque::new(),
            counts,
        }
    }

    /// Until all points have gone, or there is no connection any more.
    pub(crate) async fn go_on(
        &mut self,
        points: &mut Points,
        period: Duration,
        device: &Device<ModbusServer>,
    ) -> luna::Result<()> {
        let mut next = luna::now();
        while points.forget_ended().await? {
            if self.connection.is_none() {
                match points.unless_over(self.connect()).await? {
                    None => return self.report_leftovers(points).await,
                    Some(made) => match made? {
                        Ok(connection) => self.connection = Some(connection),
                        Err(error) => return Err(self.give_up(points, device, error)),
                    },
                }
                self.counts.add_connection();
                self.report(Event::Connected).await?;
            }
            if let Ok(()) = self.cycle(points).await? {
                self.counts.add_cycle();
            }
            next += period;
            let now = luna::now();
            if next < now {
                self.counts.add_late();
                next = now;
            }
            // If all channels have ended, the loop writes what is left in them.
            points.unless_over(luna::at(next)).await?;
        }
        self.report_pending().await
    }

    /// The next connection. Meanwhile it reports how the last one ended: the attempts do not wait
    /// for the reader of the events, so neither does the loss of the device.
    async fn connect(&mut self) -> luna::Result<Result<Connection, LinkError>> {
        let Self {
            connector,
            events,
            pending,
            ..
        } = self;
        let mut reporting = pin!(send_all(events, pending));
        let mut connecting = pin!(connector.connect());
        let mut is_reported = false;
        let made = poll_fn(|cx| {
            if !is_reported && let Poll::Ready(sent) = reporting.as_mut().poll(cx) {
                is_reported = true;
                sent?;
            }
            connecting.as_mut().poll(cx).map(Ok::<_, Error>)
        })
        .await?;
        if made.is_ok() && !is_reported {
            reporting.await?;
        }
        Ok(made.and_then(|stream| {
            Connection::new(stream).map_err(|error| LinkError::SetUp(error.into()))
        }))
    }

    /// The device is lost. That does not wait for the reader of the events: reports that have no
    /// room are dropped.
    fn give_up(
        &mut self,
        points: &mut Points,
        device: &Device<ModbusServer>,
        error: LinkError,
    ) -> Error {
        let error = match (error, self.broken_by.take()) {
            (LinkError::NoAttemptLeft { .. }, Some(reason)) => Error::other(reason),
            (error, _) => error.into(),
        };
        let lost = device.lost(error);
        for writing in &mut points.writings {
            // Not more: its senders may still be there.
            for _ in 0..writing.buffered() {
                let Ok(Some(taken)) = writing.take() else {
                    break;
                };
                if self.not_connected(writing.place(), &taken).is_err() {
                    break;
                }
            }
        }
        for event in self.pending.drain(..) {
            let _ = self.events.try_send(event);
        }
        lost
    }

    async fn cycle(&mut self, points: &mut Points) -> luna::Result<Result<(), Broken>> {
        for writing in &mut points.writings {
            for _ in 0..writing.waiting() {
                // A value that is taken for a closed connection could only fail.
                if let Err(error) = self.check(writing.place())? {
                    return Ok(self.disconnected(error));
                }
                let Some(taken) = writing.take()? else { break };
                if self.frame.write(writing.place(), taken.raw).is_err() {
                    return Err(never_fits());
                }
                match self.ask().await {
                    Ok(()) => self.counts.add_written(),
                    Err(error) => {
                        self.write_failed(&taken, error.clone());
                        if !error.keeps_connection() {
                            return Ok(self.disconnected(error));
                        }
                        self.report_pending().await?;
                    }
                }
            }
        }
        let Points {
            readings, blocks, ..
        } = points;
        for block in blocks {
            if self.frame.read(block.place).is_err() {
                return Err(never_fits());
            }
            self.values.clear();
            let (code, error) = match self.ask().await {
                Ok(()) => {
                    for reading in &readings[block.readings.clone()] {
                        let place = reading.place();
                        let from = usize::from(place.address - block.place.address);
                        let to = from + usize::from(place.width);
                        reading.give(&self.values[from..to], &self.counts);
                    }
                    (None, None)
                }
                Err(error @ RequestError::Exception { code, .. }) => (Some(code), Some(error)),
                Err(error) => return Ok(self.disconnected(error)),
            };
            let is_new = std::mem::replace(&mut block.refused, code) != code;
            if let Some(error) = error
                && is_new
            {
                self.report(Event::ReadRefused(error)).await?;
            }
        }
        Ok(Ok(()))
    }

    /// Whether the connection is open, before a value is taken for the place.
    fn check(&mut self, place: Place) -> luna::Result<Result<(), RequestError>> {
        let Some(connection) = &self.connection else {
            return Ok(Ok(()));
        };
        if self.frame.write(place, [0; 2]).is_err() {
            return Err(never_fits());
        }
        Ok(connection.check(self.frame.about))
    }

    /// Sends the frame, and waits for its answer.
    async fn ask(&mut self) -> Result<(), RequestError> {
        let request = self.frame.about;
        let Some(connection) = &mut self.connection else {
            return Err(RequestError::NotConnected { request });
        };
        let asked = connection.exchange(&self.frame, self.timeout, &mut self.values, &self.counts);
        let answered = asked.await;
        match &answered {
            Ok(()) => self.connector.useful(),
            Err(RequestError::Exception { .. }) => {
                self.connector.useful();
                self.counts.add_exception();
            }
            Err(RequestError::TimedOut { .. }) => self.counts.add_timeout(),
            Err(RequestError::Garbage { .. }) => self.counts.add_garbage(),
            Err(_) => {}
        }
        answered
    }

    fn disconnected(&mut self, error: RequestError) -> Result<(), Broken> {
        self.connection = None;
        self.broken_by = Some(error.clone());
        self.pending.push_back(Event::Disconnected(error));
        Err(Broken)
    }

    fn write_failed(&mut self, taken: &Taken, error: RequestError) {
        self.counts.add_write_failure();
        let value = taken.number;
        self.pending.push_back(Event::WriteFailed { value, error });
    }

    /// Without a connection: the value is not sent.
    fn not_connected(&mut self, place: Place, taken: &Taken) -> luna::Result<()> {
        if self.frame.write(place, taken.raw).is_err() {
            return Err(never_fits());
        }
        let request = self.frame.about;
        self.write_failed(taken, RequestError::NotConnected { request });
        Ok(())
    }

    /// At the end without a connection: reports the values that wait. Their senders are gone.
    async fn report_leftovers(&mut self, points: &mut Points) -> luna::Result<()> {
        for writing in &mut points.writings {
            while let Some(taken) = writing.take()? {
                self.not_connected(writing.place(), &taken)?;
                self.report_pending().await?;
            }
        }
        self.report_pending().await
    }

    async fn report(&mut self, event: Event) -> luna::Result<()> {
        self.pending.push_back(event);
        self.report_pending().await
    }

    async fn report_pending(&mut self) -> luna::Result<()> {
        send_all(&self.events, &mut self.pending).await
    }
}

/// Waits until all are taken. Without a receiver they are only counted. If it is dropped, those that
/// were not taken stay.
async fn send_all(events: &Sender<Event>, pending: &mut VecDeque<Event>) -> luna::Result<()> {
    while let Some(event) = pending.front() {
        let sent = events.send(event.clone()).await;
        pending.pop_front();
        if sent.is_err_and(|error| error.is_poisoned()) {
            return Err(Error::Poisoned);
        }
    }
    Ok(())
}

/// Points are within their tables, and blocks within a frame.
fn never_fits() -> Error {
    Error::other("a request does not fit into a Modbus frame")
}
