//! The start of the processes: every `pre_run`, and then all of them held.

use super::super::neighbours;
use super::super::plan::{Member, NamedThread, NotStarted, Plan, ProcessPlan, Running, Started};
use crate::csp::composition::ThreadPart;
use crate::csp::process::clean_up;
use crate::error::{Error, Result};
use luna_core::Executor;
use luna_core::current::ProcessId;
use std::sync::Arc;

/// Starts all processes, and those that they spawn meanwhile; none is released. Gives the executors
/// back; if one cannot be started, all that was started is ended.
pub(super) fn start_processes(
    plan: &Plan,
    running: &Arc<Running>,
    executors: Vec<(String, Executor)>,
    places: &[ThreadPart],
    mut waiting: Vec<ProcessPlan>,
    remembered: usize,
) -> Result<Vec<(String, Executor)>> {
    let mut held = Held::default();
    // Behind it, so ended before it: their bodies refer to it.
    let executors = executors;
    let started = loop {
        // Without the plan's lock: what runs here is the user's, and may spawn.
        if let Err(error) = pre_run_all(running, &mut waiting)
            .and_then(|()| held.start_all(running, places, waiting))
        {
            break Err(error);
        }
        for (_, executor) in &executors {
            executor.settle();
        }
        let mut members = plan.members();
        // Processes that these have spawned already start with the others.
        waiting = std::mem::take(&mut members.waiting);
        if waiting.is_empty() {
            break plan
                .parameters
                .all_declared()
                .map(|()| members)
                .map_err(Error::from);
        }
    };
    let mut members = match started {
        Ok(members) => members,
        Err(error) => {
            // Their bodies end with the executors and threads.
            drop(executors);
            held.undo();
            return Err(error);
        }
    };
    members.started.most_ended = remembered;
    members.started.reserve(held.members.len());
    for (id, member) in held.members {
        members.started.enter(id, member, &running.common.emergency);
    }
    members.threads = held.threads;
    members.running = Some(running.clone());
    drop(members);
    Ok(executors)
}

/// Runs every `pre_run`; if one fails, the processes prepared before it are cleaned up, last first.
fn pre_run_all(running: &Running, processes: &mut [ProcessPlan]) -> Result<()> {
    for index in 0..processes.len() {
        let process = &mut processes[index];
        let Some(resident) = &mut process.prepared.resident else {
            continue;
        };
        if let Err(error) = running.common.prepare(&mut **resident) {
            let error = error.in_process(process.name());
            for earlier in processes[..index].iter_mut().rev() {
                clean_up(earlier.prepared.resident.take());
            }
            return Err(error);
        }
    }
    Ok(())
}

/// Processes that are started and held.
#[derive(Default)]
struct Held {
    /// Before the members, to which their bodies refer.
    threads: Vec<NamedThread>,
    members: Vec<(ProcessId, Member)>,
}

impl Held {
    /// Starts processes that are prepared. If one cannot be, it and those behind it are cleaned up,
    /// last first.
    fn start_all(
        &mut self,
        running: &Running,
        places: &[ThreadPart],
        prepared: Vec<ProcessPlan>,
    ) -> Result<()> {
        let mut prepared = prepared.into_iter();
        while let Some(mut process) = prepared.next() {
            neighbours::join(&mut process.place, running, places, &self.threads);
            let id = process.id();
            match running.start(process) {
                Ok((member, started)) => {
                    self.members.push((id, member));
                    match started {
                        Started::OnExecutor(announced) => drop(announced.start()),
                        Started::OnThread(thread) => self.threads.push(thread),
                    }
                }
                Err(NotStarted { error, resident }) => {
                    prepared
                        .rev()
                        .for_each(|process| drop(clean_up(process.prepared.resident)));
                    clean_up(resident);
                    return Err(error);
                }
            }
        }
        Ok(())
    }

    /// Ends what was started of a system that does not start. Its executors are gone already, and
    /// with them their bodies.
    fn undo(mut self) {
        self.threads.clear();
        self.members
            .into_iter()
            .rev()
            .for_each(|(_, mut member)| drop(clean_up(member.resident.take())));
    }
}
