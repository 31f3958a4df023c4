//! Blocking calls of processes that share an executor.

use crate::common;
use common::{PLACEMENTS, SpawnOk, in_process, watchdog};
use luna::prelude::*;
use luna::{Error, Exit};

#[test]
fn a_call_runs_on_an_ordinary_thread_of_its_own() {
    let _watch = watchdog();
    for place in PLACEMENTS {
        let mut system = System::new("where");
        let process = place.process(&mut system, "place", "calling");
        process.spawn_ok(async {
            let own = std::thread::current().id();
            let call = luna::blocking(move || {
                assert_ne!(std::thread::current().id(), own);
                assert!(!luna::realtime::on_path());
                let name = std::thread::current().name().map(str::to_owned);
                (name, luna_platform::thread::current_policy())
            });
            assert_eq!(call.await, (Some("luna-buddy".to_owned()), Policy::Other));
            assert_eq!(std::thread::current().id(), own);
            Ok(())
        });
        system.run().unwrap();
    }
}

#[test]
fn a_panic_passes_through() {
    let _watch = watchdog();
    let call = || luna::blocking(|| -> u8 { panic!("in the call") });
    let outcome = std::panic::catch_unwind(|| luna::run(async { Ok(call().await) }));
    assert_eq!(outcome.unwrap_err().downcast_ref(), Some(&"in the call"));

    let mut system = System::new("panicking");
    let executor = system.executor("main").build().unwrap();
    let calling = async { luna::blocking(|| -> luna::Result<()> { panic!("number {}", 7) }).await };
    let id = executor.process("calling").spawn_ok(calling);
    let panicked = Error::Panicked("number 7".to_owned());
    assert_eq!(system.run().unwrap_err(), in_process("calling", panicked));
    assert_eq!(
        system.process_handle(id).unwrap().exit(),
        Some(Exit::Panicked("number 7".to_owned()))
    );

    // The pool has survived it.
    assert_eq!(luna::run(async { Ok(luna::blocking(|| 1).await) }), Ok(1));
}
