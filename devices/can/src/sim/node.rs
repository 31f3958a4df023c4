//! A node on the simulated bus.

use crate::{BusError, BusReport, Filter, Frame, Incoming, PortError, State};
use luna::{Buffer, Receiver, Sender};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// How many received frames a node keeps.
pub(super) const QUEUE: usize = 64;

/// A node's access to a simulated bus: see [`Bus::open`](crate::sim::Bus::open).
pub struct Port {
    outgoing: Sender<Frame>,
    incoming: Receiver<Option<Frame>>,
    status: Arc<Mutex<Status>>,
}

/// The bus' end of a node.
pub(super) struct Node {
    pub(super) name: String,
    pub(super) outgoing: Receiver<Frame>,
    pub(super) incoming: Sender<Option<Frame>>,
    pub(super) status: Arc<Mutex<Status>>,
}

/// What both ends share of a node.
#[derive(Debug, Default)]
pub(super) struct Status {
    pub(super) report: BusReport,
    pub(super) sent_errors: u32,
    pub(super) received_errors: u32,
    pub(super) state: State,
    pub(super) is_cut: bool,
    /// How many frames of this node are still to be destroyed.
    pub(super) to_corrupt: u32,
    /// How many frames of others it is still to miss.
    pub(super) to_lose: u32,
    /// Sent at once, in an emergency.
    pub(super) at_once: Vec<Frame>,
}

pub(super) fn lock(status: &Mutex<Status>) -> MutexGuard<'_, Status> {
    status.lock().unwrap_or_else(PoisonError::into_inner)
}

pub(super) fn pair(name: &str) -> (Port, Node) {
    let (send, outgoing) = luna::channel();
    let (incoming, received) = luna::buffered(Buffer::fifo(QUEUE));
    let status = Arc::new(Mutex::new(Status::default()));
    let port = Port {
        outgoing: send,
        incoming: received,
        status: status.clone(),
    };
    let node = Node {
        name: name.to_owned(),
        outgoing,
        incoming,
        status,
    };
    (port, node)
}

impl Node {
    /// Whether it takes part.
    pub(super) fn is_on(&self) -> bool {
        let status = lock(&self.status);
        status.state != State::BusOff && !status.is_cut
    }

    /// Gives it a frame of another node.
    pub(super) fn receive(&self, frame: Frame) {
        {
            let mut status = lock(&self.status);
            // From 128 on it goes back at once.
            status.received_errors = status.received_errors.min(128).saturating_sub(1);
            status.settle();
            if status.to_lose > 0 {
                status.to_lose -= 1;
                return;
            }
        }
        if self.incoming.try_send(Some(frame)).is_err() {
            lock(&self.status).report.lost += 1;
        }
        self.show();
    }

    /// Counts an error in a frame that it sends or receives.
    pub(super) fn fail(&self, error: BusError, sends: bool) {
        {
            let mut status = lock(&self.status);
            let is_alone = error == BusError::NotAcknowledged && status.state >= State::Passive;
            match sends {
                // A passive node that is alone does not become bus-off.
                true if is_alone => {}
                true => status.sent_errors += 8,
                false => status.received_errors += 1,
            }
            status.report.error = Some(error);
            status.settle();
        }
        self.show();
    }

    /// Counts a frame that it has sent.
    pub(super) fn sent(&self) {
        {
            let mut status = lock(&self.status);
            status.sent_errors = status.sent_errors.saturating_sub(1);
            status.settle();
        }
        self.show();
    }

    /// Lets its port look at the report, if there is any.
    pub(super) fn show(&self) {
        if lock(&self.status).report != BusReport::default() {
            // If its queue is full, the port looks with the next frame.
            let _ = self.incoming.try_send(None);
        }
    }
}

impl Status {
    /// The state by the counters.
    pub(super) fn settle(&mut self) {
        let most = self.sent_errors.max(self.received_errors);
        let state = match most {
            _ if self.state == State::BusOff || self.sent_errors >= 256 => State::BusOff,
            128.. => State::Passive,
            96.. => State::Warning,
            _ => State::Active,
        };
        if state != self.state {
            self.state = state;
            self.report.state = Some(state);
        }
    }
}

impl crate::Port for Port {
    const IS_OUTSIDE: bool = false;

    async fn transmit(&self, frame: Frame) -> Result<(), PortError> {
        self.outgoing.send(frame).await.map_err(|_| PortError::Gone)
    }

    async fn receive(&self) -> Result<Incoming, PortError> {
        loop {
            let report = std::mem::take(&mut lock(&self.status).report);
            if report != BusReport::default() {
                return Ok(Incoming::Report(report));
            }
            match self.incoming.recv().await {
                Ok(Some(frame)) => return Ok(Incoming::Frame(frame)),
                Ok(None) => {}
                Err(_) => return Err(PortError::Gone),
            }
        }
    }

    /// It gets all frames; its controller selects.
    fn listen(&self, _: &[Filter]) -> Result<(), PortError> {
        Ok(())
    }

    /// In an emergency the bus does not run any more: see
    /// [`Control::sent_at_once`](crate::sim::Control::sent_at_once).
    fn transmit_at_once(&self, frame: Frame) -> Result<(), PortError> {
        lock(&self.status).at_once.push(frame);
        Ok(())
    }
}

luna_platform::debug_fields!(Port);
