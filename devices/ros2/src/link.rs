//! The process that starts the DDS side of a channel, and waits for its end.

use crate::carrier::{Carrier, Stop};
use crate::node::Inner;
use crate::{Ros2Error, Status};
use luna::realtime::off_path;
use luna::{Error, Process, Receiver};
use luna_platform::clock::Clock;
use std::sync::Arc;

/// The DDS side of a subscription, a service, a client or the parameters: a process, to be spawned.
///
/// Values go between the channel and a thread of the link's own, at SCHED_OTHER, so they cost
/// neither the link nor its executor anything. The link ends
///
/// - without an error when the last local end of its channel is gone, of the parameters their
///   sender;
/// - with [`Error::Poisoned`] when that channel was poisoned;
/// - with [`Ros2Error`] when DDS has failed. The channel is then poisoned.
///
/// When it is cancelled, dropped, or its system ends, the channel closes.
///
/// Real-time path: its `run` waits once. `pre_run` makes a thread, and `post_run` waits for it.
///
/// # Errors
///
/// Its `pre_run` fails on a virtual clock ([`Ros2Error::VirtualClock`]), and if no thread can be
/// made.
#[must_use = "a link is a process: spawn it"]
pub struct Link {
    name: String,
    status: Status,
    work: Option<Work>,
    carrier: Option<Carrier>,
    /// Dropped last: the DDS side ends before its node.
    node: Arc<Inner>,
}

/// What the thread does.
pub(crate) type Work = Box<dyn FnOnce(&Stop) -> luna::Result<()> + Send>;

impl Link {
    pub(crate) fn new(node: Arc<Inner>, name: String, status: Status, work: Work) -> Self {
        Self {
            name,
            status,
            work: Some(work),
            carrier: None,
            node,
        }
    }

    /// What it has done, and its partners.
    pub fn status(&self) -> Status {
        self.status.clone()
    }

    /// How its thread's work ends.
    pub(crate) fn done(&self) -> Result<Receiver<luna::Result<()>>, Ros2Error> {
        let done = self.carrier.as_ref().map(|carrier| carrier.done.clone());
        done.ok_or_else(|| self.twice())
    }

    fn twice(&self) -> Ros2Error {
        Ros2Error::RunTwice {
            name: self.name.clone(),
        }
    }

    pub(crate) fn run_twice(&self) -> Error {
        self.twice().into()
    }

    pub(crate) fn ended(&self) -> Error {
        off_path(|| {
            Ros2Error::Ended {
                name: self.name.clone(),
                reason: "its thread has panicked".to_owned(),
            }
            .into()
        })
    }
}

impl Process for Link {
    fn pre_run(&mut self) -> luna::Result<()> {
        if Clock::is_virtual_here() {
            let name = self.name.clone();
            return Err(Ros2Error::VirtualClock { name }.into());
        }
        let Some(work) = self.work.take() else {
            return Err(self.run_twice());
        };
        self.carrier = Some(Carrier::start(&self.name, work)?);
        Ok(())
    }

    async fn run(&mut self) -> luna::Result<()> {
        let done = off_path(|| self.done())?;
        match done.recv().await {
            Ok(result) => result,
            Err(_) => Err(self.ended()),
        }
    }

    fn post_run(&mut self) {
        self.carrier = None;
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        self.carrier = None;
        self.work = None;
        self.node.graph().forget(&self.status);
    }
}

luna_platform::debug_fields!(Link, |link| name: link.name, status: link.status);
