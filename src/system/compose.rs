//! Makes the picture of a system from its plan, its threads, and the views of its processes.

use super::plan::{Members, On, Placement, Plan};
use crate::csp::composition::{
    ChannelPart, Composition, EndUser, ProcessKind, ProcessPart, ThreadKind, ThreadPart,
    WaitingPart,
};
use crate::csp::tree::SubProcess;
use luna_channels::inspect::{Role, WaitPointView, wait_points};
use luna_core::ProcessState;
use luna_core::current::{ProcessId, User};
use std::collections::HashMap;
use std::sync::Arc;

/// A handle to look at a system while it runs: see [`System::observer`](crate::System::observer).
/// Cloning it is cheap.
///
/// ```
/// use luna::prelude::*;
///
/// let mut system = System::new("observed");
/// let observer = system.observer();
/// let main = system.executor("main").build()?;
/// let (output, input) = luna::channel::<u32>();
/// main.process("source").spawn(async move {
///     output.send(1).await?;
///     Ok(())
/// })?;
/// main.process("sink").spawn(async move {
///     input.recv().await?;
///     let composition = observer.composition(); // not in a loop that is in a hurry
///     println!("{composition}");
///     assert!(composition.find("source").is_some());
///     assert_eq!(composition.channels.len(), 1);
///     Ok(())
/// })?;
/// system.run()?;
/// # Ok::<(), luna::Error>(())
/// ```
#[derive(Clone)]
pub struct Observer {
    plan: Arc<Plan>,
}

impl Observer {
    pub(super) fn new(plan: Arc<Plan>) -> Self {
        Self { plan }
    }

    /// The parts of the system at this moment: see
    /// [`System::composition`](crate::System::composition).
    pub fn composition(&self) -> Composition {
        // Each is read by itself: the parts first, since the user of a channel is looked up among
        // them.
        let mut threads = parts(&self.plan.members());
        let mut names = HashMap::new();
        let mut below = Children::of(self.plan.tree.read());
        for process in threads.iter_mut().flat_map(|thread| &mut thread.processes) {
            names.insert(process.id, process.name.clone());
            process.children = below.take(process.id, 0);
        }
        let points = wait_points();
        let of_system = points
            .iter()
            .filter(|wait_point| users(wait_point).any(|id| names.contains_key(&id)));
        Composition {
            system: self.plan.name().to_owned(),
            threads,
            channels: of_system
                .map(|wait_point| channel_part(wait_point, &names))
                .collect(),
        }
    }
}

luna_platform::debug_fields!(Observer, |observer| system: observer.plan.name());

fn part(name: &str, id: ProcessId, state: ProcessState, priority: u8) -> ProcessPart {
    ProcessPart {
        name: name.to_owned(),
        id,
        kind: ProcessKind::UserThread,
        state,
        priority,
        children: Vec::new(),
    }
}

/// The threads with their processes: those that are planned, or those that were started.
pub(super) fn parts(members: &Members) -> Vec<ThreadPart> {
    let planned = members.executors.iter().map(ThreadPart::executor);
    let mut threads: Vec<ThreadPart> = planned.chain(members.places.iter().cloned()).collect();
    let started = members.started.in_order().into_iter().map(|(id, member)| {
        let handle = &member.handle;
        let part = part(member.name(), id, handle.state(), handle.priority());
        (part, member.on.clone())
    });
    let waiting = members.waiting.iter().map(|process| {
        let priority = process.spec.priority();
        let part = part(
            process.name(),
            process.id(),
            ProcessState::Created,
            priority,
        );
        let on = match &process.place {
            Placement::Executor(number) => On::Executor(*number),
            Placement::Thread(attributes) => On::Thread(Box::new(ThreadPart::asked(
                ThreadKind::OsThread,
                attributes,
            ))),
        };
        (part, on)
    });
    for (mut part, on) in started.chain(waiting) {
        match on {
            // Executors are numbered in their order, and come first.
            On::Executor(number) => {
                if let Some(thread) = threads.get_mut(number) {
                    thread.processes.push(part);
                }
            }
            On::Thread(mut thread) => {
                part.kind = ProcessKind::OsThread;
                thread.processes.push(part);
                threads.push(*thread);
            }
        }
    }
    threads
}

/// Sub-processes by what they run in: a process, and a sub-process of it or 0.
struct Children(HashMap<(ProcessId, u64), Vec<SubProcess>>);

impl Children {
    fn of(all: Vec<SubProcess>) -> Self {
        let ids: HashMap<u64, ProcessId> = all.iter().map(|one| (one.id, one.process)).collect();
        let mut below = HashMap::<_, Vec<_>>::new();
        for one in all {
            // A part with a parent that has just gone, or was moved, is shown in the process
            // itself. A parent is older, so there are no circles.
            let is_there = ids.get(&one.parent) == Some(&one.process) && one.parent < one.id;
            let parent = if is_there { one.parent } else { 0 };
            below.entry((one.process, parent)).or_default().push(one);
        }
        Self(below)
    }

    fn take(&mut self, process: ProcessId, parent: u64) -> Vec<ProcessPart> {
        let children = self.0.remove(&(process, parent)).unwrap_or_default();
        let parts = children.into_iter().map(|child| ProcessPart {
            name: child.name.to_string(),
            id: process,
            kind: ProcessKind::SubProcess,
            state: if child.is_running {
                ProcessState::Running
            } else {
                ProcessState::Waiting
            },
            priority: child.level,
            children: self.take(process, child.id),
        });
        parts.collect()
    }
}

/// The processes that have used it last, or wait at it.
fn users(wait_point: &WaitPointView) -> impl Iterator<Item = ProcessId> {
    let last = wait_point.sender.into_iter().chain(wait_point.receiver);
    let all = last.chain(wait_point.waiting.iter().map(|one| one.user));
    all.filter_map(|user| match user {
        User::Process(id) => Some(id),
        User::Outside => None,
    })
}

fn channel_part(wait_point: &WaitPointView, names: &HashMap<ProcessId, String>) -> ChannelPart {
    let user = |user: User| match user {
        User::Process(id) => names
            .get(&id)
            .map_or(EndUser::Outside, |name| EndUser::Process(name.clone())),
        User::Outside => EndUser::Outside,
    };
    let waiting = wait_point.waiting.iter().map(|one| WaitingPart {
        user: user(one.user),
        sends: matches!(one.role, Role::Sender | Role::Held),
    });
    ChannelPart {
        name: wait_point.name.clone(),
        made_at: wait_point.place(),
        kind: wait_point.kind,
        buffered: wait_point.buffered,
        overwrites: wait_point.overwrites,
        external: wait_point.external,
        ended: wait_point.ended,
        sender: wait_point.sender.map(user),
        receiver: wait_point.receiver.map(user),
        waiting: waiting.collect(),
    }
}
