//! Call channels: a server works at its client's priority, from when the client waits for it.

use crate::common::{PLACEMENTS, Placement, SpawnOk, real_time_core};
use crate::inversion::HIGH;
use crate::inversion::between::BURST;
use crate::inversion::stage::{Stage, let_go, scheduled};
use crate::inversion::{LOW, ROUNDS};
use crate::kernel::{as_scheduled, burn, scheduled_priority, thread_id};
use luna::channel::{Client, call_channel};
use luna::prelude::*;
use luna::{after, channel};
use luna_core::current::refused_boosts;
use luna_platform::thread::current_policy;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

/// How long a server works for a client.
const WORK: Duration = Duration::from_micros(100);

#[test]
fn a_server_that_waits() {
    own_process!();
    let Some(core) = real_time_core() else { return };
    let fifo = Policy::fifo(LOW);
    for (place, own) in [
        (Placement::Executor, fifo),
        (Placement::Thread, fifo),
        (Placement::Executor, Policy::round_robin(LOW)),
        (Placement::Executor, Policy::Other),
    ] {
        let mut stage = Stage::new(core);
        let (client, server) = call_channel::<(), (i64, Policy)>();
        let calls = Arc::new(AtomicU32::new(0));
        let called = calls.clone();
        stage.high(None, async move || {
            called.fetch_add(1, Ordering::SeqCst);
            let boosted = (as_scheduled(HIGH), Policy::fifo(HIGH));
            assert_eq!(client.call(()).await?, boosted);
            Ok(())
        });
        stage.process(place, "server", own).spawn_ok(async move {
            let (mut accepted, mut back) = (0, 0);
            while let Ok(call) = server.accept().await {
                accepted += 1;
                burn(WORK);
                let _ = call.reply((scheduled_priority(thread_id()), current_policy()));
                let now = (scheduled_priority(thread_id()), current_policy());
                // On a busy machine the next call may have come by now, and boost the server
                // again.
                if calls.load(Ordering::SeqCst) == accepted {
                    assert_eq!(now, (scheduled(own), own));
                    back += 1;
                }
            }
            assert!(back > 0, "the next call always came before");
            Ok(())
        });
        let what = format!("call, server waits ({place:?}, {own})");
        stage.run().expect_inherited(&what);
        assert_eq!(refused_boosts(), None);
    }
}

#[test]
fn two_plain_channels_do_not_inherit() {
    own_process!();
    let Some(core) = real_time_core() else { return };
    let mut stage = Stage::new(core);
    let (request, requests) = channel::<()>();
    let (reply, replies) = channel::<()>();
    stage.high(None, async move || {
        request.send(()).await?;
        replies.recv().await?;
        Ok(())
    });
    stage
        .process(Placement::Executor, "server", Policy::fifo(LOW))
        .spawn_ok(async move {
            while requests.recv().await.is_ok() {
                burn(WORK);
                reply.send(()).await?;
            }
            Ok(())
        });
    stage.run().expect_inverted("two plain channels");
}

/// A client of lower priority that calls, so that the server is busy.
fn other_client(stage: &mut Stage, client: Client<bool, ()>) {
    stage
        .process(Placement::Executor, "other", Policy::fifo(LOW - 10))
        .spawn_ok(async move {
            for _ in 0..ROUNDS {
                client.call(false).await?;
            }
            Ok(())
        });
}

#[test]
fn a_server_that_is_busy_with_anothers_call() {
    own_process!();
    let Some(core) = real_time_core() else { return };
    for place in PLACEMENTS {
        let mut stage = Stage::new(core);
        let (client, server) = call_channel::<bool, ()>();
        other_client(&mut stage, client.clone());
        let (go, gone) = channel();
        stage.high(Some(gone), async move || Ok(client.call(true).await?));
        stage
            .process(place, "server", Policy::fifo(LOW))
            .spawn_ok(async move {
                // The high one waits by then.
                after(BURST * 2).await;
                while let Ok(call) = server.accept().await {
                    if !*call {
                        let_go(&go).await;
                        assert_eq!(scheduled_priority(thread_id()), as_scheduled(HIGH));
                        burn(WORK);
                    }
                    let is_high = *call;
                    let _ = call.reply(());
                    if is_high {
                        assert_eq!(scheduled_priority(thread_id()), as_scheduled(LOW));
                        // Until the high one is ready for the next round.
                        after(BURST * 3).await;
                    }
                }
                Ok(())
            });
        stage
            .run()
            .expect_inherited(&format!("call, server is busy ({place:?})"));
    }
}

#[test]
fn a_server_that_is_between_two_calls() {
    own_process!();
    let Some(core) = real_time_core() else { return };
    for place in PLACEMENTS {
        let mut stage = Stage::new(core);
        let (client, server) = call_channel::<bool, ()>();
        let (go, gone) = channel();
        let first = client.clone();
        stage.high(Some(gone), async move || Ok(client.call(true).await?));
        stage
            .process(Placement::Executor, "other", Policy::fifo(LOW - 10))
            .spawn_ok(async move { Ok(first.call(false).await?) });
        stage
            .process(place, "server", Policy::fifo(LOW))
            .spawn_ok(async move {
                // It is known as the channel's server from then on.
                server.accept().await?.reply(()).unwrap();
                for _ in 0..ROUNDS {
                    after(BURST * 3).await;
                    let_go(&go).await;
                    assert_eq!(scheduled_priority(thread_id()), as_scheduled(HIGH));
                    burn(WORK);
                    server.accept().await?.reply(()).unwrap();
                    assert_eq!(scheduled_priority(thread_id()), as_scheduled(LOW));
                }
                Ok(())
            });
        stage
            .run()
            .expect_inherited(&format!("call, server is between two ({place:?})"));
    }
}
