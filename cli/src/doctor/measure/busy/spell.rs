//! One spell in which the thread is busy.

use super::super::threads;
use super::{AFTER, BUSY, HARD, NETWORK, SIGNAL, SOFT, Spell};
use luna::{Instant, Policy, now};
use luna_platform::clock::nanos;
use luna_platform::clock::processor_time;
use luna_platform::futex::Futex;
use nix::sys::pthread::{Pthread, pthread_kill, pthread_self};
use nix::sys::signal::{SigSet, Signal};
use nix::sys::signalfd::{SfdFlags, SignalFd};
use nix::sys::time::TimeSpec;
use nix::sys::timerfd::{ClockId, Expiration, TimerFd, TimerFlags, TimerSetTimeFlags};
use std::fmt::Display;
use std::net::{Ipv4Addr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::Duration;

/// A harmless one, which only the busy thread gets.
const HARMLESS: Signal = Signal::SIGUSR2;
/// How often it looks what has come at least, also where a host takes the core away meanwhile.
const LOOKS: u32 = 500;
/// For that often.
const LONGEST: Duration = Duration::from_millis(500);
/// For the busy thread to begin.
const PATIENCE: Duration = Duration::from_secs(5);

/// What the busy thread and the one above it share. Times are in nanoseconds, 0 for none yet.
#[derive(Default)]
struct Shared {
    began: AtomicU64,
    /// The busy thread, for signals.
    thread: AtomicUsize,
    /// When the thread above woke by its timer, and when it sent the signal.
    woke: AtomicU64,
    signalled: AtomicU64,
    /// When the busy thread was so no longer.
    ended: AtomicU64,
}

/// What is sent to the busy thread, ready before it is busy.
struct Ways {
    timer: TimerFd,
    signals: SignalFd,
    socket: UdpSocket,
}

/// Has a thread be busy on `core`, with one of a higher priority beside it.
pub(in super::super) fn run(core: usize) -> Result<Spell, String> {
    let shared = Arc::new(Shared::default());
    let begun = Arc::new(Futex::new(0));
    let (own, is_begun) = (shared.clone(), begun.clone());
    // The one above first: below the busy one it would not get to run to be made.
    let above = threads::on(core, threads::PRIORITY + 1, move || watch(&own, &is_begun))?;
    let own = shared.clone();
    let busy = threads::on(core, threads::PRIORITY, move || {
        let outcome = Ways::open().and_then(|ways| be_busy(&own, &ways, &begun));
        // Also after an error: the other thread waits for it.
        begin(&own, &begun);
        outcome
    });
    // If it was refused, the other thread gives up by itself.
    let busy = busy?;
    let how = threads::how(busy.obtained());
    let has_policy = matches!(busy.obtained().policy, Policy::Fifo(_))
        && matches!(above.obtained().policy, Policy::Fifo(_));
    threads::end(above)?;
    let mut spell = threads::end(busy)??;
    let began = shared.began.load(Ordering::Relaxed);
    let woke = shared.woke.load(Ordering::Relaxed);
    let late = Duration::from_nanos(woke.saturating_sub(began + nanos(AFTER)));
    let ended = shared.ended.load(Ordering::Relaxed);
    spell.late[HARD] = (woke < ended).then_some(late);
    Ok(Spell {
        how,
        has_policy,
        ..spell
    })
}

/// The thread of the higher priority: sleeps, and then sends a signal.
fn watch(shared: &Shared, begun: &Futex) {
    let give_up = now() + PATIENCE;
    while begun.word().load(Ordering::Acquire) == 0 && now() < give_up {
        begun.wait(0, give_up);
    }
    let slot = Instant::from_nanos(shared.began.load(Ordering::Relaxed)) + AFTER;
    let never = Futex::new(0);
    while now() < slot {
        never.wait(0, slot);
    }
    shared.woke.store(now().as_nanos(), Ordering::Relaxed);
    let thread = shared.thread.load(Ordering::Relaxed);
    if thread != 0 {
        shared.signalled.store(now().as_nanos(), Ordering::Relaxed);
        // The thread is not joined before this one, so its number is still its own. One that has
        // ended meanwhile got none in time.
        let _ = pthread_kill(thread as Pthread, HARMLESS);
    }
}

impl Ways {
    fn open() -> Result<Ways, String> {
        let own = SigSet::from(HARMLESS);
        own.thread_block().map_err(failed("block a signal"))?;
        let flags = SfdFlags::SFD_NONBLOCK | SfdFlags::SFD_CLOEXEC;
        let signals = SignalFd::with_flags(&own, flags).map_err(failed("make a signalfd"))?;
        let flags = TimerFlags::TFD_NONBLOCK | TimerFlags::TFD_CLOEXEC;
        let timer = TimerFd::new(ClockId::CLOCK_MONOTONIC, flags);
        let timer = timer.map_err(failed("make a timerfd"))?;
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0));
        let socket = socket.map_err(failed("open a UDP socket on loopback"))?;
        let own = socket.local_addr().map_err(failed("read its address"))?;
        socket.connect(own).map_err(failed("connect it"))?;
        socket
            .set_nonblocking(true)
            .map_err(failed("make it non-blocking"))?;
        Ok(Ways {
            timer,
            signals,
            socket,
        })
    }
}

fn failed<E: Display>(to: &'static str) -> impl Fn(E) -> String {
    move |error| format!("could not {to}: {error}")
}

/// Has the thread above begin its sleep.
fn begin(shared: &Shared, begun: &Futex) {
    let none =
        shared
            .began
            .compare_exchange(0, now().as_nanos(), Ordering::Relaxed, Ordering::Relaxed);
    if none.is_ok() {
        begun.word().store(1, Ordering::Release);
        begun.wake_one();
    }
}

/// The busy thread: arms, sends, and looks what comes.
fn be_busy(shared: &Shared, ways: &Ways, begun: &Futex) -> Result<Spell, String> {
    shared
        .thread
        .store(pthread_self() as usize, Ordering::Relaxed);
    begin(shared, begun);
    let began = Instant::from_nanos(shared.began.load(Ordering::Relaxed));
    let (due, end) = (began + AFTER, began + BUSY);
    let left = Duration::from_nanos(due.nanos_since(now()));
    let once = Expiration::OneShot(TimeSpec::from(left));
    let armed = ways.timer.set(once, TimerSetTimeFlags::empty());
    armed.map_err(failed("arm a timerfd"))?;
    let mut sent = None;
    let mut spell = Spell::default();
    let mut looks = 0;
    let (from, before) = (now(), processor_time());
    loop {
        let time = now();
        if time >= end && (looks >= LOOKS || time >= end + LONGEST) {
            shared.ended.store(time.as_nanos(), Ordering::Relaxed);
            let took = before.zip(processor_time());
            let took = took.map(|(before, after)| after.saturating_sub(before));
            spell.waited = took.map_or(Duration::ZERO, |took| (time - from).saturating_sub(took));
            return Ok(spell);
        }
        looks += u32::from(time >= due);
        if sent.is_none() && time >= due {
            sent = Some(now());
            ways.socket
                .send(b"luna")
                .map_err(failed("send a packet over loopback"))?;
        }
        let mut note = |way: usize, since: Instant, came: &dyn Fn() -> bool| {
            let late: &mut Option<Duration> = &mut spell.late[way];
            if late.is_none() && came() {
                *late = Some(now() - since);
            }
        };
        if time >= due {
            note(SOFT, due, &|| ways.timer.wait().is_ok());
        }
        if let Some(sent) = sent {
            note(NETWORK, sent, &|| ways.socket.recv(&mut [0; 8]).is_ok());
        }
        match shared.signalled.load(Ordering::Relaxed) {
            0 => {}
            signalled => note(SIGNAL, Instant::from_nanos(signalled), &|| {
                matches!(ways.signals.read_signal(), Ok(Some(_)))
            }),
        }
    }
}
