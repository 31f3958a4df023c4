//! What connects a unit with its neighbours and with the operator. A unit is written once, against
//! [`Links`]; a deployment chooses which.

mod carry;
#[cfg(feature = "hosts")]
mod hosts;
mod ipc;
mod local;

#[cfg(feature = "hosts")]
pub use hosts::Hosts;
pub use ipc::Programs;
pub use local::Local;

use crate::messages::Message;
use luna::{Buffer, Receiver, Sender};

/// How a channel is to behave.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Style {
    /// The newest values, at most so many; a sender never waits.
    Newest(usize),
    /// A rendezvous: the sender goes on when the value was taken.
    Rendezvous,
}

impl Style {
    fn channel<T: Message>(self, name: &str) -> (Sender<T>, Receiver<T>) {
        let (sender, receiver) = match self {
            Style::Newest(values) => luna::buffered(Buffer::overwrite_oldest(values)),
            Style::Rendezvous => luna::channel(),
        };
        (sender.named(name), receiver)
    }
}

/// Makes the ends of channels by their names. Both ends of a channel are asked for with the same
/// name, type and style, perhaps in different programs.
pub trait Links {
    /// The sending end.
    ///
    /// # Errors
    ///
    /// What the link needs cannot be had.
    fn sender<T: Message>(&mut self, name: &str, style: Style) -> luna::Result<Sender<T>>;

    /// The receiving end.
    ///
    /// # Errors
    ///
    /// What the link needs cannot be had.
    fn receiver<T: Message>(&mut self, name: &str, style: Style) -> luna::Result<Receiver<T>>;
}
