//! The deadlock of a system: the wait-for graph of its processes, and its report.
//!
//! A [`Deadlock`] is reported on standard error and stands in the [`Report`](crate::Report). In a
//! strict system it ends the run, and `run` returns it.

// `quiet` finds that all threads sleep with nothing of their own to wake them. This module decides
// whether a thread or device outside could still wake one, and finds the cycle in the wait-for
// graph.

use crate::csp::composition::kind_name;
use luna_channels::inspect::{Role, WaitPointView};
use luna_core::current::{ProcessId, User};
use luna_error::{Deadlock, Operation, Partner, Wait};
use std::collections::HashMap;
use std::sync::Arc;

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
            waits.push(Wait::new(
                &process.name,
                operation,
                place(wait_point),
                partner,
            ));
        }
        awaited_by[from].dedup();
        for &to in &awaited_by[from] {
            let awaited = processes[to].name.to_string();
            edges[from].push(to);
            let partner = Partner::Process(awaited.clone());
            waits.push(Wait::new(&process.name, Operation::Join, awaited, partner));
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
    let cycle = cycle(&edges).into_iter();
    let cycle = cycle.map(|place| processes[place].name.to_string());
    Some(Deadlock::new(system, waits, cycle.collect()))
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

/// A wait point, as an operation of a report names it.
fn place(wait_point: &WaitPointView) -> String {
    let kind = kind_name(wait_point.kind);
    match &wait_point.name {
        Some(name) => format!("{kind} `{name}`"),
        None => format!("the {kind} made at {}", wait_point.place()),
    }
}

#[cfg(test)]
mod tests;
