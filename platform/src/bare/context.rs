//! The contexts of the one CPU, and what each has of its own.

use super::port;
use crate::on_drop::OnDrop;
use core::cell::{Cell, RefCell};
use core::sync::atomic::{AtomicUsize, Ordering, compiler_fence};

/// How many interrupts that use LUNA may be under way at once, each in the middle of another. Each
/// takes about a kilobyte of static memory on a 32-bit chip.
///
/// An interrupt comes in the middle of one of lower priority alone. So it is enough if the handlers
/// that use LUNA have at most so many priorities. The environment variable `LUNA_NESTED_INTERRUPTS`
/// sets it when LUNA is compiled, from 1 to 255; it is 3 otherwise.
pub const NESTED_INTERRUPTS: usize = match option_env!("LUNA_NESTED_INTERRUPTS") {
    None => 3,
    Some(text) => match usize::from_str_radix(text, 10) {
        Ok(number @ 1..=255) => number,
        _ => panic!("LUNA_NESTED_INTERRUPTS is not a number from 1 to 255"),
    },
};

/// The number of contexts: the program, and the interrupts.
pub const CONTEXTS: usize = NESTED_INTERRUPTS + 1;

/// The running context: 0 is the program, and each interrupt adds one and takes it back.
static RUNNING: AtomicUsize = AtomicUsize::new(0);

/// Runs `handler`, the part of an interrupt handler that uses LUNA, as a context of its own. O(1)
/// apart from `handler`, no critical section.
///
/// `handler` is `Send`, since it runs in another context than its caller.
///
/// In it these may be called: `try_send` and `try_recv` of channels, a `Waker`, and all that reads.
/// What waits panics there. What allocates or frees relies on an allocator that may be called from
/// interrupts: that is making a channel, spawning, a send into a buffer that grows, and each drop
/// of a value that owns memory. Values are dropped there when one displaces another in a buffer,
/// and when the last receiver goes.
///
/// # Panics
///
/// If more than [`NESTED_INTERRUPTS`] are under way.
pub fn interrupt<R: Send>(handler: impl FnOnce() -> R + Send) -> R {
    let before = RUNNING.load(Ordering::Relaxed);
    assert!(
        before < NESTED_INTERRUPTS,
        "more than {NESTED_INTERRUPTS} interrupts that use LUNA are under way"
    );
    // An interrupt between the two leaves the number as it found it. The fences keep what belongs
    // to this context between the stores, as such an interrupt sees them.
    RUNNING.store(before + 1, Ordering::Relaxed);
    compiler_fence(Ordering::SeqCst);
    let _leave = OnDrop::new(|| {
        compiler_fence(Ordering::SeqCst);
        RUNNING.store(before, Ordering::Relaxed);
    });
    handler()
}

/// Whether the caller runs within [`interrupt`]. One load.
#[inline]
pub fn is_interrupt() -> bool {
    RUNNING.load(Ordering::Relaxed) > 0
}

/// The number of the running context.
#[inline]
fn running() -> usize {
    if cfg!(debug_assertions)
        && let Some(port) = port::installed()
    {
        // Before the load: the port of a simulated CPU may run an interrupt here.
        let is_handler = port.is_interrupt();
        assert!(
            !is_handler || is_interrupt(),
            "an interrupt handler has to call LUNA within `luna_platform::bare::interrupt`"
        );
    }
    RUNNING.load(Ordering::Relaxed)
}

/// A variable of which each context has one. It has the names of `std::thread::LocalKey`; made by
/// [`local!`](crate::local).
pub struct Local<T: 'static>([T; CONTEXTS]);

// SAFETY: a reference to an element is given to the context of its number alone, and leaves it
// neither by the methods here nor, by the promise to `install`, by another CPU. A context that is
// interrupted does not run until the interrupting one has ended, which has an element of its own.
unsafe impl<T> Sync for Local<T> {}

/// What [`Local::try_with`] never returns: no context ends.
#[derive(Debug)]
#[non_exhaustive]
pub struct AccessError;

impl<T> Local<T> {
    #[doc(hidden)]
    pub const fn new(first: [T; CONTEXTS]) -> Self {
        Self(first)
    }

    /// Calls `f` with this context's own.
    #[inline]
    pub fn with<R>(&'static self, f: impl FnOnce(&T) -> R) -> R {
        f(&self.0[running()])
    }

    /// As [`with`](Self::with).
    ///
    /// # Errors
    ///
    /// None.
    #[inline]
    pub fn try_with<R>(&'static self, f: impl FnOnce(&T) -> R) -> Result<R, AccessError> {
        Ok(self.with(f))
    }
}

impl<T> Local<Cell<T>> {
    /// Sets this context's own.
    #[inline]
    pub fn set(&'static self, value: T) {
        self.with(|own| own.set(value));
    }

    /// A copy of this context's own.
    #[inline]
    pub fn get(&'static self) -> T
    where
        T: Copy,
    {
        self.with(Cell::get)
    }

    /// Takes this context's own, and leaves the default.
    #[inline]
    pub fn take(&'static self) -> T
    where
        T: Default,
    {
        self.with(Cell::take)
    }

    /// Sets this context's own, and returns what was there.
    #[inline]
    pub fn replace(&'static self, value: T) -> T {
        self.with(|own| own.replace(value))
    }
}

impl<T> Local<RefCell<T>> {
    /// Calls `f` with a reference to what this context has.
    pub fn with_borrow<R>(&'static self, f: impl FnOnce(&T) -> R) -> R {
        self.with(|own| f(&own.borrow()))
    }

    /// Calls `f` with an exclusive reference to what this context has.
    pub fn with_borrow_mut<R>(&'static self, f: impl FnOnce(&mut T) -> R) -> R {
        self.with(|own| f(&mut own.borrow_mut()))
    }

    /// Sets this context's own.
    pub fn set(&'static self, value: T) {
        self.with(|own| *own.borrow_mut() = value);
    }

    /// Takes this context's own, and leaves the default.
    pub fn take(&'static self) -> T
    where
        T: Default,
    {
        self.with(RefCell::take)
    }
}

crate::debug_fields!(impl[T] Local<T>);
