//! Contexts, locks and idling.

use luna_bare::cpu;
use luna_core::deferred_free::{self, Shared};
use luna_core::park::block_on;
use luna_core::{Executor, ProcessSpec};
use luna_platform::bare::{self, NESTED_INTERRUPTS};
use luna_platform::clock::Instant;
use luna_platform::futex::{Futex, Waited};
use luna_platform::lock::PiLock;
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::rc::Rc;
use std::sync::Arc;

luna_platform::local! {
    static OWN: Cell<u32> = const { Cell::new(7) };
}

/// The words of the panic of `code`.
fn panic_of(code: impl FnOnce()) -> String {
    let payload = catch_unwind(AssertUnwindSafe(code)).unwrap_err();
    luna_platform::panics::text(&*payload).unwrap().to_owned()
}

#[test]
fn each_context_has_variables_of_its_own() {
    cpu::begin(1, 0);
    OWN.set(1);
    bare::interrupt(|| {
        OWN.set(2);
        bare::interrupt(|| OWN.set(3));
        assert_eq!(OWN.get(), 2);
        assert!(bare::is_interrupt());
    });
    assert_eq!(OWN.get(), 1);
    assert!(!bare::is_interrupt());
    let seen = bare::interrupt(|| (OWN.get(), bare::interrupt(|| OWN.get())));
    assert_eq!(seen, (2, 3), "they are kept from one interrupt to the next");
}

#[test]
fn too_many_interrupts_are_an_error() {
    fn nest(depth: usize) {
        bare::interrupt(|| {
            if depth > 1 {
                nest(depth - 1);
            }
        });
    }
    cpu::begin(1, 0);
    nest(NESTED_INTERRUPTS);
    let text = panic_of(|| nest(NESTED_INTERRUPTS + 1));
    assert!(
        text.contains("interrupts that use LUNA are under way"),
        "{text}"
    );
    assert!(!bare::is_interrupt(), "the unwinding has left them");
}

#[test]
fn a_handler_that_does_not_say_that_it_is_one_is_found() {
    cpu::begin(1, 0);
    let text = panic_of(|| cpu::within_bare_handler(|| OWN.set(1)));
    assert!(
        text.contains("within `luna_platform::bare::interrupt`"),
        "{text}"
    );
}

#[test]
fn locks_are_left_in_any_order_and_no_interrupt_comes_while_one_is_held() {
    cpu::begin(1, 1);
    let came = Rc::new(Cell::new(0));
    let counts = came.clone();
    cpu::add_interrupt(1, move || {
        counts.set(counts.get() + 1);
        true
    });
    let (first, second) = (PiLock::new(1), PiLock::new(2));
    let one = first.lock();
    let before = came.get();
    assert!(before > 0, "one came before the lock was held");
    let two = second.lock();
    drop(one);
    OWN.set(OWN.get() + *two);
    assert!(first.try_lock().is_some());
    assert_eq!(came.get(), before);
    drop(two);
    assert!(came.get() > before);
}

#[test]
fn a_lock_that_is_held_is_not_held_twice() {
    cpu::begin(1, 0);
    let lock = PiLock::new(());
    let held = lock.lock();
    assert!(lock.try_lock().is_none());
    assert_eq!(
        panic_of(|| drop(lock.lock())),
        "this context holds the lock already"
    );
    drop(held);
    drop(lock.lock());
}

#[test]
fn an_interrupt_cannot_wait() {
    cpu::begin(1, 0);
    let futex = Futex::new(0);
    let wait = || bare::interrupt(|| assert_eq!(futex.wait(0, Instant::NEVER), Waited::Woken));
    assert_eq!(panic_of(wait), "an interrupt cannot wait");
    let run = || bare::interrupt(|| drop(Executor::new()));
    assert_eq!(
        panic_of(run),
        "an executor runs in the context of the program"
    );
}

#[test]
fn a_wait_ends_by_a_wake_by_its_deadline_or_at_once() {
    cpu::begin(1, 0);
    let futex = Rc::new(Futex::new(0));
    assert_eq!(futex.wait(1, Instant::NEVER), Waited::Woken);
    let deadline = Instant::now() + core::time::Duration::from_millis(1);
    assert_eq!(futex.wait(0, deadline), Waited::TimedOut);
    assert!(Instant::now() >= deadline);
    let rings = futex.clone();
    cpu::add_interrupt(1, move || {
        rings.word().store(1, std::sync::atomic::Ordering::Release);
        rings.wake_one();
        false
    });
    while futex.wait(0, Instant::NEVER) == Waited::Woken {
        if futex.word().load(std::sync::atomic::Ordering::Acquire) == 1 {
            return;
        }
    }
    panic!("it was woken");
}

#[test]
fn what_an_interrupt_drops_is_freed_by_the_program() {
    cpu::begin(1, 0);
    let token = Arc::new(());
    let shared = Shared::new(token.clone());
    let executor = Executor::new();
    let handle = executor.handle().clone();
    bare::interrupt(move || {
        drop(shared);
        deferred_free::collect();
        handle.spawn(ProcessSpec::new("process"), || async {});
    });
    assert_eq!(Arc::strong_count(&token), 2);
    deferred_free::collect();
    assert_eq!(Arc::strong_count(&token), 1);
    drop(executor);
}

#[test]
fn a_lost_wake_is_found() {
    cpu::begin(1, 0);
    let text = panic_of(|| block_on(std::future::pending()));
    assert_eq!(text, "the CPU idles for ever");
}
