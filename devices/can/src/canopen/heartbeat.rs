//! Processes that send heartbeats and watch those of others.

use super::nmt::Heartbeat;
use super::{NmtState, NodeId};
use crate::Frame;
use luna::channel::ChannelEnd;
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
    /// None before the first, and after a missed one.
    deadline: Option<Instant>,
}

/// Watches the heartbeats of nodes, to be spawned: see
/// [`Network::heartbeats`](super::Network::heartbeats).
///
/// A node is watched from its first heartbeat or boot-up on, as the standard has it: one that never
/// comes is not reported.
///
/// It ends without an error when the receivers of its reports or the controller are gone, and then
/// raises no emergency any more. It waits until a report is taken: give that channel a buffer. Real-time path: yes; no allocation,
/// O(nodes) a heartbeat.
#[derive(Debug)]
#[must_use = "a consumer is a process: spawn it"]
pub struct HeartbeatConsumer {
    frames: Receiver<Frame>,
    events: Sender<NodeEvent>,
    watches: Vec<Watch>,
}

impl HeartbeatConsumer {
    pub(super) fn new(frames: Receiver<Frame>, events: Sender<NodeEvent>) -> Self {
        Self {
            frames,
            events,
            watches: Vec::new(),
        }
    }

    /// Watches a node: a heartbeat is missed when none has come for `limit`. Take some periods of
    /// its producer.
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

    /// Handles a heartbeat. Returns what is to be reported.
    fn note(&mut self, beat: Heartbeat) -> Option<NodeEvent> {
        let watch = self.watches.iter_mut().find(|one| one.node == beat.node)?;
        watch.deadline = Some(luna::now() + watch.limit);
        let before = watch.state.replace(beat.state);
        match beat.state {
            NmtState::BootUp => Some(NodeEvent::BootUp(beat.node)),
            state if before != Some(state) => Some(NodeEvent::State(beat.node, state)),
            _ => None,
        }
    }

    /// The one whose time is over first.
    fn next(&mut self) -> Option<(Instant, &mut Watch)> {
        let watches = self.watches.iter_mut();
        let timed = watches.filter_map(|watch| Some((watch.deadline?, watch)));
        timed.min_by_key(|(deadline, _)| *deadline)
    }

    async fn go_on(&mut self) -> luna::Result<()> {
        loop {
            let due = self.next().map(|(due, _)| due);
            let received = match self.frames.recv_unless(over(&self.events, due)).await {
                Ok(frame) => Some(frame),
                Err(error) if error.is_timeout() => None,
                Err(error) => return Err(error.into()),
            };
            if let Some(frame) = received {
                if let Some(event) = Heartbeat::decode(&frame).and_then(|beat| self.note(beat)) {
                    self.events.send(event).await?;
                }
                continue;
            }
            let watch = match self.next() {
                Some((due, watch)) if due <= luna::now() => watch,
                // Its reports have no receiver any more.
                _ => {
                    return match self.events.ended().await {
                        ChannelEnd::Poisoned => Err(Error::Poisoned),
                        ChannelEnd::Closed => Ok(()),
                    };
                }
            };
            (watch.deadline, watch.state) = (None, None);
            let (node, limit, on_missed) = (watch.node, watch.limit, watch.on_missed);
            if on_missed == OnMissed::Emergency {
                // The emergency comes first: it does not wait for a reader.
                let missed = HeartbeatMissed { node, limit };
                // It allocates; there is nothing left to be in time for.
                let error = off_path(|| luna::emergency(Error::other(missed)));
                let _ = self.events.try_send(NodeEvent::Missed(node));
                return Err(error);
            }
            self.events.send(NodeEvent::Missed(node)).await?;
        }
    }
}

/// Waits until its reports have no receiver any more, or a heartbeat is due.
async fn over(events: &Sender<NodeEvent>, due: Option<Instant>) {
    let mut ended = pin!(events.ended());
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
