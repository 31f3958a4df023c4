//! Interrupts between any two instructions of the CPU: they are signals.

use luna_bare::cpu;
use luna_channels::{Buffer, buffered, channel};
use luna_core::{Executor, ProcessSpec, yield_now};
use luna_platform::on_drop::OnDrop;
use std::cell::Cell;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

const COUNT: u64 = 10_000;

extern "C" fn on_signal(_: libc::c_int) {
    cpu::preempt();
}

/// Lets SIGUSR1 interrupt the calling thread, as often as it can, while `f` runs.
fn interrupted(f: impl FnOnce()) {
    // SAFETY: the handler does only what may be done in the middle of anything: it neither
    // allocates nor locks, but for the critical section, which holds it back.
    let thread = unsafe {
        let mut action: libc::sigaction = std::mem::zeroed();
        action.sa_sigaction = on_signal as *const () as usize;
        action.sa_flags = libc::SA_RESTART;
        assert_eq!(
            libc::sigaction(libc::SIGUSR1, &action, std::ptr::null_mut()),
            0
        );
        libc::pthread_self()
    };
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let mut round = 0;
            while !is_over.load(Ordering::Acquire) {
                // SAFETY: the thread waits for this one.
                unsafe { libc::pthread_kill(thread, libc::SIGUSR1) };
                // Not in step with what the thread does.
                round += 1;
                let end = Instant::now() + Duration::from_nanos(10_000 + round % 97 * 211);
                while Instant::now() < end {}
            }
        });
        let _end = OnDrop::new(|| is_over.store(true, Ordering::Release));
        f();
    });
}

#[test]
fn nothing_is_lost_or_doubled_between_any_two_instructions() {
    let (sender, receiver) = buffered(Buffer::fifo(4));
    let (next, is_wrong) = (
        Cell::new(0_u64),
        Box::leak(Box::new(AtomicBool::new(false))),
    );
    let (answers, answered) = buffered(Buffer::fifo(4));
    let (seen, wrong): (_, &AtomicBool) = (Cell::new(0_u64), is_wrong);
    // It neither allocates nor panics; it is leaked, so that no signal comes too late for it.
    cpu::set_preempting(Box::leak(Box::new(move || {
        if next.get() < COUNT && sender.try_send(next.get()).is_ok() {
            next.set(next.get() + 1);
        }
        if let Ok(value) = answered.try_recv()
            && value != seen.replace(value + 1)
        {
            wrong.store(true, Ordering::Relaxed);
        }
    })));
    let executor = Executor::new();
    let (passes, passed) = channel();
    executor.spawn(ProcessSpec::new("first").level(20), || async move {
        for value in 0..COUNT {
            assert_eq!(receiver.recv().await, Ok(value), "lost or doubled");
            passes.send(value).await.unwrap();
        }
    });
    executor.spawn(ProcessSpec::new("second").level(10), || async move {
        while let Ok(value) = passed.recv().await {
            answers.send(value).await.unwrap();
        }
    });
    // It keeps the run queue in motion.
    let handle = executor.handle().clone();
    executor.spawn(ProcessSpec::new("busy").level(20), || async move {
        for round in 0..COUNT {
            yield_now().await;
            if round % 64 == 0 {
                handle.spawn(ProcessSpec::new("short").level(20), yield_now);
            }
        }
    });
    interrupted(|| executor.run());
    assert!(!is_wrong.load(Ordering::Relaxed), "lost or doubled");
    let (served, ..) = cpu::counts();
    assert!(served >= COUNT, "{served}");
}
