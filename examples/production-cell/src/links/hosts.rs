//! Channels between computers, by `luna-net`.

use super::carry::{Remote, receiver, sender};
use super::{Links, Style};
use crate::messages::Message;
use luna::system::Executor;
use luna::{Error, Process, Receiver, Sender};
use luna_net::{Endpoint, Network, Stamped};
use std::time::Duration;

/// Links between hosts.
#[derive(Debug)]
pub struct Hosts<'a> {
    executor: &'a Executor,
    network: Network,
}

impl<'a> Hosts<'a> {
    /// Whose processes run on `executor`, and carry values over `network`.
    pub fn new(executor: &'a Executor, network: Network) -> Self {
        Self { executor, network }
    }

    fn endpoint(&self, name: &str) -> Endpoint {
        self.network.endpoint(&format!("cell/{name}"))
    }
}

impl Links for Hosts<'_> {
    fn sender<T: Message>(&mut self, name: &str, style: Style) -> luna::Result<Sender<T>> {
        sender(self.executor, name, self.endpoint(name), style)
    }

    fn receiver<T: Message>(&mut self, name: &str, style: Style) -> luna::Result<Receiver<T>> {
        receiver(self.executor, name, self.endpoint(name), style)
    }
}

impl Remote for Endpoint {
    fn open_sender<T: Message>(self) -> luna::Result<(Sender<T>, impl Process + Send + 'static)> {
        self.sender().map_err(Error::other)
    }

    type Arrived<T: Message> = Stamped<T>;

    fn open_receiver<T: Message>(
        self,
    ) -> luna::Result<(Receiver<Stamped<T>>, impl Process + Send + 'static)> {
        self.stamped_receiver().map_err(Error::other)
    }

    fn value<T: Message>(arrived: &Stamped<T>) -> T {
        let age = arrived.age().at_most.unwrap_or(Duration::MAX);
        arrived.get().aged(age)
    }
}
