//! How processes end: by themselves, by a panic, cancelled in every state. What they held is
//! dropped once, on their own thread.

#![cfg(not(loom))]

use crate::support;
use luna_core::current::{User, dropped_ends_poison, user};
use luna_core::timer_queue::Sleep;
use luna_core::{
    Executor, ExecutorHandle, Exit, ProcessHandle, ProcessRegistry, ProcessSpec, ProcessState,
    has_given_up, yield_now,
};
use luna_platform::clock::Instant;
use luna_platform::lock::PiLock;
use luna_platform::thread::Attributes;
use std::future::{Future, pending, poll_fn};
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll, Wake, Waker};
use std::thread::ThreadId;
use std::time::Duration;
use support::{Drops, Gate, Log, executor, quiet_panics, until, watchdog};

/// Reports on which thread it was dropped. Not `Send`.
struct WhereDropped(
    Log<ThreadId>,
    #[expect(dead_code, reason = "makes it `!Send`")] Rc<()>,
);

impl Drop for WhereDropped {
    fn drop(&mut self) {
        self.0.add(std::thread::current().id());
    }
}

struct PanicsWhenDropped;

impl Drop for PanicsWhenDropped {
    fn drop(&mut self) {
        panic!("on purpose, in drop");
    }
}

#[test]
fn a_future_that_is_not_send_is_dropped_on_its_thread_however_it_ends() {
    let _watchdog = watchdog();
    quiet_panics();
    let executor = executor();
    let (threads, drops) = (Log::new(), Log::new());
    for ending in ["ends", "panics", "is cancelled", "is stopped"] {
        let (threads, drops) = (threads.clone(), drops.clone());
        let process = executor.spawn(ProcessSpec::new(ending), move || {
            threads.add(std::thread::current().id());
            let held = WhereDropped(drops, Rc::new(()));
            async move {
                yield_now().await;
                let _held = &held;
                match ending {
                    "ends" => {}
                    "panics" => panic!("on purpose"),
                    _ => pending().await,
                }
            }
        });
        if ending == "is cancelled" {
            process.cancel();
        }
    }
    executor.settle();
    executor.release();
    executor.stop();
    let threads = threads.take();
    assert_eq!(threads.len(), 4);
    assert_eq!(drops.take(), threads);
    assert_ne!(threads[0], std::thread::current().id());
}

#[test]
fn panics_in_the_poll_the_drop_and_the_builder_end_the_process_alone() {
    let _watchdog = watchdog();
    quiet_panics();
    let executor = executor();
    let drops = Drops::default();
    let panicked = |text: &str| Exit::Panicked(text.into());

    let token = drops.token();
    let at_once = executor.spawn(ProcessSpec::new("at once"), move || async move {
        let _token = token;
        panic!("on purpose");
    });
    let token = drops.token();
    let later = executor.spawn(ProcessSpec::new("in a later poll"), move || async move {
        let _token = token;
        yield_now().await;
        std::panic::panic_any(String::from("on purpose: text"));
    });
    let no_text = executor.spawn(ProcessSpec::new("no text"), || async {
        std::panic::resume_unwind(Box::new(7))
    });
    let in_drop = executor.spawn(ProcessSpec::new("in drop"), || async {
        drop(PanicsWhenDropped)
    });
    let in_cancelled_drop = executor.spawn(ProcessSpec::new("in drop, cancelled"), || async {
        let _held = PanicsWhenDropped;
        pending().await
    });
    let token = drops.token();
    let in_builder = executor.spawn(ProcessSpec::new("in builder"), move || {
        let _token = token;
        if token_is_alive() {
            panic!("on purpose, in the builder");
        }
        async {}
    });
    executor.release();
    assert_eq!(at_once.wait(), panicked("on purpose"));
    assert_eq!(later.wait(), panicked("on purpose: text"));
    assert_eq!(
        no_text.wait(),
        panicked("(a panic whose message is no text)")
    );
    assert_eq!(in_drop.wait(), panicked("on purpose, in drop"));
    assert_eq!(in_builder.wait(), panicked("on purpose, in the builder"));
    assert_eq!(
        (in_builder.polls(), in_builder.state()),
        (0, ProcessState::Ended)
    );
    in_cancelled_drop.cancel();
    assert_eq!(in_cancelled_drop.wait(), panicked("on purpose, in drop"));
    assert_eq!(drops.count(), 3);
    // And the executor goes on.
    assert_eq!(
        executor.spawn(ProcessSpec::new("next"), || async {}).wait(),
        Exit::Completed
    );
}

fn token_is_alive() -> bool {
    true
}

#[test]
fn a_refused_builder_may_panic_when_it_is_dropped() {
    let _watchdog = watchdog();
    quiet_panics();
    let registry = Arc::new(ProcessRegistry::new());
    let executor = luna_core::Executor::start_counted(
        luna_platform::thread::Attributes::new("test"),
        registry.clone(),
    )
    .unwrap();
    let handle = executor.handle().clone();
    executor.stop();
    let held = PanicsWhenDropped;
    let process = handle.spawn(
        ProcessSpec::new("refused"),
        move || async move { drop(held) },
    );
    assert_eq!(process.wait(), Exit::Panicked("on purpose, in drop".into()));
    assert_eq!(registry.count(), 0);
}

/// Cancels a process that has come to `state`, and checks that it ends so.
fn check_cancelled(process: &ProcessHandle, drops: &Drops, before: usize) {
    process.cancel();
    assert_eq!(process.wait(), Exit::Cancelled);
    assert_eq!(
        (process.state(), drops.count()),
        (ProcessState::Ended, before + 1)
    );
    process.cancel();
    assert_eq!(process.exit(), Some(Exit::Cancelled));
}

#[test]
fn cancelled_while_created_ready_and_waiting() {
    let _watchdog = watchdog();
    let (executor, drops) = (executor(), Drops::default());
    let spawn = |name| {
        let token = drops.token();
        executor.spawn(ProcessSpec::new(name), move || async move {
            let _token = token;
            pending::<()>().await;
        })
    };
    // Ready: built, not released. Its body is dropped where it runs, so after the release.
    let ready = spawn("ready");
    executor.settle();
    assert_eq!(ready.state(), ProcessState::Ready);
    ready.cancel();
    // Cancelled before it is built, perhaps: which of the two comes first is open.
    let created = spawn("created");
    created.cancel();
    executor.release();
    assert_eq!(
        (ready.wait(), created.wait(), ready.polls(), created.polls()),
        (Exit::Cancelled, Exit::Cancelled, 0, 0)
    );
    assert_eq!(drops.count(), 2);
    // Waiting for nothing.
    let waiting = spawn("waiting");
    until(|| waiting.state() == ProcessState::Waiting);
    check_cancelled(&waiting, &drops, 2);
    // Waiting for a deadline, and for another process.
    let token = drops.token();
    let sleeping = executor.spawn(ProcessSpec::new("sleeping"), move || async move {
        let _token = token;
        Sleep::until(Instant::NEVER.min(Instant::now() + std::time::Duration::from_secs(10_000)))
            .await;
    });
    until(|| sleeping.state() == ProcessState::Waiting);
    let (token, other) = (drops.token(), sleeping.clone());
    let joining = executor.spawn(ProcessSpec::new("joining"), move || async move {
        let _token = token;
        other.join().await;
    });
    until(|| joining.state() == ProcessState::Waiting);
    check_cancelled(&joining, &drops, 3);
    check_cancelled(&sleeping, &drops, 4);
}

#[test]
fn cancelled_while_running_it_ends_at_its_next_await() {
    let _watchdog = watchdog();
    let (executor, drops, log) = (executor(), Drops::default(), Log::new());
    let (inside, go_on) = (
        Arc::new(AtomicBool::new(false)),
        Arc::new(AtomicBool::new(false)),
    );
    let (token, own) = (drops.token(), log.clone());
    let (entered, left) = (inside.clone(), go_on.clone());
    let process = executor.spawn(ProcessSpec::new("busy"), move || async move {
        let _token = token;
        entered.store(true, Ordering::SeqCst);
        until(|| left.load(Ordering::SeqCst));
        own.add("ran on");
        yield_now().await;
        own.add("ran after its await");
    });
    executor.release();
    until(|| inside.load(Ordering::SeqCst));
    assert_eq!(process.state(), ProcessState::Running);
    process.cancel();
    assert_eq!(process.exit(), None);
    go_on.store(true, Ordering::SeqCst);
    assert_eq!((process.wait(), process.polls()), (Exit::Cancelled, 1));
    assert_eq!((log.take(), drops.count()), (vec!["ran on"], 1));
}

#[test]
fn a_process_that_cancels_itself() {
    let _watchdog = watchdog();
    let executor = executor();
    for completes in [true, false] {
        let itself = Arc::new(PiLock::new(None::<ProcessHandle>));
        let own = itself.clone();
        // Held, since the executor may run already.
        let mut place = itself.lock();
        let process = executor.spawn(ProcessSpec::new("itself"), move || {
            poll_fn(move |_| {
                own.lock().as_ref().unwrap().cancel();
                if completes {
                    Poll::Ready(())
                } else {
                    Poll::Pending
                }
            })
        });
        *place = Some(process.clone());
        drop(place);
        executor.release();
        let exit = if completes {
            Exit::Completed
        } else {
            Exit::Cancelled
        };
        assert_eq!((process.wait(), process.polls()), (exit, 1));
    }
}

#[test]
fn cancelled_by_a_process_of_its_own_executor_and_of_another() {
    let _watchdog = watchdog();
    let (own, other) = (executor(), executor());
    own.release();
    other.release();
    for canceller in [&own, &other] {
        let (gate, drops) = (Gate::default(), Drops::default());
        let (wait, token) = (gate.clone(), drops.token());
        let victim = own.spawn(ProcessSpec::new("victim"), move || async move {
            let _token = token;
            wait.pass().await
        });
        until(|| gate.waiting() > 0);
        let to_cancel = victim.clone();
        let process = canceller.spawn(ProcessSpec::new("canceller"), move || async move {
            to_cancel.cancel();
            to_cancel.cancel();
            assert_eq!(to_cancel.join().await, Exit::Cancelled);
        });
        assert_eq!(
            (process.wait(), victim.exit(), drops.count()),
            (Exit::Completed, Some(Exit::Cancelled), 1)
        );
        gate.open();
    }
}

#[test]
fn announced_and_dropped_or_built_in_the_turn_of_another() {
    let _watchdog = watchdog();
    quiet_panics();
    let registry = Arc::new(ProcessRegistry::new());
    let executor = Executor::start_counted(Attributes::new("announced"), registry.clone()).unwrap();
    executor.release();
    let spec = ProcessSpec::new("dropped").listed();
    let (announced, dropped) = executor.handle().announce(spec, || async {});
    assert_eq!((registry.count(), dropped.exit()), (1, None));
    drop(announced);
    assert_eq!(dropped.wait(), Exit::Cancelled);

    let own = executor.handle().clone();
    let parent = executor.spawn(ProcessSpec::new("parent").listed(), move || async move {
        let child = own.spawn(ProcessSpec::new("child").listed(), || {
            if user() == User::Outside {
                panic!("not mine");
            }
            async {}
        });
        // Built right there, and no part of the parent's turn: the panic is not the parent's.
        assert_eq!(child.exit(), Some(Exit::Panicked("not mine".to_owned())));
        assert_ne!(user(), User::Outside);
        yield_now().await;
    });
    assert_eq!(parent.wait(), Exit::Completed);
    // A waiter may be notified before the end is listed.
    executor.stop();
    let mut ended = Vec::new();
    registry.take_ended(|one| ended.push(one.id()));
    assert_eq!(ended.len(), 3);
    assert_eq!((ended[0], ended[2]), (dropped.id(), parent.id()));
    registry.take_ended(|one| panic!("{one:?} was listed twice"));
}

/// A waker of another runtime, with a bug.
struct PanicsWhenWoken;

impl Wake for PanicsWhenWoken {
    fn wake(self: Arc<Self>) {
        panic!("on purpose, in a waker");
    }
}

/// When dropped, notes where and how, spawns another one, and panics.
struct Last {
    drops: Log<(ThreadId, bool, bool)>,
    executor: ExecutorHandle,
    late: Log<ProcessHandle>,
}

impl Drop for Last {
    fn drop(&mut self) {
        self.drops.add((
            std::thread::current().id(),
            dropped_ends_poison(),
            has_given_up(),
        ));
        let spec = ProcessSpec::new("late");
        self.late.add(self.executor.spawn(spec, || async {}));
        panic!("on purpose, in drop");
    }
}

#[test]
fn a_panic_around_the_bodies_ends_them_all_on_their_thread() {
    let _watchdog = watchdog();
    quiet_panics();
    let executor = executor();
    let (threads, drops, late) = (Log::new(), Log::new(), Log::new());
    let own = threads.clone();
    let mut processes = vec![executor.spawn(ProcessSpec::new("has the waker"), move || {
        own.add(std::thread::current().id());
        async {
            let waker = Waker::from(Arc::new(PanicsWhenWoken));
            let soon = Instant::now() + Duration::from_millis(1);
            let mut sleep = Box::pin(Sleep::until(soon));
            let polled = sleep.as_mut().poll(&mut Context::from_waker(&waker));
            assert!(polled.is_pending());
            pending().await
        }
    })];
    // Some wait, and some are in the run queue.
    for number in 0..6 {
        let held = Last {
            drops: drops.clone(),
            executor: executor.handle().clone(),
            late: late.clone(),
        };
        processes.push(
            executor.spawn(ProcessSpec::new("others"), move || async move {
                let _held = held;
                if number % 2 != 0 {
                    return pending().await;
                }
                loop {
                    yield_now().await;
                }
            }),
        );
    }
    executor.release();
    for process in &processes {
        let exit = process.wait();
        let Exit::Panicked(message) = &exit else {
            panic!("{exit:?}");
        };
        assert!(
            message.ends_with("not LUNA's: on purpose, in a waker"),
            "{message}"
        );
    }
    executor.stop();
    assert!(!has_given_up());
    let here = threads.take()[0];
    assert_eq!(drops.take(), [(here, true, true); 6]);
    let late = late.take();
    assert_eq!(late.len(), 6);
    for process in late {
        assert_eq!(process.wait(), Exit::Cancelled);
    }
}
