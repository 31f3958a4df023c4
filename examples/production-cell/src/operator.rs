//! The user interface: not real-time. It starts and stops the line, makes faults and repairs them,
//! and keeps what the units report.

use crate::messages::{Condition, Fault, Report, Request};
use crate::parameters::{BLOCKS, OPERATOR_TIMEOUT, Unit};
use crate::unit::Panel;
use luna::time::Instant;
use serde::Serialize;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// How often it looks.
const LOOK: Duration = Duration::from_millis(5);
/// Looks between two requests that say nothing new, for a unit that was started again.
const LOOKS_OF_REQUEST: u32 = 20;
/// How long units have to report at first, and to come to rest at the end.
const PATIENCE: Duration = Duration::from_secs(8);

/// What the operator does in a run.
#[derive(Debug, Clone)]
pub struct Plan {
    /// How long the line runs.
    pub time: Duration,
    /// The control laws are exchanged each such time.
    pub exchange: Option<Duration>,
    /// The faults that are made.
    pub drills: Vec<Drill>,
}

/// A fault, and its repair.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Drill {
    /// Where.
    pub unit: Unit,
    /// What.
    pub fault: Breakage,
    /// When, from the start of the line.
    pub at: Duration,
    /// How long until it is repaired.
    pub lasts: Duration,
}

/// What breaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Breakage {
    /// The axis is stuck.
    Stuck,
    /// The position sensor is broken.
    Sensor,
    /// The unit's program is killed (SIGKILL), and started again for the repair. Where the unit is
    /// no program of its own, it is dead as if it were.
    Kill,
}

/// What kills and starts the programs of units.
pub(crate) trait Programs: Send + Sync {
    /// Sends SIGKILL.
    fn kill(&mut self, unit: Unit) -> luna::Result<()>;
    /// Starts it again.
    fn restart(&mut self, unit: Unit) -> luna::Result<()>;
}

/// How a unit is seen in the time line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Seen {
    /// Its condition.
    pub condition: Condition,
    /// It runs, and has nothing to do.
    pub waits: bool,
}

/// A change in the time line.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Change {
    /// In s, from the start of the line.
    pub at: f64,
    /// Of which unit.
    pub unit: Unit,
    /// How it is from then on.
    pub seen: Seen,
}

/// What the operator did: the line's start and stop, a fault, its repair.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Mark {
    /// In s, from the start of the line.
    pub at: f64,
    /// What.
    pub what: &'static str,
    /// Blocks that each unit had given by then.
    pub given: [u32; 6],
    /// Where the axis of each unit was, in m.
    pub positions: [f64; 6],
}

/// What is known at the end.
#[derive(Debug, Clone, Default)]
pub struct Log {
    /// The time line.
    pub changes: Vec<Change>,
    /// What the operator did.
    pub marks: Vec<Mark>,
    /// The last report of each unit.
    pub last: [Option<Report>; 6],
    /// Whether all units came to rest.
    pub is_at_rest: bool,
    /// In s, from the start of the line to its end.
    pub seconds: f64,
}

impl Log {
    /// The blocks that no unit has, and those that are in more than one place.
    pub fn lost_and_doubled(&self) -> (u32, u32) {
        let held = |block| {
            let contents = self.last.iter().flatten().map(|report| report.contents);
            let all = contents.flat_map(|contents| contents.blocks);
            all.filter(|held| *held == block).count()
        };
        let of =
            |is: fn(usize) -> bool| (1..=BLOCKS as u32).filter(|n| is(held(*n))).count() as u32;
        (of(|places| places == 0), of(|places| places > 1))
    }
}

/// The operator of a cell.
pub(crate) struct Operator {
    pub(crate) plan: Plan,
    pub(crate) panels: Vec<Panel>,
    pub(crate) programs: Option<Box<dyn Programs>>,
    pub(crate) log: Arc<Mutex<Log>>,
}

/// While it runs.
struct Run {
    log: Log,
    /// Looks since a unit was heard. Looks that come late are fewer, so that an operator that is
    /// late itself takes no unit for lost.
    silent: [u32; 6],
    requests: [Request; 6],
    looks: u32,
    began: Instant,
}

impl Run {
    fn seconds(&self) -> f64 {
        (luna::now() - self.began).as_secs_f64()
    }

    fn mark(&mut self, what: &'static str) {
        let at = self.seconds();
        let given = |report: Option<Report>| report.map_or(0, |report| report.contents.given);
        let given = self.log.last.map(given);
        let position = |report: Option<Report>| report.map_or(0.0, |report| report.position);
        let positions = self.log.last.map(position);
        self.log.marks.push(Mark {
            at,
            what,
            given,
            positions,
        });
    }

    fn see(&mut self, unit: Unit, seen: Seen) {
        let mut of_unit = self.log.changes.iter().rev();
        let last = of_unit.find(|change| change.unit == unit);
        if last.is_none_or(|change| change.seen != seen) {
            let at = self.seconds();
            self.log.changes.push(Change { at, unit, seen });
        }
    }
}

impl Operator {
    /// Runs the line. All units end with it.
    pub(crate) async fn run(mut self) -> luna::Result<()> {
        let now = luna::now();
        let mut run = Run {
            log: Log::default(),
            silent: [0; 6],
            requests: [Request::default(); 6],
            looks: 0,
            began: now,
        };
        let mut ticks = luna::periodic("operator", LOOK)?;
        let all_report = |log: &Log| log.last.iter().all(Option::is_some);
        while !all_report(&run.log) && luna::now() - now < PATIENCE {
            ticks.next().await;
            self.look(&mut run).await;
        }

        run.began = luna::now();
        run.log.changes.clear();
        run.mark("start");
        self.request_all(&mut run, |request| request.run = true)
            .await;
        let outcome = self.operate(&mut run, &mut ticks).await;

        run.mark("stop");
        self.request_all(&mut run, |request| request.run = false)
            .await;
        let stopped = luna::now();
        let is_at_rest = |log: &Log| {
            let mut reports = log.last.iter();
            reports.all(|report| {
                report.is_some_and(|report| {
                    let is_over = !matches!(report.condition, Condition::Running | Condition::Safe);
                    is_over && !report.contents.under_way
                })
            })
        };
        // Reports that were under way when the line was stopped are older.
        loop {
            ticks.next().await;
            self.look(&mut run).await;
            let time = luna::now() - stopped;
            run.log.is_at_rest = is_at_rest(&run.log);
            if (time > 4 * OPERATOR_TIMEOUT && run.log.is_at_rest) || time > PATIENCE {
                break;
            }
        }
        run.log.seconds = run.seconds();
        self.request_all(&mut run, |request| request.end = true)
            .await;
        *self.log.lock().unwrap_or_else(PoisonError::into_inner) = run.log;
        outcome
    }

    async fn operate(&mut self, run: &mut Run, ticks: &mut luna::Periodic) -> luna::Result<()> {
        let (time, exchange) = (self.plan.time, self.plan.exchange);
        let mut faults = std::mem::take(&mut self.plan.drills);
        let mut repairs: Vec<Drill> = Vec::new();
        let mut next = exchange;
        loop {
            ticks.next().await;
            self.look(run).await;
            let passed = luna::now() - run.began;
            for drill in faults.extract_if(.., |drill| passed >= drill.at) {
                run.mark("fault");
                self.break_unit(run, drill).await?;
                repairs.push(drill);
            }
            for drill in repairs.extract_if(.., |drill| passed >= drill.at + drill.lasts) {
                run.mark("repair");
                self.repair(run, drill).await?;
            }
            if next.is_some_and(|at| passed >= at) {
                next = next.zip(exchange).map(|(at, time)| at + time);
                self.request_all(run, |request| request.law ^= 1).await;
            }
            if passed >= time {
                return Ok(());
            }
        }
    }

    async fn break_unit(&mut self, run: &mut Run, drill: Drill) -> luna::Result<()> {
        let fault = match (drill.fault, &mut self.programs) {
            (Breakage::Kill, Some(programs)) => return programs.kill(drill.unit),
            (Breakage::Kill, None) => Fault::Dead,
            (Breakage::Stuck, _) => Fault::Stuck,
            (Breakage::Sensor, _) => Fault::Sensor,
        };
        run.requests[drill.unit as usize].fault = fault;
        self.request(run, drill.unit).await;
        Ok(())
    }

    async fn repair(&mut self, run: &mut Run, drill: Drill) -> luna::Result<()> {
        if let (Breakage::Kill, Some(programs)) = (drill.fault, &mut self.programs) {
            programs.restart(drill.unit)?;
        }
        let request = &mut run.requests[drill.unit as usize];
        request.fault = Fault::None;
        request.repairs += 1;
        self.request(run, drill.unit).await;
        Ok(())
    }

    async fn request_all(&self, run: &mut Run, change: impl Fn(&mut Request)) {
        for unit in Unit::ALL {
            change(&mut run.requests[unit as usize]);
            self.request(run, unit).await;
        }
    }

    async fn request(&self, run: &Run, unit: Unit) {
        let panel = &self.panels[unit as usize];
        // One that has ended is shown as lost.
        let _ = panel.requests.send(run.requests[unit as usize]).await;
    }

    async fn look(&self, run: &mut Run) {
        for (unit, panel) in Unit::ALL.into_iter().zip(&self.panels) {
            while let Ok(report) = panel.reports.try_recv() {
                let Report {
                    condition, waits, ..
                } = report;
                let waits = waits && condition == Condition::Running;
                if condition != Condition::Lost {
                    run.log.last[unit as usize] = Some(report);
                    run.silent[unit as usize] = 0;
                }
                run.see(unit, Seen { condition, waits });
            }
            run.silent[unit as usize] += 1;
            if LOOK * run.silent[unit as usize] > OPERATOR_TIMEOUT {
                let (condition, waits) = (Condition::Lost, false);
                run.see(unit, Seen { condition, waits });
            }
        }
        run.looks += 1;
        if run.looks.is_multiple_of(LOOKS_OF_REQUEST) {
            for unit in Unit::ALL {
                self.request(run, unit).await;
            }
        }
    }
}
