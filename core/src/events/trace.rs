//! The trace of a thread, and the listener to names: the hooks.

use super::Kind;
use alloc::boxed::Box;
use alloc::string::String;
use core::cell::{Cell, RefCell};
use core::fmt;
use core::ptr::NonNull;
use core::sync::atomic::{AtomicUsize, Ordering};
use luna_platform::sync::OnceLock;

/// Whether threads can be traced: without it the compiler leaves out what is behind it.
const HAS_EVENTS: bool = cfg!(all(feature = "events", not(loom)));

/// Takes the events of one thread.
pub trait Trace: Send {
    /// Takes an event: its code, its subject and two numbers; false if nothing takes any more.
    /// Called on the thread, on the real-time path: wait-free, O(1), no allocation.
    fn put(&self, code: u16, subject: u32, arguments: [u64; 2]) -> bool;

    /// The recording, and the number of the thread, or of its present executor, in it.
    fn place(&self) -> (u64, u32);
}

luna_platform::local! {
    /// The trace of this thread: none, or that in `ATTACHED`.
    static TRACE: Cell<Option<NonNull<dyn Trace>>> = const { Cell::new(None) };
    static ATTACHED: RefCell<Attached> = const { RefCell::new(Attached(None)) };
}

struct Attached(Option<Box<dyn Trace>>);

impl Drop for Attached {
    fn drop(&mut self) {
        TRACE.set(None);
    }
}

#[inline(always)]
fn current() -> Option<NonNull<dyn Trace>> {
    if HAS_EVENTS { TRACE.get() } else { None }
}

/// Whether the calling thread is traced. One load. Without the feature `events` it never is.
#[inline(always)]
pub fn is_on() -> bool {
    current().is_some()
}

/// From now on the calling thread's events go to this trace.
pub fn attach(trace: Box<dyn Trace>) {
    exchange(Some(trace));
}

/// From now on the calling thread is not traced.
pub fn detach() {
    exchange(None);
}

fn exchange(trace: Option<Box<dyn Trace>>) -> Option<Box<dyn Trace>> {
    let before = ATTACHED.try_with(|attached| {
        TRACE.set(None);
        let before = core::mem::replace(&mut attached.borrow_mut().0, trace);
        TRACE.set(attached.borrow().0.as_deref().map(NonNull::from));
        before
    });
    // A thread that is ending is traced no more.
    before.ok().flatten()
}

fn with<R>(f: impl FnOnce(&dyn Trace) -> R) -> Option<R> {
    // SAFETY: the pointer is that of this thread's trace, which is live: it is cleared before
    // the trace is dropped or given back.
    current().map(|trace| f(unsafe { trace.as_ref() }))
}

#[inline]
pub(crate) fn put(code: u16, subject: u32, arguments: [u64; 2]) {
    if with(|trace| trace.put(code, subject, arguments)) == Some(false) {
        // The trace stays: this may be the real-time path, where nothing is freed.
        TRACE.set(None);
    }
}

/// The recording of the calling thread, and the number of the thread, or of its present
/// executor, in it.
pub fn place() -> Option<(u64, u32)> {
    with(|trace| trace.place())
}

/// The trace of an executor that shares its thread with others, while another one has its turn.
#[derive(Default)]
pub struct Kept(Option<Box<dyn Trace>>);

impl Kept {
    /// Exchanges this trace and the thread's: before a turn and after it.
    pub fn exchange(&mut self) {
        if HAS_EVENTS {
            self.0 = exchange(self.0.take());
        }
    }
}

impl fmt::Debug for Kept {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Kept").field(&self.0.is_some()).finish()
    }
}

/// Hears a name: the kind of the object, its number, its parent's or 0, its name, and the level
/// of a process on the calling thread.
pub type Namer = fn(Kind, u32, u32, String, Option<u8>);

static NAMER: OnceLock<Namer> = OnceLock::new();
static LISTENING: AtomicUsize = AtomicUsize::new(0);

/// While this lives, names are told.
#[derive(Debug)]
#[must_use = "nothing is told any more when it is dropped"]
pub struct Listening(());

/// Lets `namer` hear each process, channel, barrier, lock and loop that is named from now on,
/// until the result is dropped. All of a program have the namer of the first.
pub fn listen(namer: Namer) -> Listening {
    let _ = NAMER.set(namer);
    LISTENING.fetch_add(1, Ordering::Release);
    Listening(())
}

impl Drop for Listening {
    fn drop(&mut self) {
        LISTENING.fetch_sub(1, Ordering::Release);
    }
}

/// Tells a name, if something listens. Not for the real-time path: it locks and allocates then.
#[inline]
pub fn name(kind: Kind, number: u32, parent: u32, text: impl FnOnce() -> String) {
    tell(kind, number, parent, text, None);
}

#[inline]
fn tell(kind: Kind, number: u32, of: u32, text: impl FnOnce() -> String, level: Option<u8>) {
    if HAS_EVENTS
        && LISTENING.load(Ordering::Acquire) > 0
        && let Some(namer) = NAMER.get()
    {
        namer(kind, number, of, text(), level);
    }
}

/// Names a process, on the thread that it runs on, if that is traced. As [`name`].
#[inline]
pub fn name_process(process: u32, level: u8, text: impl FnOnce() -> String) {
    if is_on() {
        tell(Kind::Process, process, 0, text, Some(level));
    }
}

/// Names the executor of the calling thread to its recorder, if there is one. As [`name`].
#[inline]
pub fn name_executor(text: impl FnOnce() -> String) {
    if let Some((_, number)) = place() {
        tell(Kind::Executor, number, 0, text, None);
    }
}
