//! Processes and their executor.

use crate::deadlines::{Beside, on_one_executor_beside};
use crate::laps::laps;
use crate::on_one_executor;
use std::future::poll_fn;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::Poll;
use std::time::Duration;

/// Two processes yield to each other: a step is a switch there and one back.
pub(crate) fn switch(steps: u64) -> luna::Result<()> {
    switch_beside(Beside::Nothing, steps)
}

pub(crate) fn switch_with_deadlines(steps: u64) -> luna::Result<()> {
    switch_beside(Beside::Deadlines, steps)
}

fn switch_beside(beside: Beside, steps: u64) -> luna::Result<()> {
    on_one_executor_beside("switch", beside, |executor, end| {
        let is_over = Arc::new(AtomicBool::new(false));
        let over = is_over.clone();
        executor.process("one").spawn(move || async move {
            laps(steps, async |_| luna::yield_now().await).await?;
            over.store(true, Ordering::Relaxed);
            drop(end);
            Ok(())
        })?;
        executor.process("other").spawn(async move {
            while !is_over.load(Ordering::Relaxed) {
                luna::yield_now().await;
            }
            Ok(())
        })
    })
}

/// By its waker, as a future of another library does.
pub(crate) fn wake_itself(steps: u64) -> luna::Result<()> {
    on_one_executor("wake", |executor| {
        executor.process("sleepless").spawn(move || async move {
            laps(steps, async |_| {
                let mut is_woken = false;
                poll_fn(|context| {
                    if is_woken {
                        return Poll::Ready(());
                    }
                    is_woken = true;
                    context.waker().wake_by_ref();
                    Poll::Pending
                })
                .await;
            })
            .await
        })
    })
}

pub(crate) fn spawn_and_join(steps: u64) -> luna::Result<()> {
    on_one_executor("spawn", |executor| {
        let place = executor.clone();
        executor.process("parent").spawn(move || async move {
            laps(steps, async |number| {
                let child = place
                    .process(format!("child {number}"))
                    .spawn(async { Ok(()) })
                    .expect("the name is free");
                let child = place.process_handle(child).expect("it was spawned");
                assert_eq!(child.join().await, luna::Exit::Completed);
            })
            .await
        })
    })
}

/// As above, of processes that share their name.
pub(crate) fn start_and_join(steps: u64) -> luna::Result<()> {
    on_one_executor("start", |executor| {
        let place = executor.clone();
        executor.process("parent").spawn(move || async move {
            laps(steps, async |_| {
                let child = place.process("child").one_of_many();
                let child = child.start(async { Ok(()) }).expect("the system runs");
                assert_eq!(child.join().await, luna::Exit::Completed);
            })
            .await
        })
    })
}

/// A timeout that does not come, beside later ones. As by an operation that has to wait, and is
/// done in time.
pub(crate) fn timeout(steps: u64) -> luna::Result<()> {
    on_one_executor_beside("timeout", Beside::Deadlines, |executor, end| {
        executor.process("setter").spawn(move || async move {
            laps(steps, async |_| {
                let mut timeout = pin!(luna::after(Duration::from_secs(500)));
                poll_fn(|context| {
                    assert!(timeout.as_mut().poll(context).is_pending());
                    Poll::Ready(())
                })
                .await;
            })
            .await?;
            drop(end);
            Ok(())
        })
    })
}

/// Late enough for the executor to be asleep by then, however slowly it runs.
const DELAY: Duration = Duration::from_millis(4);

/// Takes longer than 10 µs, after which an executor does not treat a turn as short. In Valgrind a
/// turn takes about as long by itself, so without this the result would vary. The C library's own
/// functions for it are cancellation points, which have atomic instructions of their own.
#[cfg(target_os = "linux")]
fn be_remembered() {
    let pause = libc::timespec {
        tv_sec: 0,
        tv_nsec: 30_000,
    };
    let rest = std::ptr::null_mut::<libc::timespec>();
    // SAFETY: the kernel reads `pause`, which is alive, and writes nothing, since the second
    // pointer is null.
    unsafe { libc::syscall(libc::SYS_nanosleep, &raw const pause, rest) };
}

#[cfg(not(target_os = "linux"))]
fn be_remembered() {}

pub(crate) fn timer(steps: u64) -> luna::Result<()> {
    on_one_executor("timer", |executor| {
        executor.process("sleeper").spawn(move || async move {
            laps(steps, async |_| {
                luna::after(DELAY).await;
                be_remembered();
            })
            .await
        })
    })
}
