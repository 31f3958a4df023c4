//! The cycles of a running client.

use crate::connection::Connection;
use crate::frame::Frame;
use crate::points::{Points, Taken};
use crate::{Counts, Event, ModbusServer, RequestError};
use luna::devices::Device;
use luna::external::LinkError;
use luna::{Error, Sender};
use luna_links::tcp::Connector;
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
    counts: Counts,
}

/// The connection is closed; the reports are made.
struct Broken;

impl Exchange {
    pub(crate) fn new(
        connector: Connector,
        unit: u8,
        timeout: Duration,
        events: Sender<Event>,
        counts: Counts,
    ) -> Self {
        Self {
            connection: None,
            connector,
            frame: Frame::new(unit),
            values: Vec::new(),
            timeout,
            events,
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
                match points.unless_over(self.connector.connect()).await? {
                    None => return self.report_leftovers(points).await,
                    Some(Ok(stream)) => match Connection::new(stream) {
                        Ok(connection) => self.connection = Some(connection),
                        Err(error) => return Err(device.lost(LinkError::SetUp(error.into()))),
                    },
                    Some(Err(error)) => {
                        self.report_leftovers(points).await?;
                        return Err(device.lost(error));
                    }
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
        Ok(())
    }

    async fn cycle(&mut self, points: &mut Points) -> luna::Result<Result<(), Broken>> {
        for writing in &mut points.writings {
            for _ in 0..writing.waiting() {
                let Some(taken) = writing.take()? else { break };
                if self.frame.write(writing.place(), taken.raw).is_err() {
                    return Err(never_fits());
                }
                match self.ask().await {
                    Ok(()) => self.counts.add_written(),
                    Err(error) => {
                        self.report_failure(&taken, error.clone()).await?;
                        if !error.keeps_connection() {
                            return self.disconnected(error).await;
                        }
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
                Err(error) => return self.disconnected(error).await,
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

    /// Sends the frame, and waits for its answer.
    async fn ask(&mut self) -> Result<(), RequestError> {
        let request = self.frame.about;
        let Some(connection) = &mut self.connection else {
            return Err(RequestError::NotConnected { request });
        };
        let asked = connection.exchange(&self.frame, self.timeout, &mut self.values);
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

    async fn disconnected(&mut self, error: RequestError) -> luna::Result<Result<(), Broken>> {
        self.connection = None;
        self.report(Event::Disconnected(error)).await?;
        Ok(Err(Broken))
    }

    async fn report_failure(&mut self, taken: &Taken, error: RequestError) -> luna::Result<()> {
        self.counts.add_write_failure();
        let value = taken.number;
        self.report(Event::WriteFailed { value, error }).await
    }

    /// Without a connection, and at the end: reports the values that wait.
    async fn report_leftovers(&mut self, points: &mut Points) -> luna::Result<()> {
        for writing in &mut points.writings {
            while let Some(taken) = writing.take()? {
                if self.frame.write(writing.place(), taken.raw).is_err() {
                    return Err(never_fits());
                }
                let request = self.frame.about;
                let error = RequestError::NotConnected { request };
                self.report_failure(&taken, error).await?;
            }
        }
        Ok(())
    }

    /// Waits until the event is taken. Without a receiver it is only counted.
    async fn report(&mut self, event: Event) -> luna::Result<()> {
        match self.events.send(event).await {
            Err(error) if error.is_poisoned() => Err(Error::Poisoned),
            _ => Ok(()),
        }
    }
}

/// Points are within their tables, and blocks within a frame.
fn never_fits() -> Error {
    Error::other("a request does not fit into a Modbus frame")
}
