//! The process between a port and channels.

mod routing;

use crate::{BusError, Counts, Filter, Frame, Port, PortError, State};
use luna::devices::Device;
use luna::external::LinkError;
use luna::realtime::off_path;
use luna::{Error, Process, Receiver, Sender};
use luna_platform::clock::Clock;
use routing::{Ends, PassedOn, Reported, Route, Routing, Stop, Take, Typed, give_way};
use std::future::{Future, poll_fn};
use std::pin::pin;
use std::task::Poll;

/// Creates a process that sends the frames of a channel over a port, and gives received frames to
/// other channels: see [`Controller`].
pub fn controller<P: Port>(device: &Device<P>) -> Controller<P> {
    Controller {
        device: Some(device.clone()),
        outgoing: None,
        receivers: Vec::new(),
        reported: Vec::new(),
        events: None,
        on_bus_off: OnBusOff::default(),
        counts: Counts::default(),
    }
}

/// What a controller reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Event {
    /// The node has another error state.
    State(State),
    /// An error on the bus.
    Error(BusError),
    /// The channel of a receiver is full, and frames for it are dropped: once, until it takes one
    /// again.
    Overrun {
        /// Which: they are numbered from 0 in the order in which they were added.
        receiver: usize,
    },
    /// A frame for a receiver is none of its values: it has another length, say. It and those that
    /// follow are dropped: once, until one is.
    Malformed {
        /// Which, as for [`Event::Overrun`].
        receiver: usize,
    },
    /// Frames were lost in the queue of the kernel, of the hardware or of the simulated node.
    Lost(u64),
}

/// What a controller does when its node is bus-off.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum OnBusOff {
    /// The device is [lost](Device::lost): an emergency, unless its
    /// [`on_loss`](Device::on_loss) says otherwise.
    #[default]
    Lose,
    /// It reports that, and waits until the node is restarted: by the kernel (`restart-ms`), or by
    /// hand. Until the port reports another state, frames to send are dropped, and
    /// [counted](Counts::dropped): they would be old when the node is back. What the port and the
    /// kernel have taken before is theirs: a kernel may send it then.
    Wait,
}

/// Why a device is lost.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CanError {
    /// The node is bus-off.
    #[error(
        "the node is bus-off (its error counter is above 255): check the wires, the termination and the bit rates"
    )]
    BusOff,
    /// The port fails.
    #[error("{0}")]
    Port(#[from] PortError),
}

/// A controller, to be spawned: see [`controller`].
///
/// It ends without an error when all senders of what it sends are gone, and all receivers of what
/// it receives. A poisoned channel ends it with that error. The device is lost if the node is
/// bus-off, unless [`on_bus_off`](Self::on_bus_off) says otherwise, or when its port fails. With a
/// port to [outside](Port::IS_OUTSIDE) its `pre_run` fails on a virtual clock.
///
/// Real-time path: from its `run` on. No allocation; O(receivers and their filters) a frame. With
/// SocketCAN a system call a frame, and those of [`readable`](luna::external::readable) to wait.
///
/// Cancel-safe: a frame that was taken from the channel and not sent yet is lost only with the
/// process.
#[must_use = "a controller is a process: spawn it"]
pub struct Controller<P: Port> {
    device: Option<Device<P>>,
    outgoing: Option<Receiver<Frame>>,
    receivers: Vec<Route>,
    /// Of each receiver: what was reported of it.
    reported: Vec<Reported>,
    events: Option<Sender<Event>>,
    on_bus_off: OnBusOff,
    counts: Counts,
}

impl<P: Port> Controller<P> {
    /// Sends the frames of this channel, in their order. A frame waits for those before it: the
    /// identifier decides only between nodes. For several processes clone the sender.
    pub fn send(mut self, outgoing: Receiver<Frame>) -> Self {
        self.outgoing = Some(match P::IS_OUTSIDE {
            true => outgoing.external(),
            false => outgoing,
        });
        self
    }

    /// Gives received frames that one of the filters matches to this channel; with no filter, none.
    /// A frame can go to several receivers.
    ///
    /// The controller does not wait for a receiver: a frame for which its channel has no room is
    /// dropped, [counted](Counts::overruns) and [reported](Event::Overrun). So give it a buffer
    /// ([`luna::buffered`]); one that overwrites its oldest has the newest frames.
    pub fn receive(self, filters: &[Filter], sender: Sender<Frame>) -> Self {
        self.receive_as(filters, |frame| Some(*frame), sender)
    }

    /// As [`receive`](Self::receive), with what frames stand for. A frame for which `decode` gives
    /// none is dropped, [counted](Counts::malformed) and [reported](Event::Malformed).
    pub fn receive_as<T: Send + 'static>(
        mut self,
        filters: &[Filter],
        decode: impl Fn(&Frame) -> Option<T> + Send + 'static,
        sender: Sender<T>,
    ) -> Self {
        self.add(filters, decode, sender);
        self
    }

    pub(crate) fn add<T: Send + 'static>(
        &mut self,
        filters: &[Filter],
        decode: impl Fn(&Frame) -> Option<T> + Send + 'static,
        sender: Sender<T>,
    ) {
        let sender = outside::<P, T>(sender);
        self.add_route(filters, Box::new(Typed { sender, decode }));
    }

    /// For a process that passes on to `reader` what it makes of frames: it counts as gone when the
    /// receivers of `reader` are.
    pub(crate) fn add_passed_on<T: Send + 'static>(
        &mut self,
        filters: &[Filter],
        frames: Sender<Frame>,
        reader: Sender<T>,
    ) {
        let sender = outside::<P, Frame>(frames);
        let decode = |frame: &Frame| Some(*frame);
        let to = Typed { sender, decode };
        self.add_route(filters, Box::new(PassedOn { to, reader }));
    }

    fn add_route(&mut self, filters: &[Filter], to: Box<dyn Take>) {
        self.receivers.push(Route {
            filters: filters.to_vec(),
            to,
        });
        self.reported.push(Reported::default());
    }

    /// Reports events to this channel. It does not wait for it either: an event without room is
    /// [counted](Counts::unreported).
    pub fn events(mut self, events: Sender<Event>) -> Self {
        self.events = Some(outside::<P, Event>(events));
        self
    }

    /// Sets what it does when its node is bus-off; the device is lost if not stated.
    pub fn on_bus_off(mut self, policy: OnBusOff) -> Self {
        self.on_bus_off = policy;
        self
    }

    /// What it counts.
    pub fn counts(&self) -> Counts {
        self.counts.clone()
    }
}

/// A sender of what comes from outside of the system, if it does.
fn outside<P: Port, T: Send>(sender: Sender<T>) -> Sender<T> {
    match P::IS_OUTSIDE {
        true => sender.external(),
        false => sender,
    }
}

impl<P: Port> Process for Controller<P> {
    /// # Errors
    ///
    /// The system runs on a virtual clock, which a bus outside of the system does not follow.
    fn pre_run(&mut self) -> luna::Result<()> {
        if P::IS_OUTSIDE && Clock::is_virtual_here() {
            return Err(Error::other(
                "a CAN bus takes real time, which a virtual clock does not wait for: use a simulated bus (`luna_can::sim`)",
            ));
        }
        Ok(())
    }

    fn run(&mut self) -> impl Future<Output = luna::Result<()>> {
        // A failure here occurs again at the first wait, which reports it. A simulated bus has no
        // files.
        let _ = luna::external::prepare_files();
        async {
            let Some(device) = self.device.clone() else {
                return Err(LinkError::NotPrepared.into());
            };
            let stop = self.carry(&device).await;
            if !matches!(stop, Stop::Closed) {
                self.receivers
                    .iter()
                    .for_each(|receiver| receiver.to.fail());
            }
            match stop {
                Stop::Closed => Ok(()),
                Stop::Poisoned => Err(Error::Poisoned),
                Stop::Lost(error) => Err(device.lost(Error::other(error))),
            }
        }
    }

    /// Lets go of the device and the channels.
    fn post_run(&mut self) {
        self.device = None;
        self.outgoing = None;
        self.receivers.clear();
        self.events = None;
    }
}

impl<P: Port> Controller<P> {
    /// Both directions, until both have ended, or one fails.
    async fn carry(&mut self, port: &P) -> Stop {
        let listens = off_path(|| {
            let filters: Vec<Filter> = self
                .receivers
                .iter()
                .flat_map(|receiver| receiver.filters.iter().copied())
                .collect();
            port.listen(&filters)
        });
        if let Err(error) = listens {
            return error.into();
        }
        let outgoing = self.outgoing.take();
        let counts = self.counts.clone();
        let Self {
            receivers,
            reported,
            events,
            on_bus_off,
            ..
        } = self;
        let mut routing = Routing {
            reported,
            receivers,
            events: events.as_ref(),
            on_bus_off: *on_bus_off,
            counts: counts.clone(),
        };
        let mut ends = Ends::new(receivers);
        let mut going = pin!(async {
            let Some(outgoing) = outgoing else {
                return Stop::Closed;
            };
            transmit(port, &outgoing, &counts).await
        });
        // Reports come even where no frame is received.
        let mut coming = pin!(routing.receive_all(port));
        let mut is_sent = false;
        poll_fn(|cx| {
            if ends.poll(cx) {
                return Poll::Ready(Stop::Poisoned);
            }
            if let Poll::Ready(stop) = coming.as_mut().poll(cx) {
                return Poll::Ready(stop);
            }
            // After what comes: a frame that waits is dropped when its node is bus-off.
            if !is_sent && let Poll::Ready(stop) = going.as_mut().poll(cx) {
                is_sent = true;
                if !matches!(stop, Stop::Closed) {
                    return Poll::Ready(stop);
                }
            }
            match is_sent && ends.are_all() {
                true => Poll::Ready(Stop::Closed),
                false => Poll::Pending,
            }
        })
        .await
    }
}

async fn transmit<P: Port>(port: &P, outgoing: &Receiver<Frame>, counts: &Counts) -> Stop {
    for number in 1_u64.. {
        let frame = match outgoing.recv().await {
            Ok(frame) => frame,
            Err(error) if error.is_closed() => return Stop::Closed,
            Err(_) => return Stop::Poisoned,
        };
        let is_off = || counts.state() == Some(State::BusOff);
        let mut sending = pin!(port.transmit(frame));
        let mut poisoned = pin!(outgoing.poisoned());
        let sent = poll_fn(|cx| {
            if is_off() {
                return Poll::Ready(Ok(false));
            }
            if let Poll::Ready(sent) = sending.as_mut().poll(cx) {
                return Poll::Ready(sent.map(|()| true).map_err(Stop::from));
            }
            // A bus that takes no frames holds up no end.
            poisoned.as_mut().poll(cx).map(|_| Err(Stop::Poisoned))
        });
        match sent.await {
            Ok(true) => counts.add_sent(1),
            Ok(false) => counts.add_dropped(1),
            Err(stop) => return stop,
        }
        give_way(number).await;
    }
    Stop::Closed
}

luna_platform::debug_fields!(
    impl[P: Port] Controller<P>, |controller|
    device: controller.device.as_ref().map(Device::name),
    on_bus_off: controller.on_bus_off,
    counts: controller.counts
);
