//! Calls: the reply reaches the client that called, once, or no client; whatever is dropped,
//! poisoned or preferred meanwhile.

#![cfg(not(loom))]

use crate::common;
use common::{Ledger, Random, Token, Wakes, Watchdog, pending, poll_with, ready};
use futures_lite::future::block_on;
use luna_channels::{
    Call, CallError, Client, RecvError, Server, TryRecvError, alt, call_channel, channel, pri_alt,
};
use luna_core::current;
use luna_core::{Executor, Exit, OsThread, ProcessSpec};
use luna_platform::thread::Attributes;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

/// A call that a server has accepted.
fn accepted<Q: Send, A: Send>(server: &Server<Q, A>) -> Call<'_, Q, A> {
    ready(&mut Box::pin(server.accept())).unwrap()
}

#[test]
fn the_reply_comes_whichever_was_first() {
    for client_first in [false, true] {
        let (client, server) = call_channel();
        let (wakes, waker) = Wakes::new();
        let mut call = Box::pin(client.call(5));
        let mut accept = Box::pin(server.accept());
        if !client_first {
            pending(&mut accept);
        }
        assert!(poll_with(&mut call, &waker).is_pending());
        let accepted = ready(&mut accept).unwrap();
        assert!(poll_with(&mut call, &waker).is_pending());
        assert_eq!((*accepted, wakes.count()), (5, 0));
        assert_eq!(accepted.reply("six"), Ok(()));
        assert_eq!(wakes.count(), 1);
        assert_eq!(ready(&mut call), Ok("six"));
    }
}

#[test]
fn several_are_answered_in_any_order() {
    let (client, server) = call_channel();
    let mut calls: Vec<_> = (0..3).map(|n| Box::pin(client.call(n))).collect();
    calls.iter_mut().for_each(pending);
    let mut served: Vec<_> = (0..3).map(|_| Some(accepted(&server))).collect();
    for n in [1, 2, 0] {
        pending(&mut calls[n]);
        let call = served[n].take().unwrap();
        let answer = *call * 10;
        assert_eq!(call.reply(answer), Ok(()));
        assert_eq!(ready(&mut calls[n]), Ok(n * 10));
    }
}

#[test]
fn a_call_that_is_dropped_is_unanswered() {
    let ledger = Ledger::new(1);
    let (client, server) = call_channel::<_, ()>();
    let mut call = Box::pin(client.call(ledger.token(0)));
    pending(&mut call);
    let served = accepted(&server);
    assert_eq!(ledger.dropped(), []);
    drop(served);
    ledger.assert_all_dropped_once();
    assert_eq!(
        ready(&mut call).map_err(|error| error.is_unanswered()),
        Err(true)
    );
}

#[test]
fn a_server_that_panics_leaves_its_client_unanswered() {
    let _watch = Watchdog::new();
    let (client, server) = call_channel::<u32, u32>();
    let thread = thread::spawn(move || {
        let _call = server.blocking_accept().unwrap();
        panic!("on purpose");
    });
    assert_eq!(client.blocking_call(1), Err(CallError::Unanswered));
    assert!(thread.join().is_err());
}

#[test]
fn the_request_comes_back_if_nobody_took_it() {
    let (client, server) = call_channel::<u32, ()>();
    let mut waits = Box::pin(client.call(1));
    pending(&mut waits);
    drop(server);
    assert_eq!(ready(&mut waits), Err(CallError::Closed(1)));
    assert_eq!(block_on(client.call(2)), Err(CallError::Closed(2)));
    let (client, server) = call_channel::<u32, ()>();
    let mut waits = Box::pin(client.call(1));
    pending(&mut waits);
    server.poison();
    assert_eq!(ready(&mut waits), Err(CallError::Poisoned(1)));
    assert_eq!(block_on(client.call(2)), Err(CallError::Poisoned(2)));
    assert_eq!(
        block_on(server.accept()).map(drop),
        Err(RecvError::Poisoned)
    );
    assert_eq!(
        server.try_accept().map(drop).unwrap_err(),
        TryRecvError::Poisoned
    );
}

#[test]
fn poisoned_while_it_is_served_the_call_is_interrupted() {
    let (client, server) = call_channel::<u32, u32>();
    let mut call = Box::pin(client.call(1));
    pending(&mut call);
    let served = accepted(&server);
    client.poison();
    assert_eq!(ready(&mut call), Err(CallError::Interrupted));
    assert_eq!(served.reply(7), Err(7));
}

#[test]
fn poison_after_the_reply_changes_nothing() {
    let (client, server) = call_channel::<u32, u32>();
    let mut call = Box::pin(client.call(1));
    pending(&mut call);
    accepted(&server).reply(7).unwrap();
    client.poison();
    assert_eq!(ready(&mut call), Ok(7));
}

#[test]
fn an_accept_that_was_given_its_call_has_it_after_poison() {
    let (client, server) = call_channel::<u32, u32>();
    let mut accept = Box::pin(server.accept());
    pending(&mut accept);
    let mut call = Box::pin(client.call(1));
    pending(&mut call);
    server.poison();
    let served = ready(&mut accept).unwrap();
    assert_eq!((*served, served.reply(7)), (1, Err(7)));
    assert_eq!(ready(&mut call), Err(CallError::Interrupted));
}

#[test]
fn clients_that_go_are_never_written_to() {
    let ledger = Ledger::new(4);
    let (client, server) = call_channel::<Token, Token>();
    // Before it was taken.
    let mut call = Box::pin(client.call(ledger.token(0)));
    pending(&mut call);
    drop(call);
    assert!(server.try_accept().unwrap_err().is_empty());
    // While it is served.
    let mut call = Box::pin(client.call(ledger.token(1)));
    pending(&mut call);
    let served = accepted(&server);
    drop(call);
    assert_eq!(served.reply(ledger.token(2)).unwrap_err().id, 2);
    // With the reply that it did not take.
    let mut call = Box::pin(client.call(ledger.token(3)));
    pending(&mut call);
    let (request, reply) = accepted(&server).into_parts();
    reply.send(request).unwrap();
    assert_eq!(ledger.dropped(), [0, 1, 2]);
    drop(call);
    ledger.assert_all_dropped_once();
}

#[test]
fn a_call_dropped_by_its_accept_goes_to_the_next_server() {
    let (client, server) = call_channel::<u32, u32>();
    let mut one = Box::pin(server.accept());
    pending(&mut one);
    let mut call = Box::pin(client.call(1));
    pending(&mut call);
    let (wakes, waker) = Wakes::new();
    let mut two = Box::pin(server.accept());
    assert!(poll_with(&mut two, &waker).is_pending());
    drop(one);
    assert_eq!(wakes.count(), 1);
    let served = ready(&mut two).unwrap();
    pending(&mut call);
    assert_eq!(served.reply(9), Ok(()));
    assert_eq!(ready(&mut call), Ok(9));
}

#[test]
fn a_call_dropped_by_its_accept_waits_again_before_its_equals() {
    let (client, server) = call_channel::<u32, u32>();
    let mut calls: Vec<_> = (0..2).map(|n| Box::pin(client.call(n))).collect();
    calls.iter_mut().for_each(pending);
    // It takes the first call, lets others run, and is dropped then.
    outranked(|| pending(&mut Box::pin(server.accept())));
    for n in 0..2 {
        let served = accepted(&server);
        assert_eq!(*served, n);
        served.reply(5).unwrap();
        assert_eq!(ready(&mut calls[n as usize]), Ok(5));
    }
}

#[test]
fn a_client_that_waits_again_gets_its_request_back_when_poisoned() {
    let (client, server) = call_channel::<u32, u32>();
    let mut accept = Box::pin(server.accept());
    pending(&mut accept);
    let mut call = Box::pin(client.call(1));
    pending(&mut call);
    drop(accept);
    server.poison();
    assert_eq!(ready(&mut call), Err(CallError::Poisoned(1)));
}

#[test]
fn a_client_that_waits_again_leaves_no_trace() {
    let ledger = Ledger::new(1);
    let (client, server) = call_channel::<Token, ()>();
    let mut accept = Box::pin(server.accept());
    pending(&mut accept);
    let mut call = Box::pin(client.call(ledger.token(0)));
    pending(&mut call);
    drop(accept);
    assert_eq!(ledger.dropped(), []);
    drop(call);
    ledger.assert_all_dropped_once();
    assert!(server.try_accept().unwrap_err().is_empty());
}

#[test]
fn an_accept_dropped_when_its_client_has_gone_drops_the_request() {
    let ledger = Ledger::new(1);
    let (client, server) = call_channel::<Token, ()>();
    let mut accept = Box::pin(server.accept());
    pending(&mut accept);
    let mut call = Box::pin(client.call(ledger.token(0)));
    pending(&mut call);
    drop(call);
    assert_eq!(ledger.dropped(), []);
    drop(accept);
    ledger.assert_all_dropped_once();
    assert!(server.try_accept().unwrap_err().is_empty());
}

#[test]
fn both_ends_are_guards() {
    let _watch = Watchdog::new();
    for priority in [false, true] {
        let (client, server) = call_channel::<u32, u32>();
        let (_idle, never) = channel::<u32>();
        let serve = async {
            for _ in 0..2 {
                alt! {
                    call = server.accept() => {
                        let call = call.unwrap();
                        let answer = *call + 1;
                        call.reply(answer).unwrap();
                    }
                    value = never.recv() => panic!("{value:?}"),
                }
            }
        };
        let work = async {
            for n in 0..2 {
                if priority {
                    pri_alt! {
                        answer = client.call(n) => assert_eq!(answer, Ok(n + 1)),
                        value = never.recv() => panic!("{value:?}"),
                    }
                } else {
                    alt! {
                        answer = client.call(n) => assert_eq!(answer, Ok(n + 1)),
                        value = never.recv() => panic!("{value:?}"),
                    }
                }
            }
        };
        block_on(futures_lite::future::zip(serve, work));
        block_on(async {
            pri_alt! {
                answer = client.call(0) => panic!("{answer:?}"),
                skip => {}
            }
        });
        assert!(server.try_accept().unwrap_err().is_empty());
    }
}

/// Calls `f` in a process of an executor with another ready process of higher level: operations
/// that complete at once let it run.
fn outranked(f: impl FnOnce()) {
    let executor_id = current::ExecutorId::new();
    let timers = Arc::new(luna_core::timer_queue::TimerQueue::new());
    let _entered = current::enter_executor(executor_id, timers, false);
    let id = current::ProcessId::new();
    let process = current::Alone::new(id, 0, 0, std::task::Waker::noop().clone());
    crate::common::beside_a_ready_process(5, || {
        // SAFETY: this thread is the executor of the process, and the process lives.
        unsafe { current::with_process(&process, f) };
    });
}

#[test]
fn an_alternative_whose_call_was_taken_and_given_back_stays_with_it() {
    for accepts_in_alternative in [false, true] {
        let (client, server) = call_channel::<u32, u32>();
        let (other, others) = channel::<u32>();
        let mut work = Box::pin(async {
            alt! {
                answer = client.call(1) => answer,
                value = others.recv() => panic!("{value:?}"),
            }
        });
        pending(&mut work);
        outranked(|| {
            if accepts_in_alternative {
                pending(&mut Box::pin(async {
                    alt! { call = server.accept() => drop(call) }
                }));
            } else {
                pending(&mut Box::pin(server.accept()));
            }
        });
        pending(&mut work);
        assert!(other.try_send(5).unwrap_err().is_full(), "it has chosen");
        let served = accepted(&server);
        pending(&mut work);
        served.reply(3).unwrap();
        assert_eq!(ready(&mut work), Ok(3));
    }
}

#[test]
fn an_alternative_that_comes_second_and_is_given_back_waits_on() {
    let (client, server) = call_channel::<u32, u32>();
    let (other, others) = channel::<u32>();
    let mut accept = Box::pin(server.accept());
    pending(&mut accept);
    let mut work = Box::pin(async {
        alt! {
            answer = client.call(1) => answer,
            value = others.recv() => panic!("{value:?}"),
        }
    });
    pending(&mut work);
    drop(accept);
    pending(&mut work);
    assert!(other.try_send(5).unwrap_err().is_full(), "it has chosen");
    accepted(&server).reply(3).unwrap();
    assert_eq!(ready(&mut work), Ok(3));
}

#[test]
fn an_accept_that_waits_among_guards_gives_its_call_back() {
    let (client, server) = call_channel::<u32, u32>();
    let (_other, others) = channel::<u32>();
    let mut serve = Box::pin(async {
        alt! {
            call = server.accept() => drop(call),
            value = others.recv() => panic!("{value:?}"),
        }
    });
    pending(&mut serve);
    let mut call = Box::pin(client.call(1));
    pending(&mut call);
    drop(serve);
    accepted(&server).reply(3).unwrap();
    assert_eq!(ready(&mut call), Ok(3));
}

#[test]
fn a_failed_sibling_ends_a_call_at_every_point() {
    let (client, server) = call_channel::<u32, u32>();
    let failed = |call: &mut Pin<Box<luna_channels::CallOp<'_, u32, u32>>>| {
        current::with_branch_below(true, 0, 0, || ready(call))
    };
    assert_eq!(
        failed(&mut Box::pin(client.call(0))),
        Err(CallError::Poisoned(0))
    );
    let mut waits = Box::pin(client.call(1));
    pending(&mut waits);
    assert_eq!(failed(&mut waits), Err(CallError::Poisoned(1)));
    let mut held = Box::pin(client.call(2));
    pending(&mut held);
    let served = accepted(&server);
    assert_eq!(failed(&mut held), Err(CallError::Interrupted));
    assert_eq!(served.reply(7), Err(7));
    let mut answered = Box::pin(client.call(3));
    pending(&mut answered);
    accepted(&server).reply(8).unwrap();
    assert_eq!(failed(&mut answered), Ok(8));
    // And as a guard.
    let mut held = Box::pin(async {
        alt! { answer = client.call(4) => answer }
    });
    pending(&mut held);
    let served = accepted(&server);
    pending(&mut held);
    assert_eq!(
        current::with_branch_below(true, 0, 0, || ready(&mut held)),
        Err(CallError::Interrupted)
    );
    assert_eq!(served.reply(7), Err(7));
}

#[test]
fn a_call_that_is_forgotten_holds_its_client_until_the_servers_go() {
    let (client, server) = call_channel::<u32, u32>();
    let mut call = Box::pin(client.call(1));
    pending(&mut call);
    std::mem::forget(accepted(&server));
    pending(&mut call);
    drop(server);
    assert_eq!(ready(&mut call), Err(CallError::Unanswered));
}

#[test]
fn nested_calls_come_back_through_all_servers() {
    let _watch = Watchdog::new();
    let (outer, outer_server) = call_channel::<u32, u32>();
    let (inner, inner_server) = call_channel::<u32, u32>();
    let executor = Executor::start(Attributes::new("servers")).unwrap();
    let middle = executor.spawn(ProcessSpec::new("middle"), move || async move {
        while let Ok(call) = outer_server.accept().await {
            let answer = inner.call(*call + 1).await.unwrap();
            call.reply(answer).unwrap();
        }
    });
    let last = executor.spawn(ProcessSpec::new("last"), move || async move {
        while let Ok(call) = inner_server.accept().await {
            let answer = *call * 2;
            call.reply(answer).unwrap();
        }
    });
    executor.release();
    for n in 0..100 {
        assert_eq!(outer.blocking_call(n), Ok((n + 1) * 2));
    }
    drop(outer);
    assert_eq!(
        (middle.wait(), last.wait()),
        (Exit::Completed, Exit::Completed)
    );
}

/// Calls `client` with its own number and counts, and checks each reply.
async fn work(client: Client<(usize, usize), (usize, usize)>, me: usize, calls: usize) {
    for n in 0..calls {
        assert_eq!(client.call((me, n)).await, Ok((me, n + 1)));
    }
}

async fn serve(server: Server<(usize, usize), (usize, usize)>, served: Arc<AtomicUsize>) {
    while let Ok(call) = server.accept().await {
        let (client, n) = *call;
        call.reply((client, n + 1)).unwrap();
        served.fetch_add(1, Ordering::Relaxed);
    }
}

#[test]
fn each_reply_reaches_its_client_wherever_all_run() {
    let _watch = Watchdog::new();
    const CALLS: usize = 300;
    let (client, server) = call_channel();
    let served = Arc::new(AtomicUsize::new(0));
    let executors = [
        Executor::start(Attributes::new("one")).unwrap(),
        Executor::start(Attributes::new("two")).unwrap(),
    ];
    let mut processes = Vec::new();
    for (at, executor) in executors.iter().enumerate() {
        let (server, served) = (server.clone(), served.clone());
        let spec = ProcessSpec::new(format!("server {at}")).level(3);
        processes.push(executor.spawn(spec, move || serve(server, served)));
        for level in [1, 3, 9] {
            let (client, me) = (client.clone(), at * 10 + usize::from(level));
            let spec = ProcessSpec::new(format!("client {me}")).level(level);
            processes.push(executor.spawn(spec, move || work(client, me, CALLS)));
        }
    }
    let mut alone = Vec::new();
    let of_thread = client.clone();
    alone.push(
        OsThread::start(Attributes::new("three"), ProcessSpec::new("client"), || {
            work(of_thread, 20, CALLS)
        })
        .unwrap(),
    );
    let (of_server, of_served) = (server.clone(), served.clone());
    alone.push(
        OsThread::start(Attributes::new("four"), ProcessSpec::new("server"), || {
            serve(of_server, of_served)
        })
        .unwrap(),
    );
    let plain: Vec<_> = [30, 31]
        .into_iter()
        .map(|me| {
            let client = client.clone();
            thread::spawn(move || block_on(work(client, me, CALLS)))
        })
        .collect();
    let (of_server, of_served) = (server.clone(), served.clone());
    let plain_server = thread::spawn(move || block_on(serve(of_server, of_served)));
    drop((client, server));
    executors.iter().for_each(Executor::release);
    alone.iter().for_each(OsThread::release);
    for thread in plain {
        thread.join().unwrap();
    }
    plain_server.join().unwrap();
    for process in processes.iter().chain(alone.iter().map(OsThread::process)) {
        assert_eq!(process.wait(), Exit::Completed);
    }
    assert_eq!(served.load(Ordering::Relaxed), 9 * CALLS);
}

#[test]
fn under_random_drops_every_request_and_answer_ends_once() {
    let _watch = Watchdog::new();
    let mut random = Random::seeded();
    const CALLS: usize = 400;
    // Even tokens are requests, the next one is its answer.
    let ledger = Ledger::new(CALLS * 4);
    let (client, server) = call_channel::<Token, Token>();
    thread::scope(|scope| {
        for at in 0..2 {
            let (client, ledger, mut random) = (client.clone(), ledger.clone(), random.split());
            scope.spawn(move || {
                for n in 0..CALLS {
                    let id = (at * CALLS + n) * 2;
                    let call = client.call(ledger.token(id));
                    let outcome = block_on(async {
                        if random.below(3) == 0 {
                            let polls = random.below(3);
                            some_polls(call, polls).await
                        } else {
                            Some(call.await)
                        }
                    });
                    match outcome {
                        Some(Ok(answer)) => assert_eq!(answer.id, id + 1),
                        Some(Err(error)) => assert!(error.is_unanswered(), "{error}"),
                        None => {}
                    }
                }
            });
        }
        drop(client);
        for _ in 0..2 {
            let (server, ledger, mut random) = (server.clone(), ledger.clone(), random.split());
            scope.spawn(move || {
                block_on(async {
                    loop {
                        let accept = server.accept();
                        let accepted = if random.below(3) == 0 {
                            some_polls(accept, random.below(2)).await
                        } else {
                            Some(accept.await)
                        };
                        match accepted {
                            Some(Ok(call)) if random.below(8) > 0 => {
                                let answer = ledger.token(call.id + 1);
                                let _ = call.reply(answer);
                            }
                            Some(Err(_)) => return,
                            Some(Ok(_)) | None => {}
                        }
                    }
                });
            });
        }
        drop(server);
    });
    let dropped = ledger.dropped();
    let requests = dropped.iter().filter(|&&id| id % 2 == 0).count();
    assert_eq!(requests, CALLS * 2, "each request was dropped once");
}

/// Polls so often at most, letting others run in between, and drops then.
async fn some_polls<F: Future>(future: F, polls: usize) -> Option<F::Output> {
    let mut future = Box::pin(future);
    for _ in 0..polls {
        let outcome = futures_lite::future::poll_once(&mut future).await;
        if outcome.is_some() {
            return outcome;
        }
        thread::yield_now();
    }
    None
}

#[test]
fn everything_goes_and_is_shared_between_threads() {
    fn check<T: Send + Sync>() {}
    check::<Client<u32, Vec<u8>>>();
    check::<Server<u32, Vec<u8>>>();
    check::<Call<'_, u32, Vec<u8>>>();
    check::<luna_channels::Reply<'_, u32, Vec<u8>>>();
    check::<luna_channels::CallOp<'_, u32, Vec<u8>>>();
    check::<luna_channels::AcceptOp<'_, u32, Vec<u8>>>();
}

/// The server's next look drops the late call, and with it the priority that it gave.
#[test]
fn a_client_that_chose_another_guard_boosts_the_server_no_longer() {
    let _watch = Watchdog::new();
    let stage = Executor::start(Attributes::new("stage")).unwrap();
    let (client, server) = call_channel::<u32, u32>();
    let (tell, told) = channel::<()>();
    let (other, from_other) = channel::<()>();
    let level = || current::priority().level;
    let serves = stage.spawn(ProcessSpec::new("server").level(1), move || async move {
        assert!(server.try_accept().unwrap_err().is_empty()); // from here on it is known
        told.recv().await.unwrap();
        assert_eq!(level(), 20, "the client waits");
        other.try_send(()).unwrap();
        assert!(server.try_accept().unwrap_err().is_empty());
        assert_eq!(level(), 1, "no client waits");
    });
    let asks = stage.spawn(ProcessSpec::new("client").level(20), move || async move {
        tell.send(()).await.unwrap();
        alt! {
            answer = client.call(1) => panic!("{answer:?}"),
            received = from_other.recv() => received.unwrap(),
        }
    });
    stage.release();
    assert_eq!(
        (serves.wait(), asks.wait()),
        (Exit::Completed, Exit::Completed)
    );
}
