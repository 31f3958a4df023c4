//! How late each kind of wait notices its deadline beside a busy executor of the same core.
//!
//! ```text
//! sources [CORE]
//! ```
//!
//! The busy executor has SCHED_FIFO 80, and its lowest process always can run. What waits is a
//! process of it, or a thread of SCHED_FIFO 81, or an ordinary thread. One line for each: how many
//! waits ended in the time, and how late they were at most. docs/time-sources.md has the table.

use luna::prelude::*;
use std::future::Future;
use std::net::UdpSocket;
use std::pin::Pin;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, mpsc};
use std::time::Duration;

const WAIT: Duration = Duration::from_millis(1);
/// For how long the executor is busy.
const BUSY: Duration = Duration::from_millis(200);

/// What was seen of one kind of wait.
#[derive(Default)]
struct Seen {
    waits: AtomicU64,
    /// In nanoseconds.
    latest: AtomicU64,
}

impl Seen {
    /// A wait that began at `began`, for [`WAIT`], has ended.
    fn note(&self, began: luna::time::Instant) {
        let late = (luna::now() - (began + WAIT)).as_nanos() as u64;
        self.waits.fetch_add(1, Ordering::Relaxed);
        self.latest.fetch_max(late, Ordering::Relaxed);
    }
}

type Body = Pin<Box<dyn Future<Output = luna::Result<()>> + Send>>;

/// Runs `wait` again and again until `end`.
fn again(
    seen: Arc<Seen>,
    end: luna::time::Instant,
    mut wait: impl FnMut() + Send + 'static,
) -> Body {
    Box::pin(async move {
        while luna::now() < end {
            let began = luna::now();
            wait();
            seen.note(began);
        }
        Ok(())
    })
}

/// Where the wait is.
#[derive(Clone, Copy, PartialEq)]
enum Place {
    /// A process of the busy executor.
    Busy,
    /// A process of another executor of the core, of SCHED_FIFO 81.
    Executor,
    /// An OS-thread process of SCHED_FIFO 81.
    Thread,
    /// A thread without a policy, on any core.
    Ordinary,
}

fn measure(
    name: &str,
    core: usize,
    place: Place,
    body: impl FnOnce(Arc<Seen>, luna::time::Instant) -> Body + Send + 'static,
) -> luna::Result<()> {
    let mut system = System::new("sources");
    system.lock_memory();
    let busy = system
        .executor("busy")
        .core(core)
        .policy(Policy::fifo(80))
        .build()?;
    let seen = Arc::new(Seen::default());
    let end = luna::now() + BUSY;
    busy.process("burner").priority(1).spawn(async move {
        while luna::now() < end {
            luna::yield_now().await;
        }
        Ok(())
    })?;
    // Its last wait may end behind the burner.
    let body = body(seen.clone(), end - WAIT);
    match place {
        Place::Busy => {
            busy.process("waits").priority(20).spawn(body)?;
        }
        Place::Executor => {
            let other = system.executor("other").core(core);
            let other = other.policy(Policy::fifo(81)).build()?;
            other.process("waits").spawn(body)?;
        }
        Place::Thread => {
            let thread = system.thread("waits").core(core).policy(Policy::fifo(81));
            thread.process("waits").spawn(body)?;
        }
        Place::Ordinary => {
            system.thread("waits").process("waits").spawn(body)?;
        }
    }
    system.run()?;
    let latest = seen.latest.load(Ordering::Relaxed) as f64 / 1000.0;
    println!(
        "{name}: {} waits, at most {latest:.1} us late",
        seen.waits.load(Ordering::Relaxed)
    );
    Ok(())
}

fn main() -> luna::Result<()> {
    let core = std::env::args().nth(1);
    let core = core.and_then(|core| core.parse().ok()).unwrap_or(0);

    measure(
        "delay on the busy executor",
        core,
        Place::Busy,
        |seen, end| {
            Box::pin(async move {
                while luna::now() < end {
                    let began = luna::now();
                    luna::after(WAIT).await;
                    seen.note(began);
                }
                Ok(())
            })
        },
    )?;
    measure(
        "timeout of a receive on the busy executor",
        core,
        Place::Busy,
        |seen, end| {
            Box::pin(async move {
                let (_sender, receiver) = luna::channel::<u8>();
                while luna::now() < end {
                    let began = luna::now();
                    let _ = receiver.recv_timeout(WAIT).await;
                    seen.note(began);
                }
                Ok(())
            })
        },
    )?;
    measure(
        "delay on an executor that waits for files",
        core,
        Place::Executor,
        |seen, end| {
            Box::pin(async move {
                let socket = UdpSocket::bind("127.0.0.1:0").expect("loopback is there");
                let address = socket.local_addr().expect("it is bound");
                let file = async {
                    luna::external::readable(&socket)
                        .await
                        .expect("sockets can be waited for");
                    Ok(())
                };
                let delays = async {
                    while luna::now() < end {
                        let began = luna::now();
                        luna::after(WAIT).await;
                        seen.note(began);
                    }
                    // So that the other branch ends.
                    socket
                        .send_to(&[0], address)
                        .expect("the socket is its own peer");
                    Ok(())
                };
                luna::par!(file, delays).await.map(drop)
            })
        },
    )?;
    measure(
        "blocking receive with a timeout",
        core,
        Place::Thread,
        |seen, end| {
            let (sender, receiver) = luna::channel::<u8>();
            again(seen, end, move || {
                let _ = &sender;
                let _ = receiver.blocking_recv_timeout(WAIT);
            })
        },
    )?;
    measure(
        "std's receive with a timeout, SCHED_FIFO 81",
        core,
        Place::Thread,
        |seen, end| {
            let (sender, receiver) = mpsc::channel::<u8>();
            again(seen, end, move || {
                let _ = &sender;
                let _ = receiver.recv_timeout(WAIT);
            })
        },
    )?;
    measure(
        "a socket's read timeout, SCHED_FIFO 81",
        core,
        Place::Thread,
        |seen, end| {
            let socket = UdpSocket::bind("127.0.0.1:0").expect("loopback is there");
            socket
                .set_read_timeout(Some(WAIT))
                .expect("the time is not zero");
            again(seen, end, move || {
                let _ = socket.recv(&mut [0]);
            })
        },
    )?;
    measure(
        "sleep of an ordinary thread",
        core,
        Place::Ordinary,
        |seen, end| again(seen, end, || std::thread::sleep(WAIT)),
    )?;
    Ok(())
}
