//! A simulated CPU: one thread at a time, interrupts at random places, and a virtual clock.
//!
//! The thread that calls LUNA first is the CPU, until it ends; others wait for that. So each test
//! has it for itself, however many threads the test harness has.
//!
//! Interrupts come where the kernel meets the CPU: before a critical section and after it, at each
//! use of a context's own variables, when the clock is read or a wake is made, and while the CPU
//! idles. They do not come in a critical section, and one comes in the middle of another only if
//! its priority is higher. A CPU that idles for ever fails the test: a wake was lost.

use luna_platform::bare::{self, Port};
use luna_platform::clock::Instant;
use luna_platform::on_drop::OnDrop;
use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering, compiler_fence};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// An idle that is not ended by so many interrupts waits for a wake that was lost.
const IDLES_LONG: u32 = 100_000;

#[cfg(not(debug_assertions))]
compile_error!("the simulated CPU needs debug assertions: the kernel meets the CPU by them");

/// What an interrupt does, within a context of its own. `false`: it comes no more.
type Handler = Rc<dyn Fn() -> bool>;

#[derive(Clone)]
struct Interrupt {
    priority: u8,
    handler: Handler,
}

/// A handler on its way into the context of its interrupt.
struct OnCpu<'a, R>(&'a dyn Fn() -> R);

// SAFETY: handlers run in interrupts alone, which are never two at once: a handler comes in the
// middle of another one only, and of none twice. So it has what it captures for itself.
unsafe impl<R> Send for OnCpu<'_, R> {}

impl<R> OnCpu<'_, R> {
    fn call(&self) -> R {
        (self.0)()
    }
}

/// The state of the CPU, which is a thread's.
///
/// What [`preempt`] uses, which comes in the middle of anything, is atomic.
struct Cpu {
    is_masked: AtomicBool,
    /// The priority of the running interrupt; 0 is the program.
    running: AtomicU8,
    /// A preempting interrupt that came in a critical section.
    is_pending: AtomicBool,
    preempting: Cell<Option<&'static dyn Fn()>>,
    now: Cell<u64>,
    /// Set by a wake, cleared by the return of an idle. An interrupt alone does not set it: on some
    /// chips it would.
    event: AtomicBool,
    random: Cell<u64>,
    /// One place in so many has an interrupt; 0: none has.
    rarity: Cell<u64>,
    interrupts: RefCell<Vec<Interrupt>>,
    served: AtomicU64,
    nested: Cell<u64>,
    idled: Cell<u64>,
}

thread_local! {
    static CPU: Cpu = const {
        Cpu {
            is_masked: AtomicBool::new(false),
            running: AtomicU8::new(0),
            is_pending: AtomicBool::new(false),
            preempting: Cell::new(None),
            now: Cell::new(1_000_000_000),
            event: AtomicBool::new(false),
            random: Cell::new(1),
            rarity: Cell::new(0),
            interrupts: RefCell::new(Vec::new()),
            served: AtomicU64::new(0),
            nested: Cell::new(0),
            idled: Cell::new(0),
        }
    };
    static TURN: Turn = Turn::take();
    static HAS_BEGUN: Cell<bool> = const { Cell::new(false) };
}

/// Whether a thread is the CPU.
static IS_TAKEN: Mutex<bool> = Mutex::new(false);
static IS_FREE: Condvar = Condvar::new();

fn is_taken() -> MutexGuard<'static, bool> {
    IS_TAKEN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// This thread is the CPU, until it ends.
struct Turn;

impl Turn {
    fn take() -> Self {
        let mut taken = is_taken();
        while *taken {
            taken = IS_FREE.wait(taken).unwrap_or_else(PoisonError::into_inner);
        }
        *taken = true;
        Turn
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        // What the handlers hold is dropped by the CPU.
        let handlers = CPU.try_with(|cpu| cpu.interrupts.take());
        drop(handlers);
        *is_taken() = false;
        IS_FREE.notify_one();
    }
}

/// Makes this thread the CPU. At first it has interrupts that send and receive on a channel of
/// their own, which disturb what runs and are not disturbed: see [`noise`].
fn take() {
    static IS_INSTALLED: AtomicBool = AtomicBool::new(false);
    // A thread that is ending has no variables any more.
    if TURN.try_with(|_| ()).is_err() {
        return;
    }
    // First, since each of the two takes the CPU too.
    if !IS_INSTALLED.swap(true, Relaxed) {
        // SAFETY: one thread at a time is the CPU, each place where the kernel meets the CPU waits
        // for that, and handlers run within `interrupt`. With debug assertions each use of a context's
        // variables is such a place. No guard overlaps a critical section in part.
        unsafe { bare::install(&Simulated) };
    }
    if !HAS_BEGUN.replace(true) {
        noise::begin();
    }
}

/// Begins anew on this thread: without interrupts, at one second. From now on the interrupts that
/// are added come at one place in `rarity`, chosen by `seed`.
pub fn begin(seed: u64, rarity: u64) {
    HAS_BEGUN.set(true);
    take();
    let before = CPU.with(|cpu| cpu.interrupts.take());
    drop(before);
    CPU.with(|cpu| {
        cpu.preempting.set(None);
        cpu.now.set(1_000_000_000);
        cpu.event.store(false, Relaxed);
        cpu.random.set(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
        cpu.rarity.set(rarity);
        cpu.served.store(0, Relaxed);
        cpu.nested.set(0);
        cpu.idled.set(0);
    });
}

/// Adds an interrupt of this priority, from 1 on. It comes at random places, and while the CPU
/// idles, as long as `handler` returns `true`.
pub fn add_interrupt(priority: u8, handler: impl Fn() -> bool + 'static) {
    assert!(priority > 0, "0 is the program's");
    take();
    let handler = Rc::new(handler);
    CPU.with(|cpu| {
        let interrupt = Interrupt { priority, handler };
        cpu.interrupts.borrow_mut().push(interrupt);
    });
}

/// Calls `handler` as an interrupt handler that does not call `interrupt`.
pub fn within_bare_handler(handler: impl FnOnce()) {
    CPU.with(|cpu| cpu.running.store(1, Relaxed));
    let _restore = OnDrop::new(|| CPU.with(|cpu| cpu.running.store(0, Relaxed)));
    handler();
}

/// How many interrupts there were, how many of them in the middle of another, and how often the CPU
/// idled.
pub fn counts() -> (u64, u64, u64) {
    CPU.with(|cpu| (cpu.served.load(Relaxed), cpu.nested.get(), cpu.idled.get()))
}

/// The time on the CPU's clock, in nanoseconds.
pub fn now() -> u64 {
    CPU.with(|cpu| cpu.now.get())
}

/// Moves the CPU's clock on.
pub fn advance(nanos: u64) {
    CPU.with(|cpu| cpu.now.set(cpu.now.get() + nanos));
}

impl Cpu {
    /// A number below `bound`, by xorshift.
    fn random(&self, bound: u64) -> u64 {
        let mut state = self.random.get();
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        self.random.set(state);
        (state >> 11) % bound
    }

    /// A place where an interrupt may come.
    fn place(&self) {
        let rarity = self.rarity.get();
        if rarity > 0 && !self.is_masked.load(Relaxed) && self.random(rarity) == 0 {
            self.serve_one();
        }
    }

    fn serve_preempting(&self) {
        if let Some(handler) = self.preempting.get() {
            self.running.store(1, Relaxed);
            self.served.fetch_add(1, Relaxed);
            let handler = OnCpu(handler);
            bare::interrupt(move || handler.call());
            self.running.store(0, Relaxed);
        }
    }

    /// Waits for preempting interrupts until one wakes.
    fn idle_preempted(&self) {
        let before = self.served.load(Relaxed);
        while !self.event.swap(false, Relaxed) {
            let served = self.served.load(Relaxed) - before;
            assert!(served < IDLES_LONG.into(), "the CPU idles for ever");
            std::hint::spin_loop();
        }
    }

    /// Serves one interrupt that may come now. `false` if there is none.
    fn serve_one(&self) -> bool {
        let running = self.running.load(Relaxed);
        let able: Vec<Interrupt> = {
            let interrupts = self.interrupts.borrow();
            let able = interrupts.iter().filter(|one| one.priority > running);
            able.cloned().collect()
        };
        if able.is_empty() {
            return false;
        }
        let chosen = &able[self.random(able.len() as u64) as usize];
        self.running.store(chosen.priority, Relaxed);
        self.served.fetch_add(1, Relaxed);
        self.nested.set(self.nested.get() + u64::from(running > 0));
        let handler = OnCpu(&*chosen.handler);
        let comes_again = bare::interrupt(move || handler.call());
        self.running.store(running, Relaxed);
        if !comes_again {
            let is_chosen = |one: &Interrupt| Rc::ptr_eq(&one.handler, &chosen.handler);
            let mut interrupts = self.interrupts.borrow_mut();
            // Dropped below, where the list is free: other interrupts may come then.
            let over = interrupts.iter().position(is_chosen);
            let over = over.map(|place| interrupts.remove(place));
            drop(interrupts);
            drop(over);
        }
        true
    }
}

/// From now on [`preempt`] is an interrupt that calls `handler`, and no other one comes.
pub fn set_preempting(handler: &'static dyn Fn()) {
    begin(1, 0);
    CPU.with(|cpu| cpu.preempting.set(Some(handler)));
}

/// An interrupt, in the middle of anything: to be called by a signal handler on the thread that is
/// the CPU. One that comes in a critical section, or in another, is held back.
pub fn preempt() {
    let _ = CPU.try_with(|cpu| {
        if cpu.is_masked.load(Relaxed) || cpu.running.load(Relaxed) > 0 {
            cpu.is_pending.store(true, Relaxed);
        } else {
            cpu.serve_preempting();
        }
    });
}

/// Calls `f` with the state of the CPU, after having waited to be it. `None` while the thread ends.
fn with_cpu<R>(f: impl FnOnce(&Cpu) -> R) -> Option<R> {
    take();
    CPU.try_with(f).ok()
}

/// The port of the simulated CPU.
struct Simulated;

impl Port for Simulated {
    fn now(&self) -> u64 {
        with_cpu(|cpu| {
            cpu.place();
            // Each look takes a little.
            cpu.now.set(cpu.now.get() + 5);
            cpu.now.get()
        })
        .unwrap_or(u64::MAX - 1)
    }

    fn idle(&self, deadline: Instant) {
        with_cpu(|cpu| {
            assert!(!cpu.is_masked.load(Relaxed), "idles in a critical section");
            assert_eq!(cpu.running.load(Relaxed), 0, "idles in an interrupt");
            cpu.idled.set(cpu.idled.get() + 1);
            if cpu.preempting.get().is_some() {
                return cpu.idle_preempted();
            }
            let has_deadline = deadline != Instant::NEVER;
            for _ in 0..IDLES_LONG {
                cpu.place();
                if cpu.event.swap(false, Relaxed) {
                    return;
                }
                // What comes first, the deadline or an interrupt, is chance too.
                let is_late = has_deadline && cpu.random(2) == 0;
                if is_late || !cpu.serve_one() {
                    assert!(has_deadline, "the CPU idles for ever");
                    cpu.now.set(cpu.now.get().max(deadline.as_nanos()));
                    return;
                }
            }
            panic!("the CPU idles for ever");
        });
    }

    fn wake(&self) {
        with_cpu(|cpu| {
            cpu.place();
            cpu.event.store(true, Relaxed);
        });
    }

    fn is_interrupt(&self) -> bool {
        with_cpu(|cpu| {
            cpu.place();
            cpu.running.load(Relaxed) > 0
        })
        .unwrap_or(false)
    }
}

struct Section;
critical_section::set_impl!(Section);

// SAFETY: the thread that is the CPU masks its interrupts, and no other thread is the CPU.
unsafe impl critical_section::Impl for Section {
    unsafe fn acquire() -> critical_section::RawRestoreState {
        with_cpu(|cpu| {
            cpu.place();
            let was_masked = cpu.is_masked.swap(true, Relaxed);
            compiler_fence(Ordering::SeqCst);
            was_masked
        })
        .unwrap_or(false)
    }

    unsafe fn release(was_masked: critical_section::RawRestoreState) {
        with_cpu(|cpu| {
            compiler_fence(Ordering::SeqCst);
            cpu.is_masked.store(was_masked, Relaxed);
            let is_program = cpu.running.load(Relaxed) == 0;
            if !was_masked && is_program && cpu.is_pending.swap(false, Relaxed) {
                cpu.serve_preempting();
            }
            cpu.place();
        });
    }
}

/// Interrupts for tests that know nothing of them.
mod noise {
    use super::{CPU, add_interrupt};
    use luna_channels::{Buffer, buffered};
    use std::cell::Cell;

    /// Two interrupts, of which one may come in the middle of the other, at one place in 20.
    pub(super) fn begin() {
        let (sender, receiver) = buffered(Buffer::fifo(3));
        let (sent, received) = (Cell::new(0_u64), Cell::new(0_u64));
        add_interrupt(1, move || {
            if sender.try_send(sent.get()).is_ok() {
                sent.set(sent.get() + 1);
            }
            true
        });
        add_interrupt(2, move || {
            if let Ok(value) = receiver.try_recv() {
                assert_eq!(value, received.replace(value + 1), "lost or doubled");
            }
            true
        });
        CPU.with(|cpu| cpu.rarity.set(20));
    }
}
