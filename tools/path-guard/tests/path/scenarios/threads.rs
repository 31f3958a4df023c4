//! Wakes across threads, ends, and what else happens to processes.

use super::{Places, ROUNDS};
use luna::Process;
use luna::prelude::*;
use std::future::poll_fn;
use std::task::{Poll, Waker};
use std::time::Duration;

pub(crate) fn yields(places: &mut Places) {
    for process in 0..3 {
        places.process(&format!("yields {process}"), async {
            for _ in 0..ROUNDS {
                luna::yield_now().await;
            }
            Ok(())
        });
    }
}

/// Partners that are plain threads, which are not on the path.
pub(crate) fn wakes_from_plain_threads(places: &mut Places) {
    let (output, input) = luna::channel::<u64>();
    let (back, again) = luna::channel::<u64>();
    let (input, back) = (input.external(), back.external());
    places.process("echoes", async move {
        for _ in 0..ROUNDS {
            let n = input.recv().await?;
            back.send(n).await?;
        }
        Ok(())
    });
    std::thread::spawn(move || {
        for n in 0..ROUNDS {
            let kept = std::hint::black_box(Box::new(n));
            output.blocking_send(*kept).unwrap();
            assert_eq!(again.blocking_recv().unwrap(), n);
        }
    });
}

/// A process that is alone on its thread may wait in the thread.
pub(crate) fn blocking_operations_of_os_threads(places: &mut Places) {
    let (output, input) = luna::channel::<u64>();
    let blocking = async move {
        for n in 0..ROUNDS {
            output.blocking_send(n).unwrap();
        }
        Ok(())
    };
    places
        .system
        .thread("blocking")
        .process("blocks")
        .spawn(blocking)
        .unwrap();
    let (back, again) = luna::channel::<u64>();
    places.process("partner", async move {
        for _ in 0..ROUNDS {
            back.send(input.recv().await?).await?;
        }
        Ok(())
    });
    let patient = async move {
        for n in 0..ROUNDS {
            assert_eq!(again.blocking_recv().unwrap(), n);
        }
        let short = Duration::from_micros(50);
        assert!(again.blocking_recv_timeout(short).is_err());
        Ok(())
    };
    places
        .system
        .thread("patient")
        .process("blocks too")
        .spawn(patient)
        .unwrap();
}

/// Bodies that end while the others run.
pub(crate) fn ends_that_are_joined(places: &mut Places) {
    let barrier = Barrier::new(3);
    for process in 0..3 {
        let barrier = barrier.clone();
        places.process(&format!("ends {process}"), async move {
            barrier.sync().await;
            luna::after(Duration::from_micros(50 * process)).await;
            Ok(())
        });
    }
    drop(barrier);
    places.process("goes on", async {
        luna::after(Duration::from_millis(2)).await;
        Ok(())
    });
}

/// Processes that the system's end finds waiting.
pub(crate) fn cancelled_processes(places: &mut Places) {
    let (output, input) = luna::channel::<u64>();
    let (stop, stopped) = luna::channel::<()>();
    places.process("waits for a value", async move {
        let _ = input.recv().await;
        Ok(())
    });
    places.process("waits for the stop", async move {
        let _ = stopped.recv().await;
        drop(output);
        Ok(())
    });
    places.process("stops", async move {
        luna::after(Duration::from_micros(100)).await;
        drop(stop);
        Ok(())
    });
}

/// Spawning is off the path, and so is receiving the spawned process' handle; processes beside it
/// and spawned ones are on it.
pub(crate) fn processes_spawned_while_running(places: &mut Places) {
    let executor = places.system.executor("late").build().unwrap();
    let (output, input) = luna::channel::<u64>();
    places.process("spawns", async move {
        for child in 0..5 {
            luna::realtime::off_path(|| {
                let output = output.clone();
                let late = async move { Ok(output.send(child).await?) };
                executor
                    .process(format!("child {child}"))
                    .spawn(late)
                    .unwrap();
            });
            luna::after(Duration::from_micros(50)).await;
        }
        // Its handle of the executor frees what it holds.
        luna::realtime::off_path(|| drop(executor));
        Ok(())
    });
    places.process("counts", async move {
        let mut sum = 0;
        for _ in 0..5 {
            sum += input.recv().await?;
        }
        assert_eq!(sum, 10);
        Ok(())
    });
}

/// What a process' type holds may be dropped with it, off the path.
pub(crate) fn processes_of_types(places: &mut Places) {
    struct Keeper {
        kept: Vec<u64>,
        input: Receiver<u64>,
    }
    impl Process for Keeper {
        fn pre_run(&mut self) -> luna::Result<()> {
            self.kept.reserve_exact(ROUNDS as usize);
            Ok(())
        }
        async fn run(&mut self) -> luna::Result<()> {
            assert!(luna::realtime::on_path());
            while let Ok(n) = self.input.recv().await {
                self.kept.push(n);
            }
            Ok(())
        }
        fn post_run(&mut self) {
            assert_eq!(self.kept.len() as u64, ROUNDS);
        }
    }
    let (output, input) = luna::channel();
    let kept = Vec::new();
    places.next("keeper").spawn(Keeper { kept, input }).unwrap();
    places.process("source", async move {
        for n in 0..ROUNDS {
            output.send(n).await?;
        }
        Ok(())
    });
}

/// The platform's own lock, contended by threads of different places.
pub(crate) fn a_contended_lock(places: &mut Places) {
    // One channel for all is one lock for all; no partner waits for another, so that they contend
    // for the lock.
    let (output, input) = luna::buffered::<u64>(Buffer::overwrite_oldest(4));
    for process in 0..4 {
        let (output, input) = (output.clone(), input.clone());
        places.process(&format!("hurries {process}"), async move {
            for n in 0..20 * ROUNDS {
                output.send(n).await?;
                let _ = input.try_recv();
            }
            Ok(())
        });
    }
}

/// A channel's lock is biased to a long-time single user, until another one comes.
pub(crate) fn a_bias_that_is_revoked(places: &mut Places) {
    let (output, input) = luna::buffered::<u64>(Buffer::fifo(4));
    let (go, gone) = luna::channel::<()>();
    let (other_output, other_input) = (output.clone(), input.clone());
    places.process("is favoured", async move {
        for n in 0..ROUNDS {
            output.send(n).await?;
            input.recv().await?;
        }
        go.send(()).await?;
        for n in 0..ROUNDS {
            let _ = output.try_send(n);
        }
        Ok(())
    });
    places.process("comes", async move {
        gone.recv().await?;
        for n in 0..ROUNDS {
            let _ = other_input.try_recv();
            let _ = other_output.try_send(n);
        }
        Ok(())
    });
}

/// Errors end their process, and its channels.
pub(crate) fn processes_that_fail(places: &mut Places) {
    places.error = Some("time ran out");
    let (output, input) = luna::channel::<u64>();
    places.process("fails", async move {
        luna::after(Duration::from_micros(50)).await;
        output.send(1).await?;
        Err(luna::Error::Timeout)
    });
    places.process("finds out", async move {
        input.recv().await?;
        assert!(input.recv().await.is_err());
        Ok(())
    });
}

/// A loop that is late too often ends its process from within a wait.
pub(crate) fn a_limit_that_is_reached(places: &mut Places) {
    places.error = Some("late");
    let period = Duration::from_micros(100);
    places.process("is late", async move {
        let mut tick = luna::periodic("is late", period)?.limit(3);
        loop {
            let cycle = tick.next().await;
            while luna::now() < cycle.deadline + 2 * period {
                std::hint::spin_loop();
            }
        }
    });
}

/// Foreign combinators keep wakers: the last waker of a process that has ended may be dropped on
/// the path of another.
pub(crate) fn wakers_that_outlive_their_process(places: &mut Places) {
    let (output, input) = luna::channel::<Waker>();
    for process in 0..3 {
        places.process(
            &format!("leaves its waker {process}"),
            leaves(output.clone()),
        );
    }
    keep(places, input);
}

/// The same of processes that had a thread alone.
pub(crate) fn wakers_that_outlive_their_thread(places: &mut Places) {
    let (output, input) = luna::channel::<Waker>();
    for process in 0..3 {
        let name = format!("leaves its waker {process}");
        let leaves = leaves(output.clone());
        places
            .system
            .thread(&name)
            .process(&name)
            .spawn(leaves)
            .unwrap();
    }
    keep(places, input);
}

async fn leaves(output: Sender<Waker>) -> luna::Result<()> {
    let waker = poll_fn(|cx| Poll::Ready(cx.waker().clone())).await;
    output.send(waker).await.map_err(|_| luna::Error::Closed)
}

fn keep(places: &mut Places, input: Receiver<Waker>) {
    places.process("keeps them", async move {
        let wakers = [
            input.recv().await?,
            input.recv().await?,
            input.recv().await?,
        ];
        // Until they are reaped.
        luna::after(Duration::from_millis(20)).await;
        wakers[0].wake_by_ref();
        drop(wakers);
        Ok(())
    });
}
