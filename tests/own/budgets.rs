//! Budgets: a process that takes too long is counted and named, and the requested reaction follows.

use crate::common;
use common::{COMPLETE, PLACEMENTS, Placement, Program, SpawnOk, burn_until, setup_error, skip};
use luna::error::SetupError;
use luna::prelude::*;
use luna::report::{BudgetReport, ProcessReport, ThreadUsage};
use luna::safety::{BudgetKind, OnOverrun};
use luna::{End, Error, Exit, Report};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::Duration;

/// No process takes that long by chance, while a busy machine runs others.
const BUDGET: Duration = Duration::from_millis(200);
const TOO_LONG: Duration = Duration::from_millis(250);
/// No process takes that long, however loaded the machine is.
const AGES: Duration = Duration::from_secs(3600);

fn burn(time: Duration) {
    burn_until(luna::now() + time);
}

fn process<'a>(report: &'a Report, name: &str) -> &'a ProcessReport {
    report
        .processes
        .iter()
        .find(|one| one.name == name)
        .unwrap()
}

fn budget(report: &Report, name: &str, kind: BudgetKind) -> BudgetReport {
    let budgets = &process(report, name).budgets;
    budgets.iter().find(|one| one.kind == kind).unwrap().clone()
}

/// Takes too long, so many times.
async fn hog(times: u32) -> luna::Result<()> {
    for _ in 0..times {
        burn(TOO_LONG);
        luna::yield_now().await;
    }
    Ok(())
}

#[test]
fn a_hog_is_counted_and_nobody_else_is() {
    own_process!();
    for place in PLACEMENTS {
        let mut system = System::new("counted");
        let at = |system: &mut System, name: &str| place.process(system, name, name);
        at(&mut system, "hog")
            .poll_budget(BUDGET)
            .cycle_budget(AGES)
            .spawn_ok(hog(3));
        at(&mut system, "patient")
            .poll_budget(AGES)
            .spawn_ok(hog(1));
        at(&mut system, "free").spawn_ok(hog(1));
        let report = system.run().unwrap();

        let hog = budget(&report, "hog", BudgetKind::Poll);
        assert!((3..=4).contains(&hog.overruns), "{place:?}: {hog:?}");
        assert_eq!((hog.budget, hog.on_overrun), (BUDGET, OnOverrun::Count));
        let worst = hog.worst.as_ref().unwrap();
        assert!(worst.taken >= TOO_LONG && worst.of_loop.is_none());
        assert_eq!(worst.usage.is_some(), COMPLETE, "{place:?}");
        let taken = process(&report, "hog").longest_poll.unwrap();
        assert_eq!(worst.taken, taken, "the polls with a budget are timed");
        assert_eq!(budget(&report, "hog", BudgetKind::Cycle).overruns, 0);

        let patient = budget(&report, "patient", BudgetKind::Poll);
        assert_eq!((patient.overruns, patient.worst), (0, None));
        let free = process(&report, "free");
        assert!(free.budgets.is_empty() && free.longest_poll.is_none());

        let text = report.to_string();
        assert!(
            text.contains("process `hog`: poll budget of 200.00 ms overrun "),
            "{text}"
        );
        assert!(!text.contains("process `patient`"), "{text}");
    }
}

#[test]
fn a_cycle_is_measured_from_its_begin_and_lateness_is_not_the_loops_fault() {
    own_process!();
    for place in PLACEMENTS {
        let mut system = System::new("cycles");
        place
            .process(&mut system, "control", "loop")
            .cycle_budget(Duration::from_millis(500))
            .spawn_ok(async {
                let mut late = luna::periodic("late", Duration::from_millis(5))?;
                burn(Duration::from_millis(700));
                assert!(late.next().await.missed > 0);
                late.next().await;
                let mut long = luna::periodic("long", Duration::from_millis(5))?;
                long.next().await;
                luna::after(Duration::from_millis(510)).await; // waiting counts too
                long.next().await;
                // A cycle without a `next` after it has no end.
                burn(Duration::from_millis(510));
                Ok(())
            });
        let report = system.run().unwrap();
        let cycles = budget(&report, "loop", BudgetKind::Cycle);
        assert_eq!(cycles.overruns, 1, "{place:?}: {cycles:?}");
        let worst = cycles.worst.unwrap();
        assert_eq!(worst.of_loop.as_deref(), Some("long"));
        assert!(worst.taken >= Duration::from_millis(510));
    }
}

/// Counts its drop.
struct Guard(Arc<AtomicU32>);

impl Drop for Guard {
    fn drop(&mut self) {
        self.0.fetch_add(1, Ordering::SeqCst);
    }
}

/// Takes too long, and holds a channel end outside of its body.
struct Hog {
    output: Sender<u32>,
    by_cycle: bool,
    held: Option<Receiver<u32>>,
    dropped: Arc<AtomicU32>,
}

impl Process for Hog {
    async fn run(&mut self) -> luna::Result<()> {
        let _guard = Guard(self.dropped.clone());
        // This end goes with the body; the other one with the process, off the path.
        let _held = self.held.take();
        self.output.send(1).await?;
        if self.by_cycle {
            let mut tick = luna::periodic("hog", Duration::from_millis(1))?;
            tick.next().await;
            luna::after(TOO_LONG).await;
            tick.next().await;
        } else {
            burn(TOO_LONG);
            luna::after(Duration::from_millis(1)).await;
        }
        unreachable!("it is ended there");
    }
}

#[test]
fn the_culprit_is_poisoned_with_its_channels() {
    own_process!();
    for place in PLACEMENTS {
        for by_cycle in [false, true] {
            let (output, input) = luna::channel();
            let (feed, held) = luna::channel();
            let dropped = Arc::new(AtomicU32::new(0));
            let mut system = System::new("poisoned");
            let hog = place.process(&mut system, "hog", "hog");
            let hog = match by_cycle {
                true => hog.cycle_budget(BUDGET),
                false => hog.poll_budget(BUDGET),
            };
            hog.on_overrun(OnOverrun::Poison).spawn_ok(Hog {
                output,
                by_cycle,
                held: Some(held),
                dropped: dropped.clone(),
            });
            let partner = place.process(&mut system, "partner", "partner");
            partner.spawn_ok(async move {
                assert_eq!(input.recv().await?, 1);
                assert_eq!(input.recv().await, Err(luna::RecvError::Poisoned));
                let refused = feed.send(2).await.unwrap_err();
                assert!(Error::from(refused).is_poisoned());
                Ok(())
            });
            let error = system.run().unwrap_err();
            let Error::Process { name, source } = &error else {
                panic!("{error}");
            };
            let kind = match by_cycle {
                true => BudgetKind::Cycle,
                false => BudgetKind::Poll,
            };
            match **source {
                Error::BudgetOverrun {
                    kind: of,
                    budget,
                    taken,
                } => {
                    assert_eq!((name.as_str(), of, budget), ("hog", kind, BUDGET));
                    assert!(taken >= TOO_LONG);
                }
                ref other => panic!("{other}"),
            }
            let text = error.to_string();
            assert!(text.contains("process `hog`: took "), "{text}");
            let report = system.report().unwrap();
            assert_eq!(report.end, End::Completed, "the others went on");
            assert_eq!(process(&report, "hog").exit, Some(Exit::Cancelled));
            assert_eq!(process(&report, "partner").exit, Some(Exit::Completed));
            assert_eq!(dropped.load(Ordering::SeqCst), 1, "its body was dropped");
        }
    }
}

#[test]
fn one_that_ends_by_itself_in_that_poll_has_ended() {
    own_process!();
    for place in PLACEMENTS {
        let (output, input) = luna::channel::<u32>();
        let mut system = System::new("ended");
        place
            .process(&mut system, "main", "hog")
            .poll_budget(BUDGET)
            .on_overrun(OnOverrun::Poison)
            .spawn_ok(async move {
                burn(TOO_LONG);
                drop(output);
                Ok(())
            });
        let report = system.run().unwrap();
        assert_eq!(process(&report, "hog").exit, Some(Exit::Completed));
        assert_eq!(budget(&report, "hog", BudgetKind::Poll).overruns, 1);
        assert_eq!(input.try_recv(), Err(luna::TryRecvError::Closed));
    }
}

#[test]
fn the_emergency_runs_and_names_the_culprit() {
    own_process!();
    for place in PLACEMENTS {
        let safe = Arc::new(AtomicBool::new(false));
        let done = safe.clone();
        let mut system = System::new("emergency");
        system.on_emergency("brake", move || done.store(true, Ordering::SeqCst));
        place
            .process(&mut system, "drive", "drive")
            .poll_budget(BUDGET)
            .on_overrun(OnOverrun::Emergency)
            .spawn_ok(async {
                burn(TOO_LONG);
                std::future::pending().await
            });
        let other = place.process(&mut system, "other", "other");
        other.spawn_ok(std::future::pending());
        let error = system.run().unwrap_err();
        let Error::Process { name, source } = error else {
            panic!("{error}");
        };
        assert_eq!(name, "drive");
        // So far: the poll may not have ended yet when the overrun was found.
        assert!(matches!(
            *source,
            Error::BudgetOverrun { budget: BUDGET, taken, .. } if taken > BUDGET
        ));
        assert!(safe.load(Ordering::SeqCst));
        let report = system.report().unwrap();
        assert_eq!(report.end, End::Overrun);
        assert_eq!(process(&report, "other").exit, Some(Exit::Cancelled));
        assert!(report.to_string().contains("ended by an overrun"));
    }
}

#[test]
fn an_emergency_of_one_that_ends_in_that_poll_is_one_too() {
    own_process!();
    let mut system = System::new("emergency");
    let main = system.executor("main").build().unwrap();
    main.process("drive")
        .poll_budget(BUDGET)
        .on_overrun(OnOverrun::Emergency)
        .spawn_ok(async {
            burn(TOO_LONG);
            Ok(())
        });
    main.process("other").spawn_ok(std::future::pending());
    let error = system.run().unwrap_err().to_string();
    assert!(error.starts_with("process `drive`: took "), "{error}");
    assert_eq!(system.report().unwrap().end, End::Overrun);
}

#[test]
fn an_overrun_is_told_while_the_system_runs() {
    own_process!();
    let mut program = Program::start("warns");
    let line = program.error_line();
    assert!(
        line.starts_with("luna: process `hog`: poll budget of 200.00 ms overrun "),
        "{line}"
    );
    // Only now it may end.
    program.close_input();
    assert!(program.end().status.success());
}

#[test]
fn many_overruns_are_told_in_few_lines_and_none_is_left_out() {
    own_process!();
    let ended = Program::start("floods").end();
    let said: Vec<&str> = ended.errors.lines().collect();
    let lines = said.iter().filter(|line| line.contains("process `hog`"));
    let seconds: usize = ended
        .output
        .lines()
        .find_map(|line| {
            let (_, seconds) = line.split_once("seconds: ")?;
            seconds.parse().ok()
        })
        .unwrap();
    let lines: Vec<_> = lines.collect();
    // One a second, the first one, and the rest at the end.
    assert!((1..=seconds + 3).contains(&lines.len()), "{ended:?}");
    assert!(
        lines.last().unwrap().contains("overrun 300 times"),
        "{ended:?}"
    );
}

#[test]
fn part() {
    let warning = |system: &mut System| {
        let main = system.executor("main").build().unwrap();
        main.process("hog").on_overrun(OnOverrun::Warn)
    };
    match common::part().as_deref() {
        Some("warns") => {
            let mut system = System::new("warns");
            let hog = warning(&mut system).poll_budget(BUDGET);
            hog.spawn_ok(async {
                burn(TOO_LONG);
                // Until the parent that started this program has read the line, and closes the
                // program's input.
                luna::blocking(|| std::io::stdin().read_line(&mut String::new()))
                    .await
                    .map_err(Error::other)?;
                Ok(())
            });
            system.run().unwrap();
        }
        Some("floods") => {
            let begun = luna::now();
            let mut system = System::new("floods");
            let hog = warning(&mut system).poll_budget(Duration::from_nanos(1));
            hog.spawn_ok(async {
                for _ in 1..300 {
                    burn(Duration::from_millis(1));
                    luna::yield_now().await;
                }
                Ok(())
            });
            system.run().unwrap();
            println!("\nseconds: {}", (luna::now() - begun).as_secs());
        }
        _ => {}
    }
}

#[test]
fn a_long_poll_is_told_from_one_that_was_off_the_processor() {
    own_process!();
    if !COMPLETE {
        skip("the portable layer does not know what a thread used");
        return;
    }
    let of_thread = || ThreadUsage::of_current_thread().unwrap().cpu_time;
    let mut system = System::new("accounted");
    let mut at = |name: &str| {
        let process = Placement::Thread.process(&mut system, name, name);
        process.poll_budget(BUDGET).accounted()
    };
    at("computes").spawn_ok(async move {
        // Something that the overrun must not be charged with.
        let before = of_thread();
        while of_thread() - before < TOO_LONG {
            luna::yield_now().await;
        }
        let before = of_thread();
        while of_thread() - before < 3 * TOO_LONG {}
        luna::yield_now().await;
        Ok(())
    });
    at("sleeps").spawn_ok(async {
        let begun = luna::now();
        burn(TOO_LONG);
        let burnt = luna::now() - begun;
        luna::yield_now().await;
        // Longer than the poll before it, which may have been off the processor too.
        std::thread::sleep(3 * (TOO_LONG + burnt));
        luna::yield_now().await;
        Ok(())
    });
    let report = system.run().unwrap();
    let usage = |name| {
        let worst = budget(&report, name, BudgetKind::Poll).worst.unwrap();
        let usage = worst.usage.unwrap();
        // From the poll's very begin.
        assert_eq!(usage.since, worst.at);
        assert!(usage.elapsed() >= worst.taken, "{worst:?}");
        usage
    };
    let computes = usage("computes").counted;
    assert!(computes.cpu_time >= 3 * TOO_LONG, "{computes:?}");
    let sleeps = usage("sleeps").counted;
    assert!(
        sleeps.cpu_time < TOO_LONG && sleeps.voluntary_switches >= 1,
        "{sleeps:?}"
    );
}

#[test]
fn bad_budgets_are_refused_with_a_typed_error() {
    own_process!();
    let mut system = System::new("wrong");
    let main = system.executor("main").build().unwrap();
    let nothing = || async { Ok(()) };
    let zero = [
        (
            main.process("a").poll_budget(Duration::ZERO),
            BudgetKind::Poll,
        ),
        (
            main.process("a")
                .poll_budget(BUDGET)
                .cycle_budget(Duration::ZERO),
            BudgetKind::Cycle,
        ),
    ];
    for (process, of) in zero {
        let error = setup_error(process.spawn(nothing()), &["`a`", &of.to_string(), "1 ns"]);
        let expected = SetupError::ZeroBudget {
            process: "a".to_owned(),
            kind: of,
        };
        assert_eq!(error, expected);
    }
    for process in [
        main.process("b").on_overrun(OnOverrun::Poison),
        main.process("b").accounted(),
    ] {
        let error = setup_error(process.spawn(nothing()), &["`b`", "poll_budget"]);
        assert!(matches!(error, SetupError::NoBudget { .. }));
    }
    // The names are still free, and the longest budget is one.
    main.process("a")
        .poll_budget(Duration::MAX)
        .cycle_budget(Duration::MAX)
        .on_overrun(OnOverrun::Emergency)
        .spawn_ok(nothing());
    assert_eq!(system.run().unwrap().end, End::Completed);
}

#[test]
fn a_process_that_is_spawned_while_the_system_runs_has_budgets_too() {
    own_process!();
    let mut system = System::new("late comers");
    let main = system.executor("main").build().unwrap();
    let spawner = main.clone();
    main.process("spawner").spawn_ok(async move {
        let spawned = luna::blocking(move || {
            spawner
                .process("hog")
                .poll_budget(BUDGET)
                .on_overrun(OnOverrun::Poison)
                .spawn(hog(3))
        });
        spawned.await?;
        Ok(())
    });
    let error = system.run().unwrap_err();
    assert!(
        error.to_string().starts_with("process `hog`: took"),
        "{error}"
    );
}
