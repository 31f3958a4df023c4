//! A system that has come to a standstill says so, once and with the circle; one that can still be woken says nothing.

mod common;

use common::{PLACES, Place, Program, watchdog};
use luna::deadlock::{Operation, Partner};
use luna::prelude::*;
use luna::{Deadlock, End, Error, ProcessBuilder};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::time::Duration;

/// Runs a strict system to its deadlock.
#[track_caller]
fn deadlock_of(system: &System) -> Deadlock {
    match system.run() {
        Err(Error::Deadlock(deadlock)) => *deadlock,
        other => panic!("expected a deadlock, got {other:?}"),
    }
}

fn strict(name: &str) -> System {
    let mut system = System::new(name);
    system.strict();
    system
}

/// Two processes that each receive from the other first.
fn spawn_two_that_receive_first(left: ProcessBuilder, right: ProcessBuilder) {
    let (to_left, from_right) = luna::channel::<u32>();
    let (to_right, from_left) = luna::channel::<u32>();
    let from_right = from_right.named("to left");
    left.spawn(async move {
        let n = from_right.recv().await?;
        to_right.send(n).await?;
        Ok(())
    })
    .unwrap();
    right
        .spawn(async move {
            let n = from_left.recv().await?;
            to_left.send(n).await?;
            Ok(())
        })
        .unwrap();
}

#[test]
fn two_that_receive_from_each_other_first() {
    let _watchdog = watchdog();
    for left in PLACES {
        for right in PLACES {
            let mut system = strict("two");
            let left_process = left.process(&mut system, "l", "left");
            let right_process = right.process(&mut system, "r", "right");
            spawn_two_that_receive_first(left_process, right_process);
            let found = deadlock_of(&system);
            assert_eq!(found.system, "two");
            assert_eq!(found.waits.len(), 2, "{found}");
            let first = &found.waits[0];
            assert_eq!(
                (first.process.as_str(), first.operation, first.at.as_str()),
                ("left", Operation::Receive, "channel `to left`")
            );
            assert_eq!(first.partner, Partner::Nobody);
            assert!(found.waits[1].at.contains("tests/deadlock.rs:"), "{found}");
            let report = system.report().unwrap();
            assert_eq!(report.end, End::Deadlock);
            assert_eq!(report.deadlock, Some(found.clone()));
            assert!(
                report.to_string().contains("`right` waits to receive"),
                "{report}"
            );
        }
    }
}

/// Three philosophers who each lay their left fork on the table, which is a channel, take it up, meet, and then take the right one.
fn philosophers(
    system: &mut System,
    mut process: impl FnMut(&mut System, usize) -> ProcessBuilder,
) {
    const SEATS: usize = 3;
    let forks: Vec<_> = (0..SEATS)
        .map(|seat| {
            let (put, take) = luna::buffered::<()>(Buffer::fifo(1));
            (put, take.named(&format!("fork {seat}")))
        })
        .collect();
    // That all have their left fork is known when everybody has told everybody.
    let seated: Vec<_> = (0..SEATS)
        .map(|_| luna::buffered::<()>(Buffer::fifo(SEATS)))
        .collect();
    for seat in 0..SEATS {
        let (left, right) = (forks[seat].clone(), forks[(seat + 1) % SEATS].clone());
        let tell: Vec<_> = seated.iter().map(|(tell, _)| tell.clone()).collect();
        let told = seated[seat].1.clone();
        process(system, seat)
            .spawn(async move {
                left.0.send(()).await?;
                left.1.recv().await?;
                for tell in &tell {
                    tell.send(()).await?;
                }
                for _ in 0..SEATS {
                    told.recv().await?;
                }
                right.1.recv().await?;
                right.0.send(()).await?;
                left.0.send(()).await?;
                Ok(())
            })
            .unwrap();
    }
}

/// Each waits for the fork that its neighbour took: the last who received, who was also the last to use it.
fn is_the_dinner(found: &Deadlock) {
    assert_eq!(found.waits.len(), 3, "{found}");
    for (seat, wait) in found.waits.iter().enumerate() {
        assert_eq!(wait.process, format!("philosopher {seat}"));
        assert_eq!(wait.at, format!("channel `fork {}`", (seat + 1) % 3));
        assert_eq!(wait.operation, Operation::Receive);
    }
}

#[test]
fn philosophers_on_one_executor_on_two_and_on_threads() {
    let _watchdog = watchdog();
    for executors in [1, 2] {
        let mut system = strict("dinner");
        let places: Vec<_> = (0..executors)
            .map(|n| system.executor(&format!("e{n}")).build().unwrap())
            .collect();
        philosophers(&mut system, |_, seat| {
            places[seat % executors].process(&format!("philosopher {seat}"))
        });
        is_the_dinner(&deadlock_of(&system));
    }
    let mut system = strict("dinner");
    philosophers(&mut system, |system, seat| {
        let name = format!("philosopher {seat}");
        system.thread(&name).process(&name)
    });
    is_the_dinner(&deadlock_of(&system));
}

#[test]
fn the_circle_is_named_when_the_ends_were_used_before() {
    let _watchdog = watchdog();
    for place in PLACES {
        let mut system = strict("used");
        let (ping, pinged) = luna::channel::<u32>();
        let (pong, ponged) = luna::channel::<u32>();
        place
            .process(&mut system, "1", "one")
            .spawn(async move {
                ping.send(1).await?;
                ponged.recv().await?;
                ponged.recv().await?; // one too many
                ping.send(2).await?;
                Ok(())
            })
            .unwrap();
        place
            .process(&mut system, "2", "two")
            .spawn(async move {
                pinged.recv().await?;
                pong.send(1).await?;
                pinged.recv().await?;
                Ok(())
            })
            .unwrap();
        let found = deadlock_of(&system);
        assert_eq!(found.cycle, ["one", "two"], "{found}");
        assert_eq!(found.waits[0].partner, Partner::Process("two".to_owned()));
    }
}

#[test]
fn senders_and_alternatives_and_branches_are_named_too() {
    let _watchdog = watchdog();
    let mut system = strict("kinds");
    let main = system.executor("main").build().unwrap();
    let (send, _receive) = luna::channel::<u32>();
    let (_hold, a) = luna::channel::<u32>();
    let (_keep, b) = luna::channel::<u32>();
    let (_have, c) = luna::channel::<u32>();
    let send = send.named("out");
    main.process("sender")
        .spawn(async move {
            send.send(1).await?;
            Ok(())
        })
        .unwrap();
    main.process("chooser")
        .spawn(async move {
            luna::alt! {
                n = a.recv() => { n?; }
                n = b.recv() => { n?; }
            }
            Ok(())
        })
        .unwrap();
    main.process("parallel")
        .spawn(async move {
            par!(
                async {
                    c.recv().await?;
                    Ok(())
                },
                async {
                    c.recv().await?;
                    Ok::<_, Error>(())
                },
            )
            .await?;
            Ok(())
        })
        .unwrap();
    let found = deadlock_of(&system);
    let of = |name| found.waits.iter().filter(move |wait| wait.process == name);
    assert_eq!(of("sender").next().unwrap().operation, Operation::Send);
    assert_eq!(of("sender").next().unwrap().at, "channel `out`");
    assert_eq!(of("chooser").count(), 2, "{found}");
    assert_eq!(of("parallel").count(), 2, "{found}");
}

#[test]
fn who_joins_one_that_waits_waits_too() {
    let _watchdog = watchdog();
    let mut system = strict("joined");
    let main = system.executor("main").build().unwrap();
    let (_keep, never) = luna::channel::<()>();
    let stuck = main
        .process("stuck")
        .spawn(async move {
            never.recv().await?;
            Ok(())
        })
        .unwrap();
    let on = main.clone();
    main.process("joiner")
        .spawn(async move {
            let handle = on.process_handle(stuck).unwrap();
            handle.join().await;
            Ok(())
        })
        .unwrap();
    let found = deadlock_of(&system);
    assert_eq!(found.waits[1].operation, Operation::Join);
    assert_eq!(found.waits[1].partner, Partner::Process("stuck".to_owned()));
}

#[test]
fn a_deadlock_brings_the_machine_to_safety_and_runs_post_run() {
    let _watchdog = watchdog();
    struct Stuck(Receiver<()>, Arc<AtomicBool>);
    impl Process for Stuck {
        async fn run(&mut self) -> luna::Result<()> {
            self.0.recv().await?;
            Ok(())
        }
        fn post_run(&mut self) {
            self.1.store(true, Ordering::Release);
        }
    }
    let (_keep, never) = luna::channel();
    let (cleaned, safe) = (
        Arc::new(AtomicBool::new(false)),
        Arc::new(AtomicBool::new(false)),
    );
    let mut system = strict("safe");
    let seen = safe.clone();
    system.on_emergency("brake", move || seen.store(true, Ordering::Release));
    let main = system.executor("main").build().unwrap();
    main.process("stuck")
        .spawn(Stuck(never, cleaned.clone()))
        .unwrap();
    deadlock_of(&system);
    assert!(cleaned.load(Ordering::Acquire) && safe.load(Ordering::Acquire));
}

/// Runs a strict system with a process that waits for what somebody else sends late; it must end well.
fn must_end_well(name: &str, describe: impl FnOnce(&mut System, Sender<u32>)) {
    let mut system = strict(name);
    let (sender, receiver) = luna::channel();
    let waiter = system.executor("waiter").build().unwrap();
    waiter
        .process("waiter")
        .spawn(async move {
            assert_eq!(receiver.recv().await?, 7);
            Ok(())
        })
        .unwrap();
    describe(&mut system, sender);
    let report = system
        .run()
        .unwrap_or_else(|error| panic!("{name}: {error}"));
    assert_eq!(report.deadlock, None, "{name}");
}

/// Long enough for many looks.
const LONG: Duration = Duration::from_millis(300);

#[test]
fn a_deadline_a_blocking_call_and_a_computation_are_no_deadlock() {
    let _watchdog = watchdog();
    for place in PLACES {
        must_end_well("deadline", |system, sender| {
            let process = place.process(system, "other", "other");
            process
                .spawn(async move {
                    luna::after(LONG).await;
                    sender.send(7).await?;
                    Ok(())
                })
                .unwrap();
        });
        must_end_well("blocking", |system, sender| {
            let process = place.process(system, "other", "other");
            process
                .spawn(async move {
                    luna::blocking(|| std::thread::sleep(LONG)).await;
                    sender.send(7).await?;
                    Ok(())
                })
                .unwrap();
        });
    }
    must_end_well("forgotten call", |system, sender| {
        let process = Place::Executor.process(system, "other", "other");
        process
            .spawn(async move {
                let call = luna::blocking(move || {
                    std::thread::sleep(LONG);
                    sender.blocking_send(7).unwrap();
                });
                // Started, and then nobody waits for it.
                let mut call = std::pin::pin!(call);
                std::future::poll_fn(|cx| {
                    assert!(call.as_mut().poll(cx).is_pending());
                    std::task::Poll::Ready(())
                })
                .await;
                Ok(())
            })
            .unwrap();
    });
    must_end_well("blocked", |system, sender| {
        let process = Place::Thread.process(system, "other", "other");
        process
            .spawn(async move {
                std::thread::sleep(LONG);
                sender.send(7).await?;
                Ok(())
            })
            .unwrap();
    });
    must_end_well("blocking receive", |system, sender| {
        let (early, late) = luna::channel::<()>();
        let early = early.external();
        let process = Place::Thread.process(system, "other", "other");
        process
            .spawn(async move {
                late.blocking_recv()?;
                sender.send(7).await?;
                Ok(())
            })
            .unwrap();
        std::thread::spawn(move || {
            std::thread::sleep(LONG);
            early.blocking_send(()).unwrap();
        });
    });
}

#[cfg(unix)]
#[test]
fn a_file_is_no_deadlock() {
    use std::io::{Read, Write};
    let _watchdog = watchdog();
    if !common::COMPLETE {
        return common::skip("the portable layer cannot wait for files");
    }
    for place in PLACES {
        let (mut near, mut far) = std::os::unix::net::UnixStream::pair().unwrap();
        must_end_well("file", move |system, sender| {
            let process = place.process(system, "other", "other");
            process
                .spawn(async move {
                    luna::readable(&near).await?;
                    let mut byte = [0];
                    near.read_exact(&mut byte)?;
                    sender.send(u32::from(byte[0])).await?;
                    Ok(())
                })
                .unwrap();
            std::thread::spawn(move || {
                std::thread::sleep(LONG);
                far.write_all(&[7]).unwrap();
            });
        });
    }
}

#[test]
fn a_plain_thread_is_no_deadlock_where_it_is_known() {
    let _watchdog = watchdog();
    // By the mark.
    must_end_well("marked", |_, sender| {
        let sender = sender.external();
        std::thread::spawn(move || {
            std::thread::sleep(LONG);
            sender.blocking_send(7).unwrap();
        });
    });
    // By what it has done before.
    let mut system = strict("used before");
    let (sender, receiver) = luna::buffered::<u32>(Buffer::fifo(1));
    let main = system.executor("main").build().unwrap();
    let process = main.process("sum");
    process
        .spawn(async move {
            let mut sum = 0;
            for _ in 0..4 {
                sum += receiver.recv().await?;
            }
            assert_eq!(sum, 4);
            Ok(())
        })
        .unwrap();
    // Once before the start; then it is known.
    sender.try_send(1).unwrap();
    std::thread::spawn(move || {
        for _ in 0..3 {
            std::thread::sleep(LONG / 3);
            sender.blocking_send(1).unwrap();
        }
    });
    assert_eq!(system.run().unwrap().deadlock, None);
}

#[test]
fn at_a_barrier_a_thread_that_has_come_before_is_no_deadlock() {
    let _watchdog = watchdog();
    for place in PLACES {
        let mut system = strict("barrier");
        let barrier = Barrier::new(2);
        let party = barrier.clone();
        let (come, has_come) = std::sync::mpsc::channel();
        place
            .process(&mut system, "e", "party")
            .spawn(async move {
                for _ in 0..3 {
                    party.sync().await;
                }
                Ok(())
            })
            .unwrap();
        let thread = std::thread::spawn(move || {
            for round in 0..3 {
                if round > 0 {
                    // So long that the others would have been found deadlocked.
                    std::thread::sleep(LONG / 3);
                }
                luna::run(async {
                    let mut came = std::pin::pin!(barrier.sync());
                    std::future::poll_fn(|cx| {
                        let polled = came.as_mut().poll(cx);
                        let _ = come.send(());
                        polled
                    })
                    .await;
                    Ok(())
                })
                .unwrap();
            }
        });
        has_come.recv().unwrap();
        assert_eq!(system.run().unwrap().deadlock, None);
        thread.join().unwrap();
    }
}

/// The count of parties that is one too great is the usual mistake.
#[test]
fn at_a_barrier_of_too_many_parties_they_wait_for_those_who_never_come() {
    let _watchdog = watchdog();
    for place in PLACES {
        let mut system = strict("barrier");
        let barrier = Barrier::new(3).named("start");
        for name in ["left", "right"] {
            let party = barrier.clone();
            let spawner = place.process(&mut system, name, name);
            spawner
                .spawn(async move {
                    party.sync().await;
                    Ok(())
                })
                .unwrap();
        }
        let found = deadlock_of(&system);
        assert_eq!(found.waits.len(), 2);
        assert!(
            found
                .waits
                .iter()
                .all(|wait| wait.operation == Operation::Sync)
        );
    }
}

#[test]
fn at_a_barrier_whose_parties_have_met_they_wait_for_each_other() {
    let _watchdog = watchdog();
    for place in PLACES {
        let mut system = strict("barrier");
        let barrier = Barrier::new(2).named("meet");
        let (sender, receiver) = luna::channel::<()>();
        let (left, right) = (barrier.clone(), barrier);
        let spawner = place.process(&mut system, "l", "left");
        spawner
            .spawn(async move {
                left.sync().await;
                left.sync().await;
                sender.send(()).await?;
                Ok(())
            })
            .unwrap();
        let spawner = place.process(&mut system, "r", "right");
        spawner
            .spawn(async move {
                right.sync().await;
                receiver.recv().await?;
                right.sync().await;
                Ok(())
            })
            .unwrap();
        let found = deadlock_of(&system);
        let wait = &found.waits[0];
        assert_eq!(
            (wait.process.as_str(), wait.operation, &wait.partner),
            ("left", Operation::Sync, &Partner::Others)
        );
        assert_eq!(found.waits[1].process, "right");
    }
}

#[test]
fn what_is_none_of_lunas_may_wake_somebody() {
    let _watchdog = watchdog();
    let mut system = strict("foreign");
    let main = system.executor("main").build().unwrap();
    let (wake, woken) = mpsc::channel::<std::task::Waker>();
    main.process("foreign")
        .spawn(async move {
            let mut is_first = true;
            std::future::poll_fn(|cx| {
                if std::mem::take(&mut is_first) {
                    wake.send(cx.waker().clone()).unwrap();
                    return std::task::Poll::Pending;
                }
                std::task::Poll::Ready(())
            })
            .await;
            Ok(())
        })
        .unwrap();
    std::thread::spawn(move || {
        let waker = woken.recv().unwrap();
        std::thread::sleep(LONG);
        waker.wake();
    });
    assert_eq!(system.run().unwrap().deadlock, None);
}

#[test]
fn processes_that_come_while_it_runs_are_no_deadlock_and_can_come_to_one() {
    let _watchdog = watchdog();
    for spawned_on in PLACES {
        for is_good in [true, false] {
            let mut system = strict("late");
            let main = system.executor("main").build().unwrap();
            let mut other = Some(match spawned_on {
                Place::Executor => system.executor("other").build().unwrap().process("late 1"),
                Place::Thread => system.thread("other").process("late 1"),
            });
            let (sender, receiver) = luna::channel();
            main.process("first")
                .spawn(async move {
                    let late = other.take().unwrap();
                    late.spawn(async move {
                        if is_good {
                            sender.send(7).await?;
                        } else {
                            let (_keep, never) = luna::channel::<()>();
                            never.recv().await?;
                            drop(sender);
                        }
                        Ok(())
                    })?;
                    receiver.recv().await?;
                    Ok(())
                })
                .unwrap();
            if is_good {
                assert_eq!(system.run().unwrap().deadlock, None);
            } else {
                let found = deadlock_of(&system);
                assert_eq!(found.waits[1].process, "late 1", "{found}");
            }
        }
    }
}

#[test]
fn many_that_wake_each_other_across_threads_are_no_deadlock_until_they_are() {
    let _watchdog = watchdog();
    let mut random = common::Random::seeded();
    for _ in 0..20 {
        let mut system = strict("ring");
        let count = 2 + random.below(4) as usize;
        let rounds = 50 + random.below(200);
        let channels: Vec<_> = (0..count).map(|_| luna::channel::<u64>()).collect();
        for n in 0..count {
            let place = PLACES[random.below(2) as usize];
            let (to, from) = (channels[n].0.clone(), channels[(n + 1) % count].1.clone());
            place
                .process(&mut system, &format!("t{n}"), &format!("p{n}"))
                .spawn(async move {
                    if n == 0 {
                        to.send(0).await?;
                    }
                    loop {
                        let hops = from.recv().await?;
                        if hops < rounds {
                            to.send(hops + 1).await?;
                        }
                        // Else the token is lost, and all wait for ever.
                    }
                })
                .unwrap();
        }
        drop(channels);
        let found = deadlock_of(&system);
        let report = system.report().unwrap();
        let polls: u64 = report.processes.iter().map(|one| one.polls).sum();
        assert!(polls > rounds, "it was found before the token was lost");
        assert_eq!(found.waits.len(), count);
        assert_eq!(found.cycle.len(), count, "{found}");
    }
}

#[test]
fn it_is_found_also_after_the_outside_has_come_and_gone() {
    let _watchdog = watchdog();
    let mut system = strict("then");
    let (sender, receiver) = luna::channel();
    let sender = sender.external();
    let (_keep, never) = luna::channel::<()>();
    let main = system.executor("main").build().unwrap();
    main.process("process")
        .spawn(async move {
            receiver.recv().await?;
            never.recv().await?;
            Ok(())
        })
        .unwrap();
    std::thread::spawn(move || {
        std::thread::sleep(LONG);
        sender.blocking_send(()).unwrap();
    });
    assert_eq!(deadlock_of(&system).waits.len(), 1);
}

#[test]
fn it_is_found_also_when_the_last_call_is_forgotten() {
    let _watchdog = watchdog();
    let mut system = strict("call");
    let (_keep, never) = luna::channel::<()>();
    let main = system.executor("main").build().unwrap();
    main.process("process")
        .spawn(async move {
            {
                let mut call = std::pin::pin!(luna::blocking(|| std::thread::sleep(LONG)));
                std::future::poll_fn(|cx| {
                    assert!(call.as_mut().poll(cx).is_pending());
                    std::task::Poll::Ready(())
                })
                .await;
            }
            never.recv().await?;
            Ok(())
        })
        .unwrap();
    assert_eq!(deadlock_of(&system).waits.len(), 1);
}

fn run_stuck(is_alone: bool) {
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

/// Played by children of these tests.
#[test]
fn part() {
    match common::part().as_deref() {
        Some("system") => run_stuck(false),
        Some("alone") => run_stuck(true),
        _ => {}
    }
}

/// Ends when the one before has, and holds what the next one waits for until it is buried.
struct Link {
    before: luna::Receiver<()>,
    _next: luna::Sender<()>,
}

impl Process for Link {
    async fn run(&mut self) -> luna::Result<()> {
        assert!(self.before.recv().await.is_err());
        Ok(())
    }
}

#[test]
fn what_those_hold_who_are_not_buried_yet_is_no_deadlock() {
    let _watchdog = watchdog();
    for _ in 0..300 {
        let mut system = strict("chain");
        let (first, mut before) = luna::channel();
        let executors = ["one", "other"].map(|name| system.executor(name).build().unwrap());
        for number in 0..4 {
            let (next, after) = luna::channel();
            let link = Link {
                before: std::mem::replace(&mut before, after),
                _next: next,
            };
            executors[number % 2]
                .process(&format!("link {number}"))
                .spawn(link)
                .unwrap();
        }
        executors[0]
            .process("first")
            .spawn(async move {
                luna::after(Duration::from_millis(1)).await;
                drop(first);
                Ok(())
            })
            .unwrap();
        system.run().unwrap();
    }
}
