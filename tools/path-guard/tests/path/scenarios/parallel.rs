//! Parallel constructs within one process.

use super::{Places, ROUNDS};
use luna::Error;
use luna::prelude::*;

pub(crate) fn parallel_branches(places: &mut Places) {
    let (a, from_a) = luna::channel::<u64>();
    let (b, from_b) = luna::channel::<u64>();
    places.process("sends both", async move {
        for n in 0..ROUNDS {
            par!(a.send(n), b.send(n)).await?;
        }
        Ok(())
    });
    places.process("receives both", async move {
        for n in 0..ROUNDS {
            assert_eq!(par!(from_a.recv(), from_b.recv()).await?, (n, n));
        }
        Ok(())
    });
}

pub(crate) fn failing_branches(places: &mut Places) {
    let (a, b) = luna::channel::<u64>();
    places.process("fails", async move {
        for n in 0..ROUNDS {
            let failed = par!(a.send(n), async { Err::<(), _>(Error::Timeout) }).await;
            let errors = [Error::Poisoned, Error::Timeout];
            assert!(failed.unwrap_err().errors().eq(&errors));
            let (_, received) = par!(a.send(n), b.recv()).await?;
            assert_eq!(received, n);
            drop(par!(a.send(n), b.recv()));
        }
        // A network ends: its branches find their channels poisoned, also in nested networks.
        a.poison();
        let ended = par!(
            a.send(1),
            par!(a.send(1), par!(b.recv(), b.recv()), b.recv()),
            async { Err::<(), _>(Error::Closed) },
            pri_par!(a.send(1), b.recv()),
        );
        assert_eq!(ended.await.unwrap_err().errors().count(), 8);
        Ok(())
    });
}

pub(crate) fn prioritized_branches(places: &mut Places) {
    let (a, from_a) = luna::channel::<u64>();
    let (b, from_b) = luna::channel::<u64>();
    places.process_at(20, "by priority", async move {
        pri_par!(
            async {
                for n in 0..ROUNDS {
                    a.send(n).await?;
                }
                luna::Result::Ok(())
            },
            async {
                for n in 0..ROUNDS {
                    b.send(n).await?;
                }
                luna::Result::Ok(())
            },
        )
        .await?;
        Ok(())
    });
    for (name, input) in [("one", from_a), ("two", from_b)] {
        places.process_at(19, name, async move {
            for n in 0..ROUNDS {
                assert_eq!(input.recv().await?, n);
            }
            Ok(())
        });
    }
}

/// They are created and dropped off the path, since that allocates and frees; in between nothing
/// does.
pub(crate) fn collections_of_branches(places: &mut Places) {
    let (output, input) = luna::channel::<u64>();
    places.process("many branches", async move {
        let mut all = luna::realtime::off_path(|| {
            luna::par_for(0..20_u64, |branch| {
                let output = &output;
                async move {
                    for n in 0..ROUNDS / 10 {
                        output.send(branch + n).await?;
                    }
                    luna::Result::Ok(())
                }
            })
        });
        let ended = (&mut all).await;
        luna::realtime::off_path(|| drop((all, ended)));
        Ok(())
    });
    places.process("takes all", async move {
        for _ in 0..20 * (ROUNDS / 10) {
            input.recv().await?;
        }
        Ok(())
    });
}

pub(crate) fn named_branches(places: &mut Places) {
    places.process("has parts", async move {
        for _ in 0..ROUNDS {
            par!(
                luna::named("left", async {
                    luna::yield_now().await;
                    Ok(())
                }),
                luna::named("right", luna::named("inner", async { Ok::<(), Error>(()) })),
            )
            .await?;
            let lost = luna::named("lost", std::future::pending::<()>());
            futures_lite::future::or(lost, luna::yield_now()).await;
        }
        Ok(())
    });
}

/// The observer adds and removes marks meanwhile, on a thread off the path.
pub(crate) fn named_branches_that_are_looked_at(places: &mut Places) {
    let observer = places.system.observer();
    let (alive, ended) = std::sync::mpsc::channel::<()>();
    let (output, input) = luna::channel::<u64>();
    places.process("has parts", async move {
        for n in 0..ROUNDS {
            par!(
                luna::named("sends", output.send(n)),
                luna::named("waits", async {
                    luna::yield_now().await;
                    luna::Result::Ok(())
                }),
            )
            .await?;
        }
        luna::realtime::off_path(|| drop(alive));
        Ok(())
    });
    places.process("receives", async move {
        while luna::named("receives", input.recv()).await.is_ok() {}
        Ok(())
    });
    std::thread::spawn(move || {
        while ended.try_recv() != Err(std::sync::mpsc::TryRecvError::Disconnected) {
            assert_eq!(
                observer.composition().system,
                "named_branches_that_are_looked_at"
            );
        }
    });
}
