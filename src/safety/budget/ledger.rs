//! A process' budgets while it runs: measured on its thread, read by the thread that runs the
//! system.

use super::{BudgetKind, BudgetOverrun, BudgetReport, Budgets, OnOverrun};
use crate::error::Error;
use crate::safety::{Cause, Emergency};
use crate::time::{Accounting, LoopName};
use luna_core::{PollMonitor, ProcessRegistry, Verdict};
use luna_platform::clock::{Instant, nanos};
use luna_platform::lock::PiLock;
use std::any::Any;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

/// The budgets of one process, and how it keeps them. All memory is reserved before the start.
/// Overruns are written under a priority-inheriting lock, which the reader holds for a copy only.
pub(crate) struct Ledger {
    budgets: Budgets,
    /// A first reading was made. Written by the process' thread alone.
    has_begun: AtomicBool,
    /// The process is to be ended.
    ended_for_overrun: AtomicBool,
    under_way: UnderWay,
    books: PiLock<Books>,
    /// Set when the process is started.
    system: OnceLock<(Arc<Emergency>, Arc<ProcessRegistry>)>,
}

#[derive(Default)]
struct Books {
    accounting: Accounting,
    poll: Overruns,
    cycle: Overruns,
    /// The decision, if the process or the system is to end.
    offence: Option<Error>,
    /// The overrun that was counted before it ended, by when it began.
    counted: Option<(BudgetKind, Instant)>,
    /// The last overruns are not reported yet.
    is_unsaid: bool,
}

#[derive(Clone, Default)]
struct Overruns {
    count: u64,
    /// The loop's name is kept beside it without an allocation; `of_loop` is filled in the report.
    worst: Option<(BudgetOverrun, Option<LoopName>)>,
}

impl Ledger {
    pub(super) fn new(budgets: Budgets) -> Self {
        Self {
            budgets,
            has_begun: AtomicBool::new(false),
            ended_for_overrun: AtomicBool::new(false),
            under_way: UnderWay::default(),
            books: PiLock::new(Books::default()),
            system: OnceLock::new(),
        }
    }

    fn on_overrun(&self) -> OnOverrun {
        self.budgets.on_overrun.unwrap_or_default()
    }

    /// Sets the system that the process is part of, before it runs.
    pub(crate) fn join(&self, emergency: &Arc<Emergency>, registry: &Arc<ProcessRegistry>) {
        // A process is started once.
        let _ = self.system.set((emergency.clone(), registry.clone()));
    }

    /// The ledger of the process that is being polled, if it has budgets.
    pub(crate) fn current() -> Option<Arc<Ledger>> {
        let poll_monitor: Arc<dyn Any + Send + Sync> = luna_core::poll_monitor()?;
        poll_monitor.downcast().ok()
    }

    /// A cycle has ended. Returns whether the process has to end too. O(1); on an overrun as
    /// [`overrun`](Self::overrun).
    #[inline]
    pub(crate) fn cycle_ends(&self, of: LoopName, began: Instant, now: Instant) -> bool {
        if let Some(budget) = self.budgets.cycle
            && now.nanos_since(began) > nanos(budget)
        {
            self.overrun(BudgetKind::Cycle, budget, Some(of), began, now);
        }
        self.ended_for_overrun.load(Ordering::Relaxed)
    }

    /// A cycle of the process that is being polled begins: it is looked at until the result is
    /// dropped. O(1), no allocation.
    #[inline]
    pub(crate) fn cycle_begins(now: Instant) -> Option<CycleWatch> {
        let ledger = Self::current()?;
        ledger.budgets.cycle.filter(|_| ledger.is_watched())?;
        let place = ledger.under_way.cycle_begins(now)?;
        Some(CycleWatch { ledger, place })
    }

    /// Whether a poll or cycle that never ends is looked for.
    fn is_watched(&self) -> bool {
        self.on_overrun() == OnOverrun::Emergency
    }

    /// Looks for a poll or cycle that has lasted for longer than its budget at `now`, which was
    /// read before this call. Returns when to look again, and whether one was found for the first
    /// time: then the caller triggers the emergency. For the thread that runs the system.
    pub(crate) fn look(&self, now: Instant) -> (Instant, bool) {
        if !self.is_watched() {
            return (Instant::NEVER, false);
        }
        let under_way = [
            (BudgetKind::Poll, self.budgets.poll, self.under_way.poll()),
            (
                BudgetKind::Cycle,
                self.budgets.cycle,
                self.under_way.first_cycle(),
            ),
        ];
        let (mut next, mut is_overdue) = (Instant::NEVER, false);
        for (kind, budget, began) in under_way {
            let Some(budget) = budget else { continue };
            match began {
                Some(began) if now.nanos_since(began) > nanos(budget) => {
                    is_overdue |= self.overdue(kind, budget, began, now);
                }
                // Those that begin after this look are found by the next.
                began => next = next.min(began.unwrap_or(now) + budget),
            }
        }
        (next, is_overdue)
    }

    /// Notes it, and returns whether it is the first.
    fn overdue(&self, kind: BudgetKind, budget: Duration, began: Instant, now: Instant) -> bool {
        let mut books = self.books.lock();
        if books.offence.is_some() {
            return false;
        }
        // What the kernel has counted of the thread is not known here.
        let overrun = BudgetOverrun::new(began, now - began, None);
        books.note(kind, budget, (overrun, None), true);
        books.counted = Some((kind, began));
        true
    }

    /// O(1), no allocation. Three system calls to read what the kernel has counted; one more to
    /// trigger the emergency, or for the first warning since the last one was printed.
    #[cold]
    fn overrun(
        &self,
        kind: BudgetKind,
        budget: Duration,
        of_loop: Option<LoopName>,
        began: Instant,
        now: Instant,
    ) {
        let policy = self.on_overrun();
        let mut books = self.books.lock();
        let overrun = BudgetOverrun::new(began, now - began, books.accounting.turn(now));
        let ends = matches!(policy, OnOverrun::Poison | OnOverrun::Emergency);
        let is_first = books.note(kind, budget, (overrun, of_loop), ends);
        let is_news = policy == OnOverrun::Warn && !std::mem::replace(&mut books.is_unsaid, true);
        drop(books);
        match (policy, self.system.get()) {
            (OnOverrun::Poison, _) => self.ended_for_overrun.store(true, Ordering::Relaxed),
            (OnOverrun::Warn, Some((_, registry))) if is_news => registry.announce(),
            (OnOverrun::Emergency, Some((emergency, _))) if is_first => {
                emergency.trigger(Cause::Overrun)
            }
            _ => {}
        }
    }

    /// The overrun for which the process or the system is being ended, once it is.
    pub(crate) fn offence(&self) -> Option<Error> {
        self.books.lock().offence.clone()
    }

    /// The overrun for which the system is being ended, if it is.
    pub(crate) fn emergency(&self) -> Option<Error> {
        self.offence()
            .filter(|_| self.on_overrun() == OnOverrun::Emergency)
    }

    /// Whether the process was ended for an overrun; the channel ends that it leaves then poison
    /// their channels.
    pub(crate) fn is_sentenced(&self) -> bool {
        self.ended_for_overrun.load(Ordering::Relaxed)
    }

    /// Whether an overrun is to be reported.
    pub(crate) fn has_news(&self) -> bool {
        self.books.lock().is_unsaid
    }

    /// The overruns are being reported: the next one is new.
    pub(crate) fn take_news(&self) {
        self.books.lock().is_unsaid = false;
    }

    /// How each budget was kept until now. Not for the real-time path.
    pub(crate) fn reports(&self) -> Vec<BudgetReport> {
        let (poll, cycle) = {
            let books = self.books.lock();
            (books.poll.clone(), books.cycle.clone())
        };
        let kinds = [
            (BudgetKind::Poll, self.budgets.poll, poll),
            (BudgetKind::Cycle, self.budgets.cycle, cycle),
        ];
        kinds
            .into_iter()
            .filter_map(|(kind, budget, overruns)| {
                Some(BudgetReport {
                    kind,
                    budget: budget?,
                    on_overrun: self.on_overrun(),
                    overruns: overruns.count,
                    worst: overruns.worst.map(|(worst, of_loop)| BudgetOverrun {
                        of_loop: of_loop.map(|name| name.to_string()),
                        ..worst
                    }),
                })
            })
            .collect()
    }
}

impl Books {
    /// Counts an overrun, once also if it was found before it ended, and keeps the worst. Returns
    /// whether the process or the system is to end for it, and was not yet.
    fn note(
        &mut self,
        kind: BudgetKind,
        budget: Duration,
        overrun: (BudgetOverrun, Option<LoopName>),
        ends: bool,
    ) -> bool {
        let BudgetOverrun { at, taken, .. } = overrun.0;
        let was_counted = self.counted == Some((kind, at));
        let overruns = self.overruns(kind);
        overruns.count += u64::from(!was_counted);
        let worst = overruns.worst.as_ref();
        if worst.is_none_or(|(worst, _)| worst.taken < taken) {
            overruns.worst = Some(overrun);
        }
        let is_first = ends && self.offence.is_none();
        if is_first {
            self.offence = Some(Error::BudgetOverrun {
                kind,
                budget,
                taken,
            });
        }
        is_first
    }

    fn overruns(&mut self, kind: BudgetKind) -> &mut Overruns {
        match kind {
            BudgetKind::Poll => &mut self.poll,
            _ => &mut self.cycle,
        }
    }
}

/// A cycle that is under way.
pub(crate) struct CycleWatch {
    ledger: Arc<Ledger>,
    place: usize,
}

impl Drop for CycleWatch {
    fn drop(&mut self) {
        self.ledger.under_way.cycle_ends(self.place);
    }
}

impl PollMonitor for Ledger {
    fn poll_begins(&self, now: Instant) {
        if self.budgets.poll.is_some() && self.is_watched() {
            self.under_way.poll_begins(now);
        }
        // The first reading is what the first overrun is counted from.
        if self.budgets.accounted || !self.has_begun.load(Ordering::Relaxed) {
            self.has_begun.store(true, Ordering::Relaxed);
            self.books.lock().accounting.begin(now);
        }
    }

    fn poll_ends(&self, began: Instant, now: Instant) -> Verdict {
        if self.budgets.poll.is_some() && self.is_watched() {
            self.under_way.poll_ends();
        }
        if let Some(budget) = self.budgets.poll
            && now.nanos_since(began) > nanos(budget)
        {
            self.overrun(BudgetKind::Poll, budget, None, began, now);
        }
        if self.ended_for_overrun.load(Ordering::Relaxed) {
            Verdict::Poison
        } else {
            Verdict::GoOn
        }
    }
}

/// As many cycles of a process are looked at while they last: one for each of its loops.
const CYCLES: usize = 8;

/// When each of them began. Written by the thread that runs the process, one store each; read by
/// the thread that runs the system.
#[derive(Debug, Default)]
struct UnderWay {
    poll: AtomicU64,
    cycles: [AtomicU64; CYCLES],
}

/// No instant of a begin is 0: the system runs then.
const NONE: u64 = 0;

impl UnderWay {
    /// A poll begins. O(1), a store.
    fn poll_begins(&self, now: Instant) {
        self.poll.store(now.as_nanos(), Ordering::Release);
    }

    fn poll_ends(&self) {
        self.poll.store(NONE, Ordering::Release);
    }

    /// A cycle begins. Gives its place, if there is one. O(1).
    fn cycle_begins(&self, now: Instant) -> Option<usize> {
        let take = |place: &AtomicU64| {
            let (order, failed) = (Ordering::AcqRel, Ordering::Relaxed);
            let taken = place.compare_exchange(NONE, now.as_nanos(), order, failed);
            taken.is_ok()
        };
        self.cycles.iter().position(take)
    }

    fn cycle_ends(&self, place: usize) {
        if let Some(place) = self.cycles.get(place) {
            place.store(NONE, Ordering::Release);
        }
    }

    /// When the poll began that is under way, if one is.
    fn poll(&self) -> Option<Instant> {
        begun(&self.poll)
    }

    /// When the first of the cycles began that are under way.
    fn first_cycle(&self) -> Option<Instant> {
        self.cycles.iter().filter_map(begun).min()
    }
}

fn begun(place: &AtomicU64) -> Option<Instant> {
    let nanos = place.load(Ordering::Acquire);
    (nanos != NONE).then(|| Instant::from_nanos(nanos))
}
