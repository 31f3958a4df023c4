//! The three phases of processes: all `pre_run` before any body, `post_run` after its own body and off the executor's thread.

mod common;

use common::{PLACES, Place, watchdog};
use luna::prelude::*;
use luna::{Error, Exit};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::ThreadId;

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
                on.process(&name)
                    .priority(level)
                    .spawn(Logger {
                        name: name.clone(),
                        log: events.clone(),
                    })
                    .unwrap();
                names.push(name);
            }
        }
        for name in ["own", "other"] {
            system
                .thread(name)
                .process(name)
                .spawn(Logger {
                    name: name.to_owned(),
                    log: events.clone(),
                })
                .unwrap();
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
    for place in PLACES {
        let (ended, announced) = luna::channel();
        let mut system = System::new("announced");
        place
            .process(&mut system, "first", "announcer")
            .spawn(Announcer { ended })
            .unwrap();
        let second = system.executor("second").build().unwrap();
        // Runs until the other's post_run: if that waited for the end of the system, neither would end.
        second
            .process("listener")
            .spawn(async move { Ok(announced.recv().await?) })
            .unwrap();
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
    for place in PLACES {
        let events = Log::default();
        let (output, input) = luna::channel::<()>();
        let mut system = System::new("held");
        place
            .process(&mut system, "first", "holder")
            .spawn(Holder {
                _output: output,
                log: events.clone(),
            })
            .unwrap();
        let own = events.clone();
        let second = system.executor("second").build().unwrap();
        second
            .process("listener")
            .spawn(async move {
                assert!(input.recv().await.unwrap_err().is_closed());
                log(&own, "closed", "listener");
                Ok(())
            })
            .unwrap();
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

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Ending {
    Returns,
    Fails,
    Panics,
    IsCancelled,
}

/// Where its phases ran, and how often.
#[derive(Default)]
struct Traces {
    pre_run: Option<ThreadId>,
    run: Option<(ThreadId, Option<String>)>,
    body_drops: usize,
    post_run: Option<ThreadId>,
    post_runs: usize,
    drops: usize,
}

struct Traced {
    ending: Ending,
    traces: Arc<Mutex<Traces>>,
}

/// Counts the body's end.
struct InBody(Arc<Mutex<Traces>>);

impl Drop for InBody {
    fn drop(&mut self) {
        let mut traces = self.0.lock().unwrap();
        assert_eq!(traces.post_runs, 0, "the body has ended before post_run");
        traces.body_drops += 1;
    }
}

impl Process for Traced {
    fn pre_run(&mut self) -> luna::Result<()> {
        assert!(!luna::on_path());
        self.traces.lock().unwrap().pre_run = Some(std::thread::current().id());
        Ok(())
    }

    async fn run(&mut self) -> luna::Result<()> {
        assert!(luna::on_path());
        let _in_body = InBody(self.traces.clone());
        let thread = std::thread::current();
        self.traces.lock().unwrap().run = Some((thread.id(), thread.name().map(str::to_owned)));
        match self.ending {
            Ending::Returns => Ok(()),
            Ending::Fails => Err(Error::other("on purpose")),
            Ending::Panics => panic!("on purpose"),
            Ending::IsCancelled => std::future::pending().await,
        }
    }

    fn post_run(&mut self) {
        assert!(!luna::on_path());
        let mut traces = self.traces.lock().unwrap();
        traces.post_run = Some(std::thread::current().id());
        traces.post_runs += 1;
    }
}

impl Drop for Traced {
    fn drop(&mut self) {
        let mut traces = self.traces.lock().unwrap();
        assert_eq!(traces.post_runs, 1);
        traces.drops += 1;
    }
}

#[test]
fn post_run_runs_once_off_the_executors_thread_whatever_ended_the_body() {
    let _watch = watchdog();
    for place in PLACES {
        for ending in [
            Ending::Returns,
            Ending::Fails,
            Ending::Panics,
            Ending::IsCancelled,
        ] {
            let traces = Arc::new(Mutex::new(Traces::default()));
            let mut system = System::new("traced");
            let process = place.process(&mut system, "place of traced", "traced");
            let id = process
                .spawn(Traced {
                    ending,
                    traces: traces.clone(),
                })
                .unwrap();
            if ending == Ending::IsCancelled {
                let other = system.executor("other").build().unwrap();
                let own = other.clone();
                other
                    .process("canceller")
                    .spawn(async move {
                        let handle = own.process_handle(id).unwrap();
                        while handle.state() != luna::ProcessState::Waiting {
                            luna::after(std::time::Duration::from_micros(100)).await;
                        }
                        handle.cancel();
                        assert_eq!(handle.join().await, Exit::Cancelled);
                        Ok(())
                    })
                    .unwrap();
            }
            let outcome = system.run();

            let expected = match ending {
                Ending::Returns => None,
                Ending::Fails => Some("process `traced`: on purpose"),
                Ending::Panics => Some("process `traced`: panicked: on purpose"),
                Ending::IsCancelled => {
                    Some("process `traced`: cancelled before its body had ended")
                }
            };
            assert_eq!(
                outcome.err().map(|error| error.to_string()).as_deref(),
                expected,
                "{place:?} {ending:?}"
            );
            let here = Some(std::thread::current().id());
            let traces = traces.lock().unwrap();
            let (ran_on, name) = traces.run.clone().unwrap();
            assert_eq!(name.as_deref(), Some("place of traced"));
            assert_ne!(Some(ran_on), here);
            assert_eq!(
                (traces.pre_run, traces.post_run),
                (here, here),
                "{place:?} {ending:?}"
            );
            assert_eq!(
                (traces.body_drops, traces.post_runs, traces.drops),
                (1, 1, 1),
                "{place:?} {ending:?}"
            );
        }
    }
}

#[test]
fn a_post_run_that_panics_does_not_keep_the_others_from_theirs() {
    let _watch = watchdog();
    struct Counts(Arc<AtomicUsize>);
    impl Process for Counts {
        async fn run(&mut self) -> luna::Result<()> {
            Ok(())
        }
        fn post_run(&mut self) {
            self.0.fetch_add(1, Ordering::Relaxed);
            panic!("in post_run, on purpose");
        }
    }
    impl Drop for Counts {
        fn drop(&mut self) {
            self.0.fetch_add(100, Ordering::Relaxed);
        }
    }
    let count = Arc::new(AtomicUsize::new(0));
    let mut system = System::new("untidy");
    for name in ["a", "b", "c"] {
        Place::Thread
            .process(&mut system, name, name)
            .spawn(Counts(count.clone()))
            .unwrap();
    }
    system.run().unwrap();
    assert_eq!(count.load(Ordering::Relaxed), 303);
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
