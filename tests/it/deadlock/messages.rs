//! What a deadlock prints on standard error.

use super::*;
use crate::common::SpawnOk;

pub(super) fn run_stuck(is_alone: bool) {
    if is_alone {
        let (a, from_a) = luna::channel::<u32>();
        let a = a.named("own");
        println!("ready");
        let _ = luna::run(async move {
            from_a.recv().await?;
            drop(a);
            Ok(())
        });
        return;
    }
    let mut system = System::new("said");
    let left = system.executor("l").build().unwrap().process("left");
    let right = system.thread("r").process("right");
    spawn_two_that_receive_first(left, right);
    println!("ready");
    let report = system.run().unwrap();
    println!("{:?}", report.end);
    println!("found: {}", report.deadlock.is_some());
}

/// Reads the program's standard error until it contains `wanted`; returns all of it.
#[cfg(unix)]
fn errors_until(program: &mut Program, wanted: &str) -> String {
    let mut said = String::new();
    while !said.contains(wanted) {
        let line = program.error_line();
        assert!(
            !line.is_empty(),
            "it ended without saying `{wanted}`, but: {said}"
        );
        said.push_str(&line);
    }
    said
}

/// Without `strict` it waits on, and a signal ends it as usual.
#[cfg(unix)]
#[test]
fn it_is_said_once_and_the_system_waits_on() {
    let Some(_watch) = common::with_signals() else {
        return;
    };
    let mut program = Program::start("system");
    program.wait_for("ready");
    let last = if COMPLETE {
        "let one send first"
    } else {
        "external()"
    };
    let said = errors_until(&mut program, last);
    // Time for more, were there more to come.
    std::thread::sleep(LONG);
    program.signal(15);
    let ended = program.end();
    let all = said + &ended.errors;
    assert_eq!(all.matches("is deadlocked").count(), 1, "{all}");
    assert!(
        all.contains("`left` waits to receive from channel `to left`"),
        "{all}"
    );
    assert!(ended.output.contains("Signal(15)"), "{ended:?}");
    assert!(ended.output.contains("found: true"), "{ended:?}");
}

#[cfg(unix)]
#[test]
fn a_body_without_a_system_says_so_too() {
    let _watchdog = watchdog();
    let mut program = Program::start("alone");
    program.wait_for("ready");
    let said = errors_until(&mut program, "own");
    assert!(said.contains("the body of luna::run waits"), "{said}");
    assert!(
        said.contains(
            "`main` waits to receive from channel `own`, whose other end nobody has used yet"
        ),
        "{said}"
    );
    program.signal(9);
    let all = said + &program.end().errors;
    assert_eq!(all.matches("luna::run waits").count(), 1, "{all}");
}

/// What a system does when a thread outside of it has ended its deadlock.
#[cfg(unix)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Then {
    Ends,
    GoesOn,
    IsStuckAgain,
}

/// A system that is stuck until its standard input is closed. Its channel is not marked as
/// external.
#[cfg(unix)]
pub(super) fn run_revived(then: Then) {
    let (revive, revived) = luna::channel::<()>();
    let (_keep, never) = luna::channel::<()>();
    std::thread::spawn(move || {
        std::io::copy(&mut std::io::stdin(), &mut std::io::sink()).unwrap();
        revive.blocking_send(()).unwrap();
    });
    let mut system = System::new("revived");
    let main = system.executor("main").build().unwrap();
    main.process("process").spawn_ok(async move {
        revived.recv().await?;
        println!("goes on");
        match then {
            Then::Ends => {}
            Then::GoesOn => {
                let mut tick = luna::periodic("loop", Duration::from_millis(1))?;
                loop {
                    tick.next().await;
                }
            }
            Then::IsStuckAgain => never.recv().await?,
        }
        Ok(())
    });
    println!("ready");
    let report = system.run().unwrap();
    println!("found: {}", report.deadlock.is_some());
}

/// What is printed about such a system, and about its deadlock at the end.
#[cfg(unix)]
fn revived(then: &str) -> (String, String) {
    let mut program = Program::start(then);
    program.wait_for("ready");
    let mut said = errors_until(&mut program, "external()");
    program.close_input();
    program.wait_for("goes on");
    if then == "stuck again" {
        said += &errors_until(&mut program, "external()");
    }
    if then != "ends" {
        program.signal(15);
    }
    let ended = program.end();
    (said + &ended.errors, ended.output)
}

#[cfg(unix)]
#[test]
fn a_system_that_has_gone_on_is_not_called_deadlocked_at_its_end() {
    let Some(_watch) = common::with_signals() else {
        return;
    };
    for then in ["ends", "goes on"] {
        let (said, output) = revived(then);
        assert_eq!(said.matches("is deadlocked").count(), 1, "{said}");
        assert!(output.contains("found: false"), "{then}: {output}");
    }
}

#[cfg(unix)]
#[test]
fn a_second_deadlock_is_told_too() {
    let Some(_watch) = common::with_signals() else {
        return;
    };
    let (said, output) = revived("stuck again");
    assert_eq!(said.matches("is deadlocked").count(), 2, "{said}");
    assert!(output.contains("found: true"), "{output}");
}
