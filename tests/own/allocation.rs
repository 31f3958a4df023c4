//! The real-time path neither allocates nor frees. One test alone, since the allocator counts what
//! the whole program does.

use crate::ALLOCATOR;
use crate::common;

use crate::counting::Counted;
use common::SpawnOk;
use luna::Error;
use luna::prelude::*;
use luna::system::ProcessBuilder;
use luna::time::Overrun;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const PERIOD: Duration = Duration::from_millis(1);
const ROUNDS: u64 = 500;
/// Less than what one allocation a round would make.
const A_FEW: u64 = 50;

/// A barrier for all processes of a network. The last one to come notes the allocations until then.
#[derive(Default)]
struct Line {
    waiting: AtomicUsize,
    open: AtomicBool,
    counted: Mutex<Counted>,
}

impl Line {
    async fn pass(&self, all: &AtomicUsize) {
        if self.waiting.fetch_add(1, Ordering::SeqCst) + 1 == all.load(Ordering::SeqCst) {
            *self.counted.lock().unwrap() = ALLOCATOR.everywhere();
            self.open.store(true, Ordering::SeqCst);
        }
        while !self.open.load(Ordering::SeqCst) {
            luna::after(Duration::from_micros(200)).await;
        }
    }
}

/// Processes that work between two lines.
#[derive(Default)]
struct Network {
    processes: AtomicUsize,
    start: Line,
    finish: Line,
}

impl Network {
    fn spawn(
        self: &Arc<Self>,
        process: ProcessBuilder,
        work: impl Future<Output = luna::Result<()>> + Send + 'static,
    ) {
        self.processes.fetch_add(1, Ordering::SeqCst);
        let own = self.clone();
        let between = async move {
            own.start.pass(&own.processes).await;
            let outcome = work.await;
            own.finish.pass(&own.processes).await;
            outcome
        };
        process.spawn_ok(between);
    }

    /// Numbers to and fro over two rendezvous channels.
    fn ping_pong(self: &Arc<Self>, at: ProcessBuilder, to: ProcessBuilder) {
        let (there, come) = luna::channel();
        let (back, again) = luna::channel();
        self.spawn(at, ping(there, again));
        self.spawn(to, pong(come, back));
    }
}

async fn run_loop(name: &'static str, policy: Overrun) -> luna::Result<()> {
    let mut tick = luna::periodic(name, PERIOD)?.overrun(policy).limit(1000);
    for _ in 0..30 {
        tick.next().await;
    }
    Ok(())
}

/// Passes numbers to and fro.
async fn ping(output: Sender<u64>, input: Receiver<u64>) -> luna::Result<()> {
    for n in 0..ROUNDS {
        output.send(n).await?;
        assert_eq!(input.recv().await?, n + 1);
    }
    Ok(())
}

async fn pong(input: Receiver<u64>, output: Sender<u64>) -> luna::Result<()> {
    while let Ok(n) = input.recv().await {
        output.send(n + 1).await?;
    }
    Ok(())
}

/// A process with memory of its own, which is dropped off the path.
struct Keeper {
    kept: Vec<u64>,
    input: Receiver<u64>,
    network: Arc<Network>,
}

impl Process for Keeper {
    fn pre_run(&mut self) -> luna::Result<()> {
        self.kept.reserve_exact(ROUNDS as usize);
        Ok(())
    }

    async fn run(&mut self) -> luna::Result<()> {
        self.network.start.pass(&self.network.processes).await;
        while let Ok(n) = self.input.recv().await {
            self.kept.push(n);
        }
        self.network.finish.pass(&self.network.processes).await;
        Ok(())
    }

    fn post_run(&mut self) {
        assert_eq!(self.kept, (0..ROUNDS).collect::<Vec<_>>());
    }
}

/// Runs a network of all that the path offers. Returns the count at the begin of its work and at
/// its end.
fn run_network(with_threads: bool) -> (Counted, Counted) {
    let network = Arc::new(Network::default());
    let mut system = System::new("counted");
    let left = system
        .executor("left")
        .policy(Policy::fifo(20))
        .build()
        .unwrap();
    let right = system.executor("right").build().unwrap();

    // Loops.
    network.spawn(
        left.process("skipping").priority(20),
        run_loop("skipping", Overrun::SkipToGrid),
    );
    network.spawn(
        left.process("catching up"),
        run_loop("catching up", Overrun::CatchUp),
    );
    network.spawn(
        right.process("rephasing").timed(),
        run_loop("rephasing", Overrun::Rephase),
    );

    // Rendezvous: on one executor (upwards and downwards), and between two.
    network.ping_pong(
        left.process("ping up").priority(3),
        left.process("pong up").priority(4),
    );
    network.ping_pong(
        left.process("ping down").priority(6),
        left.process("pong down").priority(5),
    );
    network.ping_pong(left.process("ping across"), right.process("pong across"));

    if with_threads {
        network.spawn(
            system.thread("own").process("looping alone"),
            run_loop("looping alone", Overrun::SkipToGrid),
        );
        network.ping_pong(
            system.thread("pinging").process("ping of a thread"),
            left.process("pong to a thread"),
        );
    }

    // Buffers.
    let (output, input) = luna::buffered(Buffer::fifo(4));
    let send_all = async move {
        for n in 0..ROUNDS {
            output.send(n).await?;
        }
        Ok(())
    };
    network.spawn(left.process("source"), send_all);
    network.processes.fetch_add(1, Ordering::SeqCst);
    right.process("keeper").spawn_ok(Keeper {
        kept: Vec::new(),
        input,
        network: network.clone(),
    });
    let (newest, latest) = luna::buffered(Buffer::overwrite_oldest(1));
    let overwrite = async move {
        for n in 0..ROUNDS {
            newest.send(n).await?;
            luna::yield_now().await;
            let _ = latest.try_recv();
        }
        Ok(())
    };
    network.spawn(right.process("overwriter"), overwrite);

    // Timers and timeouts.
    let (silent, silence) = luna::channel::<u64>();
    let wait = async move {
        for _ in 0..20 {
            luna::after(Duration::from_micros(50)).await;
            assert!(
                silence
                    .recv_timeout(Duration::from_micros(50))
                    .await
                    .unwrap_err()
                    .is_timeout()
            );
            assert!(
                silent
                    .send_timeout(1, Duration::from_micros(50))
                    .await
                    .unwrap_err()
                    .is_timeout()
            );
        }
        Ok(())
    };
    network.spawn(left.process("waiting"), wait);

    // Parallel branches, also failing ones.
    let (a, b) = luna::channel();
    let branches = async move {
        for n in 0..ROUNDS {
            let (_, received) = par!(a.send(n), b.recv()).await?;
            assert_eq!(received, n);
            let failed = par!(a.send(n), async { Err::<(), _>(Error::Timeout) }).await;
            let errors = [Error::Poisoned, Error::Timeout];
            assert!(failed.unwrap_err().errors().eq(&errors));
        }
        Ok(())
    };
    network.spawn(right.process("branching"), branches);

    let report = system.run().unwrap();
    assert_eq!(report.loops.len(), 3 + usize::from(with_threads));
    (
        *network.start.counted.lock().unwrap(),
        *network.finish.counted.lock().unwrap(),
    )
}

#[test]
fn nothing_is_allocated_or_freed_while_the_bodies_run() {
    own_process!();
    for with_threads in [false, true] {
        // The framework's own threads, which are not real-time, may still free memory of their
        // start when the bodies already run, and may allocate for a deadlock check: a few times.
        // Allocations of the bodies would show in each round.
        let is_quiet = (0..10).any(|_| {
            let (start, finish) = run_network(with_threads);
            assert!(start.0 > 0, "it does count");
            println!(
                "allocations and frees until the start {start:?}, until the finish {finish:?}"
            );
            finish.0 - start.0 <= A_FEW && finish.1 - start.1 <= A_FEW
        });
        assert!(
            is_quiet,
            "anywhere while the bodies ran, in each attempt; with threads: {with_threads}"
        );
        assert_eq!(
            ALLOCATOR.on_path(),
            (0, 0),
            "on the path, begin and end of the processes included; with threads: {with_threads}"
        );
    }
}
