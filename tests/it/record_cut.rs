//! Recorded runs that were cut short, by a signal or by being killed. Each system is recorded in a
//! program of its own.

#![cfg(unix)]

use crate::common;
use common::{Program, SpawnOk, TempFile, watchdog, with_signals};
use luna::prelude::*;
use luna::replay::{self, Recording};
use luna::{Buffer, End};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;

const FILE: &str = "LUNA_TEST_RECORDING";
const KILLED: i32 = Signal::SIGKILL as i32;

type Outputs = Arc<Mutex<Vec<(&'static str, u64)>>>;

fn give(outputs: &Outputs, name: &'static str, value: u64) {
    replay::output(name, &value);
    outputs.lock().unwrap().push((name, value));
}

/// Ends the recorded run; a replay does not come here.
fn end_the_run() {
    replay::input("end", || kill(Pid::this(), Signal::SIGTERM).is_ok());
}

const MILLISECOND: Duration = Duration::from_millis(1);

/// Waits over and over, and logs nothing that could have been otherwise.
async fn only_waits() -> luna::Result<()> {
    loop {
        luna::after(MILLISECOND).await;
    }
}

/// Counts, and ends the run after so many.
async fn counts(outputs: &Outputs, end: u64) -> luna::Result<()> {
    for number in 0.. {
        luna::after(MILLISECOND).await;
        give(outputs, "count", number);
        if number == end {
            end_the_run();
        }
    }
    Ok(())
}

fn network(name: &str, outputs: &Outputs) -> System {
    let mut system = System::new(name);
    let left = system.executor("left").build().unwrap();
    let right = system.executor("right").build().unwrap();
    let outputs = outputs.clone();
    match name {
        "a branch without events" => {
            let body = async move {
                par!(only_waits(), counts(&outputs, 5)).await?;
                Ok(())
            };
            left.process("main").spawn_ok(body);
        }
        "branches that take" => {
            let (values, taken) = luna::buffered::<u64>(Buffer::fifo(4));
            let source = async move {
                for number in 0.. {
                    values.send(number).await?;
                }
                Ok(())
            };
            left.process("source").spawn_ok(source);
            let out = outputs.clone();
            let body = async move {
                // So that the process itself has an operation before its branches.
                luna::after(MILLISECOND).await;
                let takes = async {
                    loop {
                        let value = taken.recv().await?;
                        give(&out, "taken", value);
                        luna::after(MILLISECOND / 2).await;
                    }
                };
                let ((), ()) = par!(takes, counts(&outputs, 5)).await?;
                Ok(())
            };
            right.process("worker").spawn_ok(body);
        }
        "constructs in turn" => {
            let body = async move {
                for round in 0.. {
                    let once = async {
                        luna::after(MILLISECOND).await;
                        Ok::<(), luna::Error>(())
                    };
                    let twice = async {
                        luna::after(MILLISECOND).await;
                        let inner = async {
                            luna::after(MILLISECOND).await;
                            give(&outputs, "inner", round);
                            Ok::<(), luna::Error>(())
                        };
                        par!(inner, async { Ok::<(), luna::Error>(()) }).await?;
                        Ok::<(), luna::Error>(())
                    };
                    par!(once, twice).await?;
                    if round == 5 {
                        end_the_run();
                    }
                }
                Ok(())
            };
            left.process("main").spawn_ok(body);
        }
        "one that only yields" => {
            let body = async move {
                for number in 0.. {
                    luna::yield_now().await;
                    give(&outputs, "number", number);
                    if number == 20 {
                        end_the_run();
                        break;
                    }
                }
                loop {
                    luna::yield_now().await;
                }
            };
            left.process("main").spawn_ok(body);
        }
        "killed" => {
            let body = async move {
                for number in 0..5 {
                    give(&outputs, "number", number);
                }
                luna::after(Duration::from_secs(1000)).await;
                Ok(())
            };
            left.process("main").spawn_ok(body);
        }
        other => panic!("no system `{other}`"),
    }
    system
}

#[test]
fn part() {
    let Some(part) = common::part() else { return };
    let _watch = watchdog();
    let outputs = Outputs::default();
    let mut system = network(&part, &outputs);
    let file = std::env::var_os(FILE).unwrap();
    let report = system.record(file).run().unwrap();
    assert_eq!(report.end, End::Signal(Signal::SIGTERM as i32));
    for (name, value) in outputs.lock().unwrap().iter() {
        println!("{name}={value}");
    }
    println!("recorded");
}

fn start(name: &str, file: &Path) -> Program {
    let mut command = std::process::Command::new(std::env::current_exe().unwrap());
    command.env(FILE, file);
    Program::start_by(command, &common::part_of_caller(), name)
}

/// Records a run that a signal ends, and replays it: the replay goes as far as the run had come,
/// and is ended then.
#[track_caller]
fn check(name: &str) {
    let Some(_watch) = with_signals() else { return };
    let file = TempFile::new(&name.replace(' ', "-"));
    let mut program = start(name, &file.0);
    let recorded = program.wait_for("recorded");
    let ended = program.end();
    assert!(ended.status.success(), "{ended:?}");
    let recording = Recording::open(&file.0).unwrap();
    assert!(recording.is_whole() && !recording.has_ended());
    for _ in 0..2 {
        let outputs = Outputs::default();
        network(name, &outputs).replay(&recording).run().unwrap();
        let outputs = std::mem::take(&mut *outputs.lock().unwrap());
        assert!(outputs.len() > 5);
        assert_eq!(outputs.len() as u64, recording.outputs());
        // Of each process the same; how two branches of one are interleaved is the same too.
        for (name, value) in &outputs {
            let line = format!("{name}={value}");
            let is_there = |said: &String| said.ends_with(&line);
            assert!(recorded.iter().any(is_there), "{line}: {recorded:?}");
        }
    }
}

#[test]
fn a_branch_that_only_waited_comes_as_far_as_it_had_come() {
    check("a branch without events");
}

#[test]
fn branches_that_take_what_others_send_come_as_far_as_they_had_come() {
    check("branches that take");
}

#[test]
fn constructs_that_came_after_one_another_are_gone_through() {
    check("constructs in turn");
}

#[test]
fn one_that_only_yields_does_not_go_on_for_ever() {
    check("one that only yields");
}

#[test]
fn the_file_of_a_program_that_was_killed_has_its_events() {
    let _watch = watchdog();
    let file = TempFile::new("killed");
    let program = start("killed", &file.0);
    // The program says nothing when it has written: that is seen in the file alone.
    while Recording::salvage(&file.0).map_or(0, |(recording, _)| recording.outputs()) < 5 {
        std::thread::yield_now();
    }
    program.signal(KILLED);
    program.end();
    let (recording, wrong) = Recording::salvage(&file.0).unwrap();
    assert_eq!((recording.system(), recording.outputs()), ("killed", 5));
    assert!(wrong.is_some() && !recording.is_whole());
    let outputs = Outputs::default();
    network("killed", &outputs)
        .replay(&recording)
        .run()
        .unwrap();
    let numbers: Vec<_> = outputs.lock().unwrap().iter().map(|&(_, n)| n).collect();
    assert_eq!(numbers, [0, 1, 2, 3, 4]);
}
