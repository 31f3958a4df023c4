//! What is said on standard error.

use super::*;

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

/// Reads what the program says on standard error until `wanted` was said there; gives it all.
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
    let _watchdog = watchdog();
    if common::has_no_signals() {
        return;
    }
    let mut program = Program::start("system");
    program.wait_for("ready");
    let said = errors_until(&mut program, "external()");
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
