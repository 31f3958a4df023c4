//! What a thread knows of being watched.

use crate::Kind;
use crate::room::{self, Raw};
use crate::system_calls::{self, Selector};
use luna_core::current::{self, User};
use luna_core::path::{self, Watcher};
use std::cell::Cell;
use std::sync::{Mutex, PoisonError};

/// The names of the threads that were on the path in a scope, by their numbers. A plain lock: taken
/// off the path.
static THREADS: Mutex<Vec<String>> = Mutex::new(Vec::new());

/// # Invariants
///
/// It has no destructor, so that it can be read, also by the kernel, as long as the thread lives.
struct Here {
    /// Read by the kernel on each system call, once the thread is armed.
    selector: Selector,
    is_armed: Cell<bool>,
    /// The guard itself is at work: it may allocate and call the system.
    is_busy: Cell<bool>,
    /// The thread's number.
    thread: Cell<usize>,
}

thread_local! {
    static HERE: Here = const {
        Here {
            selector: Selector::new(),
            is_armed: Cell::new(false),
            is_busy: Cell::new(false),
            thread: Cell::new(0),
        }
    };
}

pub(crate) struct Guard;

impl Watcher for Guard {
    fn switched(&self, on_path: bool) {
        HERE.with(|here| {
            here.selector.let_pass();
            if on_path && room::is_open() {
                if !here.is_armed.replace(true) {
                    let name = std::thread::current().name().unwrap_or("?").to_owned();
                    let mut threads = THREADS.lock().unwrap_or_else(PoisonError::into_inner);
                    here.thread.set(threads.len());
                    threads.push(name);
                    drop(threads);
                    // SAFETY: the selector lives as long as the thread, by the invariant.
                    unsafe { system_calls::arm(&here.selector) };
                }
                here.selector.stop();
            }
        });
    }
}

/// Registers the guard with the platform.
pub(crate) fn begin() {
    path::watch(&Guard);
}

/// What a thread is called.
pub(crate) fn thread_name(thread: usize) -> String {
    let threads = THREADS.lock().unwrap_or_else(PoisonError::into_inner);
    threads.get(thread).cloned().unwrap_or_default()
}

/// Whether the rules apply to this thread now. Async-signal-safe.
fn is_watched(here: &Here) -> bool {
    room::is_open() && current::on_path() && !here.is_busy.get() && !std::thread::panicking()
}

/// Calls `f`; if this thread is watched, first notes that `f` breaks a rule, and watches nothing
/// within it.
#[inline]
pub(crate) fn noting<R>(kind: Kind, f: impl FnOnce() -> R) -> R {
    // First, since memory is allocated before a program has thread-locals.
    if !room::is_open() {
        return f();
    }
    HERE.with(|here| {
        if !is_watched(here) {
            return f();
        }
        here.is_busy.set(true);
        here.selector.let_pass();
        note(here, kind);
        // System calls of the allocator are part of the noted allocation.
        let outcome = f();
        here.selector.stop();
        here.is_busy.set(false);
        outcome
    })
}

/// Called when the kernel has stopped a system call of this thread: notes it if it breaks a rule.
/// Async-signal-safe. Returns the selector, which lets calls pass from now on.
pub(crate) fn stopped(kind: impl FnOnce() -> Option<Kind>) -> *const Selector {
    HERE.with(|here| {
        here.selector.let_pass();
        if is_watched(here)
            && let Some(kind) = kind()
        {
            here.is_busy.set(true);
            note(here, kind);
            here.is_busy.set(false);
        }
        &raw const here.selector
    })
}

fn note(here: &Here, kind: Kind) {
    let process = match current::user() {
        User::Process(process) => process.get(),
        User::Outside => 0,
    };
    room::note(&Raw::here(kind, process, here.thread.get()));
}
