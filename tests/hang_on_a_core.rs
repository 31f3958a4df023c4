//! A function that hangs where nobody else was woken, on the core of a real-time thread: the timer finds it. Alone in its program, in which another system would wake who watches.

mod common;

use common::watchdog;
use luna::prelude::*;
use luna::{Error, FunctionOutcome};
use std::sync::mpsc;
use std::time::Duration;

#[test]
fn it_is_left_behind_though_nothing_else_happens() {
    let _watch = watchdog();
    let core = luna_platform::thread::available_cores()[0];
    let mut system = System::new("hanging");
    let (let_go, is_let_go) = mpsc::channel::<()>();
    system.on_emergency_within("hangs", Duration::from_millis(20), move || {
        // Until the sender is dropped.
        let _ = is_let_go.recv();
    });
    system.on_emergency("last", || ());
    let executor = system.executor("control").core(core);
    let executor = executor.policy(Policy::fifo(50)).build().unwrap();
    executor
        .process("raiser")
        .spawn(async {
            let _raised = luna::emergency(Error::other("now"));
            // The functions alone end the run.
            std::future::pending().await
        })
        .unwrap();
    system.run().unwrap_err();
    let safety = system.report().unwrap().safety;
    let outcomes: Vec<_> = safety.functions.iter().map(|one| one.outcome).collect();
    use FunctionOutcome::{LeftBehind, Ran};
    assert_eq!(outcomes, [LeftBehind, Ran]);
    drop(let_go);
}
