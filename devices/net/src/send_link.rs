//! The link of the sending side.

use crate::NetError;
use crate::batch::Batch;
use crate::link::{First, Line, Link, Near, first};
use crate::side::Stop;
use luna::channel::{ChannelEnd, Extended};
use luna::realtime::off_path;
use luna::{Instant, Receiver, RecvError};
use serde::Serialize;
use std::pin::{Pin, pin};

/// The link of the sending side, made by [`sender`](crate::Network::sender).
pub type SendLink<T> = Link<Outward<T>>;

/// A link that sends: the near side of it.
#[expect(missing_debug_implementations, reason = "only links hold it")]
pub struct Outward<T> {
    pub(crate) receiver: Receiver<T>,
    /// Batches for values.
    pub(crate) free: Receiver<Batch>,
    /// Says that values were acknowledged; the status says which.
    pub(crate) acknowledged: Receiver<()>,
    /// How many values may be under way.
    pub(crate) window: u64,
    /// Whether a sender goes on before the other program has taken its value.
    pub(crate) is_buffered: bool,
}

/// Refuses a value that was not acknowledged, also if the link is dropped.
struct Offered<'a, T>(Option<Extended<'a, T>>);

impl<T> Offered<'_, T> {
    fn refuse(&mut self, end: ChannelEnd) {
        if let Some(taken) = self.0.take() {
            taken.refuse(end);
        }
    }
}

impl<T> Drop for Offered<'_, T> {
    fn drop(&mut self) {
        self.refuse(ChannelEnd::Closed);
    }
}

impl<T: Serialize + Send> Near for Outward<T> {
    async fn carry(&self, line: &Line) -> Stop {
        let carried = match self.join(line).await {
            Err(stop) => Err(stop),
            Ok(()) if self.is_buffered => self.stream(line).await,
            Ok(()) => self.rendezvous(line).await,
        };
        carried.err().unwrap_or(Stop::Ended(ChannelEnd::Closed))
    }

    fn poison(&self) {
        self.receiver.poison();
    }
}

/// Waits for `own`, unless something stops the link before.
async fn unless<V>(
    stop: Pin<&mut impl Future<Output = Stop>>,
    own: impl Future<Output = V>,
) -> Result<V, Stop> {
    match first(pin!(own), stop).await {
        First::Own(value) => Ok(value),
        First::Other(stop) => Err(stop),
    }
}

/// The next value; none if the last sender is gone.
fn received<V>(value: Result<V, RecvError>) -> Result<Option<V>, Stop> {
    match value {
        Ok(value) => Ok(Some(value)),
        Err(error) if error.is_closed() => Ok(None),
        Err(_) => Err(Stop::Ended(ChannelEnd::Poisoned)),
    }
}

impl<T: Serialize + Send> Outward<T> {
    /// One value after the other. A sender goes on when its value was acknowledged.
    async fn rendezvous(&self, line: &Line) -> Result<(), Stop> {
        let mut stop = pin!(self.stopped(line));
        loop {
            let mut batch = self.batch(line, stop.as_mut()).await?;
            let taken = unless(stop.as_mut(), self.receiver.recv_extended()).await?;
            let Some(taken) = received(taken)? else {
                return Ok(());
            };
            let encoded = encode(line, &mut batch, &*taken);
            let mut offered = Offered(Some(taken));
            if let Err(stop) = encoded {
                offered.refuse(ChannelEnd::Poisoned);
                return Err(stop);
            }
            line.status.send(1);
            line.shared.send(batch);
            if let Err(stop) = self.room(line, 1, stop.as_mut()).await {
                offered.refuse(match &stop {
                    Stop::Ended(end) => *end,
                    Stop::Failed(_) => ChannelEnd::Poisoned,
                });
                return Err(stop);
            }
            drop(offered.0.take());
        }
    }

    /// While the link's thread sends one batch the values that come go into the next.
    async fn stream(&self, line: &Line) -> Result<(), Stop> {
        let mut stop = pin!(self.stopped(line));
        let mut batch = self.batch(line, stop.as_mut()).await?;
        let mut is_open = true;
        while is_open || batch.count() > 0 {
            let has_room = line.status.in_doubt() < self.window && batch.has_room();
            let value = match batch.count() {
                0 if !has_room => {
                    self.acknowledged(line, stop.as_mut()).await?;
                    continue;
                }
                0 => First::Other(unless(stop.as_mut(), self.receiver.recv()).await?),
                _ if is_open && has_room => {
                    let next = pin!(self.batch_or_end(line));
                    let value = pin!(self.receiver.recv());
                    unless(stop.as_mut(), first(next, value)).await?
                }
                _ => First::Own(unless(stop.as_mut(), self.batch_or_end(line)).await?),
            };
            match value {
                First::Own(next) => line.shared.send(std::mem::replace(&mut batch, next?)),
                First::Other(value) => match received(value)? {
                    Some(value) => self.fill(line, &mut batch, value)?,
                    None => is_open = false,
                },
            }
        }
        // The last sender is gone. Values are still under way.
        while line.status.in_doubt() > 0 {
            self.acknowledged(line, stop.as_mut()).await?;
        }
        Ok(())
    }

    /// Adds a value and those that are in the buffer, as far as there is room.
    fn fill(&self, line: &Line, batch: &mut Batch, first: T) -> Result<(), Stop> {
        let room = self.window.saturating_sub(line.status.in_doubt());
        let (before, mut next) = (batch.count(), Some(first));
        while let Some(value) = next {
            let encoded = encode(line, batch, &value);
            if encoded.is_err() {
                // Those before it were taken, and are in doubt.
                line.status.send(batch.count() - before);
            }
            encoded?;
            let has_room = batch.count() - before < room && batch.has_room();
            // The next receive finds an end.
            next = has_room.then(|| self.receiver.try_recv().ok()).flatten();
        }
        line.status.send(batch.count() - before);
        Ok(())
    }

    async fn batch_or_end(&self, line: &Line) -> Result<Batch, Stop> {
        let batch = self.free.recv().await;
        batch.map_err(|_| off_path(|| line.thread_ended()))
    }

    /// An empty batch.
    async fn batch(
        &self,
        line: &Line,
        stop: Pin<&mut impl Future<Output = Stop>>,
    ) -> Result<Batch, Stop> {
        unless(stop, self.batch_or_end(line)).await?
    }

    /// For how many values the window has room: at least for one.
    async fn room(
        &self,
        line: &Line,
        window: u64,
        mut stop: Pin<&mut impl Future<Output = Stop>>,
    ) -> Result<u64, Stop> {
        loop {
            let room = window.saturating_sub(line.status.in_doubt());
            if room > 0 {
                return Ok(room);
            }
            self.acknowledged(line, stop.as_mut()).await?;
        }
    }

    /// Waits until the status may have changed.
    async fn acknowledged(
        &self,
        line: &Line,
        stop: Pin<&mut impl Future<Output = Stop>>,
    ) -> Result<(), Stop> {
        let acknowledged = unless(stop, self.acknowledged.recv()).await?;
        acknowledged.map_err(|_| off_path(|| line.thread_ended()))
    }

    /// Poison, or the end of the session.
    async fn stopped(&self, line: &Line) -> Stop {
        match first(pin!(self.receiver.poisoned()), pin!(line.stopped())).await {
            First::Own(end) => Stop::Ended(end),
            First::Other(stop) => stop,
        }
    }
}

/// Adds a value that was taken now.
fn encode<T: Serialize>(line: &Line, batch: &mut Batch, value: &T) -> Result<(), Stop> {
    let sent = Instant::now_real().as_nanos();
    batch.add(value, sent).map_err(|error| {
        off_path(|| {
            Stop::Failed(NetError::Encode {
                name: line.name.clone(),
                capacity: batch.capacity(),
                why: error.to_string(),
            })
        })
    })
}

impl<T: Send> Outward<T> {
    /// Waits for the other program, or the end of the local channel.
    async fn join(&self, line: &Line) -> Result<(), Stop> {
        match first(pin!(self.receiver.ended()), pin!(line.joined())).await {
            // What is in the buffer is still to be delivered.
            First::Own(ChannelEnd::Closed) if self.receiver.buffered() > 0 => {
                match first(pin!(self.receiver.poisoned()), pin!(line.joined())).await {
                    First::Own(end) => Err(Stop::Ended(end)),
                    First::Other(joined) => joined,
                }
            }
            First::Own(end) => Err(Stop::Ended(end)),
            First::Other(joined) => joined,
        }
    }
}
