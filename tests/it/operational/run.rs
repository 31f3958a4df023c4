//! Runs networks on executors and threads, to their end or until nothing happens any more.

use crate::operational::check::{End, Refusal, check};
use crate::operational::job::Job;
use crate::operational::network::{Entry, Network};
use crate::operational::play::{Player, players};
use luna::process::ProcessState;
use luna_core::{Executor, Exit, OsThread, ProcessHandle, ProcessSpec};
use luna_platform::thread::Attributes;
use std::fmt;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Where the processes of a network run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Placement {
    OneExecutor,
    TwoExecutors,
    /// Each on a thread of its own.
    Threads,
    /// By turns on one executor, on the other, and on a thread of its own.
    Mixed,
}

/// What runs one network after the other.
pub(crate) struct Bench {
    executors: [Executor; 2],
}

/// A network that did what the model does not allow.
pub(crate) struct Failed {
    network: Network,
    trace: Vec<Entry>,
    what: String,
}

/// How long nothing may happen in a network that is not at its end.
const PATIENCE: Duration = Duration::from_secs(60);

impl Bench {
    pub(crate) fn new() -> Bench {
        let start = |name: &str| {
            let executor =
                Executor::start(Attributes::new(name)).expect("a plain thread can be had");
            executor.release();
            executor
        };
        Bench {
            executors: [start("left"), start("right")],
        }
    }

    /// Runs the network, and compares what was seen with the model.
    ///
    /// Threads may block only in a network that comes to an end on every path: nothing could end a
    /// thread that blocks for ever.
    pub(crate) fn run(
        &self,
        network: &Network,
        placement: Placement,
        always_ends: bool,
    ) -> Result<Seen, Box<Failed>> {
        let may_block = always_ends && placement == Placement::Threads;
        let job = Arc::new(Job::new(network.clone(), may_block));
        let mut processes = Vec::new();
        let mut threads = Vec::new();
        for (number, player) in players(&job.network).into_iter().enumerate() {
            let spec = ProcessSpec::new(format!("process {}", player.agent()))
                .level(job.network.agents[player.agent()].level);
            let place = match placement {
                Placement::OneExecutor => Some(0),
                Placement::TwoExecutors => Some(number % 2),
                Placement::Threads => None,
                Placement::Mixed => (number % 3 < 2).then_some(number % 3),
            };
            let body = body(job.clone(), player);
            match place {
                Some(executor) => processes.push(self.executors[executor].spawn(spec, body)),
                None => {
                    let thread = OsThread::start(Attributes::new("alone"), spec, body);
                    threads.push(thread.expect("a plain thread can be had"));
                }
            }
        }
        // All that have a thread of their own start together.
        for thread in &threads {
            thread.release();
            processes.push(thread.process().clone());
        }
        let outcome = watch(&job, &processes);
        // What they note when they are cancelled is not of interest.
        let trace = job.trace();
        if may_block && outcome.is_err() {
            // They may never end.
            threads.into_iter().for_each(OsThread::abandon);
            processes.clear();
        }
        for process in &processes {
            process.cancel();
        }
        let panic = processes.iter().find_map(|process| match process.wait() {
            Exit::Panicked(message) => Some(format!("`{}` panicked: {message}", process.name())),
            _ => None,
        });
        let what = match (outcome, panic) {
            (_, Some(message)) => message,
            (Ok(seen), None) => return Ok(seen),
            (Err(refusal), None) => refusal,
        };
        Err(Box::new(Failed {
            network: network.clone(),
            trace,
            what,
        }))
    }
}

/// What a run came to.
#[derive(Debug)]
pub(crate) struct Seen {
    pub(crate) trace: Vec<Entry>,
    pub(crate) end: End,
    /// How many states the checker had to carry; `None` if there were too many to count.
    pub(crate) states: Option<usize>,
}

/// The process that does what the player does.
fn body(
    job: Arc<Job>,
    player: Player,
) -> impl FnOnce() -> std::pin::Pin<Box<dyn Future<Output = ()>>> + Send {
    move || {
        Box::pin(async move {
            // What it fails with was noted where it failed.
            let _ = player.play(&job).await;
        })
    }
}

/// Waits until all have ended, or until they have come to a state in which, by the model, nothing
/// can happen any more.
fn watch(job: &Job, processes: &[ProcessHandle]) -> Result<Seen, String> {
    let mut refused: Option<(usize, Refusal)> = None;
    let mut last_change = Instant::now();
    loop {
        let complete = processes
            .iter()
            .all(|process| process.state() == ProcessState::Ended);
        if complete || are_quiet(processes) {
            let trace = job.trace();
            let end = if complete { End::Complete } else { End::Stuck };
            let is_news = refused
                .as_ref()
                .is_none_or(|(length, _)| *length < trace.len());
            if complete || is_news {
                match check(&job.network, &trace, end) {
                    Ok(states) => return Ok(Seen { trace, end, states }),
                    Err(refusal) if complete => return Err(format!("{end:?}: {refusal}")),
                    // It has not come to rest: a timer has yet to fire, or a wake to arrive.
                    Err(refusal) => {
                        refused = Some((trace.len(), refusal));
                        last_change = Instant::now();
                    }
                }
            }
        }
        if last_change.elapsed() > PATIENCE {
            return Err(match refused {
                Some((_, refusal)) => format!("nothing happens any more: {refusal}"),
                None => "it goes on for ever".to_owned(),
            });
        }
        std::thread::park_timeout(Duration::from_micros(50));
    }
}

/// Whether there was an instant at which no process ran or was ready: none was polled between two
/// checks that found none running.
fn are_quiet(processes: &[ProcessHandle]) -> bool {
    let look = || {
        processes.iter().map(|process| {
            let waits = matches!(process.state(), ProcessState::Waiting | ProcessState::Ended);
            waits.then(|| process.polls())
        })
    };
    let Some(before) = look().collect::<Option<Vec<u64>>>() else {
        return false;
    };
    look().eq(before.into_iter().map(Some))
}

impl fmt::Display for Failed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.network)?;
        for (place, entry) in self.trace.iter().enumerate() {
            writeln!(f, "{place}: {entry}")?;
        }
        f.write_str(&self.what)
    }
}
