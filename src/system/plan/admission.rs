//! How a process comes to a system: described beside others, or started beside those that run.

use super::running::{Running, Started};
use super::{Members, Names, Phase, Placement, Plan, ProcessPlan, duplicate};
use crate::csp::process::clean_up;
use crate::error::{Result, SetupError};
use crate::system::neighbours;
use luna_core::current::ProcessId;
use luna_core::{ProcessHandle, make_room};
use std::sync::MutexGuard;

/// The names of a process that is about to be added. Dropping it gives them back.
pub(crate) struct Reservation<'a> {
    plan: &'a Plan,
    names: Option<Names>,
}

impl Reservation<'_> {
    /// The names stay taken.
    pub(crate) fn keep(mut self) {
        self.names = None;
    }
}

impl Drop for Reservation<'_> {
    fn drop(&mut self) {
        if let Some(names) = &self.names {
            self.plan.members().give_back(names);
        }
    }
}

impl Plan {
    /// Takes the names of a process that has no body yet.
    pub(crate) fn reserve(&self, plan: &ProcessPlan) -> Result<Reservation<'_>> {
        drop(self.admit(plan)?);
        Ok(Reservation {
            plan: self,
            names: Some(plan.names()),
        })
    }

    /// Adds a process: to be started with the others, or at once if they run. O(1) but for what is
    /// the user's, and those that have ended meanwhile.
    pub(crate) fn add_process(&self, plan: ProcessPlan) -> Result<ProcessId> {
        let id = plan.id();
        make_room();
        self.add_admitted(self.admit(&plan)?, plan)?;
        Ok(id)
    }

    /// As [`add_process`](Self::add_process), for one with a [reserved](Self::reserve) name.
    pub(crate) fn add_reserved(&self, plan: ProcessPlan) -> Result<ProcessId> {
        let id = plan.id();
        make_room();
        self.add_admitted(self.members(), plan)?;
        Ok(id)
    }

    /// As [`add_process`](Self::add_process), to a system that runs.
    pub(crate) fn start_process(&self, plan: ProcessPlan) -> Result<ProcessHandle> {
        make_room();
        let mut members = self.admit(&plan)?;
        if members.running.is_none() {
            members.give_back(&plan.names());
            drop(members);
            self.note_refusal();
            let process = plan.name().to_owned();
            return Err(SetupError::NotRunning { process }.into());
        }
        match self.add_admitted(members, plan)? {
            Some(handle) => Ok(handle),
            None => unreachable!("the system runs"),
        }
    }

    /// Adds a process whose names are taken. Gives its handle if it is started.
    fn add_admitted(
        &self,
        mut members: MutexGuard<'_, Members>,
        plan: ProcessPlan,
    ) -> Result<Option<ProcessHandle>> {
        if members.phase == Phase::Ended {
            drop(members);
            return Err(self.ended(plan.name()));
        }
        if members.running.is_none() {
            members.waiting.push(plan);
            return Ok(None);
        }
        let names = plan.names();
        self.start_late(members, plan)
            .map(Some)
            .inspect_err(|_| self.members().give_back(&names))
    }

    /// Refuses if the system has ended; else takes the [names](Names) of the process.
    fn admit(&self, plan: &ProcessPlan) -> Result<MutexGuard<'_, Members>> {
        let name = plan.name();
        let mut guard = self.members();
        let members = &mut *guard;
        if members.phase == Phase::Ended {
            drop(guard);
            return Err(self.ended(name));
        }
        if let Some(running) = &members.running {
            // A spawn may free memory, and need not put it aside.
            luna_core::path::off_path(|| members.started.note_ends(&running.common));
        }
        if !plan.shares_name && !members.started.take_name(plan.spec.name()) {
            // The process that had it may have ended, and others may know that, though its executor
            // has not reported it yet.
            if let Some(running) = &members.running {
                members.started.look_for_ends(&running.common.emergency);
            }
            if !members.started.take_name(plan.spec.name()) {
                self.note_refusal();
                return Err(duplicate("process", name));
            }
        }
        if let Some(thread) = plan.thread_name()
            && let Err(refused) = members.take_thread_name(thread)
        {
            if !plan.shares_name {
                members.started.give_name_back(plan.spec.name());
            }
            self.note_refusal();
            return Err(refused);
        }
        Ok(guard)
    }

    /// Forgets a process that has ended before it was entered: its end is reported before that.
    fn never_entered(&self, running: &Running, id: ProcessId) {
        let mut members = self.members();
        members.started.note_ends(&running.common);
        members.started.never_entered(id);
    }

    /// Starts a process beside those that run. Its `pre_run` and its thread's start happen without
    /// the lock: they may take long, and spawn.
    fn start_late<'a>(
        &'a self,
        mut members: MutexGuard<'a, Members>,
        mut plan: ProcessPlan,
    ) -> Result<ProcessHandle> {
        let has_phases = plan.prepared.resident.is_some();
        let is_apart = has_phases || matches!(plan.place, Placement::Thread(_));
        // For what is done without the lock.
        let running = match &members.running {
            Some(running) if is_apart => running.clone(),
            _ => return self.start_on_executor(members, plan),
        };
        let id = plan.id();
        let _clock = has_phases.then(|| running.common.clock.enter());
        if let Some(resident) = &mut plan.prepared.resident {
            drop(members);
            let prepared = running.common.prepare(&mut **resident);
            prepared.map_err(|error| error.in_process(plan.name()))?;
            members = self.members();
        }
        if members.phase == Phase::Ended || matches!(plan.place, Placement::Executor(_)) {
            return self.start_on_executor(members, plan);
        }
        neighbours::join(&mut plan.place, &running, &members.places, &members.threads);
        drop(members);
        let started = running.start(plan);
        let mut members = self.members();
        let (mut member, started) = match started {
            Ok(both) => both,
            Err(refused) => {
                drop(members);
                self.never_entered(&running, id);
                clean_up(refused.resident);
                return Err(refused.error);
            }
        };
        // A thread is held until the system is known to run still.
        if members.phase == Phase::Ended {
            drop(members);
            // Its body ends before it began.
            drop(started);
            self.never_entered(&running, id);
            clean_up(member.resident.take());
            return Err(self.ended(member.name()));
        }
        let handle = member.handle.clone();
        member.is_late = true;
        let emergency = &running.common.emergency;
        members.started.enter(id, member, emergency);
        if let Started::OnThread(thread) = started {
            thread.1.release();
            members.threads.push(thread);
        }
        Ok(handle)
    }

    /// Starts a process on an executor beside those that run. The lock is kept from the look at the
    /// phase until the process is entered: the end cannot come in between. No user code runs there.
    fn start_on_executor(
        &self,
        mut guard: MutexGuard<'_, Members>,
        plan: ProcessPlan,
    ) -> Result<ProcessHandle> {
        let members = &mut *guard;
        let (Some(running), &Placement::Executor(number)) = (&members.running, &plan.place) else {
            drop(guard);
            let ended = self.ended(plan.name());
            clean_up(plan.prepared.resident);
            return Err(ended);
        };
        let id = plan.id();
        let (mut member, announced) = running.announce(number, plan);
        let handle = member.handle.clone();
        member.is_late = true;
        let emergency = &running.common.emergency;
        members.started.enter(id, member, emergency);
        drop(announced.start_under(guard));
        Ok(handle)
    }
}
