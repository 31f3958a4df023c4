//! The program: a handler sends the ticks, a process adds them up, a loop runs beside it.

use crate::board::{allocated, println};
use core::sync::atomic::{AtomicU32, Ordering};
use core::time::Duration;
use luna_bare::cortex_m::SysTickPort;
use luna_channels::{Buffer, Sender, alt, buffered, channel};
use luna_core::timer_queue::Sleep;
use luna_core::{Executor, ProcessSpec};
use luna_platform::bare::interrupt;
use luna_platform::clock::Instant;
use luna_platform::sync::OnceLock;

/// QEMU's board runs at 25 MHz.
static PORT: SysTickPort = SysTickPort::new(25);
static TICKS: OnceLock<Sender<u32>> = OnceLock::new();
const COUNT: u32 = 100;

/// SysTick's handler: each millisecond.
pub(crate) unsafe extern "C" fn sys_tick() {
    static NEXT: AtomicU32 = AtomicU32::new(0);
    PORT.tick();
    let next = NEXT.load(Ordering::Relaxed);
    if next == COUNT {
        return;
    }
    interrupt(|| {
        if TICKS
            .get()
            .is_some_and(|ticks| ticks.try_send(next).is_ok())
        {
            NEXT.store(next + 1, Ordering::Relaxed);
        }
    });
}

/// Never inlined into its caller, which turns the floating-point unit on: its registers may be
/// saved at the begin.
#[inline(never)]
pub(crate) fn main() {
    // SAFETY: LUNA runs on this core alone, and the one handler calls it within `interrupt`.
    // Nothing else uses SysTick.
    unsafe { PORT.start() };
    let executor = Executor::new();
    let ((ticks, from_ticks), (done, is_done)) = (buffered(Buffer::fifo(4)), channel());
    executor.spawn(ProcessSpec::new("adder").level(20), || async move {
        let (mut sum, mut cycles) = (0, 0);
        loop {
            alt! {
                tick = from_ticks.recv() => match tick {
                    Ok(tick) => sum += tick,
                    Err(_) => break,
                },
                cycle = is_done.recv() => match cycle {
                    Ok(cycle) => cycles += cycle,
                    Err(_) => break,
                },
            }
        }
        println(format_args!("sum of the ticks {sum}, cycles {cycles}"));
        assert_eq!((sum, cycles), ((0..COUNT).sum(), 20));
    });
    executor.spawn(ProcessSpec::new("loop").level(30), || async move {
        let (mut next, mut latest) = (Instant::now(), Duration::ZERO);
        let set_up = allocated();
        for _ in 0..20 {
            next += Duration::from_micros(5500);
            Sleep::until(next).await;
            latest = latest.max(Instant::now() - next);
            done.send(1).await.unwrap();
        }
        println(format_args!("the loop was at most {latest:?} late"));
        assert!(latest < Duration::from_millis(1));
        println(format_args!("{set_up} bytes were allocated at the set-up"));
        assert_eq!(allocated(), set_up, "nothing is allocated later");
    });
    assert!(TICKS.set(ticks).is_ok());
    executor.run();
    println(format_args!("ended at {:?}", Instant::now()));
}
