//! A lock that is dropped leaves its process' list of waits before its waker is dropped. Otherwise
//! a panic of that waker left it in the list.

use crate::defects::waker::{panics, panics_in_drop};
use luna::sync::Mutex;
use std::future::Future;
use std::task::{Context, Waker};

#[test]
fn a_dropped_lock_is_in_no_list_though_its_wakers_drop_panics() -> luna::Result<()> {
    luna::run(async {
        let waker = panics_in_drop();
        let mutex = Mutex::new(0);
        let _held = mutex.lock().await.ok();
        let mut lock = Box::pin(mutex.lock());
        let polled = lock.as_mut().poll(&mut Context::from_waker(&waker));
        assert!(polled.is_pending());
        assert!(panics(|| drop(lock)));
        let mut next = Box::pin(mutex.lock());
        let polled = next.as_mut().poll(&mut Context::from_waker(Waker::noop()));
        assert!(polled.is_pending());
        drop(next);
        Ok(())
    })
}
