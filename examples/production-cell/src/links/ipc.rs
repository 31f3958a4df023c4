//! Channels between programs of one computer, by `luna-ipc`.

use super::carry::{Remote, receiver, sender};
use super::{Links, Style};
use crate::messages::Message;
use luna::system::Executor;
use luna::{Error, Process, Receiver, Sender};
use luna_ipc::Endpoint;

/// Links between programs.
#[derive(Debug)]
pub struct Programs<'a> {
    executor: &'a Executor,
    cell: String,
}

impl<'a> Programs<'a> {
    /// Whose processes run on `executor`. Programs of one cell have the same name `cell`.
    pub fn new(executor: &'a Executor, cell: &str) -> Self {
        let cell = cell.to_owned();
        Self { executor, cell }
    }

    fn endpoint(&self, name: &str) -> Endpoint {
        Endpoint::new(&format!("{}/{name}", self.cell))
    }
}

impl Links for Programs<'_> {
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

    type Arrived<T: Message> = T;

    fn open_receiver<T: Message>(
        self,
    ) -> luna::Result<(Receiver<T>, impl Process + Send + 'static)> {
        self.receiver().map_err(Error::other)
    }

    fn value<T: Message>(arrived: &T) -> T {
        *arrived
    }
}
