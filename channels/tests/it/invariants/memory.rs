//! Invariant 3: after waking a partner, its memory is not touched again.

use super::common::Watchdog;
use super::either;
use futures_lite::future::block_on;
use luna_channels::{alt, channel, pri_alt};
use std::future::Future;
use std::mem::MaybeUninit;
use std::pin::Pin;
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll, Wake, Waker};

/// A future in memory that outlives it: it is filled when the future is gone, so that a late access
/// shows.
struct Remains<F> {
    memory: Box<MaybeUninit<F>>,
    alive: bool,
}

const GONE: u8 = 0xA5;

impl<F: Future> Remains<F> {
    fn new(future: F) -> Self {
        Self {
            memory: Box::new(MaybeUninit::new(future)),
            alive: true,
        }
    }

    fn poll(&mut self, waker: &Waker) -> Poll<F::Output> {
        assert!(self.alive);
        // SAFETY: the future is there, and does not move until it is dropped in its place.
        let future = unsafe { Pin::new_unchecked(self.memory.assume_init_mut()) };
        future.poll(&mut Context::from_waker(waker))
    }

    fn end(&mut self) {
        assert!(std::mem::replace(&mut self.alive, false));
        // SAFETY: the future is there, and no code uses it again.
        unsafe {
            self.memory.assume_init_drop();
            std::ptr::write_bytes(self.memory.as_mut_ptr().cast::<u8>(), GONE, size_of::<F>());
        }
    }

    fn is_untouched(&self) -> bool {
        // SAFETY: all its bytes were written by `end`, and it lives as long as `self`.
        let bytes = unsafe {
            std::slice::from_raw_parts(self.memory.as_ptr().cast::<u8>(), size_of::<F>())
        };
        !self.alive && bytes.iter().all(|&byte| byte == GONE)
    }
}

/// Runs something when it is woken, once.
struct WhenWoken(Mutex<Option<Box<dyn FnOnce() + Send>>>);

impl Wake for WhenWoken {
    fn wake(self: Arc<Self>) {
        let run = self.0.lock().unwrap().take();
        if let Some(run) = run {
            run();
        }
    }
}

#[test]
fn invariant_3_after_waking_a_partner_its_memory_is_not_touched_again() {
    let _watchdog = Watchdog::new();
    // The waker ends the alternative before it returns to the sender that woke it: it polls it,
    // drops it, and overwrites what it was.
    let (one, from_one) = channel::<u64>();
    let (two, from_two) = channel::<u64>();
    let alternative = async move { either(&from_one, &from_two).await };
    let remains = Arc::new(Mutex::new(Remains::new(alternative)));
    let ended = remains.clone();
    let waker = Waker::from(Arc::new(WhenWoken(Mutex::new(Some(Box::new(move || {
        let mut remains = ended.lock().unwrap();
        assert_eq!(remains.poll(Waker::noop()), Poll::Ready((2, Ok(7))));
        remains.end();
    }))))));
    assert!(remains.lock().unwrap().poll(&waker).is_pending());
    assert_eq!(two.try_send(7), Ok(()));
    assert!(remains.lock().unwrap().is_untouched());
    // The receivers went with it.
    assert!(one.try_send(1).unwrap_err().is_closed());
    assert!(two.try_send(1).unwrap_err().is_closed());
}

#[test]
fn invariant_3_nor_when_an_alternative_wakes_an_alternative_or_poison_does() {
    let _watchdog = Watchdog::new();
    for poisons in [false, true] {
        let (one, from_one) = channel::<u64>();
        let (two, from_two) = channel::<u64>();
        let offers = async move {
            alt! {
                sent = one.send(1) => sent,
                value = from_two.recv() => value.map(|_| ()).map_err(|_| unreachable!()),
            }
        };
        let remains = Arc::new(Mutex::new(Remains::new(offers)));
        let ended = remains.clone();
        let waker = Waker::from(Arc::new(WhenWoken(Mutex::new(Some(Box::new(move || {
            let mut remains = ended.lock().unwrap();
            let Poll::Ready(sent) = remains.poll(Waker::noop()) else {
                panic!("it was woken for nothing");
            };
            assert_eq!(sent.is_err(), poisons);
            remains.end();
        }))))));
        assert!(remains.lock().unwrap().poll(&waker).is_pending());
        if poisons {
            from_one.poison();
        } else {
            let received = block_on(async {
                pri_alt! {
                    value = from_one.recv() => value,
                    sent = two.send(2) => unreachable!("{sent:?}"),
                }
            });
            assert_eq!(received, Ok(1));
        }
        assert!(remains.lock().unwrap().is_untouched());
        assert!(two.try_send(1).unwrap_err().is_closed());
    }
}
