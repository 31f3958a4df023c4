//! Call channels: a server works at its client's priority, from when the client waits for it.

use crate::common::{SpawnOk, real_time_core};
use crate::inversion::between::{BURST, Burner, Control, Waits};
use crate::inversion::{HIGH, LOW, ROUNDS};
use crate::kernel::{as_scheduled, burn, scheduled_priority, thread_id};
use luna::channel::{Client, call_channel};
use luna::prelude::*;
use luna::system::ProcessBuilder;
use luna::{Receiver, Sender, after, channel};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Where the server runs.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Placement {
    Executor,
    Thread,
}

const PLACEMENTS: [Placement; 2] = [Placement::Executor, Placement::Thread];

/// How long a server works for a client.
const WORK: Duration = Duration::from_micros(100);

struct Stage {
    system: System,
    core: usize,
    burner: Burner,
    waits: Arc<Mutex<Vec<Duration>>>,
}

impl Stage {
    fn new(core: usize) -> Stage {
        Stage {
            system: System::new("inversion"),
            core,
            burner: Burner::start(core),
            waits: Arc::default(),
        }
    }

    fn process(&mut self, place: Placement, name: &str, priority: u8) -> ProcessBuilder {
        let (core, policy) = (self.core, Policy::fifo(priority));
        match place {
            Placement::Executor => {
                let executor = self.system.executor(name).core(core).policy(policy);
                executor.build().unwrap().process(name)
            }
            Placement::Thread => {
                let thread = self.system.thread(name).core(core).policy(policy);
                thread.process(name)
            }
        }
    }

    /// The high process: each round it waits to be released, releases the thread between, and does
    /// `once`.
    fn high(
        &mut self,
        gone: Option<Receiver<()>>,
        once: impl AsyncFn() -> luna::Result<()> + Send + 'static,
    ) {
        let (control, waits) = (self.burner.control(), self.waits.clone());
        self.process(Placement::Executor, "high", HIGH)
            .spawn_ok(async move || {
                for _ in 0..ROUNDS {
                    match &gone {
                        Some(gone) => gone.recv().await?,
                        None => after(Duration::from_micros(300)).await,
                    }
                    let before = control.burnt();
                    control.go();
                    once().await?;
                    let burnt = control.burnt() - before;
                    waits.lock().unwrap().push(burnt);
                    settle(&control, before).await;
                }
                Ok(())
            });
    }

    fn run(self) -> Waits {
        self.system.run().unwrap();
        let waits = self.waits.lock().unwrap();
        assert_eq!(waits.len(), ROUNDS);
        Waits::of(&waits)
    }
}

/// Lets it burn what it has left, so that each round begins alike.
async fn settle(control: &Control, before: Duration) {
    while control.burnt() < before + BURST {
        after(BURST).await;
    }
}

#[test]
fn a_server_that_waits() {
    own_process!();
    let Some(core) = real_time_core() else { return };
    for place in PLACEMENTS {
        let mut stage = Stage::new(core);
        let (client, server) = call_channel::<(), i64>();
        let calls = Arc::new(AtomicU32::new(0));
        let called = calls.clone();
        stage.high(None, async move || {
            called.fetch_add(1, Ordering::SeqCst);
            assert_eq!(client.call(()).await?, as_scheduled(HIGH));
            Ok(())
        });
        stage.process(place, "server", LOW).spawn_ok(async move {
            let (mut accepted, mut back) = (0, 0);
            while let Ok(call) = server.accept().await {
                accepted += 1;
                burn(WORK);
                let _ = call.reply(scheduled_priority(thread_id()));
                let level = scheduled_priority(thread_id());
                // On a busy machine the next call may have come by now, and boost the server
                // again.
                if calls.load(Ordering::SeqCst) == accepted {
                    assert_eq!(level, as_scheduled(LOW));
                    back += 1;
                }
            }
            assert!(back > 0, "the next call always came before");
            Ok(())
        });
        stage
            .run()
            .expect_inherited(&format!("call, server waits ({place:?})"));
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
        .process(Placement::Executor, "server", LOW)
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
        .process(Placement::Executor, "other", LOW - 10)
        .spawn_ok(async move {
            for _ in 0..ROUNDS {
                client.call(false).await?;
            }
            Ok(())
        });
}

/// Releases the high process, which then runs at once; on a machine that was held up, when it is
/// ready for the round.
async fn let_go(go: &Sender<()>) {
    while let Err(error) = go.try_send(()) {
        assert!(error.is_full(), "{error}");
        after(BURST).await;
    }
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
        stage.process(place, "server", LOW).spawn_ok(async move {
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
            .process(Placement::Executor, "other", LOW - 10)
            .spawn_ok(async move { Ok(first.call(false).await?) });
        stage.process(place, "server", LOW).spawn_ok(async move {
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
