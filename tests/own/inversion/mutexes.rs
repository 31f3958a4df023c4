//! The mutex of processes: its holder works at the priority of its most urgent waiter, wherever it
//! runs.

use crate::common::{Placement, SpawnOk, real_time_core};
use crate::inversion::stage::{Stage, scheduled};
use crate::inversion::{HIGH, LOW, ROUNDS};
use crate::kernel::{as_scheduled, scheduled_priority, thread_id};
use luna::prelude::*;
use luna::sync::Mutex;
use luna_core::current::refused_boosts;
use luna_platform::thread::{Attributes, current_policy, spawn};
use std::convert::Infallible;

#[test]
fn a_mutex_that_is_held_below() {
    own_process!();
    let Some(core) = real_time_core() else { return };
    let fifo = Policy::fifo(LOW);
    for (place, own) in [
        (Some(Placement::Executor), fifo),
        (Some(Placement::Thread), fifo),
        (Some(Placement::Thread), Policy::round_robin(LOW)),
        (Some(Placement::Executor), Policy::Other),
        // A plain thread.
        (None, fifo),
        (None, Policy::Other),
    ] {
        let mut stage = Stage::new(core);
        let mutex = Mutex::new(());
        let wanted = mutex.clone();
        let (go, gone) = luna::channel();
        stage.high(Some(gone.external()), async move || {
            drop(wanted.lock().await?);
            Ok(())
        });
        // In steps without an await while it holds the mutex.
        let hold = move || {
            let now = || (scheduled_priority(thread_id()), current_policy());
            for _ in 0..ROUNDS {
                assert_eq!(now(), (scheduled(own), own));
                let guard = mutex.try_lock().expect("the high one has unlocked");
                // A rendezvous, by trying until the high one waits: it runs at once then.
                while go.try_send(()).is_err() {}
                while current_policy() == own {}
                assert_eq!(now(), (as_scheduled(HIGH), Policy::fifo(HIGH)));
                drop(guard);
                assert_eq!(now(), (scheduled(own), own));
            }
        };
        let what = format!("mutex ({place:?}, {own})");
        let waits = match place {
            Some(place) => {
                let low = stage.process(place, "low", own);
                low.spawn_ok(async move {
                    hold();
                    Ok(())
                });
                stage.run()
            }
            None => {
                let attributes = Attributes::new("low").policy(own).core(core);
                let low = spawn(attributes, |_| Ok::<_, Infallible>(()), move |()| hold()).unwrap();
                let waits = stage.run();
                low.join().unwrap();
                waits
            }
        };
        waits.expect_inherited(&what);
        assert_eq!(refused_boosts(), None);
    }
}
