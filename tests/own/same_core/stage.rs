//! Where the sides run: each as a process of an executor, as a process with an OS thread of its
//! own, or as a plain thread.

use crate::common::{Random, SpawnOk};
use crate::kernel::{burn, own_processor_time};
use crate::same_core::high::High;
use crate::same_core::low::Low;
use crate::same_core::scenes::Scene;
use crate::same_core::shared::Shared;
use futures_lite::future::poll_once;
use luna::after;
use luna_core::park::block_on;
use luna_platform::clock::Instant;
use luna_platform::futex::Futex;
use luna_platform::thread::{Attributes, Mode, Policy, Thread, spawn};
use std::convert::Infallible;
use std::future::Future;
use std::pin::{Pin, pin};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Placement {
    Executor,
    Thread,
    Plain,
}

pub(crate) const PLACEMENTS: [Placement; 3] =
    [Placement::Executor, Placement::Thread, Placement::Plain];

/// Made on the thread that it runs on.
type Body = Box<dyn FnOnce() -> Pin<Box<dyn Future<Output = ()>>> + Send>;

/// One side of a run: where, at which priority, and what.
struct Side {
    name: &'static str,
    place: Placement,
    policy: Policy,
    body: Body,
}

/// Runs both sides through all scenes on one core. `burns`: with a third thread between them.
pub(crate) fn play(
    shared: &Arc<Shared>,
    scenes: Vec<Scene>,
    core: usize,
    (high, low): (Placement, Placement),
    low_policy: Policy,
    (rounds, burns, seed): (u32, bool, u64),
) {
    let (mut of_high, mut of_low) = (Vec::new(), Vec::new());
    for scene in scenes {
        of_high.push((scene.name, scene.high));
        of_low.push(scene.low);
    }
    let (for_high, for_low, places) = (shared.clone(), shared.clone(), (high, low));
    // With a deadline, so that the system is never quiescent. Otherwise the thread that looks for a
    // deadlock would come, from another core, and hold the locks meanwhile.
    let never = || after(Duration::from_secs(100_000));
    // The thread that starts both is an ordinary one. On a busy machine it starts the low side long
    // after the high side.
    let (has_begun, low_begins) = luna::channel::<()>();
    let (has_begun, low_begins) = (has_begun.external(), low_begins.external());
    let high = Side {
        name: "high",
        place: high,
        policy: Policy::fifo(80),
        body: Box::new(move || {
            Box::pin(async move {
                let mut far = pin!(never());
                if places.0 != Placement::Plain {
                    poll_once(&mut far).await;
                }
                let mut side = High::new(for_high, places, rounds, Random::new(seed));
                low_begins.recv().await.unwrap();
                for (name, scene) in of_high {
                    side.enter(name);
                    scene(&mut side).await;
                    side.leave();
                }
            })
        }),
    };
    let low = Side {
        name: "low",
        place: low,
        policy: low_policy,
        body: Box::new(move || {
            Box::pin(async move {
                let mut far = pin!(never());
                if places.1 != Placement::Plain {
                    poll_once(&mut far).await;
                }
                let mut side = Low::new(for_low, Random::new(seed ^ 1));
                has_begun.send(()).await.unwrap();
                for scene in of_low {
                    scene(&mut side).await;
                    side.leave();
                }
            })
        }),
    };
    let burner = burns.then(|| burner(shared.clone(), core, seed));
    run([high, low], core);
    shared.over.store(true, Ordering::SeqCst);
    if let Some(burner) = burner {
        burner.join().unwrap();
    }
}

fn run(sides: [Side; 2], core: usize) {
    let mut system = luna::System::new("same core");
    system.strict();
    let mut threads = Vec::new();
    let mut has_processes = false;
    for Side {
        name,
        place,
        policy,
        body,
    } in sides
    {
        let process = match place {
            Placement::Plain => {
                let attributes = Attributes::new(name)
                    .core(core)
                    .policy(policy)
                    .mode(Mode::Strict);
                let set_up = |_: &_| Ok::<_, Infallible>(());
                threads.push(spawn(attributes, set_up, |()| block_on(body())).unwrap());
                continue;
            }
            Placement::Executor => {
                let executor = system.executor(name).core(core).policy(policy);
                executor.build().unwrap().process(name)
            }
            Placement::Thread => system.thread(name).core(core).policy(policy).process(name),
        };
        has_processes = true;
        process.spawn_ok(move || async move {
            body().await;
            Ok(())
        });
    }
    if has_processes {
        system.run().unwrap();
    }
    for thread in threads {
        thread.join().unwrap();
    }
}

/// A thread at FIFO 50 that keeps the core for some milliseconds at a time, and leaves it as long.
fn burner(shared: Arc<Shared>, core: usize, seed: u64) -> Thread<()> {
    let attributes = Attributes::new("burner")
        .core(core)
        .policy(Policy::fifo(50))
        .mode(Mode::Strict);
    let set_up = |_: &_| Ok::<_, Infallible>(());
    let body = move |()| {
        Shared::set_thread(&shared.burner_thread);
        let mut random = Random::new(seed ^ 2);
        let nobody_wakes = Futex::new(0);
        while !shared.over.load(Ordering::SeqCst) {
            let pause = Duration::from_micros(100 + random.below(2_000));
            nobody_wakes.wait(0, Instant::now() + pause);
            let before = own_processor_time();
            let end = before + Duration::from_micros(500 + random.below(2_000));
            while own_processor_time() < end {
                shared.burnt.fetch_add(1, Ordering::SeqCst);
                burn(Duration::from_micros(2));
            }
            let burnt_for = own_processor_time() - before;
            shared
                .burnt_for
                .fetch_add(burnt_for.as_nanos() as u64, Ordering::Relaxed);
        }
    };
    spawn(attributes, set_up, body).unwrap()
}
