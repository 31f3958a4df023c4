//! `post_run` runs once, off the executor's thread, whatever ended the body.

use crate::common;
use common::{PLACEMENTS, SpawnOk, watchdog};
use luna::prelude::*;
use luna::{Error, Exit};
use std::sync::{Arc, Mutex};
use std::thread::ThreadId;

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
        assert!(!luna::realtime::on_path());
        self.traces.lock().unwrap().pre_run = Some(std::thread::current().id());
        Ok(())
    }

    async fn run(&mut self) -> luna::Result<()> {
        assert!(luna::realtime::on_path());
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
        assert!(!luna::realtime::on_path());
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
    for place in PLACEMENTS {
        for ending in [
            Ending::Returns,
            Ending::Fails,
            Ending::Panics,
            Ending::IsCancelled,
        ] {
            let traces = Arc::new(Mutex::new(Traces::default()));
            let mut system = System::new("traced");
            let process = place.process(&mut system, "place of traced", "traced");
            let id = process.spawn_ok(Traced {
                ending,
                traces: traces.clone(),
            });
            if ending == Ending::IsCancelled {
                let other = system.executor("other").build().unwrap();
                let own = other.clone();
                other.process("canceller").spawn_ok(async move {
                    let handle = own.process_handle(id).unwrap();
                    while handle.state() != luna::process::ProcessState::Waiting {
                        luna::after(std::time::Duration::from_micros(100)).await;
                    }
                    handle.cancel();
                    assert_eq!(handle.join().await, Exit::Cancelled);
                    Ok(())
                });
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

/// Panics as it is cleaned up, in `post_run` or in its drop.
struct Untidy {
    in_drop: bool,
    body: luna::Result<()>,
}

impl Process for Untidy {
    async fn run(&mut self) -> luna::Result<()> {
        self.body.clone()
    }

    fn post_run(&mut self) {
        assert!(self.in_drop, "in post_run");
    }
}

impl Drop for Untidy {
    fn drop(&mut self) {
        assert!(std::thread::panicking() || !self.in_drop, "in the drop");
    }
}

#[test]
fn a_panic_while_cleaning_up_is_the_runs_error_and_ends_nobody_else() {
    let _watch = watchdog();
    for place in PLACEMENTS {
        for (in_drop, body, expected) in [
            (false, Ok(()), "process `untidy`: panicked: in post_run"),
            (true, Ok(()), "process `untidy`: panicked: in the drop"),
            // What the body says is graver.
            (
                false,
                Err(Error::Timeout),
                "process `untidy`: the time ran out",
            ),
        ] {
            let traces = Arc::new(Mutex::new(Traces::default()));
            let mut system = System::new("untidy");
            let (done, is_done) = luna::channel::<()>();
            let untidy = place.process(&mut system, "place of untidy", "untidy");
            let id = untidy.spawn_ok(Untidy { in_drop, body });
            let other = system.executor("other").build().unwrap();
            let own = other.clone();
            other.process("goes on").spawn_ok(async move {
                own.process_handle(id).unwrap().join().await;
                done.send(()).await?;
                Ok(())
            });
            system
                .thread("place of traced")
                .process("traced")
                .spawn_ok(async move {
                    is_done.recv().await?;
                    Ok(())
                });
            other.process("tidy").spawn_ok(Traced {
                ending: Ending::Returns,
                traces: traces.clone(),
            });
            let error = system.run().unwrap_err();
            assert_eq!(error.to_string(), expected, "{place:?}");
            let report = system.report().unwrap();
            assert_eq!(report.end, luna::End::Completed);
            for process in &report.processes {
                assert_eq!(process.exit, Some(Exit::Completed), "{}", process.name);
            }
            assert_eq!(traces.lock().unwrap().post_runs, 1);
        }
    }
}
