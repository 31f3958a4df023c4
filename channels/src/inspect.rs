//! What channels there are, who uses them, and who waits: for reports of deadlocks and pictures of a system.
//!
//! Not for the real-time path: [`places`] looks at each channel under its lock, one after the other, so what it gives is no snapshot of
//! one instant, unless everybody waits.

use crate::place::{Ending, Lists, Place};
use crate::waiter::Waiter;
use luna_platform::current::User;
use luna_platform::wait_list::{WaitList, WaitNode};
use std::collections::BTreeMap;
use std::panic::Location;
use std::ptr::NonNull;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};

/// What kind of meeting place it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum PlaceKind {
    /// A channel without a buffer.
    Rendezvous,
    /// A channel with a buffer of this capacity; `usize::MAX` where it grows.
    Buffered(usize),
    /// A barrier.
    Barrier,
    /// A mutex. Its last receiver is who holds it.
    Mutex,
    /// A condition variable. Its last receiver is who last notified.
    Condition,
    /// A semaphore. Its last receiver is who last took permits.
    Semaphore,
    /// No place at all: STOP, an alternative without an open guard.
    Stop,
}

/// Who waits at a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub struct Waiting {
    /// Who.
    pub user: User,
    /// To do what.
    pub role: Role,
}

/// What somebody waits for at a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Role {
    /// To send.
    Sender,
    /// To receive.
    Receiver,
    /// For the end of an extended rendezvous: its value was received.
    Held,
    /// For the others at a barrier.
    Party,
    /// For nothing: none of its guards is open.
    Stopped,
    /// To lock a mutex.
    Locker,
    /// To be notified, at a condition.
    Notified,
    /// To acquire permits of a semaphore.
    Acquirer,
}

/// A channel, barrier or lock as it was when it was looked at.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct PlaceView {
    /// A number of its own.
    pub id: u64,
    /// The name that it was given.
    pub name: Option<String>,
    /// Where in the program it was made.
    pub made_at: &'static Location<'static>,
    /// What it is.
    pub kind: PlaceKind,
    /// How many values are buffered.
    pub buffered: usize,
    /// Whether it was marked as used from outside of the system.
    pub external: bool,
    /// Whether it was poisoned, or all its senders or receivers are gone.
    pub ended: bool,
    /// Who last sent, or offered to.
    pub sender: Option<User>,
    /// Who last received, or offered to.
    pub receiver: Option<User>,
    /// Who waits now.
    pub waiting: Vec<Waiting>,
}

/// What is known of a place from its beginning.
#[derive(Debug)]
pub(crate) struct Identity {
    id: u64,
    made_at: &'static Location<'static>,
    kind: PlaceKind,
    name: OnceLock<String>,
    external: AtomicBool,
}

impl Identity {
    #[track_caller]
    pub(crate) fn new(kind: PlaceKind) -> Self {
        static NEXT: AtomicU64 = AtomicU64::new(1);
        Self {
            id: NEXT.fetch_add(1, Ordering::Relaxed),
            made_at: Location::caller(),
            kind,
            name: OnceLock::new(),
            external: AtomicBool::new(false),
        }
    }

    /// A number of its own, which rises from one that is made to the next.
    #[cfg(loom)]
    pub(crate) fn id(&self) -> u64 {
        self.id
    }

    /// The first name stays.
    pub(crate) fn set_name(&self, name: &str) {
        let _ = self.name.set(name.to_owned());
    }

    pub(crate) fn set_external(&self) {
        self.external.store(true, Ordering::Relaxed);
    }
}

/// A live place, and how to count what it stores.
struct Registered {
    place: NonNull<Place>,
    stored: unsafe fn(NonNull<Place>) -> usize,
}

// SAFETY: a place is shared by its lock, and registered only while it lives.
unsafe impl Send for Registered {}

/// By number, so in the order in which they were made.
static PLACES: Mutex<BTreeMap<u64, Registered>> = Mutex::new(BTreeMap::new());

/// Registers a place. Off the real-time path, as is making one.
///
/// # Safety
///
/// The place stays where it is, and lives until it is unregistered. `stored` can be called for it under its lock.
pub(crate) unsafe fn register(place: NonNull<Place>, stored: unsafe fn(NonNull<Place>) -> usize) {
    // A model makes and drops thousands of channels, whose locks belong to one run of it.
    if cfg!(loom) {
        return;
    }
    // SAFETY: the contract.
    let id = unsafe { place.as_ref() }.identity.id;
    let mut places = PLACES.lock().unwrap_or_else(PoisonError::into_inner);
    places.insert(id, Registered { place, stored });
}

/// Takes a place off the register, as it is freed.
pub(crate) fn unregister(place: &Place) {
    let mut places = PLACES.lock().unwrap_or_else(PoisonError::into_inner);
    places.remove(&place.identity.id);
}

/// All channels, barriers and locks of the program that live, in the order in which they were made. Allocates; O(places + those who wait).
///
/// ```
/// use luna_channels::{channel, inspect};
///
/// let (sender, _receiver) = channel::<u32>();
/// let _sender = sender.named("setpoint");
/// let all = inspect::places();
/// let place = all.iter().find(|place| place.name.as_deref() == Some("setpoint")).unwrap();
/// assert!(place.waiting.is_empty() && place.made_at.line() > 0);
/// ```
pub fn places() -> Vec<PlaceView> {
    let places = PLACES.lock().unwrap_or_else(PoisonError::into_inner);
    let mut views: Vec<PlaceView> = places
        .values()
        .map(|registered| {
            // SAFETY: a registered place lives, and unregistering needs the lock that is held.
            unsafe { view(registered) }
        })
        .collect();
    drop(places);
    views.extend(stopped());
    views
}

/// Those who have stopped, if there are any.
fn stopped() -> Option<PlaceView> {
    #[cfg_attr(loom, expect(unused_mut, reason = "a model looks at no reports"))]
    let mut waiting = Vec::new();
    #[cfg(not(loom))]
    while !crate::alternative::with_stopped(|list| {
        waiting.clear();
        copy_list(list, Role::Stopped, |_| true, &mut waiting)
    }) {
        waiting.reserve(waiting.capacity().max(8) * 2);
    }
    (!waiting.is_empty()).then(|| PlaceView {
        id: 0,
        name: Some("STOP".to_owned()),
        made_at: Location::caller(),
        kind: PlaceKind::Stop,
        buffered: 0,
        external: false,
        ended: false,
        sender: None,
        receiver: None,
        waiting,
    })
}

/// # Safety
///
/// The place lives.
unsafe fn view(registered: &Registered) -> PlaceView {
    // SAFETY: the contract.
    let place = unsafe { registered.place.as_ref() };
    let mut waiting = Vec::new();
    // Processes on the real-time path take this lock: nothing is allocated under it.
    let (buffered, sender, receiver, ended) = loop {
        waiting.clear();
        let mut lists = place.lock_briefly();
        if copy_waiting(&mut lists, place.identity.kind, &mut waiting) {
            // SAFETY: the lock is held.
            let buffered = unsafe { (registered.stored)(registered.place) };
            let ended = lists.ending != Ending::Open;
            break (buffered, lists.sender.get(), lists.receiver.get(), ended);
        }
        drop(lists);
        waiting.reserve(waiting.capacity().max(8) * 2);
    };
    PlaceView {
        id: place.identity.id,
        name: place.identity.name.get().cloned(),
        made_at: place.identity.made_at,
        kind: place.identity.kind,
        buffered,
        external: place.identity.external.load(Ordering::Relaxed),
        ended,
        sender,
        receiver,
        waiting,
    }
}

/// Copies who waits, if there is room for all.
fn copy_waiting(lists: &mut Lists, kind: PlaceKind, into: &mut Vec<Waiting>) -> bool {
    let (first, second) = match kind {
        PlaceKind::Barrier => (Role::Party, Role::Party),
        PlaceKind::Mutex => (Role::Locker, Role::Locker),
        PlaceKind::Condition => (Role::Notified, Role::Notified),
        PlaceKind::Semaphore => (Role::Acquirer, Role::Acquirer),
        _ => (Role::Sender, Role::Receiver),
    };
    let all = [
        (&lists.senders, first),
        (&lists.receivers, second),
        (&lists.registered, second),
        (&lists.held, Role::Held),
    ];
    all.into_iter().all(|(list, role)| {
        // SAFETY: all nodes of these lists are those of waiters, which begin alike whatever the type of their values is.
        let waits = |node: NonNull<WaitNode>| unsafe { is_waiting(node.cast()) };
        // One who is held waits, also if it is an alternative, which has chosen this guard.
        copy_list(list, role, |node| role == Role::Held || waits(node), into)
    })
}

/// Copies those in `list` who wait indeed, if there is room for all. The caller holds the lock that guards it.
fn copy_list(
    list: &WaitList,
    role: Role,
    waits: impl Fn(NonNull<WaitNode>) -> bool,
    into: &mut Vec<Waiting>,
) -> bool {
    let mut next = list.first();
    while let Some(node) = next {
        if into.len() == into.capacity() {
            return false;
        }
        // SAFETY: the node is in the list, and the caller holds the lock that guards it.
        unsafe {
            next = list.after(node);
            if waits(node) {
                into.push(Waiting {
                    user: node.as_ref().user(),
                    role,
                });
            }
        }
    }
    true
}

/// Whether who is listed waits indeed: an alternative may have chosen another guard, or be registered while its process does other things.
///
/// # Safety
///
/// The node is listed, and the lock is held that guards it. Of the waiter, only what comes before its value is looked at.
unsafe fn is_waiting(waiter: NonNull<Waiter<()>>) -> bool {
    // SAFETY: the contract; a listed node's selection is live.
    unsafe {
        (*Waiter::link(waiter))
            .selection
            .is_none_or(|(selection, _)| selection.as_ref().is_open())
    }
}
