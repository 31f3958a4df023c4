//! The three phases of processes: all `pre_run` before any body, `post_run` after its own body and
//! off the executor's thread.

use crate::common;
use common::{PLACEMENTS, SpawnOk, watchdog};
use luna::prelude::*;

use std::sync::{Arc, Mutex};

/// What happened, in order: the phase and the process.
type Log = Arc<Mutex<Vec<(&'static str, String)>>>;

fn log(log: &Log, phase: &'static str, name: &str) {
    log.lock().unwrap().push((phase, name.to_owned()));
}

/// Logs its phases.
struct Logger {
    name: String,
    log: Log,
}

impl Process for Logger {
    fn pre_run(&mut self) -> luna::Result<()> {
        log(&self.log, "pre", &self.name);
        Ok(())
    }

    async fn run(&mut self) -> luna::Result<()> {
        log(&self.log, "run", &self.name);
        luna::yield_now().await;
        Ok(())
    }

    fn post_run(&mut self) {
        log(&self.log, "post", &self.name);
    }
}

impl Drop for Logger {
    fn drop(&mut self) {
        log(&self.log, "drop", &self.name);
    }
}

#[test]
fn every_pre_run_ends_before_any_run_begins() {
    let _watch = watchdog();
    for _ in 0..20 {
        let events = Log::default();
        let mut system = System::new("phases");
        let mut names = Vec::new();
        for executor in ["left", "middle", "right"] {
            let on = system.executor(executor).build().unwrap();
            for (number, level) in [(1, 31), (2, 0), (3, 16)] {
                let name = format!("{executor} {number}");
                on.process(&name).priority(level).spawn_ok(Logger {
                    name: name.clone(),
                    log: events.clone(),
                });
                names.push(name);
            }
        }
        for name in ["own", "other"] {
            system.thread(name).process(name).spawn_ok(Logger {
                name: name.to_owned(),
                log: events.clone(),
            });
            names.push(name.to_owned());
        }
        system.run().unwrap();

        let events = events.lock().unwrap();
        let prepared: Vec<_> = events.iter().take(names.len()).collect();
        let expected: Vec<_> = names.iter().map(|name| ("pre", name.clone())).collect();
        assert_eq!(
            prepared,
            expected.iter().collect::<Vec<_>>(),
            "in the order of spawning"
        );
        for name in &names {
            let of_it: Vec<_> = events
                .iter()
                .filter(|(_, of)| of == name)
                .map(|(phase, _)| *phase)
                .collect();
            assert_eq!(of_it, ["pre", "run", "post", "drop"], "{name}");
        }
    }
}

/// Tells its partner when its body is over, from `post_run`.
struct Announcer {
    ended: Sender<()>,
}

impl Process for Announcer {
    async fn run(&mut self) -> luna::Result<()> {
        Ok(())
    }

    fn post_run(&mut self) {
        self.ended.blocking_send(()).unwrap();
    }
}

#[test]
fn post_run_runs_when_its_own_body_has_ended_while_others_run() {
    let _watch = watchdog();
    for place in PLACEMENTS {
        let (ended, announced) = luna::channel();
        let mut system = System::new("announced");
        place
            .process(&mut system, "first", "announcer")
            .spawn_ok(Announcer { ended });
        let second = system.executor("second").build().unwrap();
        // Runs until the other's post_run: if that waited for the end of the system, neither would
        // end.
        second
            .process("listener")
            .spawn_ok(async move { Ok(announced.recv().await?) });
        assert_eq!(system.run().unwrap().end, luna::End::Completed, "{place:?}");
    }
}

#[test]
fn a_process_is_dropped_after_its_post_run_and_its_channels_end_with_it() {
    let _watch = watchdog();
    struct Holder {
        _output: Sender<()>,
        log: Log,
    }
    impl Process for Holder {
        async fn run(&mut self) -> luna::Result<()> {
            Ok(())
        }
        fn post_run(&mut self) {
            log(&self.log, "post", "holder");
        }
    }
    for place in PLACEMENTS {
        let events = Log::default();
        let (output, input) = luna::channel::<()>();
        let mut system = System::new("held");
        place
            .process(&mut system, "first", "holder")
            .spawn_ok(Holder {
                _output: output,
                log: events.clone(),
            });
        let own = events.clone();
        let second = system.executor("second").build().unwrap();
        second.process("listener").spawn_ok(async move {
            assert!(input.recv().await.unwrap_err().is_closed());
            log(&own, "closed", "listener");
            Ok(())
        });
        system.run().unwrap();
        let events: Vec<_> = events
            .lock()
            .unwrap()
            .iter()
            .map(|(phase, _)| *phase)
            .collect();
        assert_eq!(events, ["post", "closed"], "{place:?}");
    }
}

#[test]
fn a_system_without_processes_ends_at_once() {
    let _watch = watchdog();
    let mut system = System::new("empty");
    system.executor("idle").build().unwrap();
    let report = system.run().unwrap();
    assert_eq!(
        (report.end, report.processes.len(), report.threads.len()),
        (luna::End::Completed, 0, 1)
    );
}

/// What registering a signal says.
fn register(name: &str) -> Option<String> {
    let signal = Signal::<f64>::register(name).err();
    signal.map(|error| error.to_string())
}

fn refused(name: &str) -> Option<String> {
    Some(format!(
        "signal `{name}` was registered outside of `pre_run`; declare it where its process is spawned (`process.signal({name:?})`), or register it in `pre_run` of the process (`impl luna::Process`)"
    ))
}

/// Registers in each of its phases.
struct Registrar {
    name: &'static str,
    seen: Arc<Mutex<Vec<Option<String>>>>,
}

impl Registrar {
    fn note(&self) {
        self.seen.lock().unwrap().push(register(self.name));
    }
}

impl Process for Registrar {
    fn pre_run(&mut self) -> luna::Result<()> {
        self.note();
        Ok(())
    }

    async fn run(&mut self) -> luna::Result<()> {
        self.note();
        luna::yield_now().await;
        self.note();
        Ok(())
    }

    fn post_run(&mut self) {
        self.note();
    }
}

#[test]
fn signals_are_registered_in_pre_run_alone() {
    let _watch = watchdog();
    assert_eq!(register("in main"), refused("in main"));
    luna::run(async {
        assert_eq!(register("in run"), refused("in run"));
        Ok(())
    })
    .unwrap();
    for place in PLACEMENTS {
        for is_virtual in [false, true] {
            let mut system = System::new("registering");
            if is_virtual {
                system.virtual_clock();
            }
            assert_eq!(register("described"), refused("described"));
            let seen = ["first", "late"].map(|name| {
                let seen = Arc::default();
                let registrar = Registrar {
                    name,
                    seen: Arc::clone(&seen),
                };
                (registrar, seen)
            });
            let [(first, of_first), (late, of_late)] = seen;
            place.process(&mut system, "one", "first").spawn_ok(first);
            let spawner = system.executor("two").build().unwrap();
            let own = spawner.clone();
            spawner.process("spawner").spawn_ok(move || {
                assert_eq!(register("in a closure"), refused("in a closure"));
                async move {
                    own.process("late").spawn(late)?;
                    assert_eq!(register("in a block"), refused("in a block"));
                    own.process("made here").spawn(|| {
                        assert_eq!(register("made here"), refused("made here"));
                        async { Ok(()) }
                    })?;
                    Ok(())
                }
            });
            drop(spawner);
            system.run().unwrap();
            for (name, seen) in [("first", of_first), ("late", of_late)] {
                let expected = [None, refused(name), refused(name), refused(name)];
                assert_eq!(*seen.lock().unwrap(), expected, "{place:?}, {is_virtual}");
            }
        }
    }
}
