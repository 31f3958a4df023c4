//! Processes that send heartbeats and watch those of others.

use super::nmt::Heartbeat;
use super::{NmtState, NodeId};
use crate::{Counts, Frame};
use luna::channel::{ChannelEnd, TrySendError};
use luna::realtime::off_path;
use luna::{Error, Instant, Process, Receiver, Sender};
use std::future::{Future, poll_fn};
use std::pin::pin;
use std::task::Poll;
use std::time::Duration;

/// What a [`HeartbeatConsumer`] reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum NodeEvent {
    /// A node has booted up: after power-on, or a reset.
    BootUp(NodeId),
    /// A node has another state than it had, or has come after it was missed.
    State(NodeId, NmtState),
    /// No heartbeat has come from a node for its time: once, until one comes.
    Missed(NodeId),
}

/// What a consumer does when a heartbeat is missed, beside its report.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum OnMissed {
    /// Nothing: the process that receives the report decides.
    #[default]
    Report,
    /// It raises an emergency ([`luna::emergency`]), and ends with [`HeartbeatMissed`].
    Emergency,
}

/// Why a consumer has raised an emergency.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("no heartbeat has come from {node} for {limit:?}")]
pub struct HeartbeatMissed {
    /// From which node.
    pub node: NodeId,
    /// For how long.
    pub limit: Duration,
}

#[derive(Debug)]
struct Watch {
    node: NodeId,
    limit: Duration,
    on_missed: OnMissed,
    state: Option<NmtState>,
    /// None before the first heartbeat, unless that is due too, and after a missed heartbeat.
    deadline: Option<Instant>,
}

impl Watch {
    /// Handles a heartbeat of its node. Returns what is to be reported.
    fn note(&mut self, beat: Heartbeat) -> Option<NodeEvent> {
        let before = self.state.replace(beat.state);
        if beat.state == NmtState::BootUp {
            // The deadline stays: a node that restarts again and again sends no heartbeat.
            return Some(NodeEvent::BootUp(beat.node));
        }
        self.deadline = Some(luna::now() + self.limit);
        (before != Some(beat.state)).then_some(NodeEvent::State(beat.node, beat.state))
    }
}

/// Watches the heartbeats of nodes, to be spawned: see
/// [`Network::heartbeats`](super::Network::heartbeats).
///
/// A node is watched from its first heartbeat on, as object 1016h has it; with
/// [`first_within`](Self::first_within) from the beginning. From then on nothing that the node
/// sends, or does not send, ends the watch: a boot-up is no heartbeat and puts nothing off. So a
/// node that restarts is missed if its next heartbeat does not come in time.
///
/// It does not wait for the reader of its reports: a report for which their channel has no room is
/// dropped, and counted in [`Counts::unreported`]. So give that channel a buffer.
///
/// It ends without an error when the controller has ended in order. With no
/// [`OnMissed::Emergency`] it also ends when that fails, or when the receivers of its reports are
/// gone. With one it goes on, for as long as anything else uses the network: readers of its reports
/// that end or poison their channel end no watch, and after a failure of the controller no
/// heartbeat can come, so the first that is due is missed.
///
/// Real-time path: yes; no allocation, O(watches) a heartbeat.
#[derive(Debug)]
#[must_use = "a consumer is a process: spawn it"]
pub struct HeartbeatConsumer {
    frames: Receiver<Frame>,
    /// How many frames may wait.
    queue: usize,
    events: Sender<NodeEvent>,
    counts: Counts,
    watches: Vec<Watch>,
    first_within: Option<Duration>,
}

/// Why the wait for a frame ends.
enum Woken {
    Frame(Frame),
    /// A heartbeat is due, or the reports have no receiver.
    Over,
    /// The controller has ended, in order or not.
    Ended {
        in_order: bool,
    },
}

impl HeartbeatConsumer {
    pub(super) fn new(
        frames: Receiver<Frame>,
        queue: usize,
        events: Sender<NodeEvent>,
        counts: Counts,
    ) -> Self {
        Self {
            frames,
            queue,
            events,
            counts,
            watches: Vec::new(),
            first_within: None,
        }
    }

    /// Watches a node: a heartbeat is missed when none has come for `limit`. Take some periods of
    /// its producer. A node can have several watches, each with its own limit.
    pub fn watch(mut self, node: NodeId, limit: Duration, on_missed: OnMissed) -> Self {
        self.watches.push(Watch {
            node,
            limit,
            on_missed,
            state: None,
            deadline: None,
        });
        self
    }

    /// Also expects the first heartbeat of each node: it is missed when none has come in `time`
    /// from the begin of this process. Without this, a node that never sends one is not watched.
    pub fn first_within(mut self, time: Duration) -> Self {
        self.first_within = Some(time);
        self
    }

    /// Handles a heartbeat. Returns what is to be reported, once for all watches of its node.
    fn note(&mut self, beat: Heartbeat) -> Option<NodeEvent> {
        let watches = self.watches.iter_mut();
        let of_node = watches.filter(|watch| watch.node == beat.node);
        of_node.fold(None, |event, watch| watch.note(beat).or(event))
    }

    /// The watch with the earliest deadline.
    fn next(&mut self) -> Option<(Instant, &mut Watch)> {
        let watches = self.watches.iter_mut();
        let timed = watches.filter_map(|watch| Some((watch.deadline?, watch)));
        timed.min_by_key(|(deadline, _)| *deadline)
    }

    /// Without a wait: other nodes are watched meanwhile.
    fn report(&self, event: NodeEvent) -> luna::Result<()> {
        match self.events.try_send(event) {
            Ok(()) => Ok(()),
            Err(TrySendError::Poisoned(_)) if self.can_end() => Err(Error::Poisoned),
            Err(_) => {
                self.counts.add_unreported(1);
                Ok(())
            }
        }
    }

    /// Whether no watch is of an emergency: those outlive the readers of the reports.
    fn can_end(&self) -> bool {
        let can_end = |watch: &Watch| watch.on_missed != OnMissed::Emergency;
        self.watches.iter().all(can_end)
    }

    /// The next frame, until `due`. `late` frames were handled since then: those that waited by
    /// then are heard, however late this process is, and a flood of others puts nothing off.
    async fn next_frame(&self, is_read: bool, due: Option<Instant>, late: usize) -> Woken {
        if late > self.queue && due.is_some_and(|due| due <= luna::now()) {
            return Woken::Over;
        }
        let reader = is_read.then_some(&self.events);
        match self.frames.recv_unless(over(reader, due)).await {
            Ok(frame) => Woken::Frame(frame),
            Err(error) if error.is_timeout() => Woken::Over,
            Err(error) => Woken::Ended {
                in_order: error.is_closed(),
            },
        }
    }

    /// The controller has failed. Returns an error when a heartbeat is due that is an emergency.
    async fn without_controller(&mut self) -> luna::Result<()> {
        self.watches
            .retain(|watch| watch.on_missed == OnMissed::Emergency);
        let Some((due, watch)) = self.next() else {
            return Ok(());
        };
        let (node, limit) = (watch.node, watch.limit);
        luna::at(due).await;
        Err(self.missed(node, limit))
    }

    fn missed(&self, node: NodeId, limit: Duration) -> Error {
        let missed = HeartbeatMissed { node, limit };
        // It allocates; there is nothing left to be in time for.
        let error = off_path(|| luna::emergency(Error::other(missed)));
        let _ = self.report(NodeEvent::Missed(node));
        error
    }

    async fn go_on(&mut self) -> luna::Result<()> {
        if let Some(time) = self.first_within {
            let due = luna::now() + time;
            let watches = self.watches.iter_mut();
            watches.for_each(|watch| watch.deadline = Some(due));
        }
        let mut is_read = true;
        let mut late = 0;
        loop {
            let due = self.next().map(|(due, _)| due);
            match self.next_frame(is_read, due, late).await {
                Woken::Frame(frame) => {
                    let is_due = due.is_some_and(|due| due <= luna::now());
                    late = if is_due { late + 1 } else { 0 };
                    if let Some(event) = Heartbeat::decode(&frame).and_then(|beat| self.note(beat))
                    {
                        self.report(event)?;
                    }
                    continue;
                }
                Woken::Ended { in_order: true } => return Ok(()),
                Woken::Ended { in_order: false } => return self.without_controller().await,
                Woken::Over => late = 0,
            }
            let watch = match self.next() {
                Some((due, watch)) if due <= luna::now() => watch,
                // Its reports have no receiver any more.
                _ => match self.events.ended().await {
                    _ if !self.can_end() => {
                        is_read = false;
                        continue;
                    }
                    ChannelEnd::Poisoned => return Err(Error::Poisoned),
                    ChannelEnd::Closed => return Ok(()),
                },
            };
            // A first heartbeat may have had another time.
            (watch.deadline, watch.state) = (None, None);
            let (node, limit, on_missed) = (watch.node, watch.limit, watch.on_missed);
            if on_missed == OnMissed::Emergency {
                return Err(self.missed(node, limit));
            }
            self.report(NodeEvent::Missed(node))?;
        }
    }
}

/// Waits until its reports have no receiver any more, or a heartbeat is due.
async fn over(reader: Option<&Sender<NodeEvent>>, due: Option<Instant>) {
    let mut ended = pin!(async {
        match reader {
            Some(events) => events.ended().await,
            None => std::future::pending().await,
        }
    });
    let mut late = pin!(async {
        match due {
            Some(due) => luna::at(due).await,
            None => std::future::pending().await,
        }
    });
    poll_fn(|cx| match ended.as_mut().poll(cx) {
        Poll::Ready(_) => Poll::Ready(()),
        Poll::Pending => late.as_mut().poll(cx),
    })
    .await;
}

impl Process for HeartbeatConsumer {
    async fn run(&mut self) -> luna::Result<()> {
        ended_is_well(self.go_on().await)
    }
}

/// The end of a channel is the end of a process between channels.
pub(super) fn ended_is_well(ended: luna::Result<()>) -> luna::Result<()> {
    match ended {
        Err(Error::Closed) => Ok(()),
        ended => ended,
    }
}

/// Sends the heartbeat of a node that this program is, to be spawned: see
/// [`Network::heartbeat`](super::Network::heartbeat).
///
/// First comes the boot-up message, then in each period the newest state, pre-operational until one
/// is received. It ends without an error when the senders of states or the controller are gone.
/// Real-time path: yes; no allocation.
#[derive(Debug)]
#[must_use = "a producer is a process: spawn it"]
pub struct HeartbeatProducer {
    pub(super) node: NodeId,
    pub(super) period: Duration,
    pub(super) states: Receiver<NmtState>,
    pub(super) frames: Sender<Frame>,
}

impl HeartbeatProducer {
    async fn go_on(&mut self) -> luna::Result<()> {
        let node = self.node.number();
        let mut tick = off_path(|| luna::periodic(format!("heartbeat {node}"), self.period))?;
        let (node, mut state) = (self.node, NmtState::BootUp);
        loop {
            self.frames.send(Heartbeat { node, state }.frame()).await?;
            if state == NmtState::BootUp {
                state = NmtState::PreOperational;
            }
            tick.next().await;
            loop {
                match self.states.try_recv() {
                    Ok(newer) => state = newer,
                    Err(error) if error.is_empty() => break,
                    Err(error) => return Err(error.into()),
                }
            }
        }
    }
}

impl Process for HeartbeatProducer {
    async fn run(&mut self) -> luna::Result<()> {
        ended_is_well(self.go_on().await)
    }
}
