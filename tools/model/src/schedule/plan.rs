//! From a model to a set of tasks, and the bounds of its parts.

use super::around::around;
use super::bound::bounds;
use super::placed::{executor, may_be_besides, open, rank};
use super::verdict::{Found, Verdict};
use super::{Arrivals, Costs, Demand, Known, NoBound, Task, Thread};
use crate::network::{Edge, Executor, Label, Network, Step};
use serde::Serialize;
use std::collections::BTreeMap;
use std::ops::Add;
use std::time::Duration;

/// The bounds of a model's parts.
#[derive(Debug)]
pub struct Schedule {
    /// Its parts, in the order of the model.
    pub rows: Vec<Row>,
    /// Its cores, by host and number.
    pub cores: Vec<Core>,
    /// By so much a release may be late, as the model states it.
    pub latency: Option<Duration>,
    /// Of these something is known, but the model has no such part.
    pub strangers: Vec<String>,
}

/// A part with a body.
#[derive(Debug)]
#[non_exhaustive]
pub struct Row {
    /// With the parts that it is in.
    pub name: String,
    /// Its executor or thread, if it names one.
    pub executor: Option<String>,
    /// The host of that; empty if the model names none.
    pub host: String,
    /// The core of that.
    pub core: Option<u16>,
    /// The policy of that.
    pub policy: Option<String>,
    /// Its priority on its executor, 0 to 31.
    pub priority: u8,
    /// From one job to the next.
    pub period: Option<Duration>,
    /// Whether its releases are those of a recording.
    pub is_seen: bool,
    /// The longest execution time of a job.
    pub cost: Option<Duration>,
    /// The longest poll.
    pub longest_poll: Option<Duration>,
    /// From when a job ought to be released to its end.
    pub bound: Option<Duration>,
    /// The longest one in a recording.
    pub measured: Option<Duration>,
    /// What the bound is held against.
    pub deadline: Option<Duration>,
    /// Whether a job may wait for other processes; the bound does not count that.
    pub may_wait: bool,
    /// What follows.
    pub verdict: Verdict,
    /// Why, and what to change.
    pub advice: Option<String>,
}

/// A core of the model.
#[derive(Debug, Serialize)]
pub struct Core {
    /// Its host; empty if the model names none.
    pub host: String,
    /// Its number there.
    #[serde(rename = "core")]
    pub number: u16,
    /// The share of its time that real-time threads ask for, as far as it is known.
    pub utilization: f64,
    /// Whether the demand of some of its parts is not known.
    pub is_more: bool,
}

/// The level of a process that states none.
const DEFAULT_PRIORITY: u8 = 16;

/// The tasks of a model. Processes without a core, or without a rank, are none.
#[derive(Default)]
struct Set<'n> {
    threads: Vec<Thread>,
    tasks: Vec<Task>,
    /// The process of each task.
    processes: Vec<usize>,
    /// The cores, whose places are the numbers of cores of the threads.
    cores: Vec<(&'n str, u16)>,
    executors: BTreeMap<&'n str, usize>,
}

pub(crate) fn schedule(network: &Network, costs: &Costs) -> Schedule {
    let mut set = Set::default();
    let mut rows: Vec<Row> = network
        .processes
        .iter()
        .enumerate()
        .map(|(number, process)| {
            let executor = executor(network, process);
            let known = costs.of.get(&process.name);
            let row = row(network, number, executor, known);
            if let Some((executor, core, rank)) =
                executor.and_then(|executor| Some((executor, executor.core?, rank(executor)?)))
            {
                set.add(network, number, (executor, core, rank), &row, known);
            }
            row
        })
        .collect();
    let found = bounds(&set.threads, &set.tasks);
    let mut bounds: Vec<Option<Result<Duration, NoBound>>> = vec![None; rows.len()];
    for (process, bound) in set.processes.iter().zip(found) {
        bounds[*process] = Some(bound);
    }
    for (number, bound) in bounds.into_iter().enumerate() {
        let task = set.processes.iter().position(|process| *process == number);
        let around = task.and_then(|task| around(&set.threads, &set.tasks, task).ok());
        let found = Found {
            row: &rows[number],
            bound,
            around: around.as_ref(),
            tasks: &set.tasks,
            names: &|task: usize| network.processes[set.processes[task]].name.as_str(),
            open: open(network, &network.processes[number]),
        };
        let (bound, verdict, advice) = found.judge();
        let row = &mut rows[number];
        (row.bound, row.verdict, row.advice) = (bound, verdict, advice);
    }
    let has = |name: &String| {
        network
            .processes
            .iter()
            .any(|process| process.name == *name)
    };
    Schedule {
        rows,
        cores: set.loads(network),
        latency: network.latency,
        strangers: costs.of.keys().filter(|name| !has(name)).cloned().collect(),
    }
}

fn row(
    network: &Network,
    number: usize,
    executor: Option<&Executor>,
    known: Option<&Known>,
) -> Row {
    let process = &network.processes[number];
    // What was measured may be more than what is stated.
    let cost = process.cost.max(known.and_then(|known| known.cost));
    let measured = known.and_then(|known| known.longest_poll);
    let poll = process.longest_poll.or(process.cost).max(measured);
    let cost = cost.map(|cost| cost.max(poll.unwrap_or_default()));
    let has_poll = process.longest_poll.or(measured).is_some();
    Row {
        name: process.name.clone(),
        executor: process.on.clone(),
        host: executor.map_or_else(String::new, |executor| executor.host.clone()),
        core: executor.and_then(|executor| executor.core),
        policy: executor.and_then(|executor| executor.policy.clone()),
        priority: process.priority.unwrap_or(DEFAULT_PRIORITY),
        period: process.period,
        is_seen: process.period.is_none() && known.is_some_and(|known| known.arrivals.is_some()),
        cost,
        longest_poll: if has_poll { poll } else { cost },
        bound: None,
        measured: known.and_then(|known| known.response),
        deadline: process.deadline.or(process.period),
        may_wait: process.period.is_some() && may_wait(network, number),
        verdict: Verdict::Nothing,
        advice: None,
    }
}

impl<'n> Set<'n> {
    fn add(
        &mut self,
        network: &'n Network,
        process: usize,
        (executor, core, rank): (&'n Executor, u16, u8),
        row: &Row,
        known: Option<&Known>,
    ) {
        let shared = self.executors.get(executor.name.as_str()).copied();
        // A process on a thread has it alone.
        let shared = shared.filter(|_| !executor.is_thread);
        let thread = shared.unwrap_or_else(|| self.thread(executor, core, rank));
        let arrivals = match (row.period, known.and_then(|known| known.arrivals.clone())) {
            (Some(period), _) => Some(Arrivals::Periodic {
                period,
                jitter: network.latency.unwrap_or_default(),
            }),
            (None, seen) => seen.map(Arrivals::Seen),
        };
        let demand = arrivals.zip(row.cost);
        self.processes.push(process);
        self.tasks.push(Task {
            thread,
            priority: row.priority,
            demand: demand.map(|(arrivals, cost)| Demand { arrivals, cost }),
            longest_poll: row.longest_poll,
            // Actions may give way: that a cycle is one poll has to be stated.
            is_one_poll: network.processes[process].longest_poll.is_some()
                && row.longest_poll == row.cost
                && is_one_poll(network, process),
        });
    }

    fn thread(&mut self, executor: &'n Executor, number: u16, rank: u8) -> usize {
        let of = (executor.host.as_str(), number);
        let core = self.cores.iter().position(|known| *known == of);
        let core = core.unwrap_or_else(|| {
            self.cores.push(of);
            self.cores.len() - 1
        });
        self.threads.push(Thread { core, rank });
        self.executors
            .insert(&executor.name, self.threads.len() - 1);
        self.threads.len() - 1
    }

    fn loads(&self, network: &Network) -> Vec<Core> {
        let executors = network.processes.iter();
        let executors = executors.filter_map(|process| executor(network, process));
        let mut cores: Vec<Core> = self
            .cores
            .iter()
            .enumerate()
            .map(|(core, (host, number))| {
                let is_here = |task: &&Task| {
                    let thread = &self.threads[task.thread];
                    thread.core == core && thread.rank > 0
                };
                let tasks = self.tasks.iter().filter(is_here);
                let demands = tasks.clone().filter_map(|task| task.demand.as_ref());
                Core {
                    host: (*host).to_owned(),
                    number: *number,
                    utilization: demands.map(Demand::utilization).fold(0.0, f64::add),
                    is_more: executors
                        .clone()
                        .any(|one| may_be_besides(one, host, *number))
                        || tasks.clone().any(|task| task.demand.is_none()),
                }
            })
            .collect();
        cores.sort_by(|one, other| (&one.host, one.number).cmp(&(&other.host, other.number)));
        cores
    }
}

/// The steps of a process and of its branches.
fn steps(network: &Network, process: usize) -> impl Iterator<Item = &Step> {
    let agents = network.agents.iter();
    let own = agents.filter(move |agent| agent.process == process);
    own.flat_map(|agent| agent.code.iter().map(|place| &place.step))
}

/// Whether it may wait for a partner, or for a time to pass.
fn may_wait(network: &Network, process: usize) -> bool {
    steps(network, process).any(|step| {
        let edges = step.edges();
        let waits = |label: &Label| match label {
            Label::Send(channel, _) => !network.channels[*channel].kind.overwrites(),
            Label::Receive(..) | Label::After => true,
            Label::Choice | Label::Skip | Label::Own(_) => false,
        };
        let skips = |edge: &Edge| matches!(edge.label, Label::Skip) && edge.condition.is_none();
        let goes_on = edges.iter().any(skips);
        !goes_on && edges.iter().any(|edge| waits(&edge.label))
    })
}

/// Whether a cycle is one poll: the body does nothing but actions.
fn is_one_poll(network: &Network, process: usize) -> bool {
    steps(network, process).all(|step| {
        let is_own = |edge: &Edge| matches!(edge.label, Label::Own(_) | Label::Choice);
        !matches!(step, Step::Fork(..) | Step::Join(..)) && step.edges().iter().all(is_own)
    })
}
