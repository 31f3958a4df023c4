//! A network's agents as real processes: each step is what a user would write, and each agent notes
//! what it sees.

use crate::operational::choose::alternative;
use crate::operational::job::Job;
use crate::operational::network::{
    Agent, End, Event, Failure, Kind, Network, Outcome, Side, Step, Value,
};
use crate::operational::operate::{dropping, plain, received};
use luna::{Alternative, Barrier, Buffer, Receiver, Sender, buffered};
use std::future::Future;
use std::ops::Range;
use std::pin::{Pin, pin};

/// The ends that an agent holds, by channel, and handles to all barriers.
#[derive(Default)]
pub(crate) struct Ends {
    senders: Vec<Option<Sender<Value>>>,
    receivers: Vec<Option<Receiver<Value>>>,
    barriers: Vec<Barrier>,
}

impl Ends {
    pub(crate) fn sender(&self, channel: usize) -> &Sender<Value> {
        self.senders[channel]
            .as_ref()
            .expect("an agent has the ends that it uses")
    }

    pub(crate) fn receiver(&self, channel: usize) -> &Receiver<Value> {
        self.receivers[channel]
            .as_ref()
            .expect("an agent has the ends that it uses")
    }

    pub(crate) fn barrier(&self, barrier: usize) -> &Barrier {
        &self.barriers[barrier]
    }

    fn drop_end(&mut self, end: End) {
        match end.side {
            Side::Sender => self.senders[end.channel] = None,
            Side::Receiver => self.receivers[end.channel] = None,
        }
    }
}

/// An agent that is about to act, with those that will be its branches.
pub(crate) struct Player {
    agent: usize,
    ends: Ends,
    branches: Vec<Player>,
}

/// The network's processes, with the ends of new channels.
pub(crate) fn players(network: &Network) -> Vec<Player> {
    let channels: Vec<_> = network.channels.iter().map(|&kind| channel(kind)).collect();
    let barriers = network.barriers.iter();
    let barriers: Vec<_> = barriers.map(|&parties| Barrier::new(parties)).collect();
    let deal = |agent: &Agent| {
        let mut ends = Ends {
            // Each with a memory of its own.
            barriers: barriers.clone(),
            ..Ends::default()
        };
        for (place, (sender, receiver)) in channels.iter().enumerate() {
            let holds = |side| {
                agent.ends.contains(&End {
                    channel: place,
                    side,
                })
            };
            ends.senders
                .push(holds(Side::Sender).then(|| sender.clone()));
            ends.receivers
                .push(holds(Side::Receiver).then(|| receiver.clone()));
        }
        ends
    };
    let mut processes = Vec::new();
    // Branches come after the agents that they are part of, so in reverse order each agent finds
    // its branches complete.
    let mut waiting: Vec<Player> = Vec::new();
    for (number, agent) in network.agents.iter().enumerate().rev() {
        let is_of = |player: &mut Player| network.agents[player.agent].parent == Some(number);
        let player = Player {
            agent: number,
            ends: deal(agent),
            branches: waiting.extract_if(.., is_of).collect(),
        };
        match agent.parent {
            Some(_) => waiting.push(player),
            None => processes.push(player),
        }
    }
    processes.reverse();
    processes
}

fn channel(kind: Kind) -> (Sender<Value>, Receiver<Value>) {
    match kind {
        Kind::Rendezvous => luna::channel(),
        Kind::Fifo(capacity) => buffered(Buffer::fifo(capacity)),
        Kind::OverwriteOldest(capacity) => buffered(Buffer::overwrite_oldest(capacity)),
        Kind::OverwriteNewest(capacity) => buffered(Buffer::overwrite_newest(capacity)),
    }
}

/// A player that leaves when this is dropped: at its end, or where it waits.
struct Acting<'a> {
    player: Player,
    job: &'a Job,
}

impl Drop for Acting<'_> {
    fn drop(&mut self) {
        self.player.leave(&self.job.network);
        self.job.note(self.player.agent, Event::Leaves);
    }
}

impl Player {
    pub(crate) fn agent(&self) -> usize {
        self.agent
    }

    /// Does the agent's steps, and fails if they end by a failure.
    pub(crate) fn play(self, job: &Job) -> Pin<Box<dyn Future<Output = luna::Result<()>> + '_>> {
        Box::pin(async move {
            let mut acting = Acting { player: self, job };
            let player = &mut acting.player;
            let agent = &job.network.agents[player.agent];
            let mut failed = false;
            let mut place = 0;
            while let Some(step) = agent.steps.get(place)
                && !failed
            {
                match step {
                    Step::Yield => luna::yield_now().await,
                    Step::Registered { fair, inputs } => {
                        let rest = &agent.steps[place..];
                        let selections = rest.iter().take_while(|other| *other == step).count();
                        let places = place..place + selections;
                        let (done, any_failed) = player.select(job, *fair, inputs, places).await;
                        (place, failed) = (place + done - 1, any_failed && agent.strict);
                    }
                    _ => {
                        job.note(player.agent, Event::Begins(place as u8));
                        let outcome = player.step(job, step).await;
                        job.note(player.agent, Event::Ends(outcome));
                        failed = outcome.is_failure() && (agent.strict || *step == Step::Fail);
                    }
                }
                place += 1;
            }
            drop(acting);
            if failed {
                Err(luna::Error::other("a step failed"))
            } else {
                Ok(())
            }
        })
    }

    /// Selects by one `Alternative`, for the steps at these places. Returns how many were done, and
    /// whether one failed, which ends those of a strict agent.
    async fn select(
        &self,
        job: &Job,
        fair: bool,
        inputs: &[usize],
        places: Range<usize>,
    ) -> (usize, bool) {
        let mut alternative = if fair {
            Alternative::fair(&[])
        } else {
            Alternative::prioritized(&[])
        };
        for &channel in inputs {
            alternative.add(self.ends.receiver(channel));
        }
        let strict = job.network.agents[self.agent].strict;
        let selections = places.len();
        for (done, place) in places.enumerate() {
            job.note(self.agent, Event::Begins(place as u8));
            let operation = async {
                let (input, result) = alternative.recv().await;
                received(input as u8, result)
            };
            let outcome = noting_waits(job, self.agent, operation).await;
            job.note(self.agent, Event::Ends(outcome));
            if outcome.is_failure() && strict {
                return (done + 1, true);
            }
        }
        (selections, false)
    }

    /// Drops its ends, and those of its branches that never started.
    fn leave(&mut self, network: &Network) {
        for &end in &network.agents[self.agent].ends {
            self.ends.drop_end(end);
        }
        self.branches.sort_unstable_by_key(Player::agent);
        for branch in &mut self.branches {
            branch.leave(network);
        }
    }

    async fn step(&mut self, job: &Job, step: &Step) -> Outcome {
        match step {
            Step::Plain(guard, patience) => {
                // A branch that blocks would keep its siblings from running.
                let blocking = job.may_block && job.network.agents[self.agent].parent.is_none();
                let operation = plain(&self.ends, *guard, *patience, blocking);
                noting_waits(job, self.agent, operation).await
            }
            Step::Alternative {
                fair,
                offers,
                skip,
                dropped,
            } => {
                let operation = alternative(&self.ends, *fair, offers, *skip);
                match dropped {
                    None => noting_waits(job, self.agent, operation).await,
                    Some(micros) => {
                        let expired = Outcome::Expired(offers.len() as u8);
                        let operation = dropping(operation, *micros, expired);
                        noting_waits(job, self.agent, operation).await
                    }
                }
            }
            Step::Poison(end) => {
                match end.side {
                    Side::Sender => self.ends.sender(end.channel).poison(),
                    Side::Receiver => self.ends.receiver(end.channel).poison(),
                }
                Outcome::Done
            }
            Step::Drop(end) => {
                self.ends.drop_end(*end);
                Outcome::Done
            }
            Step::Sync(barrier) => {
                let operation = async {
                    self.ends.barrier(*barrier).sync().await;
                    Outcome::Synced(0)
                };
                noting_waits(job, self.agent, operation).await
            }
            Step::Par(branches) => {
                let is_branch = |player: &mut Player| branches.contains(&player.agent);
                let mut players: Vec<Player> = self.branches.extract_if(.., is_branch).collect();
                players.sort_unstable_by_key(Player::agent);
                let mut plays = players.into_iter().map(|player| player.play(job));
                let mut play = || plays.next().expect("a branch for each");
                let joined = match branches.len() {
                    2 => luna::par!(play(), play()).await.map(drop),
                    3 => luna::par!(play(), play(), play()).await.map(drop),
                    other => unreachable!("no network has {other} branches in parallel"),
                };
                Outcome::Joined {
                    failed: joined.is_err(),
                }
            }
            Step::Fail => Outcome::Failed(0, Failure::Own),
            Step::Registered { .. } => unreachable!("several are done together"),
            Step::Yield => unreachable!("it is done before"),
        }
    }
}

/// Notes that `operation` has been tried, and has to wait.
async fn noting_waits(
    job: &Job,
    agent: usize,
    operation: impl Future<Output = Outcome>,
) -> Outcome {
    let mut operation = pin!(operation);
    let mut waits = false;
    std::future::poll_fn(|cx| {
        let polled = operation.as_mut().poll(cx);
        if polled.is_pending() && !waits {
            waits = true;
            job.note(agent, Event::Waits);
        }
        polled
    })
    .await
}
