//! The thread between a link and DDS.

use crate::Ros2Error;
use crate::link::Work;
use futures_lite::future::or;
use luna::{Buffer, Receiver, Sender};
use luna_core::park;
use luna_platform::clock::Instant;
use luna_platform::thread::{Attributes, Thread, spawn};
use std::convert::Infallible;
use std::pin::pin;

/// A thread of the link's own, without a real-time policy. Dropped, it is asked to end, and waited
/// for.
pub(crate) struct Carrier {
    stop: Option<Sender<()>>,
    thread: Option<Thread<()>>,
    /// How its work has ended.
    pub(crate) done: Receiver<luna::Result<()>>,
}

/// The wish that the thread ends.
pub(crate) struct Stop(Receiver<()>);

impl Stop {
    /// Waits for `future`; `None` if the thread is to end.
    pub(crate) fn wait<T>(&self, future: impl Future<Output = T>) -> Option<T> {
        park::block_on(self.or(future))
    }

    /// As [`wait`](Self::wait); `Some(None)` at the deadline.
    pub(crate) fn wait_until<T>(
        &self,
        future: impl Future<Output = T>,
        deadline: Instant,
    ) -> Option<Option<T>> {
        match park::block_on_until(pin!(self.or(future)), deadline) {
            Some(Some(output)) => Some(Some(output)),
            Some(None) => None,
            None => Some(None),
        }
    }

    async fn or<T>(&self, future: impl Future<Output = T>) -> Option<T> {
        let stopped = async {
            // Nothing is sent: it ends.
            let _ = self.0.recv().await;
            None
        };
        or(stopped, async { Some(future.await) }).await
    }
}

impl Carrier {
    /// Runs `work`.
    pub(crate) fn start(name: &str, work: Work) -> Result<Self, Ros2Error> {
        let (stop, stopped) = luna::channel();
        let (report, done) = luna::buffered(Buffer::fifo(1));
        let (report, done) = (report.external(), done.external());
        let stopped = Stop(stopped.external());
        let body = move |()| {
            // There is room for one.
            let _ = report.try_send(work(&stopped));
        };
        let thread = spawn(
            Attributes::new(format!("ros2 {name}")),
            |_| Ok::<_, Infallible>(()),
            body,
        );
        let thread = thread.map_err(|error| Ros2Error::Thread {
            name: name.to_owned(),
            reason: error.to_string(),
        })?;
        Ok(Self {
            stop: Some(stop),
            thread: Some(thread),
            done,
        })
    }
}

impl Drop for Carrier {
    fn drop(&mut self) {
        self.stop = None;
        if let Some(thread) = self.thread.take() {
            // Its panic was reported by the hook.
            let _ = thread.join();
        }
    }
}
