//! From a model to a set of tasks, and the bounds of its parts.

use super::around::around;
use super::bound::bounds;
use super::verdict::{Found, Verdict};
use super::{Arrivals, Costs, Demand, Known, NoBound, Task, Thread};
use crate::network::{Action, Executor, Kind, Network, Process, Step};
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
#[derive(Debug, PartialEq)]
pub struct Core {
    /// Its host; empty if the model names none.
    pub host: String,
    /// Its number there.
    pub number: u16,
    /// The share of its time that real-time threads ask for, as far as it is known.
    pub utilization: f64,
    /// Whether the demand of some of its parts is not known.
    pub is_more: bool,
}

/// The level of a process that states none.
const DEFAULT_PRIORITY: u8 = 16;

/// Of a policy: 0 for one that is not real-time.
fn rank(policy: Option<&str>) -> u8 {
    let level = policy.and_then(|policy| policy.split_once(':'));
    level.and_then(|(_, level)| level.parse().ok()).unwrap_or(0)
}

/// The tasks of a model. Processes without a core are none.
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
            if let Some((executor, core)) =
                executor.and_then(|executor| Some((executor, executor.core?)))
            {
                set.add(network, number, executor, core, &row, known);
            }
            row
        })
        .collect();
    let found = bounds(&set.threads, &set.tasks);
    let mut bounds: Vec<Option<Result<Duration, NoBound>>> = vec![None; rows.len()];
    for (process, bound) in set.processes.iter().zip(found) {
        bounds[*process] = Some(bound);
    }
    // A real-time thread that is on no core may be on any.
    let roaming: Vec<(usize, &Executor)> = network
        .processes
        .iter()
        .enumerate()
        .filter_map(|(number, process)| Some((number, executor(network, process)?)))
        .filter(|(_, executor)| executor.core.is_none() && rank(executor.policy.as_deref()) > 0)
        .collect();
    for (number, bound) in bounds.into_iter().enumerate() {
        let task = set.processes.iter().position(|process| *process == number);
        let around = task.and_then(|task| around(&set.threads, &set.tasks, task).ok());
        let own = rank(rows[number].policy.as_deref());
        let roams = roaming.iter().find(|(_, executor)| {
            executor.host == rows[number].host && rank(executor.policy.as_deref()) >= own
        });
        let found = Found {
            row: &rows[number],
            bound,
            around: around.as_ref(),
            tasks: &set.tasks,
            names: &|task: usize| network.processes[set.processes[task]].name.as_str(),
            roams: roams.map(|(other, _)| network.processes[*other].name.as_str()),
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
        cores: set.loads(),
        latency: network.latency,
        strangers: costs.of.keys().filter(|name| !has(name)).cloned().collect(),
    }
}

fn executor<'n>(network: &'n Network, process: &Process) -> Option<&'n Executor> {
    let on = process.on.as_ref()?;
    network
        .executors
        .iter()
        .find(|executor| executor.name == *on)
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
    let poll = process
        .longest_poll
        .max(known.and_then(|known| known.longest_poll));
    let cost = cost.map(|cost| cost.max(poll.unwrap_or_default()));
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
        longest_poll: poll.or(cost),
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
        executor: &'n Executor,
        core: u16,
        row: &Row,
        known: Option<&Known>,
    ) {
        let shared = self.executors.get(executor.name.as_str()).copied();
        // A process on a thread has it alone.
        let shared = shared.filter(|_| !executor.is_thread);
        let thread = shared.unwrap_or_else(|| self.thread(executor, core));
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
            // A poll that is shorter than the job says that there are several.
            is_one_poll: row.longest_poll == row.cost && is_one_poll(network, process),
        });
    }

    fn thread(&mut self, executor: &'n Executor, number: u16) -> usize {
        let of = (executor.host.as_str(), number);
        let core = self.cores.iter().position(|known| *known == of);
        let core = core.unwrap_or_else(|| {
            self.cores.push(of);
            self.cores.len() - 1
        });
        let rank = rank(executor.policy.as_deref());
        self.threads.push(Thread { core, rank });
        self.executors
            .insert(&executor.name, self.threads.len() - 1);
        self.threads.len() - 1
    }

    fn loads(&self) -> Vec<Core> {
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
                    is_more: tasks.clone().any(|task| task.demand.is_none()),
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

/// Whether it may wait for a partner.
fn may_wait(network: &Network, process: usize) -> bool {
    steps(network, process).any(|step| {
        let Step::Wait(edges) = step else {
            return false;
        };
        let waits = |action: &Action| match action {
            Action::Send(channel, _) => !matches!(
                network.channels[*channel].kind,
                Kind::OverwriteOldest(_) | Kind::OverwriteNewest(_)
            ),
            Action::Receive(..) => true,
            _ => false,
        };
        let goes_on = edges.iter().any(|edge| matches!(edge.action, Action::Skip));
        !goes_on && edges.iter().any(|edge| waits(&edge.action))
    })
}

/// Whether a cycle is one poll: the body does nothing but actions.
fn is_one_poll(network: &Network, process: usize) -> bool {
    steps(network, process).all(|step| match step {
        Step::Wait(edges) => edges
            .iter()
            .all(|edge| matches!(edge.action, Action::Own(_) | Action::Choice)),
        Step::Fork(..) | Step::Join(..) => false,
        _ => true,
    })
}
