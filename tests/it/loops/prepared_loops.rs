//! Loops that are made in `pre_run`: they begin with the bodies, not when they are made.

use crate::common::{PLACEMENTS, SpawnOk, burn_until, watchdog};
use luna::prelude::*;
use luna::time::Cycle;
use luna::{Instant, Parameter, Periodic};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const PERIOD: Duration = Duration::from_millis(2);

/// How long each `pre_run` takes behind its loop.
const PREPARING: Duration = Duration::from_millis(7);

/// When a body began, and its first cycles.
#[derive(Default)]
struct Seen {
    prepared: Option<Instant>,
    body: Option<Instant>,
    cycles: Vec<Cycle>,
    now: Option<Instant>,
}

impl Seen {
    /// Where slot 0 lies, from each cycle.
    fn origins(&self) -> Vec<u64> {
        let origin = |one: &Cycle| one.deadline.as_nanos() - one.number * PERIOD.as_nanos() as u64;
        self.cycles.iter().map(origin).collect()
    }
}

type Make = fn(&str) -> luna::Result<Periodic>;

struct Prepared {
    name: String,
    make: Make,
    tick: Option<Periodic>,
    seen: Arc<Mutex<Seen>>,
}

impl Process for Prepared {
    fn pre_run(&mut self) -> luna::Result<()> {
        self.tick = Some((self.make)(&self.name)?);
        burn_until(luna::now() + PREPARING);
        self.seen.lock().unwrap().prepared = Some(luna::now());
        Ok(())
    }

    async fn run(&mut self) -> luna::Result<()> {
        self.seen.lock().unwrap().body = Some(luna::now());
        let tick = self.tick.as_mut().unwrap();
        for _ in 0..3 {
            let cycle = tick.next().await;
            let now = luna::now();
            assert!(now >= cycle.deadline && cycle.lateness < PERIOD);
            let mut seen = self.seen.lock().unwrap();
            seen.cycles.push(cycle);
            seen.now = Some(now);
        }
        Ok(())
    }
}

fn plain(name: &str) -> luna::Result<Periodic> {
    luna::periodic(name, PERIOD)
}

fn in_phase(name: &str) -> luna::Result<Periodic> {
    luna::periodic(name, PERIOD)?.phase(PERIOD / 4)
}

fn corrected(name: &str) -> luna::Result<Periodic> {
    let mut tick = luna::periodic(name, PERIOD)?;
    assert_eq!(tick.correct(400), 400);
    Ok(tick)
}

#[test]
fn loops_made_in_pre_run_begin_together_when_the_bodies_do() {
    let _watch = watchdog();
    let mut system = super::system("prepared");
    let mut all = Vec::new();
    for place in PLACEMENTS {
        let kinds: [(_, Make, _); 3] = [
            ("plain", plain, 0),
            ("in phase", in_phase, PERIOD.as_nanos() as u64 / 4),
            ("corrected", corrected, 400),
        ];
        for (kind, make, behind) in kinds {
            let name = format!("{kind} on {place:?}");
            let seen = Arc::<Mutex<Seen>>::default();
            all.push((behind, seen.clone(), name.clone()));
            let process = place.process(&mut system, &name, &name);
            process.spawn_ok(Prepared {
                name: name.clone(),
                make,
                tick: None,
                seen,
            });
        }
    }
    let report = system.run().unwrap();
    let prepared = all
        .iter()
        .map(|(_, seen, _)| seen.lock().unwrap().prepared.unwrap());
    let last_prepared = prepared.max().unwrap().as_nanos();
    let bodies = all
        .iter()
        .map(|(_, seen, _)| seen.lock().unwrap().body.unwrap());
    let first_body = bodies.min().unwrap().as_nanos();
    let (behind, seen, _) = &all[0];
    let common_start = seen.lock().unwrap().origins()[0] - behind;
    for (behind, seen, name) in &all {
        let seen = seen.lock().unwrap();
        for origin in seen.origins() {
            let start = origin - behind;
            assert!(
                last_prepared <= start && start <= first_body,
                "{name}: {last_prepared} <= {start} <= {first_body}"
            );
            assert_eq!(start, common_start, "{name}");
        }
        let one = &report.loops[name];
        assert_eq!(one.cycles, 3);
        assert_eq!(one.cycles + one.missed, one.slots_elapsed, "{name}");
    }
}

#[test]
fn a_loop_of_a_process_that_comes_later_begins_with_its_body() {
    let _watch = watchdog();
    for place in PLACEMENTS {
        let seen = Arc::<Mutex<Seen>>::default();
        let mut system = super::system("later");
        let main = system.executor("main").build().unwrap();
        let later = place.process(&mut system, "place", "later");
        let process = Prepared {
            name: "later".to_owned(),
            make: plain,
            tick: None,
            seen: seen.clone(),
        };
        main.process("parent").spawn_ok(async move {
            later.spawn(process)?;
            // A loop that is made on this thread after a `pre_run` belongs to the process that
            // makes it.
            let mut own = luna::periodic("own", PERIOD)?;
            burn_until(luna::now() + PERIOD * 4);
            assert!(own.next().await.number >= 3);
            Ok(())
        });
        system.run().unwrap();
        let seen = seen.lock().unwrap();
        let begun = seen.body.unwrap().as_nanos();
        match super::timers() {
            // The grid of its period.
            luna::time::Timers::Manager => {
                assert!(begun <= seen.cycles[0].deadline.as_nanos());
            }
            _ => assert!(seen.origins()[0] >= begun),
        }
        assert!(seen.cycles[2].deadline <= seen.now.unwrap());
    }
}

#[test]
fn names_and_room_are_those_of_the_system() {
    let _watch = watchdog();
    let mut system = super::system("twice");
    let main = system.executor("main").build().unwrap();
    for name in ["one", "two"] {
        main.process(name).spawn_ok(Prepared {
            name: "the same".to_owned(),
            make: plain,
            tick: None,
            seen: Arc::default(),
        });
    }
    let error = system.run().unwrap_err().to_string();
    assert!(
        error.contains("process `two`") && error.contains("there is loop `the same` already"),
        "{error}"
    );
    // And this thread is out of the system again.
    assert!(luna::periodic("outside", PERIOD).is_err());
}

/// A process that takes a parameter at each of its cycles.
struct Tuned {
    gain: Parameter<u32>,
    tick: Option<Periodic>,
    last: u32,
}

impl Process for Tuned {
    fn pre_run(&mut self) -> luna::Result<()> {
        self.tick = Some(luna::periodic("tuned", PERIOD)?);
        // What runs meanwhile on this thread by itself is no process of the system.
        luna::run(async {
            let mut tick = luna::periodic("tuned", Duration::from_millis(1))?;
            assert!(tick.next().await.number >= 1);
            Ok(())
        })
    }

    async fn run(&mut self) -> luna::Result<()> {
        let Some(tick) = &mut self.tick else {
            return Err(luna::Error::other("it was not prepared"));
        };
        while self.gain.get() != self.last {
            tick.next().await;
        }
        Ok(())
    }
}

#[test]
fn a_loop_made_in_pre_run_takes_the_parameters_of_its_process() {
    let _watch = watchdog();
    let mut system = super::system("tuned");
    let main = system.executor("main").build().unwrap();
    let parameters = system.parameters();
    let tuned = main.process("tuned");
    let gain = tuned.parameter("gain", 1).register().unwrap();
    tuned.spawn_ok(Tuned {
        gain,
        tick: None,
        last: 7,
    });
    main.process("operator").spawn_ok(async move {
        parameters.set([("gain", 7)])?;
        Ok(())
    });
    system.run().unwrap();
}

#[test]
fn on_a_virtual_clock_the_first_slot_is_a_period_behind_the_start() {
    let _watch = watchdog();
    let seen = Arc::<Mutex<Vec<(u64, Duration)>>>::default();
    struct Exact(Option<Periodic>, Arc<Mutex<Vec<(u64, Duration)>>>);
    impl Process for Exact {
        fn pre_run(&mut self) -> luna::Result<()> {
            self.0 = Some(luna::periodic("exact", PERIOD)?);
            Ok(())
        }

        async fn run(&mut self) -> luna::Result<()> {
            let begun = luna::now();
            let tick = self.0.as_mut().unwrap();
            for _ in 0..2 {
                let cycle = tick.next().await;
                let mut seen = self.1.lock().unwrap();
                seen.push((cycle.number, luna::now() - begun));
            }
            Ok(())
        }
    }
    let mut system = super::system("exact");
    system.virtual_clock();
    let main = system.executor("main").build().unwrap();
    main.process("exact").spawn_ok(Exact(None, seen.clone()));
    system.run().unwrap();
    assert_eq!(*seen.lock().unwrap(), [(1, PERIOD), (2, PERIOD * 2)]);
}
