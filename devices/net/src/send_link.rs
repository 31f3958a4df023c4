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
            Ok(window) if self.is_buffered => self.stream(line, window).await,
            Ok(_) => self.rendezvous(line).await,
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
            if let Err(stop) = self.all_acknowledged(line, stop.as_mut()).await {
                offered.refuse(match &stop {
                    Stop::Ended(end) => *end,
                    Stop::Failed(_) => ChannelEnd::Poisoned,
                });
                return Err(stop);
            }
            drop(offered.0.take());
        }
    }

    /// Values in batches, of which at most `window` are under way.
    async fn stream(&self, line: &Line, window: u64) -> Result<(), Stop> {
        let mut stop = pin!(self.stopped(line));
        let mut batch = self.batch(line, stop.as_mut()).await?;
        let sent = self.batches(line, window, &mut batch, stop.as_mut()).await;
        if batch.count() > 0 {
            // The session has failed, and these were taken. They get their numbers, so that the
            // next session counts them as missing.
            line.shared.send(batch);
        }
        sent?;
        // The last sender is gone. Values are still under way.
        self.all_acknowledged(line, stop.as_mut()).await
    }

    /// While the link's thread sends one batch the values that come go into the next.
    async fn batches(
        &self,
        line: &Line,
        window: u64,
        batch: &mut Batch,
        mut stop: Pin<&mut impl Future<Output = Stop>>,
    ) -> Result<(), Stop> {
        let mut is_open = true;
        while is_open || batch.count() > 0 {
            let has_room = line.status.in_doubt() < window && batch.has_room();
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
                First::Own(next) => line.shared.send(std::mem::replace(batch, next?)),
                First::Other(value) => match received(value)? {
                    Some(value) => self.fill(line, window, batch, value)?,
                    None => is_open = false,
                },
            }
        }
        Ok(())
    }

    /// Adds a value and those that are in the buffer, as far as there is room.
    fn fill(&self, line: &Line, window: u64, batch: &mut Batch, first: T) -> Result<(), Stop> {
        let room = window.saturating_sub(line.status.in_doubt());
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

    /// Waits until no value is under way.
    async fn all_acknowledged(
        &self,
        line: &Line,
        mut stop: Pin<&mut impl Future<Output = Stop>>,
    ) -> Result<(), Stop> {
        while line.status.in_doubt() > 0 {
            self.acknowledged(line, stop.as_mut()).await?;
        }
        Ok(())
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
    /// Waits for the other program, or the end of the local channel; how many values may be under
    /// way.
    async fn join(&self, line: &Line) -> Result<u64, Stop> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::carrier::{Job, Shared};
    use crate::outbox::Outbox;
    use crate::peering::{Peering, tests::own};
    use crate::side::{Event, Values};
    use crate::{Role, Status};
    use luna::Buffer;
    use std::sync::Arc;
    use std::task::{Context, Poll, Waker};

    #[test]
    fn values_of_a_part_filled_batch_get_their_numbers_when_the_session_fails() {
        let status = Status::default();
        let values = Values::Out(Outbox::new(|| ()));
        let peering = Peering::new(own(Role::Sender, 1, "u64"), status.clone(), values);
        let (jobs, asked) = luna::buffered::<Job>(Buffer::fifo(6));
        let (report, events) = luna::buffered::<Event>(Buffer::fifo(4));
        let report = report.external();
        let shared = Arc::new(Shared::new(peering, jobs.external(), report.clone()));
        let line = Line::new("test".to_owned(), shared, events.external(), status.clone());
        // One batch: the other one is with the thread.
        let (give, free) = luna::buffered::<Batch>(Buffer::fifo(2));
        let give = give.external();
        give.try_send(Batch::new(8, 10)).unwrap();
        let (_notify, acknowledged) = luna::buffered::<()>(Buffer::overwrite_oldest(1));
        let (sender, receiver) = luna::buffered::<u64>(Buffer::fifo(8));
        let (sender, asked) = (sender.external(), asked.external());
        let link = Outward {
            receiver: receiver.external(),
            free: free.external(),
            acknowledged: acknowledged.external(),
            is_buffered: true,
        };
        let mut carry = pin!(link.carry(&line));
        let mut poll = || {
            let mut context = Context::from_waker(Waker::noop());
            carry.as_mut().poll(&mut context)
        };
        report.try_send(Event::Joined { window: 8 }).unwrap();
        for value in [1, 2, 3] {
            sender.try_send(value).unwrap();
        }
        assert!(poll().is_pending());
        assert!(asked.try_recv().is_err(), "it waits for the other batch");
        assert_eq!(status.in_doubt(), 3);
        let lost = Event::Stop(Stop::Ended(ChannelEnd::Poisoned));
        report.try_send(lost).unwrap();
        let stop = poll();
        assert!(matches!(
            stop,
            Poll::Ready(Stop::Ended(ChannelEnd::Poisoned))
        ));
        let Ok(Job::Values(batch)) = asked.try_recv() else {
            panic!("the batch was not sent");
        };
        assert_eq!((batch.count(), status.in_doubt()), (3, 3));
    }
}
