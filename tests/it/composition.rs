//! The picture of a system: before it runs, while it runs, and after; its threads, processes, named
//! sub-processes and channels.

use crate::common;
use common::{PLACEMENTS, Placement, SpawnOk, watchdog};
use luna::inspect::Composition;
use luna::inspect::{ChannelKind, EndUser, ProcessKind, ThreadKind};
use luna::prelude::*;
use luna::process::ProcessState;
use luna::system::Observer;
use luna::{Error, Exit};
use std::sync::{Arc, Mutex, mpsc};

fn process(name: &str) -> Option<EndUser> {
    Some(EndUser::Process(name.to_owned()))
}

/// Looks until what it sees is as it is to become.
fn until(observer: &Observer, is_so: impl Fn(&Composition) -> bool) -> Composition {
    loop {
        let composition = observer.composition();
        if is_so(&composition) {
            return composition;
        }
        std::thread::yield_now();
    }
}

fn is_waiting(composition: &Composition, name: &str) -> bool {
    composition
        .find(name)
        .is_some_and(|part| part.state == ProcessState::Waiting)
}

#[test]
fn before_the_start_it_shows_what_was_asked_for() {
    let _watchdog = watchdog();
    let mut system = System::new("planned");
    let control = system
        .executor("control")
        .core(0)
        .policy(Policy::fifo(80))
        .build()
        .unwrap();
    system.executor("idle").build().unwrap();
    let console = system.thread("console");
    control
        .process("loop")
        .priority(20)
        .spawn_ok(async { Ok(()) });
    console.process("operator").spawn_ok(async { Ok(()) });
    let composition = system.composition();
    let names: Vec<_> = composition
        .threads
        .iter()
        .map(|thread| (thread.name.as_str(), thread.kind))
        .collect();
    assert_eq!(
        names,
        [
            ("control", ThreadKind::Executor),
            ("idle", ThreadKind::Executor),
            ("console", ThreadKind::OsThread)
        ]
    );
    assert_eq!(
        (composition.threads[0].policy, composition.threads[0].core),
        (Policy::fifo(80), Some(0))
    );
    let part = &composition.threads[0].processes[0];
    assert_eq!(
        (part.name.as_str(), part.kind, part.state, part.priority),
        ("loop", ProcessKind::UserThread, ProcessState::Created, 20)
    );
    let operator = composition.find("operator").unwrap();
    assert_eq!(operator.kind, ProcessKind::OsThread);
    assert_eq!(composition.channels, []);
}

#[test]
fn while_it_runs_it_shows_what_there_is_and_what_each_does() {
    let _watchdog = watchdog();
    let mut system = System::new("running");
    let observer = system.observer();
    let main = system.executor("main").build().unwrap();
    let own = system.thread("own");
    let (numbers, printer) = luna::channel::<u32>();
    let (end, ending) = luna::channel::<()>();
    let (extra, extras) = luna::buffered::<u32>(Buffer::fifo(4));
    let (numbers, ending, extra) = (
        numbers.named("numbers"),
        ending.named("end"),
        extra.named("extra"),
    );
    main.process("source").priority(7).spawn_ok(async move {
        extra.send(1).await?;
        extra.send(2).await?;
        par!(
            luna::named("producer", async {
                numbers.send(1).await?;
                numbers.send(2).await?;
                Ok(())
            }),
            luna::named(
                "outer",
                luna::named("inner", async {
                    ending.recv().await?;
                    Ok::<(), Error>(())
                })
            ),
        )
        .await?;
        Ok(())
    });
    let (go, gone) = luna::channel::<()>();
    let go = go.external();
    own.process("sink").spawn_ok(async move {
        printer.recv().await?;
        gone.recv().await?;
        printer.recv().await?;
        extras.recv().await?;
        end.send(()).await?;
        Ok(())
    });

    let ran = std::thread::spawn(move || {
        let report = system.run();
        (system, report)
    });
    // The states are read before the channels, so both show the system at rest: the second number
    // is offered, and the sink waits for the plain thread.
    let composition = until(&observer, |one| {
        let waits_at = |name: Option<&str>| {
            let mut channels = one.channels.iter();
            channels.any(|it| it.name.as_deref() == name && !it.waiting.is_empty())
        };
        ["source", "sink", "inner"]
            .iter()
            .all(|name| is_waiting(one, name))
            && waits_at(Some("numbers"))
            && waits_at(None)
    });
    let source = composition.find("source").unwrap();
    assert_eq!((source.kind, source.priority), (ProcessKind::UserThread, 7));
    let children: Vec<_> = source
        .children
        .iter()
        .map(|child| child.name.as_str())
        .collect();
    assert_eq!(children, ["producer", "outer"]);
    let inner = &source.children[1].children[0];
    assert_eq!(
        (inner.name.as_str(), inner.kind, inner.id, inner.priority),
        ("inner", ProcessKind::SubProcess, source.id, 7)
    );
    assert_eq!(
        composition.find("sink").unwrap().kind,
        ProcessKind::OsThread
    );

    let channel = |name: &str| {
        let mut channels = composition.channels.iter();
        channels
            .find(|one| one.name.as_deref() == Some(name))
            .unwrap()
    };
    let numbers = channel("numbers");
    assert_eq!(numbers.kind, ChannelKind::Rendezvous);
    assert_eq!(
        (&numbers.sender, &numbers.receiver),
        (&process("source"), &process("sink"))
    );
    assert!(
        numbers.waiting[0].sends && Some(&numbers.waiting[0].user) == process("source").as_ref()
    );
    let extra = channel("extra");
    assert_eq!((extra.kind, extra.buffered), (ChannelKind::Buffered(4), 2));
    assert_eq!(
        (&extra.sender, &extra.receiver),
        (&process("source"), &None)
    );
    let end = channel("end");
    assert_eq!((&end.sender, &end.receiver), (&None, &process("source")));
    let unnamed = composition
        .channels
        .iter()
        .find(|one| one.name.is_none())
        .unwrap();
    assert!(unnamed.external && unnamed.made_at.contains("composition.rs:"));

    let text = composition.to_string();
    for line in [
        "system `running`",
        "  executor `main`: other, any core",
        "    process `source`: priority 7, waiting",
        "      sub-process `producer`: priority 7, waiting",
        "        sub-process `inner`: priority 7, waiting",
        "  OS thread `own`: other, any core",
        "    OS-thread process `sink`: priority 16, waiting",
        "  channel `numbers`: `source` -> `sink`, rendezvous; `source` waits to send",
        "  channel `extra`: `source` -> nobody yet, 2 of 4 buffered",
    ] {
        assert!(
            text.lines().any(|one| one == line),
            "`{line}` is not in:\n{text}"
        );
    }

    go.blocking_send(()).unwrap();
    let (system, report) = ran.join().unwrap();
    report.unwrap();
    let after = system.composition();
    assert!(after.find("source").unwrap().children.is_empty());
    assert_eq!(after.find("sink").unwrap().state, ProcessState::Ended);
    assert_eq!(after.threads.len(), 2);
}

#[test]
fn it_is_seen_from_within_by_a_process_that_runs() {
    let _watchdog = watchdog();
    for place in PLACEMENTS {
        let mut system = System::new("within");
        let observer = system.observer();
        place
            .process(&mut system, "main", "looker")
            .spawn_ok(luna::named("itself", async move {
                let composition = observer.composition();
                let looker = composition.find("looker").unwrap();
                assert_eq!(looker.state, ProcessState::Running);
                assert_eq!(looker.children[0].state, ProcessState::Running);
                Ok(())
            }));
        system.run().unwrap();
        assert!(system.composition().find("itself").is_none());
    }
}

#[test]
fn processes_that_come_late_are_shown_where_they_run() {
    let _watchdog = watchdog();
    let mut system = System::new("late");
    let observer = system.observer();
    let main = system.executor("main").build().unwrap();
    let thread = Mutex::new(Some(system.thread("own").process("late thread")));
    let on = main.clone();
    main.process("first").spawn_ok(async move {
        on.process("late process")
            .priority(3)
            .spawn(async { Ok(()) })?;
        let late = thread.lock().unwrap().take().unwrap();
        late.spawn(async { Ok(()) })?;
        let composition = observer.composition();
        let on_main: Vec<_> = composition.threads[0]
            .processes
            .iter()
            .map(|process| process.name.as_str())
            .collect();
        assert_eq!(on_main, ["first", "late process"]);
        assert_eq!(composition.threads[1].name, "own");
        assert_eq!(composition.threads[1].processes[0].name, "late thread");
        Ok(())
    });
    system.run().unwrap();
}

#[test]
fn what_is_named_goes_with_its_future_however_it_ends() {
    let _watchdog = watchdog();
    let mut system = System::new("ends");
    let observer = system.observer();
    let main = system.executor("main").build().unwrap();
    let seen = Arc::new(Mutex::new(Vec::new()));
    let see = {
        let seen = seen.clone();
        move |observer: &Observer| {
            let composition = observer.composition();
            let looker = composition.find("looker").unwrap();
            let names = looker.children.iter().map(|child| child.name.clone());
            seen.lock().unwrap().push(names.collect::<Vec<_>>());
        }
    };
    main.process("looker").spawn_ok(async move {
        {
            // Dropped where it waits, by an alternative of futures that the other one wins.
            let lost = luna::named("lost", std::future::pending::<()>());
            let quick = luna::named("quick", async {
                luna::yield_now().await;
                see(&observer);
            });
            futures_lite::future::or(lost, quick).await;
        }
        see(&observer);
        // A branch that fails ends the others.
        let failed = par!(
            luna::named("fails", async { Err::<(), _>(Error::other("no")) }),
            luna::named("goes on", async {
                luna::yield_now().await;
                see(&observer);
                Ok::<(), Error>(())
            }),
        )
        .await;
        assert!(failed.is_err());
        see(&observer);
        Ok(())
    });
    system.run().unwrap();
    let seen = std::mem::take(&mut *seen.lock().unwrap());
    assert_eq!(
        seen,
        [vec!["lost", "quick"], vec![], vec!["goes on"], vec![]]
    );
}

#[test]
fn one_that_is_cancelled_or_panics_leaves_nothing_behind() {
    let _watchdog = watchdog();
    let mut system = System::new("cancelled");
    let observer = system.observer();
    let main = system.executor("main").build().unwrap();
    let on = main.clone();
    let victim = main
        .process("victim")
        .spawn_ok(luna::named("part of the victim", std::future::pending()));
    main.process("killer").spawn_ok(async move {
        luna::yield_now().await;
        assert!(observer.composition().find("part of the victim").is_some());
        let victim = on.process_handle(victim).unwrap();
        victim.cancel();
        assert_eq!(victim.join().await, Exit::Cancelled);
        assert!(observer.composition().find("part of the victim").is_none());
        Ok(())
    });
    assert!(
        system.run().is_err(),
        "the run returns the cancellation as an error"
    );

    let mut system = System::new("panics");
    let main = system.executor("main").build().unwrap();
    main.process("bad").spawn_ok(luna::named("part", async {
        std::panic::resume_unwind(Box::new("on purpose"));
    }));
    assert!(system.run().is_err());
    assert!(system.composition().find("part").is_none());
}

#[test]
fn looking_from_many_threads_disturbs_nobody() {
    let _watchdog = watchdog();
    let mut system = System::new("busy");
    let observer = system.observer();
    for place in [Placement::Executor, Placement::Thread] {
        let name = format!("{place:?}");
        place.process(&mut system, &name, &name).spawn_ok(async {
            for n in 0..500 {
                par!(
                    luna::named(
                        &format!("a{n}"),
                        luna::named("b", async {
                            luna::yield_now().await;
                            Ok(())
                        })
                    ),
                    luna::named("c", async { Ok::<(), Error>(()) }),
                )
                .await?;
            }
            Ok(())
        });
    }
    let (done, ended) = mpsc::channel::<()>();
    let lookers: Vec<_> = (0..2)
        .map(|_| (observer.clone(), done.clone()))
        .map(|(observer, done)| {
            std::thread::spawn(move || {
                let mut looks = 0;
                while done.send(()).is_ok() {
                    let composition = observer.composition();
                    for process in composition
                        .threads
                        .iter()
                        .flat_map(|thread| &thread.processes)
                    {
                        for child in &process.children {
                            assert_eq!(
                                (child.id, child.kind),
                                (process.id, ProcessKind::SubProcess)
                            );
                        }
                    }
                    looks += 1;
                }
                looks
            })
        })
        .collect();
    system.run().unwrap();
    drop(ended);
    for looker in lookers {
        assert!(looker.join().unwrap() > 0);
    }
}

#[test]
fn channels_of_one_line_are_told_apart_by_their_numbers() {
    let line = line!() + 1;
    let make = || luna::buffered::<u32>(Buffer::overwrite_oldest(1));
    let (first, second) = (make(), make());
    let (mut system, seen) = (System::new("twins"), Arc::new(Mutex::new(Vec::new())));
    let (observer, notes) = (system.observer(), seen.clone());
    let main = system.executor("main").build().unwrap();
    main.process("uses").spawn_ok(async move {
        for (sender, receiver) in [&first, &second] {
            sender.send(1).await?;
            receiver.recv().await?;
        }
        let here = format!("{}:{line}:", file!());
        let channels = observer.composition().channels.into_iter();
        let of_this_line = channels.filter(|part| part.made_at.starts_with(&here));
        let places = of_this_line.map(|part| (part.made_at, part.overwrites));
        *notes.lock().unwrap() = places.collect();
        Ok(())
    });
    system.run().unwrap();
    let places = seen.lock().unwrap();
    let [(one, true), (other, true)] = &places[..] else {
        panic!("{places:?}")
    };
    assert_eq!(*other, format!("{one} (2)"));
}
