//! The deadlock of a system: the wait-for graph of its processes, and its report.
//!
//! A [`Deadlock`] is reported on standard error and stands in the [`Report`](crate::Report). In a
//! strict system it ends the run, and `run` returns it.

// `quiet` finds that all threads sleep with nothing of their own to wake them. This module decides
// whether a thread or device outside could still wake one, and finds the cycle in the wait-for
// graph.

mod text;

use luna_channels::inspect::{Role, WaitPointView};
use luna_core::current::{ProcessId, User};
use std::collections::HashMap;
use std::sync::Arc;

/// A deadlock: every process of a system waits, and nothing known to the system can wake one of
/// them.
///
/// The system knows of deadlines, files, calls of [`blocking`](crate::blocking), of processes that
/// compute or block, and of channels that are marked [`external`](crate::Sender::external) or were
/// last used at their other end by a thread outside of the system, before the start too. A process
/// that waits for anything else (another runtime's channel, say) may be woken by it, so no deadlock
/// is reported then.
///
/// Two things cannot be seen, and must be marked `external()`: an end (or a party of a barrier)
/// that a thread outside of the system holds and has not used yet; and a channel that a process
/// waits for together with something outside of LUNA, as in a race of both. A
/// [barrier](crate::Barrier) that a thread of its own ([`luna::run`](crate::run)) has come to is
/// known to have such a party; one with parties in two systems must be marked.
///
/// The process that an end belongs to is known once it has used the end. For an unused end the
/// report names the processes that contain the channel's address in their bodies
/// ([`Partner::Holders`]): they appear to hold it. An end that lies in a `Vec` or a `Box` is not
/// found so.
///
/// Its `Display` is a line for each wait, and the circle.
///
/// ```
/// use luna::prelude::*;
/// use luna::Error;
///
/// let (a, from_a) = luna::channel::<u32>();
/// let (b, from_b) = luna::channel::<u32>();
/// let mut system = System::new("stuck");
/// system.strict();
/// let main = system.executor("main").build()?;
/// main.process("left").spawn(async move {
///     let n = from_b.recv().await?; // each waits for the other first
///     a.send(n).await?;
///     Ok(())
/// })?;
/// main.process("right").spawn(async move {
///     let n = from_a.recv().await?;
///     b.send(n).await?;
///     Ok(())
/// })?;
/// let Err(Error::Deadlock(deadlock)) = system.run() else { panic!("it ends") };
/// assert_eq!(deadlock.waits.len(), 2);
/// assert_eq!(deadlock.waits[0].process, "left");
/// println!("{deadlock}");
/// # Ok::<(), luna::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Deadlock {
    /// The system's name.
    pub system: String,
    /// What the processes wait for: in the order of their spawning, and all that one waits for, if
    /// it is an alternative or a parallel construct, one after the other.
    pub waits: Vec<Wait>,
    /// Processes of which each waits for the next, and the last for the first. Empty where no such
    /// circle is known.
    pub cycle: Vec<String>,
}

/// One of the things that a process waits for.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Wait {
    /// The name of the process that waits.
    pub process: String,
    /// To do what.
    pub operation: Operation,
    /// Where: the name of the channel, barrier or lock, or where it was made; or the name of the
    /// process that is awaited at its end.
    pub at: String,
    /// The awaited partner, as far as it is known.
    pub partner: Partner,
}

/// What a process waits to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Operation {
    /// To send.
    Send,
    /// To receive.
    Receive,
    /// To meet others at a barrier.
    Sync,
    /// To lock a mutex.
    Lock,
    /// To be notified at a condition.
    Notified,
    /// To acquire permits of a semaphore.
    Acquire,
    /// Waits for the end of another process.
    Join,
    /// Nothing: it is in an alternative without an open guard, which is STOP.
    Stop,
}

/// The partner that a process waits for: the last user of the other end; the holder of the mutex;
/// the last process that notified at the condition, or took permits of the semaphore.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Partner {
    /// For the process of this name, which waits too.
    Process(String),
    /// For the process of this name, which has ended.
    Ended(String),
    /// The other end is unused so far, and it is not known which process holds it.
    Nobody,
    /// The other end is unused so far, but the processes of these names appear to hold it, or one
    /// of them: the channel's address lies in their bodies. They wait too.
    Holders(Vec<String>),
    /// All parties of the barrier that have not arrived.
    Others,
}

/// A process of the system, as the supervisor sees it while all sleep.
#[derive(Debug, Clone)]
pub(crate) struct Sleeping {
    pub(crate) id: ProcessId,
    pub(crate) name: Arc<str>,
    pub(crate) has_ended: bool,
    /// Processes that wait for its end.
    pub(crate) joiners: Vec<ProcessId>,
}

/// What the `processes` wait for at `points`. `None` if something outside might wake one of them.
/// `is_forgotten` reports whether a process that is not among them was one of the system's.
/// `refers` reports whether the address of a channel lies in a process' body. O(processes +
/// points + waiters at them), and O(processes) for each unused end.
pub(crate) fn find(
    system: &str,
    processes: &[Sleeping],
    points: &[WaitPointView],
    is_forgotten: impl Fn(ProcessId) -> bool,
    refers: impl Fn(ProcessId, usize) -> bool,
) -> Option<Deadlock> {
    let places = processes
        .iter()
        .zip(0..)
        .map(|(one, place)| (one.id, place));
    let known = Known {
        processes,
        places: places.collect(),
        is_forgotten,
        refers,
    };
    // For each process: the points at which it waits, and the process at the end that it waits
    // for.
    let mut waiting = vec![Vec::new(); processes.len()];
    for wait_point in points {
        for one in &wait_point.waiting {
            if let User::Process(id) = one.user
                && let Some(&place) = known.places.get(&id)
            {
                waiting[place].push((wait_point, one.role));
            }
        }
    }
    let mut awaited_by = vec![Vec::new(); processes.len()];
    for (to, awaited) in processes.iter().enumerate() {
        for joiner in &awaited.joiners {
            if let Some(&from) = known.places.get(joiner) {
                awaited_by[from].push(to);
            }
        }
    }
    let mut waits = Vec::new();
    // For each process: the indexes of the processes that it waits for.
    let mut edges = vec![Vec::new(); processes.len()];
    for (from, process) in processes.iter().enumerate() {
        if process.has_ended {
            continue;
        }
        let before = waits.len();
        for &(wait_point, role) in &waiting[from] {
            let (operation, partner, to) = wait_of(&known, wait_point, role)?;
            edges[from].extend(to);
            waits.push(Wait {
                process: process.name.to_string(),
                operation,
                at: text::place(wait_point),
                partner,
            });
        }
        awaited_by[from].dedup();
        for &to in &awaited_by[from] {
            let awaited = processes[to].name.to_string();
            edges[from].push(to);
            waits.push(Wait {
                process: process.name.to_string(),
                operation: Operation::Join,
                at: awaited.clone(),
                partner: Partner::Process(awaited),
            });
        }
        if waits.len() == before {
            // It waits for something that is none of LUNA's, which may wake it.
            return None;
        }
    }
    if waits.is_empty() {
        // All have ended just now: the system is about to.
        return None;
    }
    Some(Deadlock {
        system: system.to_owned(),
        waits,
        cycle: cycle(&edges)
            .into_iter()
            .map(|place| processes[place].name.to_string())
            .collect(),
    })
}

/// The processes of a system, and how they are found.
struct Known<'a, F, R> {
    processes: &'a [Sleeping],
    places: HashMap<ProcessId, usize>,
    is_forgotten: F,
    refers: R,
}

impl<F, R: Fn(ProcessId, usize) -> bool> Known<'_, F, R> {
    /// The places of the processes that appear to hold the other end than the one at which `role`
    /// waits. Both kinds of end have the channel's address in them, so those that wait with the
    /// same end do not count.
    fn holders(&self, wait_point: &WaitPointView, role: Role) -> Vec<usize> {
        let has_this_end = |id: ProcessId| {
            let mut waiting = wait_point.waiting.iter();
            waiting.any(|one| one.role == role && one.user == User::Process(id))
        };
        let live = self.processes.iter().zip(0..);
        live.filter(|(one, _)| !one.has_ended && !has_this_end(one.id))
            .filter(|(one, _)| (self.refers)(one.id, wait_point.address))
            .map(|(_, place)| place)
            .collect()
    }
}

/// The operation that a process waits for at `wait_point`, its partner, and the indexes of those
/// partners that live. `None` if it waits for something outside of the system, or in a way that is
/// not known here.
fn wait_of(
    known: &Known<'_, impl Fn(ProcessId) -> bool, impl Fn(ProcessId, usize) -> bool>,
    wait_point: &WaitPointView,
    role: Role,
) -> Option<(Operation, Partner, Vec<usize>)> {
    if wait_point.external || (role == Role::Party && wait_point.strangers) {
        return None;
    }
    let (operation, other_end) = match role {
        Role::Sender | Role::Held => (Operation::Send, wait_point.receiver),
        Role::Receiver => (Operation::Receive, wait_point.sender),
        // A mutex with a waiter is held.
        Role::Locker => (Operation::Lock, wait_point.receiver),
        Role::Notified => (Operation::Notified, wait_point.receiver),
        Role::Acquirer => (Operation::Acquire, wait_point.receiver),
        Role::Party => return Some((Operation::Sync, Partner::Others, Vec::new())),
        Role::Stopped => return Some((Operation::Stop, Partner::Nobody, Vec::new())),
        _ => return None,
    };
    let id = match other_end {
        None => {
            let is_channel = matches!(operation, Operation::Send | Operation::Receive);
            let holders = match is_channel {
                true => known.holders(wait_point, role),
                false => Vec::new(),
            };
            let names = holders
                .iter()
                .map(|&place| known.processes[place].name.to_string());
            let partner = match holders.is_empty() {
                true => Partner::Nobody,
                false => Partner::Holders(names.collect()),
            };
            return Some((operation, partner, holders));
        }
        Some(User::Outside) => return None,
        Some(User::Process(id)) => id,
    };
    let Some(&place) = known.places.get(&id) else {
        // Its name is gone, but not that it was here.
        let name = (known.is_forgotten)(id).then(|| format!("process {id}"))?;
        return Some((operation, Partner::Ended(name), Vec::new()));
    };
    let name = known.processes[place].name.to_string();
    Some(if known.processes[place].has_ended {
        (operation, Partner::Ended(name), Vec::new())
    } else {
        (operation, Partner::Process(name), vec![place])
    })
}

/// The first circle in a walk along `edges`, which lead from each to others, from the first on.
/// O(edges).
fn cycle(edges: &[Vec<usize>]) -> Vec<usize> {
    let mut is_done = vec![false; edges.len()];
    let mut is_on_way = vec![false; edges.len()];
    for start in 0..edges.len() {
        if is_done[start] {
            continue;
        }
        // The way from the start, each with the edge that is tried next.
        let mut way: Vec<(usize, usize)> = vec![(start, 0)];
        is_on_way[start] = true;
        while let Some((at, next)) = way.last_mut() {
            let Some(&to) = edges[*at].get(*next) else {
                is_done[*at] = true;
                is_on_way[*at] = false;
                way.pop();
                continue;
            };
            *next += 1;
            if is_on_way[to] {
                let on_way = way.iter().map(|&(on_way, _)| on_way);
                return on_way.skip_while(|&on_way| on_way != to).collect();
            }
            if !is_done[to] {
                way.push((to, 0));
                is_on_way[to] = true;
            }
        }
    }
    Vec::new()
}

#[cfg(test)]
mod tests;
