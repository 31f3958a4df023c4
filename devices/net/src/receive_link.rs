//! The link of the receiving side.

use crate::age::Stamped;
use crate::inbox::{Arrived, Deliveries};
use crate::link::{First, Line, Link, Near, end_of, first};
use crate::side::Stop;
use luna::Sender;
use std::pin::pin;

/// The link of the receiving side, made by [`receiver`](crate::Network::receiver). It carries
/// values of type `T` and delivers them as `R`.
pub type ReceiveLink<T, R = T> = Link<Inward<T, R>>;

/// The same, for values with their age.
pub type StampedLink<T> = ReceiveLink<T, Stamped<T>>;

/// A link that receives: the near side of it.
#[expect(missing_debug_implementations, reason = "only links hold it")]
pub struct Inward<T, R> {
    pub(crate) sender: Sender<R>,
    pub(crate) inbox: Deliveries<T>,
    pub(crate) deliver_as: fn(Arrived<T>) -> R,
}

impl<T: Send, R: Send> Near for Inward<T, R> {
    async fn carry(&self, line: &Line) -> Stop {
        let mut ended = pin!(self.sender.ended());
        let window = match first(ended.as_mut(), pin!(line.joined())).await {
            First::Own(end) => return Stop::Ended(end),
            First::Other(Err(stop)) => return stop,
            First::Other(Ok(window)) => window,
        };
        // How many values are taken before that is reported, while more wait.
        let quarter = (window / 4).max(1);
        let mut stopped = pin!(line.stopped());
        let mut unreported = 0;
        loop {
            let mut values = {
                let next = pin!(self.inbox.next());
                let next = pin!(first(ended.as_mut(), next));
                match first(stopped.as_mut(), next).await {
                    First::Own(stop) => return stop,
                    First::Other(First::Own(end)) => return Stop::Ended(end),
                    First::Other(First::Other(Some(values))) => values,
                    First::Other(First::Other(None)) => return stopped.await,
                }
            };
            while let Some(arrived) = values.pop_front() {
                // What waits at the end of the session is not delivered.
                if line.shared.is_stopped() {
                    self.inbox.give_back(values);
                    return stopped.await;
                }
                let number = arrived.number;
                let delivery = pin!(self.sender.send((self.deliver_as)(arrived)));
                let stop = match first(delivery, stopped.as_mut()).await {
                    First::Own(Ok(())) => None,
                    First::Own(Err(error)) => Some(Stop::Ended(end_of(error.is_closed()))),
                    First::Other(stop) => Some(stop),
                };
                if let Some(stop) = stop {
                    self.inbox.give_back(values);
                    return stop;
                }
                line.status.acknowledge(number, 1);
                unreported += 1;
                let is_last = values.is_empty() && !self.inbox.has_more();
                let is_due = is_last || unreported >= quarter;
                if is_due {
                    unreported = 0;
                }
                // Before the report, which each sign of life makes: the sender counts on the room.
                self.inbox.took_one();
                line.shared.take(number, is_due);
            }
            self.inbox.give_back(values);
        }
    }

    fn poison(&self) {
        self.sender.poison();
    }
}
