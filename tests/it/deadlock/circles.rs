//! A circle of waiting processes is found, and each process in it is named.

use super::*;
use crate::common::SpawnOk;

#[test]
fn two_that_receive_from_each_other_first() {
    let _watchdog = watchdog();
    for left in PLACEMENTS {
        for right in PLACEMENTS {
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
            if COMPLETE {
                let holders = Partner::Holders(vec!["right".to_owned()]);
                assert_eq!(first.partner, holders);
                assert_eq!(found.cycle, ["left", "right"]);
            } else {
                assert_eq!(first.partner, Partner::Nobody);
            }
            assert!(
                found.waits[1].at.contains("tests/it/deadlock/mod.rs:"),
                "{found}"
            );
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

/// The ends of a process that sends first, in a type of its own: its body borrows them.
struct SendsFirst(Sender<u32>, Receiver<u32>);

impl Process for SendsFirst {
    async fn run(&mut self) -> luna::Result<()> {
        self.0.send(1).await?;
        self.1.recv().await?;
        Ok(())
    }
}

/// The receiving ends were never used: the report finds them in what the processes hold.
#[test]
fn two_that_send_to_each_other_first() {
    let _watchdog = watchdog();
    if !COMPLETE {
        common::skip("the portable layer does not see into bodies");
        return;
    }
    for one in PLACEMENTS {
        for two in PLACEMENTS {
            for is_type in [false, true] {
                let (a, from_a) = luna::channel::<u32>();
                let (b, from_b) = luna::channel::<u32>();
                let (a, b) = (a.named("a"), b.named("b"));
                let mut system = strict("senders");
                let spawn = |process: ProcessBuilder, to: Sender<u32>, from: Receiver<u32>| {
                    let spawned = match is_type {
                        true => process.spawn(SendsFirst(to, from)),
                        false => process.spawn(async move {
                            to.send(1).await?;
                            from.recv().await?;
                            Ok(())
                        }),
                    };
                    spawned.unwrap();
                };
                spawn(one.process(&mut system, "1", "one"), a, from_b);
                spawn(two.process(&mut system, "2", "two"), b, from_a);
                let found = deadlock_of(&system);
                let holder = |name: &str| Partner::Holders(vec![name.to_owned()]);
                assert_eq!(found.waits[0].partner, holder("two"), "{found}");
                assert_eq!(found.waits[1].partner, holder("one"), "{found}");
                assert_eq!(found.cycle, ["one", "two"]);
                let text = found.to_string();
                assert!(
                    text.contains("`one` waits to send to channel `a` for `two`, which waits to send to channel `b` for `one`"),
                    "{text}"
                );
                assert!(!text.contains("outside"), "{text}");
            }
        }
    }
}

/// What lies behind a box is not seen: then nothing is claimed.
#[test]
fn of_an_end_that_is_not_seen_nothing_is_claimed() {
    let _watchdog = watchdog();
    let mut system = strict("boxed");
    let main = system.executor("main").build().unwrap();
    let (send, receive) = luna::channel::<u32>();
    let (_keep, never) = luna::channel::<()>();
    let boxed = vec![receive];
    main.process("sender").spawn_ok(async move {
        send.send(1).await?;
        Ok(())
    });
    main.process("holder").spawn_ok(async move {
        never.recv().await?;
        drop(boxed);
        Ok(())
    });
    let found = deadlock_of(&system);
    assert_eq!(found.waits[0].partner, Partner::Nobody, "{found}");
    assert!(found.to_string().contains("external()"), "{found}");
}

#[test]
fn the_circle_is_named_when_the_ends_were_used_before() {
    let _watchdog = watchdog();
    for place in PLACEMENTS {
        let mut system = strict("used");
        let (ping, pinged) = luna::channel::<u32>();
        let (pong, ponged) = luna::channel::<u32>();
        place.process(&mut system, "1", "one").spawn_ok(async move {
            ping.send(1).await?;
            ponged.recv().await?;
            ponged.recv().await?; // one too many
            ping.send(2).await?;
            Ok(())
        });
        place.process(&mut system, "2", "two").spawn_ok(async move {
            pinged.recv().await?;
            pong.send(1).await?;
            pinged.recv().await?;
            Ok(())
        });
        let found = deadlock_of(&system);
        assert_eq!(found.cycle, ["one", "two"], "{found}");
        assert_eq!(found.waits[0].partner, Partner::Process("two".to_owned()));
    }
}

/// Its guard was listed, and the partner came afterwards. At last the locks are biased to the
/// executor, and guards are listed on the fast path.
#[test]
fn one_that_has_used_a_channel_by_an_alternative_alone_is_named() {
    let _watchdog = watchdog();
    for uses_before in [0, 100] {
        let mut system = strict("guard");
        let main = system.executor("main").build().unwrap();
        let (send, receive) = luna::channel::<u32>();
        let (_keep, never) = luna::channel::<u32>();
        let (used, unused) = (receive.clone(), never.clone());
        main.process("before").spawn_ok(async move {
            for _ in 0..uses_before {
                assert!(used.try_recv().is_err() && unused.try_recv().is_err());
            }
            Ok(())
        });
        main.process("chooser").spawn_ok(async move {
            luna::alt! {
                n = receive.recv() => { n?; }
                n = never.recv() => { n?; }
            }
            never.recv().await?;
            Ok(())
        });
        main.process("sender").spawn_ok(async move {
            send.send(1).await?;
            send.send(2).await?;
            Ok(())
        });
        let found = deadlock_of(&system);
        let of_sender = found.waits.iter().find(|wait| wait.process == "sender");
        let partner = &of_sender.expect("it waits").partner;
        assert_eq!(*partner, Partner::Process("chooser".to_owned()), "{found}");
    }
}

/// No guard was ready or listed: `skip` was chosen at once.
#[test]
fn one_that_has_offered_to_use_a_channel_is_named() {
    let _watchdog = watchdog();
    let mut system = strict("skip");
    let main = system.executor("main").build().unwrap();
    let (send, receive) = luna::channel::<u32>();
    let (_keep, never) = luna::channel::<u32>();
    main.process("chooser").spawn_ok(async move {
        for _ in 0..100 {
            luna::alt! {
                n = receive.recv() => { n?; }
                skip => {}
            }
        }
        never.recv().await?;
        drop(receive);
        Ok(())
    });
    main.process("sender").priority(1).spawn_ok(async move {
        send.send(1).await?;
        Ok(())
    });
    let found = deadlock_of(&system);
    let of_sender = found.waits.iter().find(|wait| wait.process == "sender");
    let partner = &of_sender.expect("it waits").partner;
    assert_eq!(*partner, Partner::Process("chooser".to_owned()), "{found}");
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
    main.process("sender").spawn_ok(async move {
        send.send(1).await?;
        Ok(())
    });
    main.process("chooser").spawn_ok(async move {
        luna::alt! {
            n = a.recv() => { n?; }
            n = b.recv() => { n?; }
        }
        Ok(())
    });
    main.process("parallel").spawn_ok(async move {
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
    });
    let found = deadlock_of(&system);
    let of = |name| found.waits.iter().filter(move |wait| wait.process == name);
    assert_eq!(of("sender").next().unwrap().operation, Operation::Send);
    assert_eq!(of("sender").next().unwrap().at, "channel `out`");
    assert_eq!(of("chooser").count(), 2, "{found}");
    assert_eq!(of("parallel").count(), 2, "{found}");
}

#[test]
fn one_that_joins_one_that_waits_waits_too() {
    let _watchdog = watchdog();
    let mut system = strict("joined");
    let main = system.executor("main").build().unwrap();
    let (_keep, never) = luna::channel::<()>();
    let stuck = main.process("stuck").spawn_ok(async move {
        never.recv().await?;
        Ok(())
    });
    let on = main.clone();
    main.process("joiner").spawn_ok(async move {
        let handle = on.process_handle(stuck).unwrap();
        handle.join().await;
        Ok(())
    });
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
        .spawn_ok(Stuck(never, cleaned.clone()));
    deadlock_of(&system);
    assert!(cleaned.load(Ordering::Acquire) && safe.load(Ordering::Acquire));
}

/// The count of parties that is one too great is the usual mistake.
#[test]
fn at_a_barrier_of_too_many_parties_they_wait_for_those_that_never_come() {
    let _watchdog = watchdog();
    for place in PLACEMENTS {
        let mut system = strict("barrier");
        let barrier = Barrier::new(3).named("start");
        for name in ["left", "right"] {
            let party = barrier.clone();
            let spawner = place.process(&mut system, name, name);
            spawner.spawn_ok(async move {
                party.sync().await;
                Ok(())
            });
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
    for place in PLACEMENTS {
        let mut system = strict("barrier");
        let barrier = Barrier::new(2).named("meet");
        let (sender, receiver) = luna::channel::<()>();
        let (left, right) = (barrier.clone(), barrier);
        let spawner = place.process(&mut system, "l", "left");
        spawner.spawn_ok(async move {
            left.sync().await;
            left.sync().await;
            sender.send(()).await?;
            Ok(())
        });
        let spawner = place.process(&mut system, "r", "right");
        spawner.spawn_ok(async move {
            right.sync().await;
            receiver.recv().await?;
            right.sync().await;
            Ok(())
        });
        let found = deadlock_of(&system);
        let wait = &found.waits[0];
        assert_eq!(
            (wait.process.as_str(), wait.operation, &wait.partner),
            ("left", Operation::Sync, &Partner::Others)
        );
        assert_eq!(found.waits[1].process, "right");
    }
}
