//! The process that the bus is.

use super::SimError;
use super::control::{Control, Shared};
use super::node::{Node, Port, lock, pair};
use crate::{BusError, Frame};
use luna::channel::TryRecvError;
use luna::devices::{Device, DeviceManager, Sharing};
use luna::{Alternative, Buffer, Process, Receiver, Sender};
use std::cmp::Ordering;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, PoisonError};
use std::time::Duration;

/// The bits of an error frame with the space after it, at most.
const ERROR_FRAME: u32 = 23;

/// A simulated bus, to be spawned: a process that carries frames between the nodes that were opened
/// before. It ends when all their devices are closed.
///
/// While a frame is on the bus others wait, and the most urgent of them is next. Real-time path: as
/// fast as its bits are; it has locks, so it is for tests alone.
#[must_use = "a bus is a process: spawn it"]
pub struct Bus {
    bit_rate: u32,
    nodes: Vec<Node>,
    shared: Arc<Shared>,
    wake: Sender<Frame>,
    wakes: Option<Receiver<Frame>>,
}

impl Bus {
    /// A bus of this many bits a second, without nodes.
    ///
    /// # Errors
    ///
    /// [`SimError::NoRate`].
    pub fn new(bit_rate: u32) -> Result<Self, SimError> {
        if bit_rate == 0 {
            return Err(SimError::NoRate);
        }
        let (wake, wakes) = luna::buffered(Buffer::overwrite_oldest(1));
        Ok(Self {
            bit_rate,
            nodes: Vec::new(),
            shared: Arc::new(Shared::default()),
            wake,
            wakes: Some(wakes),
        })
    }

    /// Adds a node, as the device `can-sim:NAME`.
    ///
    /// # Errors
    ///
    /// [`SimError::Device`]: the system has a device of this name.
    pub fn open(&mut self, devices: &DeviceManager, name: &str) -> Result<Device<Port>, SimError> {
        let (port, node) = pair(name);
        let device = format!("can-sim:{name}");
        let kind = "simulated CAN node";
        let device = devices.open(&device, kind, Sharing::Exclusive, || Ok(port))?;
        let nodes = self.shared.nodes.lock();
        nodes
            .unwrap_or_else(PoisonError::into_inner)
            .push((name.to_owned(), node.status.clone()));
        self.nodes.push(node);
        Ok(device)
    }

    /// A handle to let errors come.
    pub fn control(&self) -> Control {
        Control {
            shared: self.shared.clone(),
            wake: self.wake.clone(),
        }
    }

    fn time(&self, bits: u32) -> Duration {
        Duration::from_nanos(u64::from(bits) * 1_000_000_000 / u64::from(self.bit_rate))
    }
}

/// A node's frame that waits for the bus.
#[derive(Clone, Copy)]
enum Waiting {
    Nothing,
    Frame(Frame),
    /// Its port is gone.
    Gone,
}

impl Process for Bus {
    async fn run(&mut self) -> luna::Result<()> {
        let Some(wakes) = self.wakes.take() else {
            return Err(luna::external::LinkError::NotPrepared.into());
        };
        let mut inputs: Vec<Receiver<Frame>> = self
            .nodes
            .iter()
            .map(|node| node.outgoing.clone())
            .collect();
        inputs.push(wakes);
        let mut alternative = Alternative::fair(&inputs);
        let mut waiting = vec![Waiting::Nothing; self.nodes.len()];
        loop {
            self.collect(&mut waiting);
            if let Some(frame) = first(&waiting) {
                self.carry(frame, &mut waiting).await;
                continue;
            }
            if waiting
                .iter()
                .all(|waiting| matches!(waiting, Waiting::Gone))
            {
                return Ok(());
            }
            let (number, taken) = alternative.recv().await;
            match waiting.get_mut(number) {
                Some(waiting) => {
                    *waiting = match taken {
                        Ok(frame) => self.accept(number, frame),
                        Err(_) => Waiting::Gone,
                    };
                }
                // The last input only wakes: a node was restarted, say.
                None => self.nodes.iter().for_each(Node::show),
            }
        }
    }

    fn post_run(&mut self) {
        self.nodes.clear();
    }
}

impl Bus {
    /// Takes the next frame of each node that has none.
    fn collect(&self, waiting: &mut [Waiting]) {
        for (number, (node, waiting)) in self.nodes.iter().zip(waiting).enumerate() {
            if matches!(waiting, Waiting::Frame(_)) && !node.is_on() {
                self.shared.dropped.fetch_add(1, Relaxed);
                *waiting = Waiting::Nothing;
            }
            while matches!(waiting, Waiting::Nothing) {
                *waiting = match node.outgoing.try_recv() {
                    Ok(frame) => self.accept(number, frame),
                    Err(TryRecvError::Empty) => break,
                    Err(_) => Waiting::Gone,
                };
            }
        }
    }

    fn accept(&self, number: usize, frame: Frame) -> Waiting {
        match self.nodes[number].is_on() {
            true => Waiting::Frame(frame),
            false => {
                self.shared.dropped.fetch_add(1, Relaxed);
                Waiting::Nothing
            }
        }
    }

    /// Has a frame on the bus for its time, and gives it to the nodes, if all goes well.
    async fn carry(&self, frame: Frame, waiting: &mut [Waiting]) {
        // Nodes with the same identifier begin at once, and differ later, if at all.
        let sends: Vec<bool> = waiting
            .iter()
            .map(|waiting| match waiting {
                Waiting::Frame(other) => frame.arbitrate(other) == Ordering::Equal,
                _ => false,
            })
            .collect();
        let senders = || sends.iter().enumerate().filter(|(_, sends)| **sends);
        luna::after(self.time(frame.bits())).await;
        let mut error = None;
        for (number, _) in senders() {
            let mut status = lock(&self.nodes[number].status);
            if status.to_corrupt > 0 {
                status.to_corrupt -= 1;
                error = Some(BusError::Protocol);
            }
            if matches!(waiting[number], Waiting::Frame(other) if other != frame) {
                error = Some(BusError::Protocol);
            }
        }
        let is_heard = (self.nodes.iter().zip(&sends)).any(|(node, sends)| !sends && node.is_on());
        if error.is_none() && !is_heard {
            error = Some(BusError::NotAcknowledged);
        }
        if let Some(error) = error {
            self.shared.destroyed.fetch_add(1, Relaxed);
            luna::after(self.time(ERROR_FRAME)).await;
            for (node, sends) in self.nodes.iter().zip(&sends) {
                if node.is_on() {
                    node.fail(error, *sends);
                }
            }
            return;
        }
        self.shared.frames.fetch_add(1, Relaxed);
        for (number, (node, sends)) in self.nodes.iter().zip(&sends).enumerate() {
            match sends {
                true => {
                    waiting[number] = Waiting::Nothing;
                    node.sent();
                }
                false if node.is_on() => node.receive(frame),
                false => {}
            }
        }
    }
}

/// The frame that goes first.
fn first(waiting: &[Waiting]) -> Option<Frame> {
    let frames = waiting.iter().filter_map(|waiting| match waiting {
        Waiting::Frame(frame) => Some(*frame),
        _ => None,
    });
    frames.min_by(Frame::arbitrate)
}

luna_platform::debug_fields!(
    Bus,
    |bus| bit_rate: bus.bit_rate,
    nodes: bus.nodes.iter().map(|node| &*node.name).collect::<Vec<&str>>()
);
