//! The peers' channels behind one pair of traits.
//!
//! The methods return the peer's own future, so that nothing is added between a process and its
//! channel.

use std::future::{Future, ready};

/// A kind of channel for numbers.
pub trait Channel: 'static {
    /// The end that is written to.
    type Sender: Sending + Clone + Send + 'static;
    /// The end that is read from.
    type Receiver: Receiving + Send + 'static;

    /// The capacity of the smallest possible buffer.
    const SMALLEST: usize = 0;

    /// Creates a channel with the smallest possible buffer.
    fn new_pair() -> (Self::Sender, Self::Receiver) {
        Self::buffered(Self::SMALLEST)
    }

    /// Makes a channel with room for `capacity` values.
    fn buffered(capacity: usize) -> (Self::Sender, Self::Receiver);

    /// Prepares a channel with ends on different executors, each of which would otherwise report a
    /// deadlock.
    fn between_executors(ends: (Self::Sender, Self::Receiver)) -> (Self::Sender, Self::Receiver) {
        ends
    }
}

/// The end of a channel that is written to.
pub trait Sending {
    /// Fails when the receivers are gone.
    fn send(&mut self, value: u64) -> impl Future<Output = Result<(), impl Sized>> + Send;
}

/// The end of a channel that is read from.
pub trait Receiving {
    /// Returns no value when the senders are gone.
    fn recv(&mut self) -> impl Future<Output = impl Received> + Send;
}

/// The result of a peer's receive: an `Option` or a `Result`.
pub trait Received {
    /// The value, if there was one.
    fn value(self) -> Option<u64>;
}

impl Received for Option<u64> {
    fn value(self) -> Option<u64> {
        self
    }
}

impl<E> Received for Result<u64, E> {
    fn value(self) -> Option<u64> {
        self.ok()
    }
}

/// tokio's `mpsc` with its smallest buffer: no rendezvous, since it has one slot.
#[derive(Debug)]
pub struct TokioMpsc;

impl Channel for TokioMpsc {
    type Sender = tokio::sync::mpsc::Sender<u64>;
    type Receiver = tokio::sync::mpsc::Receiver<u64>;

    const SMALLEST: usize = 1;

    fn buffered(capacity: usize) -> (Self::Sender, Self::Receiver) {
        tokio::sync::mpsc::channel(capacity)
    }
}

impl Sending for tokio::sync::mpsc::Sender<u64> {
    fn send(&mut self, value: u64) -> impl Future<Output = Result<(), impl Sized>> + Send {
        tokio::sync::mpsc::Sender::send(self, value)
    }
}

impl Receiving for tokio::sync::mpsc::Receiver<u64> {
    fn recv(&mut self) -> impl Future<Output = impl Received> + Send {
        tokio::sync::mpsc::Receiver::recv(self)
    }
}

/// async-channel with its smallest buffer: no rendezvous, since it has one slot.
#[derive(Debug)]
pub struct AsyncChannel;

impl Channel for AsyncChannel {
    type Sender = async_channel::Sender<u64>;
    type Receiver = async_channel::Receiver<u64>;

    const SMALLEST: usize = 1;

    fn buffered(capacity: usize) -> (Self::Sender, Self::Receiver) {
        async_channel::bounded(capacity)
    }
}

impl Sending for async_channel::Sender<u64> {
    fn send(&mut self, value: u64) -> impl Future<Output = Result<(), impl Sized>> + Send {
        async_channel::Sender::send(self, value)
    }
}

impl Receiving for async_channel::Receiver<u64> {
    fn recv(&mut self) -> impl Future<Output = impl Received> + Send {
        async_channel::Receiver::recv(self)
    }
}

/// flume's rendezvous.
#[derive(Debug)]
pub struct Flume;

impl Channel for Flume {
    type Sender = flume::Sender<u64>;
    type Receiver = flume::Receiver<u64>;

    fn buffered(capacity: usize) -> (Self::Sender, Self::Receiver) {
        flume::bounded(capacity)
    }
}

impl Sending for flume::Sender<u64> {
    fn send(&mut self, value: u64) -> impl Future<Output = Result<(), impl Sized>> + Send {
        self.send_async(value)
    }
}

impl Receiving for flume::Receiver<u64> {
    fn recv(&mut self) -> impl Future<Output = impl Received> + Send {
        self.recv_async()
    }
}

/// kanal's rendezvous.
#[derive(Debug)]
pub struct Kanal;

impl Channel for Kanal {
    type Sender = kanal::AsyncSender<u64>;
    type Receiver = kanal::AsyncReceiver<u64>;

    fn buffered(capacity: usize) -> (Self::Sender, Self::Receiver) {
        kanal::bounded_async(capacity)
    }
}

impl Sending for kanal::AsyncSender<u64> {
    fn send(&mut self, value: u64) -> impl Future<Output = Result<(), impl Sized>> + Send {
        kanal::AsyncSender::send(self, value)
    }
}

impl Receiving for kanal::AsyncReceiver<u64> {
    fn recv(&mut self) -> impl Future<Output = impl Received> + Send {
        kanal::AsyncReceiver::recv(self)
    }
}

// The channels below block the thread: the operation is complete before its future is returned.
// They are for the executor `Threads` only.

/// kanal's rendezvous for threads; it spins before it sleeps.
#[derive(Debug)]
pub struct KanalBlocking;

impl Channel for KanalBlocking {
    type Sender = kanal::Sender<u64>;
    type Receiver = kanal::Receiver<u64>;

    fn buffered(capacity: usize) -> (Self::Sender, Self::Receiver) {
        kanal::bounded(capacity)
    }
}

impl Sending for kanal::Sender<u64> {
    fn send(&mut self, value: u64) -> impl Future<Output = Result<(), impl Sized>> + Send {
        ready(kanal::Sender::send(self, value))
    }
}

impl Receiving for kanal::Receiver<u64> {
    fn recv(&mut self) -> impl Future<Output = impl Received> + Send {
        ready(kanal::Receiver::recv(self))
    }
}

/// crossbeam's rendezvous, for threads.
#[derive(Debug)]
pub struct Crossbeam;

impl Channel for Crossbeam {
    type Sender = crossbeam_channel::Sender<u64>;
    type Receiver = crossbeam_channel::Receiver<u64>;

    fn buffered(capacity: usize) -> (Self::Sender, Self::Receiver) {
        crossbeam_channel::bounded(capacity)
    }
}

impl Sending for crossbeam_channel::Sender<u64> {
    fn send(&mut self, value: u64) -> impl Future<Output = Result<(), impl Sized>> + Send {
        ready(crossbeam_channel::Sender::send(self, value))
    }
}

impl Receiving for crossbeam_channel::Receiver<u64> {
    fn recv(&mut self) -> impl Future<Output = impl Received> + Send {
        ready(crossbeam_channel::Receiver::recv(self))
    }
}

/// The standard library's rendezvous, for threads.
#[derive(Debug)]
pub struct SyncChannel;

impl Channel for SyncChannel {
    type Sender = std::sync::mpsc::SyncSender<u64>;
    type Receiver = std::sync::mpsc::Receiver<u64>;

    fn buffered(capacity: usize) -> (Self::Sender, Self::Receiver) {
        std::sync::mpsc::sync_channel(capacity)
    }
}

impl Sending for std::sync::mpsc::SyncSender<u64> {
    fn send(&mut self, value: u64) -> impl Future<Output = Result<(), impl Sized>> + Send {
        ready(std::sync::mpsc::SyncSender::send(self, value))
    }
}

impl Receiving for std::sync::mpsc::Receiver<u64> {
    fn recv(&mut self) -> impl Future<Output = impl Received> + Send {
        ready(std::sync::mpsc::Receiver::recv(self))
    }
}
