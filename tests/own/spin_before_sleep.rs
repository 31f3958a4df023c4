//! Looking for work before a sleep: which threads may, which are refused and get a reason, and that
//! it is done.

use crate::common;
use common::{COMPLETE, PLACEMENTS, Placement, SpawnOk, setup_error, skip};
use luna::error::SetupError;
use luna::prelude::*;
use luna::report::Shortfall;
use luna::system::{AttributeError, ProcessBuilder};
use luna::{Error, Report};
use luna_platform::thread::SpinRefusal;
use luna_platform::thread::available_cores;
use std::time::Duration;

const SPIN: Duration = Duration::from_micros(50);

/// A process on a thread or an executor of its own, on this core, which looks so long for work
/// before it sleeps.
fn looking(
    system: &mut System,
    place: Placement,
    on: &str,
    core: Option<usize>,
    spin: Duration,
) -> luna::Result<ProcessBuilder> {
    macro_rules! described {
        ($builder:expr) => {{
            let builder = $builder.spin_before_sleep(spin);
            match core {
                Some(core) => builder.core(core),
                None => builder,
            }
        }};
    }
    Ok(match place {
        Placement::Executor => described!(system.executor(on)).build()?.process(on),
        Placement::Thread => described!(system.thread(on)).process(on),
    })
}

/// Spawns an idle process there, which looks for work before it sleeps if it `spins`.
fn add(system: &mut System, place: Placement, name: &str, core: Option<usize>, spins: bool) {
    let spin = if spins { SPIN } else { Duration::ZERO };
    let process = looking(system, place, name, core, spin).unwrap();
    process.spawn_ok(async { Ok(()) });
}

/// A core to pin threads to.
fn one_core() -> Option<usize> {
    if !COMPLETE {
        skip("the portable layer does not pin threads");
    }
    COMPLETE.then(|| available_cores()[0])
}

/// Two of them.
fn two_cores() -> Option<[usize; 2]> {
    one_core()?;
    let cores = available_cores().first_chunk().copied();
    if cores.is_none() {
        skip("one core is usable");
    }
    cores
}

/// Whether any thread was refused to look.
fn is_refused(report: &Report) -> bool {
    let mut all = report.all_shortfalls();
    all.any(|(_, one)| matches!(one, Shortfall::Spin { .. }))
}

/// Why the thread called `name` sleeps at once, if the report says so.
fn refusal(report: &Report, name: &str) -> Option<SpinRefusal> {
    let thread = report.threads.iter().find(|thread| thread.name == name);
    let shortfalls = &thread.expect("it was started").shortfalls;
    shortfalls.iter().find_map(|one| match one {
        Shortfall::Spin { asked, why } => {
            assert_eq!(*asked, SPIN);
            Some(why.clone())
        }
        _ => None,
    })
}

#[test]
fn a_time_that_is_too_long() {
    own_process!();
    let time = Duration::from_micros(1000) + Duration::from_nanos(1);
    let mut system = System::new("wrong");
    for place in PLACEMENTS {
        let process = looking(&mut system, place, "place", None, time);
        let outcome = process.and_then(|process| process.spawn(async { Ok(()) }));
        let error = setup_error(outcome, &["`place`", "1.000001ms", "at most 1ms"]);
        let SetupError::Attributes(AttributeError::SpinTooLong { name, asked }) = error else {
            panic!("{error:?}")
        };
        assert_eq!((name.as_str(), asked), ("place", time));
    }
}

#[test]
fn a_thread_with_a_core_to_itself_is_refused_nothing() {
    own_process!();
    let Some(core) = one_core() else { return };
    for place in PLACEMENTS {
        let mut system = System::new("alone");
        add(&mut system, place, "io", Some(core), true);
        let report = system.strict().run().unwrap();
        assert_eq!(refusal(&report, "io"), None);
    }
}

#[test]
fn a_thread_that_shares_its_core_sleeps_at_once_and_says_with_whom() {
    own_process!();
    let Some(core) = one_core() else { return };
    for (first, second) in PLACEMENTS
        .iter()
        .flat_map(|one| PLACEMENTS.map(|two| (*one, two)))
    {
        let mut system = System::new("shared");
        add(&mut system, first, "io", Some(core), true);
        add(&mut system, second, "main", Some(core), false);
        let report = system.run().unwrap();
        let with = "main".to_owned();
        assert_eq!(
            refusal(&report, "io"),
            Some(SpinRefusal::SharedCore { with })
        );
        assert_eq!(refusal(&report, "main"), None, "it asked for nothing");
    }
}

#[test]
fn threads_on_cores_of_their_own_do_not_share() {
    own_process!();
    let Some([first, second]) = two_cores() else {
        return;
    };
    let mut system = System::new("apart");
    add(&mut system, Placement::Executor, "one", Some(first), true);
    add(&mut system, Placement::Thread, "two", Some(second), true);
    let report = system.run().unwrap();
    assert_eq!(
        (refusal(&report, "one"), refusal(&report, "two")),
        (None, None)
    );
}

#[test]
fn a_thread_without_a_core_shares_with_all() {
    own_process!();
    for place in PLACEMENTS {
        let mut system = System::new("unpinned");
        add(&mut system, place, "io", None, true);
        let report = system.run().unwrap();
        assert_eq!(refusal(&report, "io"), Some(SpinRefusal::NotPinned));
    }
    let Some(core) = one_core() else { return };
    for place in PLACEMENTS {
        let mut system = System::new("unpinned");
        add(&mut system, Placement::Executor, "io", Some(core), true);
        add(&mut system, place, "console", None, false);
        let report = system.run().unwrap();
        let name = "console".to_owned();
        assert_eq!(
            refusal(&report, "io"),
            Some(SpinRefusal::UnpinnedNeighbour { name })
        );
    }
}

#[test]
fn a_strict_system_does_not_start_with_one_that_shares() {
    own_process!();
    let mut system = System::new("strict");
    add(&mut system, Placement::Executor, "io", None, true);
    let error = system.strict().run().unwrap_err();
    let Error::Setup(SetupError::Refused { of, shortfall }) = &error else {
        panic!("{error:?}")
    };
    assert_eq!(of, "io");
    assert!(
        matches!(shortfall, Shortfall::Spin { asked: SPIN, .. }),
        "{shortfall:?}"
    );
    assert!(error.to_string().contains("pin it to a core"), "{error}");
}

/// How often this thread has given up its core by itself.
#[cfg(unix)]
fn sleeps() -> i64 {
    use nix::sys::resource::{UsageWho, getrusage};
    getrusage(UsageWho::RUSAGE_THREAD)
        .unwrap()
        .voluntary_context_switches()
}

/// How often a thread slept in so many short waits, with this time to look.
#[cfg(unix)]
fn sleeps_in(place: Placement, waits: u32, spin: Duration) -> i64 {
    use std::sync::{Arc, Mutex};
    let slept = Arc::new(Mutex::new(0));
    let result = slept.clone();
    let body = async move {
        let before = sleeps();
        for _ in 0..waits {
            luna::after(Duration::from_micros(100)).await;
        }
        *result.lock().unwrap() = sleeps() - before;
        Ok(())
    };
    let mut system = System::new("waits");
    let core = Some(available_cores()[0]);
    let process = looking(&mut system, place, "io", core, spin).unwrap();
    process.spawn_ok(body);
    system.run().unwrap();
    *slept.lock().unwrap()
}

#[cfg(unix)]
#[test]
fn a_thread_that_may_look_does_not_sleep_when_a_deadline_is_near() {
    own_process!();
    let Some(_) = one_core() else { return };
    for place in PLACEMENTS {
        // A thread that is kept from its core may sleep where it would have looked, or find the
        // deadline there where it would have slept. So this repeats.
        let times = |spin| (0..20).map(move |_| sleeps_in(place, 20, spin));
        let looked = times(Duration::from_millis(1)).find(|slept| *slept < 5);
        assert!(looked.is_some(), "{place:?} did not look");
        let slept = times(Duration::ZERO).find(|slept| *slept > 15);
        assert!(slept.is_some(), "{place:?} did not sleep");
    }
}

#[cfg(unix)]
#[test]
fn a_thread_that_looks_sees_messages_and_files_and_deadlines() {
    own_process!();
    let core = COMPLETE.then(|| available_cores()[0]);
    for place in PLACEMENTS {
        let (reader, mut writer) = std::io::pipe().unwrap();
        let (sender, receiver) = luna::channel::<u32>();
        let (answers, answered) = luna::channel::<u32>();
        let body = async move {
            for expected in 0..200 {
                assert_eq!(receiver.recv().await?, expected);
                match luna::external::readable(&reader).await {
                    Ok(()) => {}
                    Err(error) if error.is_unsupported() => {}
                    Err(error) => panic!("{error}"),
                }
                let mut byte = [0];
                std::io::Read::read_exact(&mut &reader, &mut byte).unwrap();
                luna::after(Duration::from_micros(u64::from(expected % 3) * 30)).await;
                answers.send(expected).await?;
            }
            Ok(())
        };
        let mut system = System::new("looks");
        let process = looking(&mut system, place, "io", core, SPIN).unwrap();
        process.spawn_ok(body);
        let client = std::thread::spawn(move || {
            for number in 0..200 {
                sender.blocking_send(number).unwrap();
                std::io::Write::write_all(&mut writer, &[1]).unwrap();
                assert_eq!(answered.blocking_recv(), Ok(number));
            }
        });
        system.run().unwrap();
        client.join().unwrap();
    }
}

/// Two processes with operations that meet without ever waiting by way of their threads, for as
/// long as others of the same executor wait: for a deadline, and for a message from a plain thread.
#[test]
fn processes_that_look_for_each_other_keep_nobody_from_running() {
    own_process!();
    let Some([first, second]) = two_cores() else {
        return;
    };
    for place in PLACEMENTS {
        let (calls, called) = luna::channel::<u64>();
        let (answers, answered) = luna::channel::<u64>();
        let (outside, from_outside) = luna::channel::<u32>();
        let busy = std::sync::Arc::new(std::sync::atomic::AtomicU32::new(2));
        let [of_client, of_ticker, of_neighbour] = [(); 3].map(|()| busy.clone());
        let order = std::sync::atomic::Ordering::Relaxed;

        let mut system = System::new("busy");
        let spin = Duration::from_millis(1);
        let main = system.executor("main").core(first).spin_before_sleep(spin);
        let main = main.build().unwrap();
        let server = looking(&mut system, place, "server", Some(second), spin).unwrap();
        let client = async move {
            let mut number = 0;
            while of_client.load(order) > 0 {
                calls.send(number).await?;
                assert_eq!(answered.recv().await?, number);
                number += 1;
            }
            Ok(())
        };
        let serve = async move {
            while let Ok(number) = called.recv().await {
                answers.send(number).await?;
            }
            Ok(())
        };
        let ticker = async move {
            for _ in 0..50 {
                luna::after(Duration::from_micros(100)).await;
            }
            of_ticker.fetch_sub(1, order);
            Ok(())
        };
        let neighbour = async move {
            for expected in 0..50 {
                assert_eq!(from_outside.recv().await?, expected);
            }
            of_neighbour.fetch_sub(1, order);
            Ok(())
        };
        server.spawn_ok(serve);
        main.process("client").priority(20).spawn_ok(client);
        main.process("ticker").priority(10).spawn_ok(ticker);
        main.process("neighbour").priority(10).spawn_ok(neighbour);
        let plain = std::thread::spawn(move || {
            (0..50).for_each(|number| outside.blocking_send(number).unwrap());
        });
        let report = system.run().unwrap();
        assert!(!is_refused(&report), "{report}");
        plain.join().unwrap();
    }
}

/// A stream between two cores, where each operation finds room or a value, or a partner that is
/// about to make it. After a turn of so many operations, the other processes of both executors run.
#[test]
fn a_stream_through_a_buffer_keeps_nobody_from_running() {
    own_process!();
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};

    const MESSAGES: u32 = 20_000;
    /// Of one turn, at most: as many as go on, and the one after which the process gives way.
    const OPERATIONS: u32 = 65;
    let Some([first, second]) = two_cores() else {
        return;
    };
    for capacity in [1, 64] {
        let (sender, receiver) = luna::buffered::<u32>(luna::Buffer::fifo(capacity));
        let is_over = Arc::new(AtomicBool::new(false));
        let turns = [(); 2].map(|()| Arc::new(AtomicU32::new(0)));

        let mut system = System::new("stream");
        let executors = [("sends", first), ("receives", second)].map(|(name, core)| {
            let executor = system.executor(name).core(core).spin_before_sleep(SPIN);
            executor.build().unwrap()
        });
        let over = is_over.clone();
        executors[0].process("sender").spawn_ok(async move {
            for number in 0..MESSAGES {
                sender.send(number).await?;
            }
            Ok(())
        });
        executors[1].process("receiver").spawn_ok(async move {
            for expected in 0..MESSAGES {
                assert_eq!(receiver.recv().await?, expected);
            }
            over.store(true, Relaxed);
            Ok(())
        });
        for ((executor, turns), name) in executors.iter().zip(&turns).zip(["first", "second"]) {
            let (over, turns) = (is_over.clone(), turns.clone());
            executor.process(name).spawn_ok(async move {
                while !over.load(Relaxed) {
                    turns.fetch_add(1, Relaxed);
                    luna::yield_now().await;
                }
                Ok(())
            });
        }
        let report = system.run().unwrap();
        assert!(!is_refused(&report), "{report}");
        for turns in turns {
            let turns = turns.load(Relaxed);
            assert!(turns >= MESSAGES / OPERATIONS - 1, "{turns}");
        }
    }
}

/// Blocking operations of one poll are more than a turn has, so the ones beyond that may not look.
/// They wait as any other.
#[test]
fn blocking_operations_without_end_in_one_turn_meet_and_time_out() {
    own_process!();
    let [first, second, ..] = available_cores()[..] else {
        return skip("one core is usable");
    };
    let core = |core| COMPLETE.then_some(core);
    let (sender, receiver) = luna::channel::<u32>();
    let (_nobody_sends, silent) = luna::channel::<u32>();
    let mut system = System::new("many");
    let mut process = |name, core| {
        let thread = Placement::Thread;
        looking(&mut system, thread, name, core, SPIN).unwrap()
    };
    process("sends", core(first)).spawn_ok(async move {
        for number in 0..5_000 {
            sender.blocking_send(number)?;
        }
        Ok(())
    });
    process("receives", core(second)).spawn_ok(async move {
        for expected in 0..5_000 {
            assert_eq!(receiver.blocking_recv()?, expected);
        }
        let late = silent.blocking_recv_timeout(Duration::from_millis(5));
        assert!(late.unwrap_err().is_timeout());
        Ok(())
    });
    system.run().unwrap();
}
