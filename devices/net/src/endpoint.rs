//! How a side of a channel is opened.

use crate::age::Stamped;
use crate::batch::Batch;
use crate::carrier::{Job, Shared, start};
use crate::error::TypeInfo;
use crate::facts;
use crate::inbox::{Arrived, inbox};
use crate::link::{Line, Link};
use crate::network::{Entry, Network};
use crate::outbox::Outbox;
use crate::peering::Peering;
use crate::receive_link::{Inward, StampedLink};
use crate::send_link::Outward;
use crate::side::{Event, Own, Values};
use crate::{NetError, ReceiveLink, Role, SendLink, Status};
use luna::{Buffer, Receiver, Sender};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::sync::Arc;

/// How many batches a stream has. While its thread sends one the link fills the other.
const BATCHES: usize = 2;

/// How a side of a channel is opened.
///
/// ```
/// # let network = luna_net::Network::open(&luna_net::Config::loopback())?;
/// let endpoint = network.endpoint("cell/setpoint").layout_version(2).capacity(64);
/// let (sender, link) = endpoint.buffered_sender::<f64>(luna::Buffer::overwrite_oldest(1))?;
/// # drop((sender, link));
/// # Ok::<(), luna_net::NetError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Endpoint {
    network: Network,
    name: String,
    version: u32,
    capacity: usize,
    window: usize,
}

impl Endpoint {
    pub(crate) fn new(network: Network, name: &str) -> Self {
        Self {
            network,
            name: name.to_owned(),
            version: 0,
            capacity: 4096,
            window: 64,
        }
    }

    /// The version of the value's layout, which both programs have to agree on; 0 if not stated.
    /// Count it up when the fields of the type change.
    #[must_use]
    pub fn layout_version(mut self, version: u32) -> Self {
        self.version = version;
        self
    }

    /// How many bytes a value of the sending side has at most, in postcard's format; 4096 if not
    /// stated. The buffers for that are allocated at the opening: one
    /// of that size, or for a stream two of at most 32 KiB more.
    #[must_use]
    pub fn capacity(mut self, bytes: usize) -> Self {
        self.capacity = bytes.min(u32::MAX as usize);
        self
    }

    /// How many values may be under way to a receiving side, or from a buffered sending side; the
    /// smaller of both counts. 64 if not stated, and at least 1. A stream is fast with a window of
    /// some thousands: then its batches are large.
    #[must_use]
    pub fn window(mut self, values: usize) -> Self {
        self.window = values.max(1);
        self
    }

    /// Opens the sending side of a rendezvous: a send goes on when a process of the other program
    /// has taken the value. The other program may open its side earlier or later.
    ///
    /// Not for the real-time path: it allocates, and starts a thread. While the system runs, call
    /// it in [`luna::blocking`].
    ///
    /// # Errors
    ///
    /// [`NetError::Name`]; [`NetError::Busy`] if this [`Network`] has that side open; or zenoh's
    /// error.
    pub fn sender<T: Serialize + DeserializeOwned + Send + 'static>(
        &self,
    ) -> Result<(Sender<T>, SendLink<T>), NetError> {
        self.sending(luna::channel(), 1, false)
    }

    /// Opens the sending side with a buffer in front of it: FIFO with back pressure, or
    /// overwriting. A send goes on when its value is in the buffer. The link takes values as long
    /// as fewer than the [window](Self::window) are under way; [`Status::acknowledged`] counts
    /// those that have arrived.
    ///
    /// When the last sender is gone, the link first delivers what is in the buffer. Poison, and the
    /// other program's end, drop what is in the buffer and under way. For the newest value: a
    /// buffer
    /// `overwrite_oldest(1)`, and a window of 1 or 2.
    ///
    /// # Errors
    ///
    /// As for [`sender`](Self::sender).
    pub fn buffered_sender<T: Serialize + DeserializeOwned + Send + 'static>(
        &self,
        buffer: Buffer,
    ) -> Result<(Sender<T>, SendLink<T>), NetError> {
        self.sending(luna::buffered(buffer), self.window, true)
    }

    /// Opens the receiving side: a value is acknowledged when a process has taken it, and with
    /// [`recv_extended`](Receiver::recv_extended) when that is done with it. All else is as for
    /// [`sender`](Self::sender).
    ///
    /// # Errors
    ///
    /// As there.
    pub fn receiver<T: Serialize + DeserializeOwned + Send + 'static>(
        &self,
    ) -> Result<(Receiver<T>, ReceiveLink<T>), NetError> {
        self.receiving(luna::channel(), Arrived::plain)
    }

    /// As [`receiver`](Self::receiver), and each value says how old it is.
    ///
    /// # Errors
    ///
    /// As there.
    pub fn stamped_receiver<T: Serialize + DeserializeOwned + Send + 'static>(
        &self,
    ) -> Result<(Receiver<Stamped<T>>, StampedLink<T>), NetError> {
        self.receiving(luna::channel(), Arrived::stamped)
    }

    /// As [`stamped_receiver`](Self::stamped_receiver), with a buffer towards the processes of this
    /// program: a value is acknowledged when it is in the buffer. With `overwrite_oldest(1)` the
    /// newest value is there whenever a process looks, and no sender waits for that.
    ///
    /// # Errors
    ///
    /// As there.
    pub fn buffered_receiver<T: Serialize + DeserializeOwned + Send + 'static>(
        &self,
        buffer: Buffer,
    ) -> Result<(Receiver<Stamped<T>>, StampedLink<T>), NetError> {
        self.receiving(luna::buffered(buffer), Arrived::stamped)
    }

    fn sending<T: Serialize + Send + 'static>(
        &self,
        (sender, receiver): (Sender<T>, Receiver<T>),
        window: usize,
        is_buffered: bool,
    ) -> Result<(Sender<T>, SendLink<T>), NetError> {
        let (notify, acknowledged) = luna::buffered(Buffer::overwrite_oldest(1));
        let notify = notify.external();
        let outbox = Outbox::new(move || {
            let _ = notify.try_send(());
        });
        let count = if is_buffered { BATCHES } else { 1 };
        let batches = (0..count).map(|_| Batch::new(window, self.capacity));
        let (line, free) =
            self.open::<T>(Role::Sender, window, Values::Out(outbox), batches.collect())?;
        let near = Outward {
            receiver: receiver.external(),
            free,
            acknowledged: acknowledged.external(),
            is_buffered,
        };
        Ok((sender.named(&self.name), Link::new(line, near)))
    }

    fn receiving<T: DeserializeOwned + Send + 'static, R: Send>(
        &self,
        (sender, receiver): (Sender<R>, Receiver<R>),
        deliver_as: fn(Arrived<T>) -> R,
    ) -> Result<(Receiver<R>, ReceiveLink<T, R>), NetError> {
        let (values, inbox) = inbox(self.window);
        let values = Values::receiving(values);
        let (line, _) = self.open::<T>(Role::Receiver, self.window, values, Vec::new())?;
        let near = Inward {
            sender: sender.external(),
            inbox,
            deliver_as,
        };
        Ok((receiver.named(&self.name), Link::new(line, near)))
    }

    /// The line, and batches from the link's thread.
    fn open<T>(
        &self,
        role: Role,
        window: usize,
        values: Values,
        batches: Vec<Batch>,
    ) -> Result<(Line, Receiver<Batch>), NetError> {
        let name = self.name.clone();
        if !is_name(&name) {
            return Err(NetError::Name { name });
        }
        let inner = &*self.network.0;
        let peer = facts::here();
        let entry: Entry = (name.clone(), role);
        let Some(memory) = inner.book.open(&entry) else {
            let holder = peer;
            return Err(NetError::Busy { name, role, holder });
        };
        let own = Own {
            name: name.clone(),
            role,
            number: facts::random(),
            info: TypeInfo {
                name: std::any::type_name::<T>().to_owned(),
                version: self.version,
            },
            peer,
            clock: facts::clock(),
            memory,
            window: window as u64,
            lost_after: inner.lost_after,
        };
        let status = Status::default();
        let (jobs, asked) = luna::buffered::<Job>(Buffer::fifo(batches.len() + 4));
        let (give, free) = luna::buffered(Buffer::fifo(batches.len().max(1)));
        let give = give.external();
        for batch in batches {
            let _ = give.try_send(batch);
        }
        // One of each kind, and one for a panic.
        let (report, events) = luna::buffered::<Event>(Buffer::fifo(4));
        let peering = Peering::new(own, status.clone(), values);
        let shared = Arc::new(Shared::new(peering, jobs.external(), report.external()));
        let started = start(
            inner.session.clone(),
            inner.book.clone(),
            shared.clone(),
            (asked.external(), give),
        );
        match started {
            Ok(started) => inner.started(started),
            Err(error) => {
                inner.book.close(&entry, memory);
                return Err(error);
            }
        }
        let line = Line::new(name, shared, events.external(), status);
        Ok((line, free.external()))
    }
}

/// Without the marks that have a meaning in a key of zenoh.
fn is_name(name: &str) -> bool {
    let is_allowed = |c: char| c.is_ascii_alphanumeric() || "_-.".contains(c);
    let is_part = |part: &str| !part.is_empty() && part.chars().all(is_allowed);
    name.len() <= 180 && name.split('/').all(is_part)
}

#[cfg(test)]
mod tests {
    use super::is_name;

    #[test]
    fn names_are_checked() {
        assert!(is_name("cell/feeder-2/ready.x"));
        let long = "x".repeat(181);
        for bad in [
            "", "/a", "a/", "a//b", "a b", "a/*", "a?b", "a#b", "@a", &long,
        ] {
            assert!(!is_name(bad), "{bad}");
        }
    }
}
