//! What a link has done.

use luna::{Buffer, Receiver, Sender};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What a link has done, and its partners. It can be read at any time, by any thread,
/// also after the link's end. The numbers are for the real-time path; the texts take a plain lock
/// and allocate, and are not.
#[derive(Debug, Clone)]
pub struct Status(Arc<Counts>);

#[derive(Debug)]
struct Counts {
    carried: AtomicU64,
    overwritten: AtomicU64,
    refused: AtomicU64,
    malformed: AtomicU64,
    unanswered: AtomicU64,
    incompatible: AtomicU64,
    partners: AtomicUsize,
    last_incompatible: Mutex<Option<String>>,
    last_fault: Mutex<Option<String>>,
    changed: Sender<()>,
    changes: Receiver<()>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Status {
    pub(crate) fn new() -> Self {
        let (changed, changes) = luna::buffered(Buffer::overwrite_oldest(1));
        Self(Arc::new(Counts {
            carried: AtomicU64::new(0),
            overwritten: AtomicU64::new(0),
            refused: AtomicU64::new(0),
            malformed: AtomicU64::new(0),
            unanswered: AtomicU64::new(0),
            incompatible: AtomicU64::new(0),
            partners: AtomicUsize::new(0),
            last_incompatible: Mutex::new(None),
            last_fault: Mutex::new(None),
            changed: changed.external(),
            changes,
        }))
    }

    pub(crate) fn is_same(&self, other: &Status) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }

    pub(crate) fn carry(&self) -> u64 {
        self.0.carried.fetch_add(1, Relaxed) + 1
    }

    pub(crate) fn overwrite(&self) {
        self.0.overwritten.fetch_add(1, Relaxed);
    }

    pub(crate) fn refuse(&self, fault: impl ToString) {
        self.0.refused.fetch_add(1, Relaxed);
        *lock(&self.0.last_fault) = Some(fault.to_string());
    }

    pub(crate) fn malformed_one(&self, fault: impl ToString) {
        self.0.malformed.fetch_add(1, Relaxed);
        *lock(&self.0.last_fault) = Some(fault.to_string());
    }

    pub(crate) fn unanswer(&self) {
        self.0.unanswered.fetch_add(1, Relaxed);
    }

    pub(crate) fn incompatible_one(&self, what: String) {
        *lock(&self.0.last_incompatible) = Some(what);
        self.0.incompatible.fetch_add(1, Relaxed);
        self.change();
    }

    pub(crate) fn set_partners(&self, partners: usize) {
        if self.0.partners.swap(partners, Relaxed) != partners {
            self.change();
        }
    }

    /// Others have waited for the change: they look.
    fn change(&self) {
        // It never waits, and the receiver is there.
        let _ = self.0.changed.try_send(());
    }

    /// Values that went to DDS or came from it. Of a service: requests.
    pub fn carried(&self) -> u64 {
        self.0.carried.load(Relaxed)
    }

    /// Values of a publisher that were overwritten in its buffer, since DDS did not take them in
    /// time. Of a subscription [`Received::number`](crate::Received::number) shows it.
    pub fn overwritten(&self) -> u64 {
        self.0.overwritten.load(Relaxed)
    }

    /// Values that DDS has refused: they cannot be encoded, or reliable readers did not
    /// acknowledge for long. [`last_fault`](Self::last_fault) says why.
    pub fn refused(&self) -> u64 {
        self.0.refused.load(Relaxed)
    }

    /// Values that came and cannot be decoded as the type: another type of the same name, or a
    /// bound that is exceeded. They are dropped.
    pub fn malformed(&self) -> u64 {
        self.0.malformed.load(Relaxed)
    }

    /// Calls without a reply: a server has dropped them, or none replied in time.
    pub fn unanswered(&self) -> u64 {
        self.0.unanswered.load(Relaxed)
    }

    /// How many partners were found with a quality of service or type that does not fit: no values
    /// go between them and this side.
    pub fn incompatible(&self) -> u64 {
        self.0.incompatible.load(Relaxed)
    }

    /// The last of them, in words: what it offers or requests, and what is asked here.
    pub fn last_incompatible(&self) -> Option<String> {
        lock(&self.0.last_incompatible).clone()
    }

    /// Why the last value was refused or malformed.
    pub fn last_fault(&self) -> Option<String> {
        lock(&self.0.last_fault).clone()
    }

    /// How many partners are connected: subscriptions of a publisher, publishers of a
    /// subscription, servers of a client, clients of a server; of parameters: nodes that use all of
    /// their services.
    pub fn partners(&self) -> usize {
        self.0.partners.load(Relaxed)
    }

    /// Waits until at least `least` partners are connected. What is sent before has no receiver:
    /// discovery takes some tenths of a second. By one process at a time.
    ///
    /// Each side finds the other by itself. So the first values may still be lost, and the first
    /// call be unanswered, if the other side has not found this one yet: a program that cannot bear
    /// it waits for a sign of the other side, or repeats.
    ///
    /// Cancel-safe. Real-time path: yes; O(1) for each change.
    pub async fn wait_for_partners(&self, least: usize) {
        while self.partners() < least {
            // The sender is beside it, so it does not end.
            let _ = self.0.changes.recv().await;
        }
    }

    /// Waits until at least `least` partners were found incompatible. By one process at a time.
    ///
    /// Cancel-safe. Real-time path: as above.
    pub async fn wait_for_incompatible(&self, least: u64) {
        while self.incompatible() < least {
            let _ = self.0.changes.recv().await;
        }
    }
}
