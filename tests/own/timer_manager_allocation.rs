//! The timer manager's thread, and loops that wait for it, neither allocate nor free on the
//! real-time path; nor does setting callbacks. One test alone, since the allocator counts for the
//! whole program.

use crate::ALLOCATOR;
use crate::common;

use common::{PLACES, watchdog};
use luna::Timers;
use luna::prelude::*;
use std::time::Duration;

const PERIOD: Duration = Duration::from_millis(1);

#[test]
fn ticks_callbacks_and_who_joins_and_leaves_allocate_nothing() {
    own_process!();
    let _watch = watchdog();
    let mut system = System::new("managed");
    system.timers(Timers::Manager);
    let manager = system.timer_manager().unwrap();
    for place in PLACES {
        for millis in [1, 2, 5] {
            let name: &'static str = format!("{place:?} {millis}").leak();
            place
                .process(&mut system, name, name)
                .spawn(async move {
                    let mut tick = luna::periodic(name, PERIOD * millis)?;
                    for round in 0..40 / millis {
                        tick.next().await;
                        // Other timers each time.
                        if round % 4 == 3 {
                            tick = tick.phase(PERIOD / 8 * (round % 8))?;
                        }
                    }
                    Ok(())
                })
                .unwrap();
        }
    }
    let callbacks: Vec<_> = (0..8)
        .map(|number| manager.callback(&format!("{number}"), |_| ()).unwrap())
        .collect();
    let setter = system.executor("setter").build().unwrap();
    setter
        .process("setter")
        .spawn(async move {
            let mut tick = luna::periodic("setter", PERIOD)?;
            for round in 0..40 {
                tick.next().await;
                for (number, callback) in (0..).zip(&callbacks) {
                    match (round + number) % 4 {
                        0 => callback.every(PERIOD * (1 + number), Duration::ZERO)?,
                        1 => callback.after(PERIOD / 3),
                        2 => drop(callback.cancel()),
                        _ => {}
                    }
                }
            }
            luna::off_path(|| drop(callbacks));
            Ok(())
        })
        .unwrap();
    let report = system.run().unwrap();
    assert_eq!(ALLOCATOR.on_path(), (0, 0), "allocations and frees");
    let timers = report.timers.unwrap();
    assert!(timers.woken > 0);
    assert!(timers.callbacks.iter().all(|one| one.calls > 0), "{timers}");
}
