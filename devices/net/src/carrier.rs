//! The link's own thread, which makes all calls of zenoh. It is not for real time, and has no
//! priority.

use crate::batch::Batch;
use crate::message::{decode, key, of_token, token};
use crate::network::{Book, Entry};
use crate::peering::Peering;
use crate::side::{Event, Stop};
use crate::{NetError, Role};
use luna::channel::ChannelEnd;
use luna::{Instant, Policy, Receiver, Sender};
use luna_platform::thread::{self, Attributes, Thread};
use std::convert::Infallible;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::SeqCst};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::CongestionControl;
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait};

/// What the link's process asks for.
pub(crate) enum Job {
    /// Values are to be sent.
    Values(Batch),
    /// Something has changed.
    Look,
    /// The process has ended.
    End(ChannelEnd),
}

/// What zenoh's threads, the link's thread and the link's process share.
pub(crate) struct Shared {
    /// Not for the process, which is on the real-time path.
    peering: Mutex<Peering>,
    /// Number of the last value that was taken here.
    taken: AtomicU64,
    /// Whether a [`Job::Look`] waits: one is enough.
    looks: AtomicBool,
    /// Whether the session is over.
    is_stopped: AtomicBool,
    jobs: Sender<Job>,
    events: Sender<Event>,
}

impl Shared {
    pub(crate) fn new(peering: Peering, jobs: Sender<Job>, events: Sender<Event>) -> Self {
        Self {
            peering: Mutex::new(peering),
            taken: AtomicU64::new(0),
            looks: AtomicBool::new(false),
            is_stopped: AtomicBool::new(false),
            jobs,
            events,
        }
    }

    fn peering(&self) -> MutexGuard<'_, Peering> {
        let locked = self.peering.lock();
        locked.unwrap_or_else(PoisonError::into_inner)
    }

    /// Wakes the link's thread. Real-time path: yes.
    fn look(&self) {
        if !self.looks.swap(true, SeqCst) {
            // There is room for one of these beside the batches.
            let _ = self.jobs.try_send(Job::Look);
        }
    }

    /// Values up to this number were taken. With `is_due` that is reported now. Real-time path:
    /// yes.
    pub(crate) fn take(&self, number: u64, is_due: bool) {
        self.taken.store(number, SeqCst);
        if is_due {
            self.look();
        }
    }

    /// Values are to be sent. Real-time path: yes.
    pub(crate) fn send(&self, batch: Batch) {
        // There are as many places as batches. The receiving end is gone only after a panic of the
        // thread, which is reported as an event.
        let _ = self.jobs.try_send(Job::Values(batch));
    }

    /// The process has ended. Real-time path: yes.
    pub(crate) fn end(&self, end: ChannelEnd) {
        let _ = self.jobs.try_send(Job::End(end));
    }

    /// Whether the other side has ended the session, or is lost. Real-time path: yes.
    pub(crate) fn is_stopped(&self) -> bool {
        self.is_stopped.load(SeqCst)
    }

    fn report(&self, event: Option<Event>) {
        if let Some(event) = event {
            if matches!(event, Event::Stop(_)) {
                self.is_stopped.store(true, SeqCst);
            }
            // There is room for all that come in a session.
            let _ = self.events.try_send(event);
        }
    }

    /// On a thread of zenoh.
    fn hear(&self, sample: &Sample) {
        let now = Instant::now_real();
        let bytes = sample.payload().to_bytes();
        let mut peering = self.peering();
        let events = match decode(&bytes) {
            Ok((head, body, values)) => peering.hear(head, body, values, now),
            Err(broken) => {
                peering.drop_broken(broken);
                [None, None]
            }
        };
        let has_dues = peering.has_dues();
        drop(peering);
        events.into_iter().for_each(|event| self.report(event));
        if has_dues {
            self.look();
        }
    }

    /// On a thread of zenoh.
    fn notice(&self, sample: &Sample) {
        let Some(number) = of_token(sample.key_expr().as_str()) else {
            return;
        };
        let event = match sample.kind() {
            SampleKind::Put => {
                self.peering().appeared();
                None
            }
            SampleKind::Delete => self.peering().gone(number),
        };
        self.report(event);
        self.look();
    }
}

/// The thread, with all that it has declared.
struct Carrier {
    shared: Arc<Shared>,
    jobs: Receiver<Job>,
    /// Batches of queued values, to be given back.
    taken: Vec<Batch>,
    free: Sender<Batch>,
    book: Book,
    period: Duration,
    is_quiet: Arc<AtomicBool>,
    // Dropped in this order.
    token: Option<LivelinessToken>,
    _tokens: Subscriber<()>,
    _messages: Subscriber<()>,
    publisher: Publisher<'static>,
    /// Open as long as any channel is.
    _session: Session,
}

/// A thread that is joined when its link has ended.
pub(crate) struct Running {
    pub(crate) thread: Thread<()>,
    /// Whether its link has ended, so that it ends soon.
    pub(crate) is_quiet: Arc<AtomicBool>,
}

/// Declares a side to zenoh, and starts its thread.
pub(crate) fn start(
    session: Session,
    book: Book,
    shared: Arc<Shared>,
    (jobs, free): (Receiver<Job>, Sender<Batch>),
) -> Result<Running, NetError> {
    let own = shared.peering().own.clone();
    let (name, other) = (own.name.as_str(), own.role.other());
    let failed = |what: &'static str| {
        move |error: zenoh::Error| NetError::System {
            name: name.to_owned(),
            what,
            why: error.to_string(),
        }
    };
    let hearing = shared.clone();
    let messages = session
        .declare_subscriber(key(name, other))
        .callback(move |sample| hearing.hear(&sample))
        .wait()
        .map_err(failed("subscribe to its messages"))?;
    let noticing = shared.clone();
    let tokens = session
        .liveliness()
        .declare_subscriber(token(name, other, None))
        .history(true)
        .callback(move |sample| noticing.notice(&sample))
        .wait()
        .map_err(failed("watch its other side"))?;
    let publisher = session
        .declare_publisher(key(name, own.role))
        .congestion_control(CongestionControl::Block)
        .express(true)
        .wait()
        .map_err(failed("publish its messages"))?;
    // The last: a partner that sees it may send messages here.
    let token = session
        .liveliness()
        .declare_token(token(name, own.role, Some(own.number)))
        .wait()
        .map_err(failed("show that it lives"))?;
    let is_quiet = Arc::new(AtomicBool::new(false));
    let carrier = Carrier {
        shared,
        jobs,
        taken: Vec::new(),
        free,
        book,
        period: own.lost_after / 4,
        is_quiet: is_quiet.clone(),
        token: Some(token),
        _tokens: tokens,
        _messages: messages,
        publisher,
        _session: session,
    };
    let side = match own.role {
        Role::Sender => "out",
        Role::Receiver => "in",
    };
    let attributes = Attributes::new(format!("net-{side}-{name}")).policy(Policy::Other);
    let started = thread::spawn(
        attributes,
        |_| Ok::<_, Infallible>(()),
        move |()| carrier.run(),
    );
    let thread = started.map_err(|error| NetError::System {
        name: name.to_owned(),
        what: "start its thread",
        why: error.to_string(),
    })?;
    Ok(Running { thread, is_quiet })
}

impl Carrier {
    fn run(mut self) {
        let mut next_tick = Instant::now_real();
        loop {
            let now = Instant::now_real();
            if now >= next_tick {
                next_tick = now + self.period;
                let event = self.shared.peering().tick(now);
                self.shared.report(event);
            }
            self.send_all();
            // Only now: what comes meanwhile goes together.
            for mut batch in self.taken.drain(..) {
                batch.clear();
                // There is room for all of them.
                let _ = self.free.try_send(batch);
            }
            if self.shared.peering().is_done() {
                return;
            }
            let left = next_tick - Instant::now_real();
            match self.jobs.blocking_recv_timeout(left) {
                Ok(job) => self.take_all(job),
                Err(error) if error.is_timeout() => continue,
                // The other end is in `shared`.
                Err(_) => return,
            }
        }
    }

    /// Takes this job and all that wait.
    fn take_all(&mut self, first: Job) {
        let mut next = Some(first);
        while let Some(job) = next {
            self.take(job);
            next = self.jobs.try_recv().ok();
        }
    }

    fn take(&mut self, job: Job) {
        match job {
            Job::Values(batch) => {
                self.shared.peering().queue(&batch);
                self.taken.push(batch);
            }
            Job::Look => {
                // Before the look: a change after it asks for another.
                self.shared.looks.store(false, SeqCst);
            }
            Job::End(end) => {
                self.is_quiet.store(true, SeqCst);
                self.shared.peering().end(end);
            }
        }
    }

    fn send_all(&self) {
        loop {
            let taken = self.shared.taken.load(SeqCst);
            let message = {
                let mut peering = self.shared.peering();
                peering.report_taken(taken);
                peering.next_message(taken, Instant::now_real())
            };
            let Some(message) = message else {
                return;
            };
            // A closed session cannot send; then the partner's token is gone too. What does not
            // arrive is sent again, or the partner is lost.
            let _ = self.publisher.put(message).wait();
        }
    }
}

impl Drop for Carrier {
    /// Also after a panic.
    fn drop(&mut self) {
        self.is_quiet.store(true, SeqCst);
        let (entry, memory) = {
            let peering = self.shared.peering();
            let own = &peering.own;
            let entry: Entry = (own.name.clone(), own.role);
            (entry, peering.memory())
        };
        // The name is free only when the other side can know it.
        drop(self.token.take());
        self.book.close(&entry, memory);
        let stop = if std::thread::panicking() {
            let name = entry.0;
            Some(Event::Stop(Stop::Failed(NetError::ThreadEnded { name })))
        } else {
            None
        };
        self.shared.report(stop);
        self.shared.report(Some(Event::Over));
    }
}
