//! SIGINT and SIGTERM: the emergency functions, then the end in order, and a report. Each system
//! runs in a program of its own.

#![cfg(unix)]

use crate::common;
use common::{Program, SpawnOk, end_by, exit_by, watchdog, with_signals};
use luna::Exit;
use luna::prelude::*;
use std::os::unix::process::ExitStatusExt;
use std::time::Duration;

const INTERRUPT: i32 = 2;
const TERMINATE: i32 = 15;

/// How long a second signal counts as the first one's echo.
const SAME_REQUEST: Duration = luna_machine::signals::SAME_REQUEST;

/// Says when its body and it itself ended.
struct Narrator {
    name: &'static str,
    ready: Option<Sender<()>>,
}

struct Saying(String);

impl Drop for Saying {
    fn drop(&mut self) {
        println!("{}", self.0);
    }
}

impl Process for Narrator {
    async fn run(&mut self) -> luna::Result<()> {
        let _body = Saying(format!("{} cancelled", self.name));
        let mut tick = luna::periodic(self.name, Duration::from_millis(1))?;
        for _ in 0..5 {
            tick.next().await;
        }
        if let Some(ready) = self.ready.take() {
            ready.send(()).await?;
        }
        loop {
            tick.next().await;
        }
    }

    fn post_run(&mut self) {
        println!("{} cleaned up", self.name);
    }
}

/// Two loops on an executor, and a thread that says "ready" when they have run.
fn looping_system() -> System {
    let mut system = System::new("looping");
    let control = system.executor("control").build().unwrap();
    let (ready, is_ready) = luna::channel();
    control.process("fast").spawn_ok(Narrator {
        name: "fast",
        ready: Some(ready.clone()),
    });
    control.process("slow").spawn_ok(Narrator {
        name: "slow",
        ready: Some(ready),
    });
    system
        .thread("console")
        .process("operator")
        .spawn_ok(async move {
            is_ready.recv().await?;
            is_ready.recv().await?;
            println!("ready");
            std::future::pending().await
        });
    system.on_emergency("first", || println!("function 1"));
    system.on_emergency("second", || println!("function 2"));
    system
}

/// What the child programs run; nothing when this program runs it as a test.
#[test]
fn part() {
    let Some(part) = common::part() else { return };
    let _watch = watchdog();
    match part.as_str() {
        "orderly" => {
            let report = looping_system().run().unwrap();
            assert!(
                report
                    .processes
                    .iter()
                    .all(|process| process.exit == Some(Exit::Cancelled)),
                "{report:?}"
            );
            assert!(report.loops.values().all(|one| one.cycles >= 5), "{report}");
            assert!(
                report.threads.iter().all(|thread| !thread.abandoned),
                "{report}"
            );
            exit_by(&report)
        }
        "hanging function" => {
            let mut system = looping_system();
            system.on_emergency("hanging", || {
                // From now on a second signal is a second request.
                std::thread::sleep(SAME_REQUEST);
                println!("hanging");
                loop {
                    std::thread::park();
                }
            });
            let _ = system.run();
        }
        "all hang" => {
            let mut system = looping_system();
            // The last one until the second signal ends the program.
            let limits = [1, 1, 1, 1, 1, 1, 1, 60_000];
            for limit in limits.map(Duration::from_millis) {
                system.on_emergency_within("hanging", limit, || {
                    println!("hanging");
                    loop {
                        std::thread::park();
                    }
                });
            }
            let _ = system.run();
        }
        "preparing" => {
            struct Slow(std::sync::mpsc::Receiver<()>);
            impl Process for Slow {
                fn pre_run(&mut self) -> luna::Result<()> {
                    println!("ready");
                    self.0.recv().unwrap();
                    Ok(())
                }
                async fn run(&mut self) -> luna::Result<()> {
                    println!("body");
                    Ok(())
                }
                fn post_run(&mut self) {
                    println!("cleaned up");
                }
            }
            let (functions_ran, have_run) = std::sync::mpsc::channel();
            let mut system = System::new("preparing");
            let control = system.executor("control").build().unwrap();
            control.process("slow").spawn_ok(Slow(have_run));
            system.thread("own").process("other").spawn_ok(async {
                println!("body");
                Ok(())
            });
            system.on_emergency("neutral", move || {
                println!("function 1");
                functions_ran.send(()).unwrap();
                // Time in which a body that was released would begin; only a failure needs it.
                std::thread::sleep(Duration::from_millis(200));
            });
            exit_by(&system.run().unwrap())
        }
        "afterwards" => {
            System::new("short").run().unwrap();
            println!("ready");
            loop {
                std::thread::park();
            }
        }
        other => panic!("no part {other}"),
    }
}

#[test]
fn the_functions_then_the_processes_then_the_report() {
    let Some(_watch) = with_signals() else { return };
    for (signal, name) in [(INTERRUPT, "SIGINT"), (TERMINATE, "SIGTERM")] {
        let ended = end_by("orderly", signal);
        assert_eq!(ended.status.code(), Some(70 + signal), "{ended:?}");
        let mut said = ended.said(&[
            "function 1",
            "function 2",
            "fast cancelled",
            "slow cancelled",
            "fast cleaned up",
            "slow cleaned up",
        ]);
        // Each once, the functions in order before anything else; `post_run` after its own body.
        assert_eq!(said.len(), 6, "{ended:?}");
        assert_eq!(said[..2], ["function 1", "function 2"], "{ended:?}");
        let place = |line: String| said.iter().position(|said| *said == line).unwrap();
        for name in ["fast", "slow"] {
            assert!(
                place(format!("{name} cancelled")) < place(format!("{name} cleaned up")),
                "{ended:?}"
            );
        }
        said.sort_unstable();
        said.dedup();
        assert_eq!(said.len(), 6, "{ended:?}");
        // The report says how it ended, and a row for each loop.
        assert!(
            ended
                .output
                .contains(&format!("system `looping`: ended by {name} after")),
            "{ended:?}"
        );
        for name in ["fast", "slow"] {
            assert!(
                ended
                    .output
                    .lines()
                    .any(|line| line.starts_with(name) && line.contains('|')),
                "{ended:?}"
            );
        }
    }
}

#[test]
fn a_second_one_ends_the_program_at_once() {
    let Some(_watch) = with_signals() else { return };
    for (first, second) in [
        (INTERRUPT, INTERRUPT),
        (TERMINATE, INTERRUPT),
        (INTERRUPT, TERMINATE),
    ] {
        let mut program = Program::start("hanging function");
        program.wait_for("ready");
        program.signal(first);
        assert_eq!(program.wait_for("hanging"), ["function 1", "function 2"]);
        program.signal(second);
        let ended = program.end();
        assert_eq!(ended.status.code(), Some(128 + second), "{ended:?}");
        assert_eq!(
            ended.said(&["fast cancelled", "fast cleaned up"]),
            [""; 0],
            "{ended:?}"
        );
    }
}

/// Also if no thread is left to run functions: the last one watches, and takes signals.
#[test]
fn a_second_one_ends_the_program_when_all_hang() {
    let Some(_watch) = with_signals() else { return };
    let mut program = Program::start("all hang");
    program.wait_for("ready");
    program.signal(INTERRUPT);
    for _ in 0..8 {
        program.wait_for("hanging");
    }
    std::thread::sleep(SAME_REQUEST);
    program.signal(TERMINATE);
    let ended = program.end();
    assert_eq!(ended.status.code(), Some(128 + TERMINATE), "{ended:?}");
}

#[test]
fn during_the_preparation_no_body_begins() {
    let Some(_watch) = with_signals() else { return };
    let ended = end_by("preparing", TERMINATE);
    assert_eq!(ended.status.code(), Some(70 + TERMINATE), "{ended:?}");
    assert_eq!(
        ended.said(&["function 1", "body", "cleaned up"]),
        ["function 1", "cleaned up"],
        "{ended:?}"
    );
}

#[test]
fn after_the_end_they_do_what_they_did_before() {
    let Some(_watch) = with_signals() else { return };
    let ended = end_by("afterwards", TERMINATE);
    assert_eq!(ended.status.signal(), Some(TERMINATE), "{ended:?}");
}
