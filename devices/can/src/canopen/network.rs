//! A controller with what CANopen has on it.

use super::heartbeat::{HeartbeatConsumer, HeartbeatProducer};
use super::pdo::{self, PdoProducer, SyncProducer};
use super::{Emergency, Nmt, NmtState, NodeEvent, NodeId, PdoError, PdoValue, SdoClient, SdoError};
use crate::{Controller, Counts, Event, Filter, Frame, OnBusOff, Port, controller};
use luna::devices::Device;
use luna::{Buffer, Receiver, Sender};
use std::time::Duration;

/// Frames of each kind that wait to be handled.
const QUEUE: usize = 64;

/// What this program has to do with the nodes of a bus. Each part is asked for while the system is
/// set up; then the [controller](Self::controller) is spawned, and each part that is a process.
///
/// While the bus takes no frames, each part waits with its frame. When it takes frames again, these
/// go out though they are old: at most one of each part, and those that the controller, the port
/// and the kernel (`txqueuelen`) have taken. So give [`rpdo`](Self::rpdo) a channel that overwrites
/// its oldest value: then the newest set-point follows. If the node was bus-off, see
/// [`OnBusOff`].
pub struct Network<P: Port> {
    controller: Controller<P>,
    outgoing: Sender<Frame>,
    /// Nodes with an SDO client.
    clients: Vec<NodeId>,
}

impl<P: Port> Network<P> {
    /// Nothing is received or sent yet.
    pub fn new(device: &Device<P>) -> Self {
        // Without a buffer: what waited there would be old when the bus takes frames again.
        let (outgoing, frames) = luna::channel();
        Self {
            controller: controller(device).send(frames),
            outgoing,
            clients: Vec::new(),
        }
    }

    /// Sets what is done when this node is bus-off: see [`Controller::on_bus_off`].
    #[must_use]
    pub fn on_bus_off(mut self, policy: OnBusOff) -> Self {
        self.controller = self.controller.on_bus_off(policy);
        self
    }

    /// Reports the controller's events to this channel: see [`Controller::events`].
    #[must_use]
    pub fn events(mut self, events: Sender<Event>) -> Self {
        self.controller = self.controller.events(events);
        self
    }

    /// What the controller counts.
    pub fn counts(&self) -> Counts {
        self.controller.counts()
    }

    /// Sends frames of the program's own.
    pub fn sender(&self) -> Sender<Frame> {
        self.outgoing.clone()
    }

    /// Commands nodes.
    pub fn nmt(&self) -> Nmt {
        Nmt(self.outgoing.clone())
    }

    /// Reads and writes the objects of a node. There is one client for a node, since a server has
    /// one transfer at a time and its answers do not say which client they are for.
    ///
    /// # Errors
    ///
    /// [`SdoError::HasClient`].
    pub fn sdo(&mut self, node: NodeId) -> Result<SdoClient, SdoError> {
        if self.clients.contains(&node) {
            return Err(SdoError::HasClient { node });
        }
        self.clients.push(node);
        let (sender, frames) = luna::buffered(Buffer::fifo(QUEUE));
        let filters = [Filter::standard(node.sdo_response(), 0x7FF)];
        self.receive_as(&filters, |frame| Some(*frame), sender);
        Ok(SdoClient::new(node, self.outgoing.clone(), frames))
    }

    /// A process that watches heartbeats, and reports to a channel. The controller does not end
    /// before the receivers of these reports are gone. If it fails, no heartbeat can come: watches
    /// with [`OnMissed::Emergency`](super::OnMissed::Emergency) then find them missed.
    pub fn heartbeats(&mut self, events: Sender<NodeEvent>) -> HeartbeatConsumer {
        let (sender, frames) = luna::buffered(Buffer::fifo(QUEUE));
        let filters = [Filter::standard(0x700, 0x780)];
        self.controller
            .add_passed_on(&filters, sender, events.clone());
        HeartbeatConsumer::new(frames, QUEUE, events, self.counts())
    }

    /// A process that sends the heartbeat of a node that this program is. Each state that comes
    /// from the channel is that of the next heartbeat.
    pub fn heartbeat(
        &self,
        node: NodeId,
        period: Duration,
        states: Receiver<NmtState>,
    ) -> HeartbeatProducer {
        HeartbeatProducer {
            node,
            period,
            states,
            frames: self.outgoing.clone(),
        }
    }

    /// Gives the EMCY messages of all nodes to a channel, by the controller: see
    /// [`Controller::receive_as`].
    pub fn emergencies(&mut self, sender: Sender<Emergency>) {
        // 80h itself is SYNC: one bit at least is set in the number of a node.
        let filters: Vec<Filter> = (0..7)
            .map(|bit| Filter::standard(0x80 | 1 << bit, 0x780 | 1 << bit))
            .collect();
        self.receive_as(&filters, Emergency::decode, sender);
    }

    /// Gives the values of a PDO that a node transmits to a channel, by the controller: see
    /// [`Controller::receive_as`]. Of a PDO that is longer than `T` the first bytes count, as
    /// CiA 301 has it; one that is shorter is dropped and [counted](Counts::malformed).
    ///
    /// # Errors
    ///
    /// [`PdoError::Identifier`].
    pub fn tpdo<T: PdoValue>(&mut self, id: u16, sender: Sender<T>) -> Result<(), PdoError> {
        let filter = Filter::standard(pdo::checked(id)?, 0x7FF);
        self.receive_as(&[filter], pdo::decode::<T>, sender);
        Ok(())
    }

    /// A process that sends the values of a channel as a PDO that a node receives.
    ///
    /// # Errors
    ///
    /// [`PdoError::Identifier`].
    pub fn rpdo<T: PdoValue>(
        &self,
        id: u16,
        values: Receiver<T>,
    ) -> Result<PdoProducer<T>, PdoError> {
        Ok(PdoProducer {
            id: pdo::checked(id)?,
            values,
            frames: self.outgoing.clone(),
        })
    }

    /// A process that sends SYNC messages; the channel switches it off and on.
    pub fn sync(&self, period: Duration, switch: Receiver<bool>) -> SyncProducer {
        SyncProducer {
            period,
            switch,
            frames: self.outgoing.clone(),
        }
    }

    /// The controller, to be spawned, when all parts have been asked for. It ends when they are
    /// gone.
    pub fn controller(self) -> Controller<P> {
        self.controller
    }

    fn receive_as<T: Send + 'static>(
        &mut self,
        filters: &[Filter],
        decode: impl Fn(&Frame) -> Option<T> + Send + 'static,
        sender: Sender<T>,
    ) {
        self.controller.add(filters, decode, sender);
    }
}

luna_platform::debug_fields!(impl[P: Port] Network<P>, |network| controller: network.controller);
