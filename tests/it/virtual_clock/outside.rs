//! What comes from elsewhere: blocking calls, spawns, real systems and threads outside.

use super::{HOUR, MS, Notes, simulated, sleep_for, watchdog};
use crate::common::SpawnOk;
use luna::Error;
use luna::error::SetupError;
use luna::prelude::*;
use luna::system::ClockKind;
use std::time::Duration;

#[test]
fn results_of_blocking_calls_come_in_the_order_of_the_calls_and_time_waits() {
    let _alive = watchdog();
    let (system, main) = simulated();
    let notes = Notes::default();
    let (release, released) = std::sync::mpsc::channel::<()>();
    let mut calls: Vec<Box<dyn FnOnce() -> u64 + Send>> = Vec::new();
    // The first is done when the second is: their order cannot be determined otherwise.
    calls.push(Box::new(move || {
        released.recv().unwrap();
        luna::now().as_nanos()
    }));
    calls.push(Box::new(move || {
        release.send(()).unwrap();
        luna::now().as_nanos()
    }));
    for (number, call) in calls.into_iter().enumerate() {
        let notes = notes.clone();
        let body = async move {
            luna::after(MS).await;
            let seen = luna::blocking(call).await;
            assert_eq!(
                seen,
                luna::now().as_nanos(),
                "the buddy sees the system's clock"
            );
            notes.note(format!("call {number}"));
            Ok(())
        };
        main.process(format!("caller {number}")).spawn_ok(body);
    }
    let own = notes.clone();
    let waits = async move {
        luna::after(MS).await;
        own.note("waiter");
        luna::after(Duration::from_nanos(1)).await;
        own.note("waiter again");
        Ok(())
    };
    main.process("waiter").spawn_ok(waits);
    system.run().unwrap();
    let names = ["waiter", "call 0", "call 1", "waiter again"];
    assert_eq!(notes.names(), names);
}

#[test]
fn processes_are_spawned_while_it_runs_on_every_kind_of_place() {
    let _alive = watchdog();
    let mut system = System::new("growing");
    system.virtual_clock();
    let main = system.executor("main").build().unwrap();
    let other = system.executor("other").build().unwrap();
    let late = system.thread("late").process("on a thread");
    let notes = Notes::default();
    let (own, own_executor) = (notes.clone(), main.clone());
    let spawns = async move {
        luna::after(MS).await;
        for (name, executor) in [("here", &own_executor), ("there", &other)] {
            let own = own.clone();
            let child = executor.process(name).spawn(async move {
                own.note(name);
                luna::after(MS).await;
                Ok(())
            })?;
            let handle = executor.process_handle(child).unwrap();
            handle.join().await;
            own_note(&handle);
        }
        let noted = own.clone();
        late.spawn(async move {
            luna::after(MS).await;
            noted.note("thread");
            Ok(())
        })?;
        own.note("spawned");
        Ok(())
    };
    main.process("spawns").spawn_ok(spawns);
    system.run().unwrap();
    let expected = [
        (1000, "here"),
        (2000, "there"),
        (3000, "spawned"),
        (4000, "thread"),
    ];
    assert_eq!(
        notes.take(),
        expected.map(|(at, what)| (at, what.to_owned()))
    );
}

fn own_note(handle: &luna::process::ProcessHandle) {
    assert_eq!(handle.exit(), Some(luna::Exit::Completed));
}

#[test]
fn a_real_system_and_virtual_ones_run_at_once() {
    let _alive = watchdog();
    let run_virtual = || {
        let (system, main) = simulated();
        main.process("patient").spawn_ok(sleep_for(HOUR));
        system.run().unwrap()
    };
    let threads = [(); 3].map(|()| std::thread::spawn(run_virtual));
    let mut real = System::new("real");
    let main = real.executor("main").build().unwrap();
    // And one within a blocking call of the real one.
    let nested = async move {
        let before = luna::now();
        let report = luna::blocking(run_virtual).await;
        assert_eq!(report.elapsed, HOUR);
        luna::after(MS).await;
        assert!(luna::now() >= before + MS && luna::now() < before + HOUR);
        Ok(())
    };
    main.process("nested").spawn_ok(nested);
    let report = real.run().unwrap();
    assert_eq!(report.clock, ClockKind::Real);
    assert!(report.elapsed < HOUR);
    for thread in threads {
        assert_eq!(thread.join().unwrap().elapsed, HOUR);
    }
}

#[test]
fn a_real_system_within_a_blocking_call_of_a_virtual_one_has_its_own_time() {
    let _alive = watchdog();
    let (system, main) = simulated();
    let body = async {
        let before = luna::now();
        let elapsed = luna::blocking(|| {
            let mut real = System::new("real");
            let main = real.executor("main").build().unwrap();
            main.process("sleeps").spawn_ok(sleep_for(MS * 2));
            luna::run(sleep_for(MS)).unwrap();
            real.run().unwrap().elapsed
        })
        .await;
        assert!(elapsed >= MS * 2);
        assert_eq!(luna::now(), before);
        Ok(())
    };
    main.process("outer").spawn_ok(body);
    system.run().unwrap();
}

#[test]
fn a_thread_outside_sends_when_it_will_and_a_delay_above_does_not_shut_it_out() {
    let _alive = watchdog();
    let (system, main) = simulated();
    let (sender, receiver) = luna::channel::<u32>();
    let (ready, is_ready) = std::sync::mpsc::channel::<()>();
    let before = luna::now();
    let outside = std::thread::spawn(move || {
        // Real time here, as before the system ran.
        let now = luna::now();
        assert!(now >= before && now - before < Duration::from_secs(60));
        is_ready.recv().unwrap();
        sender.blocking_send(7)
    });
    let body = async move {
        // While the call is made time stands, so the delay does not come.
        let call = luna::blocking(move || {
            ready.send(()).unwrap();
            outside.join().unwrap()
        });
        let receives = async {
            luna::pri_alt! {
                _ = luna::after(HOUR) => Err(Error::Timeout),
                value = receiver.recv() => Ok(value?),
            }
        };
        let (sent, received) = luna::par!(async { Ok(call.await) }, receives).await?;
        assert_eq!((sent.is_ok(), received), (true, 7));
        Ok(())
    };
    main.process("inside").spawn_ok(body);
    system.run().unwrap();
}

#[test]
fn callbacks_of_the_timer_manager_are_refused_where_nobody_could_call_them() {
    let _alive = watchdog();
    let (mut system, main) = simulated();
    system.timers(luna::time::Timers::Manager);
    let timers = system.timer_manager().unwrap();
    let own = timers.clone();
    main.process("late").spawn_ok(async move {
        let late = own.callback("late", |_| ());
        assert!(matches!(
            late,
            Err(Error::Setup(SetupError::CallbackOnVirtualClock { name })) if name == "late"
        ));
        // Loops are as ever.
        let mut tick = luna::periodic("loop", MS)?;
        assert_eq!(tick.next().await.number, 1);
        Ok(())
    });
    system.run().unwrap();

    let (mut system, _main) = simulated();
    system.timers(luna::time::Timers::Manager);
    let timers = system.timer_manager().unwrap();
    let _callback = timers.callback("early", |_| ()).unwrap();
    assert!(matches!(
        system.run(),
        Err(Error::Setup(SetupError::CallbackOnVirtualClock { name })) if name == "early"
    ));
}
