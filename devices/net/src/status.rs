//! What a link has done.

use crate::Peer;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};

/// What a link has done in its session. It can be read at any time, also after the link's end.
///
/// The numbers are for the real-time path. [`partner`](Status::partner) is not: it locks and
/// allocates.
///
/// ```
/// # let network = luna_net::Network::open(&luna_net::Config::loopback())?;
/// let (sender, link) = network.sender::<u32>("cell/ready")?;
/// let status = link.status();
/// assert!(!status.has_joined());
/// assert_eq!((status.acknowledged(), status.in_doubt()), (0, 0));
/// # drop(sender);
/// # Ok::<(), luna_net::NetError>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct Status(Arc<Counts>);

#[derive(Debug, Default)]
struct Counts {
    session: AtomicU64,
    number: AtomicU64,
    acknowledged: AtomicU64,
    sent: AtomicU64,
    missing: AtomicU64,
    resent: AtomicU64,
    dropped: AtomicU64,
    has_other_version: AtomicBool,
    partner: Mutex<Option<Peer>>,
}

impl Status {
    pub(crate) fn join(&self, peer: Peer, session: u64, start: u64, missing: u64) {
        *self.partner_lock() = Some(peer);
        self.0.number.store(start, Relaxed);
        self.0.missing.store(missing, Relaxed);
        self.0.session.store(session, Relaxed);
    }

    pub(crate) fn send(&self, values: u64) {
        self.0.sent.fetch_add(values, Relaxed);
    }

    pub(crate) fn resend(&self, values: u64) {
        self.0.resent.fetch_add(values, Relaxed);
    }

    pub(crate) fn drop_one(&self) {
        self.0.dropped.fetch_add(1, Relaxed);
    }

    pub(crate) fn hear_other_version(&self) {
        self.0.has_other_version.store(true, Relaxed);
    }

    /// So many values, up to the one of this number.
    pub(crate) fn acknowledge(&self, number: u64, values: u64) {
        self.0.number.store(number, Relaxed);
        self.0.acknowledged.fetch_add(values, Relaxed);
    }

    fn partner_lock(&self) -> std::sync::MutexGuard<'_, Option<Peer>> {
        let locked = self.0.partner.lock();
        locked.unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether the other program has joined the session.
    pub fn has_joined(&self) -> bool {
        self.session() > 0
    }

    /// The number of this session, the same in both programs: 1 for the first of this channel in
    /// the programs that live. 0 before the other program has joined.
    pub fn session(&self) -> u64 {
        self.0.session.load(Relaxed)
    }

    /// The other program, once it has joined.
    pub fn partner(&self) -> Option<Peer> {
        self.partner_lock().clone()
    }

    /// The number of the last value that was acknowledged: the same in both programs. The numbers
    /// go on from session to session as long as either program keeps its
    /// [`Network`](crate::Network). 0 before the first.
    pub fn number(&self) -> u64 {
        self.0.number.load(Relaxed)
    }

    /// Values of this session that were acknowledged: taken by a process of the receiving program,
    /// or by the buffer there.
    pub fn acknowledged(&self) -> u64 {
        self.0.acknowledged.load(Relaxed)
    }

    /// Values of this session that the sending link has taken and that are not acknowledged. After
    /// the end of the session each of them was taken once or not at all. 0 on the receiving side.
    pub fn in_doubt(&self) -> u64 {
        let sent = self.0.sent.load(Relaxed);
        sent.saturating_sub(self.acknowledged())
    }

    /// Values of earlier sessions after the last one that this side knows as acknowledged. None of
    /// them comes any more. A program that was started again knows of none.
    pub fn missing(&self) -> u64 {
        self.0.missing.load(Relaxed)
    }

    /// Values that were sent again, since they had not arrived in time.
    pub fn resent(&self) -> u64 {
        self.0.resent.load(Relaxed)
    }

    /// Messages that were dropped: damaged ones, those of another version of luna-net, and those to
    /// this side that are not of its partner. They change nothing else.
    pub fn dropped(&self) -> u64 {
        self.0.dropped.load(Relaxed)
    }

    /// Whether a message came that begins as those of another version of luna-net do. If the other
    /// program does not join, build both with the same version.
    pub fn has_heard_other_version(&self) -> bool {
        self.0.has_other_version.load(Relaxed)
    }
}
