//! A server works at its client's priority until it has replied: no process of a priority in
//! between runs meanwhile. Seen in the order of events, and in the kernel's data on the thread.

use crate::common;
use crate::levels;
use common::{Log, SpawnOk, real_time_core};
use levels::{burner, level, on_one_executor};
use luna::channel::{Call, Server, call_channel};
use luna::prelude::*;
use luna::system::ProcessBuilder;
use luna::yield_now;
use luna_platform::thread::current_policy;
use std::sync::atomic::{AtomicU64, Ordering};

/// A process of the lowest level, which runs when all others wait: it lets one of them go on.
fn starter(process: ProcessBuilder) -> luna::Receiver<()> {
    let (go, gone) = luna::channel::<()>();
    process.spawn_ok(async move {
        go.send(()).await?;
        Ok(())
    });
    gone
}

/// Serves one call with several steps in which others could run.
async fn serve_slowly(server: &Server<(), u8>, log: &Log) -> luna::Result<()> {
    let call = server.accept().await?;
    log.add("accepted");
    for _ in 0..5 {
        yield_now().await;
    }
    let _ = call.reply(level());
    Ok(())
}

#[test]
fn nobody_between_client_and_server_runs_before_the_reply() {
    own_process!();
    let log = Log::default();
    on_one_executor(|process| {
        let (client, server) = call_channel::<(), u8>();
        let start = burner(process("burner", 10), &log);
        let gone = starter(process("starter", 0));
        let own = log.clone();
        process("client", 20).spawn_ok(async move {
            gone.recv().await?;
            start.try_send(())?;
            own.add("call");
            assert_eq!(client.call(()).await?, 20);
            own.add("answer");
            Ok(())
        });
        let own = log.clone();
        process("server", 1).spawn_ok(async move {
            assert_eq!(level(), 1);
            serve_slowly(&server, &own).await?;
            assert_eq!(level(), 1, "given back with the reply");
            own.add("replied");
            yield_now().await;
            own.add("server");
            Ok(())
        });
    });
    assert_eq!(log.between("call", "answer"), ["accepted", "replied"]);
    assert_eq!(
        log.between("replied", "server"),
        [["answer"].as_slice(), &["burn"; 50]].concat()
    );
}

#[test]
fn two_plain_channels_let_those_between_run() {
    own_process!();
    // What the test above would see without inheritance.
    let log = Log::default();
    on_one_executor(|process| {
        let (request, requests) = luna::channel::<()>();
        let (reply, replies) = luna::channel::<()>();
        let start = burner(process("burner", 10), &log);
        let gone = starter(process("starter", 0));
        let own = log.clone();
        process("client", 20).spawn_ok(async move {
            gone.recv().await?;
            start.try_send(())?;
            own.add("call");
            request.send(()).await?;
            replies.recv().await?;
            own.add("answer");
            Ok(())
        });
        process("server", 1).spawn_ok(async move {
            requests.recv().await?;
            reply.send(()).await?;
            Ok(())
        });
    });
    assert_eq!(log.between("call", "answer"), ["burn"; 50]);
}

#[test]
fn a_server_that_comes_second_inherits_before_others_run() {
    own_process!();
    for in_alternative in [false, true] {
        let log = Log::default();
        on_one_executor(|process| {
            let (client, server) = call_channel::<(), u8>();
            let start = burner(process("burner", 10), &log);
            let own = log.clone();
            process("client", 20).spawn_ok(async move {
                assert_eq!(client.call(()).await?, 20);
                own.add("answer");
                Ok(())
            });
            let own = log.clone();
            process("server", 1).spawn_ok(async move {
                start.try_send(())?;
                own.add("accept");
                if in_alternative {
                    alt! {
                        call = server.accept() => {
                            yield_now().await;
                            let _ = call?.reply(level());
                        }
                    }
                } else {
                    serve_slowly(&server, &own).await?;
                }
                Ok(())
            });
        });
        assert!(!log.between("accept", "answer").contains(&"burn".into()));
    }
}

#[test]
fn a_priority_is_passed_on_by_a_server_that_calls() {
    own_process!();
    let log = Log::default();
    on_one_executor(|process| {
        let (client, server) = call_channel::<(), u8>();
        let (inner, inner_server) = call_channel::<(), u8>();
        let start = burner(process("burner", 10), &log);
        let gone = starter(process("starter", 0));
        let own = log.clone();
        process("client", 20).spawn_ok(async move {
            gone.recv().await?;
            start.try_send(())?;
            own.add("call");
            assert_eq!(client.call(()).await?, 20);
            own.add("answer");
            Ok(())
        });
        process("server", 2).spawn_ok(async move {
            let call = server.accept().await?;
            let answer = inner.call(()).await?;
            let _ = call.reply(answer);
            assert_eq!(level(), 2);
            Ok(())
        });
        let own = log.clone();
        process("inner server", 1).spawn_ok(async move { serve_slowly(&inner_server, &own).await });
    });
    assert_eq!(log.between("call", "answer"), ["accepted"]);
}

#[test]
fn with_several_calls_the_highest_counts_until_it_is_answered() {
    own_process!();
    on_one_executor(|process| {
        let (client, server) = call_channel::<u8, ()>();
        for of_client in [5, 9, 20, 9] {
            let client = client.clone();
            process(
                &format!("client {of_client} {}", client_number()),
                of_client,
            )
            .spawn_ok(async move { Ok(client.call(of_client).await?) });
        }
        drop(client);
        let gone = starter(process("starter", 0));
        process("server", 7).spawn_ok(async move {
            // All wait by then.
            gone.recv().await?;
            // Most urgent first: 20, 9, 9, 5.
            let mut calls: Vec<Option<Call<'_, u8, ()>>> = Vec::new();
            while let Ok(call) = server.try_accept() {
                calls.push(Some(call));
            }
            let served: Vec<u8> = calls.iter().flatten().map(|call| **call).collect();
            assert_eq!((served, level()), (vec![20, 9, 9, 5], 20));
            for (answered, now) in [(1, 20), (0, 9), (3, 9), (2, 7)] {
                calls[answered].take().unwrap().reply(()).unwrap();
                assert_eq!(level(), now, "after the reply to {answered}");
            }
            Ok(())
        });
    });
}

/// Processes of one system have different names.
fn client_number() -> u64 {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    NEXT.fetch_add(1, Ordering::Relaxed)
}

#[test]
fn a_boost_ends_however_the_call_ends() {
    own_process!();
    on_one_executor(|process| {
        let (client, server) = call_channel::<u8, ()>();
        process("client", 20).spawn_ok(async move {
            assert!(client.call(0).await.unwrap_err().is_unanswered());
            assert!(client.call(1).await.is_ok());
            assert!(client.call(2).await.unwrap_err().is_poisoned());
            Ok(())
        });
        process("server", 7).spawn_ok(async move {
            let call = server.accept().await?;
            assert_eq!((*call, level()), (0, 20));
            drop(call);
            assert_eq!(level(), 7);
            let call = server.accept().await?;
            assert_eq!((*call, level()), (1, 20));
            assert!(call.reply(()).is_ok());
            assert_eq!(level(), 7);
            let call = server.accept().await?;
            server.poison();
            assert_eq!((*call, level()), (2, 20), "until the call is dropped");
            assert!(call.reply(()).is_err());
            assert_eq!(level(), 7);
            Ok(())
        });
    });
}

#[test]
fn a_client_that_waits_lends_to_the_server_that_is_busy() {
    own_process!();
    on_one_executor(|process| {
        let (client, server) = call_channel::<u8, ()>();
        let other = client.clone();
        let (go, gone) = luna::channel::<()>();
        process("client", 20).spawn_ok(async move {
            gone.recv().await?;
            client.call(20).await?;
            gone.recv().await?;
            // It gives up while the server is busy.
            let give_up = async {
                gone.recv().await.unwrap();
                Err(())
            };
            let called = futures_lite::future::or(async { Ok(client.call(21).await) }, give_up);
            assert!(called.await.is_err());
            Ok(())
        });
        process("other", 5).spawn_ok(async move {
            other.call(5).await?;
            Ok(other.call(6).await?)
        });
        process("server", 7).spawn_ok(async move {
            for round in 0..2 {
                let call = server.accept().await?;
                assert_eq!((*call, level()), (5 + round, 7));
                // The client runs before this goes on, and waits then.
                go.send(()).await?;
                assert_eq!(level(), 20, "a client waits");
                if round == 0 {
                    call.reply(()).unwrap();
                    assert_eq!(level(), 20, "it still does");
                    let call = server.accept().await?;
                    assert_eq!((*call, level()), (20, 20));
                    call.reply(()).unwrap();
                } else {
                    go.send(()).await?;
                    // They are of one level now.
                    yield_now().await;
                    assert_eq!(level(), 7, "the client waits no longer");
                    call.reply(()).unwrap();
                }
                assert_eq!(level(), 7);
            }
            Ok(())
        });
    });
}

#[test]
fn of_several_servers_the_last_that_came_is_the_one_that_clients_wait_for() {
    own_process!();
    on_one_executor(|process| {
        let (client, server) = call_channel::<u8, ()>();
        let second = server.clone();
        let (go, gone) = luna::channel::<()>();
        let (next, comes) = luna::channel::<()>();
        for (name, of_client) in [("one", 5), ("two", 4)] {
            let client = client.clone();
            process(name, of_client).spawn_ok(async move { Ok(client.call(of_client).await?) });
        }
        process("client", 20).spawn_ok(async move {
            gone.recv().await?;
            Ok(client.call(20).await?)
        });
        process("first", 7).spawn_ok(async move {
            let call = server.accept().await?;
            comes.recv().await?;
            assert_eq!(level(), 7, "the other one has come since");
            call.reply(()).unwrap();
            Ok(())
        });
        process("second", 6).spawn_ok(async move {
            let call = second.accept().await?;
            go.send(()).await?;
            assert_eq!(level(), 20);
            next.send(()).await?;
            call.reply(()).unwrap();
            let call = second.accept().await?;
            assert_eq!((*call, level()), (20, 20));
            call.reply(()).unwrap();
            assert_eq!(level(), 6);
            Ok(())
        });
    });
}

#[test]
fn a_call_that_is_answered_elsewhere_sets_its_servers_thread_back() {
    own_process!();
    if real_time_core().is_none() {
        return;
    }
    let mut system = System::new("elsewhere");
    let (client, server) = call_channel::<(), u8>();
    // For the life of the program, so that a call may go anywhere.
    let server: &'static Server<(), u8> = Box::leak(Box::new(server));
    let (pass, passed) = luna::channel::<Call<'static, (), u8>>();
    let (done, is_done) = luna::channel::<()>();
    system
        .executor("client")
        .policy(Policy::fifo(60))
        .build()
        .unwrap()
        .process("client")
        .spawn_ok(async move {
            assert_eq!(client.call(()).await?, 5);
            Ok(())
        });
    system
        .executor("server")
        .policy(Policy::fifo(20))
        .build()
        .unwrap()
        .process("server")
        .spawn_ok(async move {
            let call = server.accept().await?;
            assert_eq!(current_policy(), Policy::fifo(60));
            pass.send(call).await?;
            is_done.recv().await?;
            assert_eq!(current_policy(), Policy::fifo(20));
            Ok(())
        });
    system
        .thread("other")
        .process("other")
        .spawn_ok(async move {
            passed.recv().await?.reply(5).unwrap();
            done.send(()).await?;
            Ok(())
        });
    system.run().unwrap();
}
