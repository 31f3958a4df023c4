//! The link of the receiving side.

use crate::age::{Sent, Stamped};
use crate::link::{First, Line, Link, Near, end_of, first};
use crate::side::Stop;
use luna::{Instant, Receiver, Sender};
use std::pin::pin;

/// The link of the receiving side, made by [`receiver`](crate::Network::receiver). It carries
/// values of type `T` and delivers them as `R`.
pub type ReceiveLink<T, R = T> = Link<Inward<T, R>>;

/// The same, for values with their age.
pub type StampedLink<T> = ReceiveLink<T, Stamped<T>>;

/// A value that has arrived.
pub(crate) struct Arrived<T> {
    pub(crate) value: T,
    pub(crate) number: u64,
    pub(crate) at: Instant,
    pub(crate) sent: Sent,
}

impl<T> Arrived<T> {
    pub(crate) fn plain(self) -> T {
        self.value
    }

    pub(crate) fn stamped(self) -> Stamped<T> {
        Stamped::new(self.value, self.number, self.at, self.sent)
    }
}

/// A link that receives: the near side of it.
#[expect(missing_debug_implementations, reason = "only links hold it")]
pub struct Inward<T, R> {
    pub(crate) sender: Sender<R>,
    pub(crate) inbox: Receiver<Arrived<T>>,
    pub(crate) deliver_as: fn(Arrived<T>) -> R,
    /// How many values are taken before that is reported, while more wait.
    pub(crate) quarter: u64,
}

impl<T: Send, R: Send> Near for Inward<T, R> {
    async fn carry(&self, line: &Line) -> Stop {
        let mut ended = pin!(self.sender.ended());
        match first(ended.as_mut(), pin!(line.joined())).await {
            First::Own(end) => return Stop::Ended(end),
            First::Other(Err(stop)) => return stop,
            First::Other(Ok(())) => {}
        }
        let mut stopped = pin!(line.stopped());
        let mut unreported = 0;
        loop {
            let arrived = {
                let next = pin!(self.inbox.recv());
                let next = pin!(first(ended.as_mut(), next));
                // First the end of the session: what waits then is not delivered.
                match first(stopped.as_mut(), next).await {
                    First::Own(stop) => return stop,
                    First::Other(First::Own(end)) => return Stop::Ended(end),
                    First::Other(First::Other(Ok(arrived))) => arrived,
                    First::Other(First::Other(Err(_))) => return line.stopped().await,
                }
            };
            let number = arrived.number;
            let delivery = pin!(self.sender.send((self.deliver_as)(arrived)));
            match first(delivery, stopped.as_mut()).await {
                First::Own(Ok(())) => {}
                First::Own(Err(error)) => return Stop::Ended(end_of(error.is_closed())),
                First::Other(stop) => return stop,
            }
            line.status.acknowledge(number);
            unreported += 1;
            let is_due = unreported >= self.quarter || self.inbox.buffered() == 0;
            line.shared.take(number, is_due);
            if is_due {
                unreported = 0;
            }
        }
    }

    fn poison(&self) {
        self.sender.poison();
    }
}
