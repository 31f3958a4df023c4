//! The calls on the pool that the processes of a thread have begun: counted, since their ends wake
//! processes.

use crate::process::ProcessRegistry;
use crate::quiescence::Quiescence;
use crate::simulation::Stage;
use alloc::boxed::Box;
use alloc::sync::Arc;
use core::cell::RefCell;
use luna_platform::clock::Clock;
use luna_platform::on_drop::OnDrop;

/// Where the calls of one thread are counted, with the observer to notify when the last has ended.
#[derive(Clone)]
pub(crate) struct Desk {
    quiescence: Arc<Quiescence>,
    registry: Option<Arc<ProcessRegistry>>,
    /// The stage, if the thread is one that decides when a call's result comes.
    stage: Option<Arc<Stage>>,
}

luna_platform::local! {
    /// The desk of this thread, while it runs processes.
    static HERE: RefCell<Option<Desk>> = const { RefCell::new(None) };
}

/// Counts the calls of this thread in `quiescence` until the guard is dropped, and lets the stage
/// decide when their results come if the thread is one.
pub(crate) fn enter(
    quiescence: Arc<Quiescence>,
    registry: Option<Arc<ProcessRegistry>>,
    stage: Option<Arc<Stage>>,
) -> OnDrop<impl FnMut()> {
    HERE.set(Some(Desk {
        quiescence,
        registry,
        stage,
    }));
    OnDrop::new(|| drop(HERE.take()))
}

/// Something that is under way outside of all processes and wakes one of this thread's when it is
/// done: a call on the pool, or the wait for a thread that keeps time. As long as it exists, the
/// system does not count as deadlocked.
///
/// ```
/// let under_way = luna_core::UnderWay::begin();
/// // Another thread has the waker, and this one may sleep.
/// drop(under_way);
/// ```
#[must_use = "it is under way until it is dropped"]
pub struct UnderWay {
    desk: Option<Desk>,
    /// Its number among those of its stage, until it is delivered.
    number: Option<u64>,
}

impl UnderWay {
    /// Begins on this thread, and is to be dropped after the wake that it leads to. On a thread
    /// that runs no processes it is counted nowhere. Real-time path: yes; O(1), no allocation.
    pub fn begin() -> Self {
        let desk = HERE.with_borrow(Clone::clone);
        let mut number = None;
        if let Some(desk) = &desk {
            desk.quiescence.begin_call();
            number = desk.stage.as_ref().map(|stage| stage.begin_call());
        }
        Self { desk, number }
    }

    /// The clock of the process that made the call.
    pub(crate) fn clock(&self) -> Clock {
        let stage = self.desk.as_ref().and_then(|desk| desk.stage.as_ref());
        stage.map_or(Clock::REAL, |stage| stage.clock())
    }

    /// Makes the `delivery` of its result; or leaves that to the stage, which makes it when its
    /// turn has come.
    pub(crate) fn deliver(&mut self, delivery: impl FnOnce() + Send + 'static) {
        let stage = self.desk.as_ref().and_then(|desk| desk.stage.as_ref());
        match stage.zip(self.number.take()) {
            None => delivery(),
            Some((stage, number)) => stage.call_done(number, Box::new(delivery)),
        }
    }
}

impl Drop for UnderWay {
    fn drop(&mut self) {
        // It was never made: nothing waits for it.
        self.deliver(|| ());
        if let Some(desk) = &self.desk
            && desk.quiescence.end_call()
            && let Some(registry) = &desk.registry
        {
            registry.announce();
        }
    }
}

luna_platform::debug_fields!(UnderWay, |call| is_counted: call.desk.is_some());
