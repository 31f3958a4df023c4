//! Which auto traits the types have, and which they must not have. All of it is checked by the
//! compiler.

#![cfg(not(loom))]

use luna_channels::lock_sync::{Mutex, MutexGuard};
use luna_channels::{
    Incoming, Receiver, RecvError, RecvOp, RecvTimeout, SendError, SendOp, SendTimeout, Sender,
    TrySendError,
};
use std::cell::Cell;
use std::error::Error;
use std::fmt::Debug;
use std::marker::PhantomPinned;
use std::panic::{RefUnwindSafe, UnwindSafe};
use std::rc::Rc;

fn send<T: Send>() {}
fn sync<T: Sync>() {}
fn unpin<T: Unpin>() {}
fn unwind_safe<T: UnwindSafe + RefUnwindSafe>() {}
fn clone<T: Clone>() {}
fn debug<T: Debug>() {}
fn error<T: Error + Send + Sync + 'static>() {}

/// Fails to compile if the type has the trait: the call is then ambiguous.
macro_rules! is_not {
    ($bound:path: $($type:ty),+ $(,)?) => {$({
        trait Ambiguous<Which> {
            fn here() {}
        }
        impl<T: ?Sized> Ambiguous<()> for T {}
        struct HasIt;
        impl<T: ?Sized + $bound> Ambiguous<HasIt> for T {}
        <$type as Ambiguous<_>>::here();
    })+};
}

#[test]
fn ends_of_values_that_can_be_sent_can_be_sent_and_shared() {
    send::<Sender<Cell<u8>>>();
    sync::<Sender<Cell<u8>>>();
    send::<Receiver<Cell<u8>>>();
    sync::<Receiver<Cell<u8>>>();
}

#[test]
fn operations_on_them_too() {
    send::<(SendOp<'_, Cell<u8>>, SendTimeout<'_, Cell<u8>>)>();
    sync::<(SendOp<'_, Cell<u8>>, SendTimeout<'_, Cell<u8>>)>();
    send::<(
        RecvOp<'_, Cell<u8>>,
        RecvTimeout<'_, Cell<u8>>,
        Incoming<'_, Cell<u8>>,
    )>();
    sync::<(
        RecvOp<'_, Cell<u8>>,
        RecvTimeout<'_, Cell<u8>>,
        Incoming<'_, Cell<u8>>,
    )>();
}

#[test]
fn of_values_that_cannot_be_sent_nothing_can() {
    is_not!(Send: Sender<Rc<u8>>, Receiver<Rc<u8>>, Sender<*const u8>, Receiver<*const u8>);
    is_not!(Sync: Sender<Rc<u8>>, Receiver<Rc<u8>>, Sender<*const u8>, Receiver<*const u8>);
    is_not!(Send: SendOp<'static, Rc<u8>>, SendTimeout<'static, Rc<u8>>, RecvOp<'static, Rc<u8>>);
    is_not!(Send: RecvTimeout<'static, Rc<u8>>, Incoming<'static, Rc<u8>>);
    is_not!(Sync: SendOp<'static, Rc<u8>>, SendTimeout<'static, Rc<u8>>, RecvOp<'static, Rc<u8>>);
}

#[test]
fn the_guard_of_a_mutex_is_as_a_reference_to_its_value() {
    send::<(Mutex<Cell<u8>>, MutexGuard<'_, Cell<u8>>)>();
    sync::<(Mutex<Cell<u8>>, MutexGuard<'_, u8>)>();
    is_not!(Sync: MutexGuard<'static, Cell<u8>>, Mutex<Rc<u8>>);
    is_not!(Send: MutexGuard<'static, Rc<u8>>, Mutex<Rc<u8>>);
}

#[test]
fn ends_may_move_and_operations_must_not() {
    unpin::<(Sender<PhantomPinned>, Receiver<PhantomPinned>)>();
    is_not!(Unpin: SendOp<'static, u8>, RecvOp<'static, u8>, SendTimeout<'static, u8>, RecvTimeout<'static, u8>);
    is_not!(Unpin: Incoming<'static, u8>);
}

#[test]
fn ends_need_nothing_of_their_values_but_send() {
    struct Plain;
    clone::<(Sender<Plain>, Receiver<Plain>)>();
    debug::<(
        Sender<Plain>,
        Receiver<Plain>,
        SendOp<'_, Plain>,
        RecvOp<'_, Plain>,
    )>();
    error::<SendError<Plain>>();
    error::<TrySendError<Plain>>();
    error::<RecvError>();
    unwind_safe::<(Sender<Cell<u8>>, Receiver<Cell<u8>>)>();
}
