//! A function that hangs on the core of a real-time thread, with no other worker woken there: the
//! watching thread finds it all the same. Alone in this program, and one after the other: another
//! system would wake the watching thread.

use crate::common;
use common::SpawnOk;
use luna::Error;
use luna::prelude::*;
use luna::report::FunctionOutcome;
use std::sync::mpsc;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

const SHORT: Duration = Duration::from_millis(20);

/// Longer than the watchdog waits.
const HOUR: Duration = Duration::from_secs(3600);

static ALONE: Mutex<()> = Mutex::new(());

fn alone() -> MutexGuard<'static, ()> {
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Hangs until it is released, so that no thread of a test stays for ever.
fn hang() -> (impl FnMut() + Send + 'static, mpsc::Sender<()>) {
    let (let_go, is_let_go) = mpsc::channel::<()>();
    let hangs = move || {
        // Until the sender is dropped.
        let _ = is_let_go.recv();
    };
    (hangs, let_go)
}

/// Raises an emergency on a real-time thread of a core, and says what became of the functions.
fn raise(system: &mut System) -> Vec<FunctionOutcome> {
    let core = luna_platform::thread::available_cores()[0];
    let executor = system.executor("control").core(core);
    let executor = executor.policy(Policy::fifo(50)).build().unwrap();
    executor.process("raiser").spawn_ok(async {
        let _raised = luna::emergency(Error::other("now"));
        // The functions alone end the run.
        std::future::pending().await
    });
    system.run().unwrap_err();
    let safety = system.report().unwrap().safety;
    safety.functions.iter().map(|one| one.outcome).collect()
}

#[test]
fn it_is_left_behind_though_nothing_else_happens() {
    own_process!();
    let _alone = alone();
    let mut system = System::new("hanging");
    let (hangs, let_go) = hang();
    system.on_emergency_within("hangs", SHORT, hangs);
    system.on_emergency_within("last", HOUR, || ());
    use FunctionOutcome::{LeftBehind, Ran};
    assert_eq!(raise(&mut system), [LeftBehind, Ran]);
    drop(let_go);
}

/// The watching thread would sleep for an hour.
#[test]
fn one_that_is_registered_while_others_run_is_watched_by_its_own_limit() {
    own_process!();
    let _alone = alone();
    let mut system = System::new("late and short");
    let (hangs, let_go) = hang();
    let safety = system.safety();
    let mut late = Some(hangs);
    system.on_emergency_within("first", HOUR, move || {
        let hangs = late.take().unwrap();
        safety.on_emergency("hangs", SHORT, hangs).unwrap();
        safety.on_emergency("last", HOUR, || ()).unwrap();
    });
    use FunctionOutcome::{LeftBehind, Ran};
    assert_eq!(raise(&mut system), [Ran, LeftBehind, Ran]);
    drop(let_go);
}
