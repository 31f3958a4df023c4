//! What channels there are, their users, and their waiters: for reports of deadlocks and pictures
//! of a system.
//!
//! Not for the real-time path: [`wait_points`] looks at each channel under its lock, one after the
//! other, so the result is no snapshot of one instant, unless all processes wait.

use crate::buffer::{Buffer, WhenFull};
use crate::core::{FastPath, Meet};
use crate::wait_point::{Ending, Mover, WaitPoint, WaitQueues};
use crate::waiter::Waiter;
use alloc::borrow::ToOwned;
use alloc::boxed::Box;
use alloc::format;
use alloc::string::String;
use alloc::string::ToString;
use alloc::vec::Vec;
use core::fmt;
use core::panic::Location;
use core::ptr::NonNull;
use luna_core::current::User;
use luna_core::events;
use luna_core::wait_list::{WaitList, WaitNode};
use luna_platform::sync::OnceLock;
use luna_platform::sync::plain::{AtomicBool, AtomicU64, Ordering};

mod failed_at;
#[cfg_attr(not(feature = "std"), path = "inspect/register_bare.rs")]
mod register;

pub(crate) use failed_at::note as note_failure;
pub use failed_at::{FailedAt, failed_at};
pub(crate) use register::{register, unregister};

/// What kind of meeting place it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum WaitPointKind {
    /// A channel without a buffer.
    Rendezvous,
    /// A channel with a buffer of this capacity; `usize::MAX` where it grows.
    Buffered(usize),
    /// A barrier.
    Barrier,
    /// A mutex. Its last receiver is its holder.
    Mutex,
    /// A condition variable. Its last receiver is its last notifier.
    Condition,
    /// A semaphore. Its last receiver is the last to take permits.
    Semaphore,
    /// No wait point at all: STOP, an alternative without an open guard.
    Stop,
}

impl WaitPointKind {
    /// What it is in events; nothing where none happen.
    pub fn in_events(self) -> Option<events::Kind> {
        match self {
            WaitPointKind::Rendezvous | WaitPointKind::Buffered(_) => Some(events::Kind::Channel),
            WaitPointKind::Barrier => Some(events::Kind::Barrier),
            WaitPointKind::Mutex | WaitPointKind::Condition | WaitPointKind::Semaphore => {
                Some(events::Kind::Lock)
            }
            WaitPointKind::Stop => None,
        }
    }
}

/// The number of a wait point among those that are made in one line, as by a function that is called
/// several times. The first one is shown without it.
pub(crate) struct Nth(pub(crate) u16);

impl fmt::Display for Nth {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            0 | 1 => Ok(()),
            u16::MAX => f.write_str(" (one of many)"),
            nth => write!(f, " ({nth})"),
        }
    }
}

/// A waiter at a wait point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub struct Waiting {
    /// Process or thread that waits.
    pub user: User,
    /// Its role at the wait point.
    pub role: Role,
}

impl Waiting {
    #[doc(hidden)]
    pub fn new(user: User, role: Role) -> Self {
        Self { user, role }
    }
}

/// What a process or thread waits for at a wait point.
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
    /// For nothing: it has no open guard.
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
pub struct WaitPointView {
    /// A number of its own.
    pub id: u64,
    /// Where it lies in memory: each end, or other handle, has this address in it. 0 for STOP.
    pub address: usize,
    /// Its name, if it was given one.
    pub name: Option<String>,
    /// Where in the program it was made.
    pub made_at: &'static Location<'static>,
    /// How many were made in that line until then, this one included.
    pub nth: u16,
    buffer: BufferCode,
    /// What it is.
    pub kind: WaitPointKind,
    /// How many values are buffered.
    pub buffered: usize,
    /// Whether a send into a full buffer drops a value.
    pub overwrites: bool,
    /// Whether it was marked as used from outside of the system.
    pub external: bool,
    /// Of a barrier: whether a party was a thread of its own, as under `block_on`, unknown to every
    /// system.
    pub strangers: bool,
    /// Whether it was poisoned, or all its senders or receivers are gone.
    pub ended: bool,
    /// Last to send, or to offer a value.
    pub sender: Option<User>,
    /// Last to receive, or to offer to.
    pub receiver: Option<User>,
    /// Present waiters.
    pub waiting: Vec<Waiting>,
}

/// What a channel's buffer is, in the events that name it.
///
/// 0: it is not known, as of what is no channel. Else four times the capacity, at most 2^29, plus 1
/// of a FIFO or a rendezvous, 2 of one that drops its oldest value, 3 of one that drops its newest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct BufferCode(u32);

impl BufferCode {
    pub(crate) const NONE: Self = Self(0);

    pub(crate) fn of(buffer: Buffer) -> Self {
        let capacity = buffer.capacity.min(1 << 29) as u32; // at most 2^29
        let policy = match buffer.when_full {
            WhenFull::Wait | WhenFull::Grow => 1,
            WhenFull::DropOldest => 2,
            WhenFull::DropNewest => 3,
        };
        Self(capacity * 4 + policy)
    }

    fn overwrites(self) -> bool {
        self.0 & 3 > 1
    }
}

/// The identity of a wait point, fixed at its creation.
#[derive(Debug)]
pub(crate) struct Identity {
    id: u64,
    made_at: &'static Location<'static>,
    /// How many were made in that line until then, this one included.
    nth: u16,
    /// Of a channel.
    buffer: BufferCode,
    /// How to count and move its values.
    pub(crate) values: &'static ValueMethods,
    /// Few have one, so it takes little room.
    name: OnceLock<Box<str>>,
    external: AtomicBool,
    /// Of a barrier: whether a stranger was among the parties that came.
    has_stranger: AtomicBool,
    #[cfg(not(feature = "std"))]
    links: register::Links,
}

/// What depends on the kind of a wait point, and on the type of its values.
#[derive(Debug)]
pub(crate) struct ValueMethods {
    /// Of every channel [`Rendezvous`](WaitPointKind::Rendezvous).
    pub(crate) kind: WaitPointKind,
    pub(crate) stored: CountStored,
    /// How the fast path moves a value; `None`: as one word, behind the link of the node.
    pub(crate) mover: Option<Mover>,
    /// How it stores a value in a buffer, takes one from it, and sends to a registered alternative.
    pub(crate) store: Meet,
    pub(crate) take: Meet,
    pub(crate) send_to_registered: Meet,
}

impl ValueMethods {
    /// Of a wait point without values.
    const fn none(kind: WaitPointKind) -> Self {
        Self {
            kind,
            stored: |_| (0, 0),
            mover: None,
            store: |_, _, _| FastPath::No,
            take: |_, _, _| FastPath::No,
            send_to_registered: |_, _, _| FastPath::No,
        }
    }

    fn of(kind: WaitPointKind) -> &'static Self {
        match kind {
            WaitPointKind::Barrier => const { &Self::none(WaitPointKind::Barrier) },
            WaitPointKind::Mutex => const { &Self::none(WaitPointKind::Mutex) },
            WaitPointKind::Condition => const { &Self::none(WaitPointKind::Condition) },
            WaitPointKind::Semaphore => const { &Self::none(WaitPointKind::Semaphore) },
            // A channel has its own.
            _ => const { &Self::none(WaitPointKind::Rendezvous) },
        }
    }
}

/// How many values a wait point stores, and for how many it has room, called under its lock.
pub(crate) type CountStored = unsafe fn(NonNull<WaitPoint>) -> (usize, usize);

impl WaitPointView {
    /// What it is called in events: its name, or where it was made.
    pub fn name_in_events(&self) -> String {
        match &self.name {
            Some(name) => name.clone(),
            None => {
                let (file, line) = (self.made_at.file(), self.made_at.line());
                format!("{file}:{line}{}", Nth(self.nth))
            }
        }
    }

    /// What its buffer is, in the events that name it: see docs/recording-format.md.
    pub fn buffer_in_events(&self) -> u32 {
        self.buffer.0
    }

    /// Where it was made, and which of those that were made there it is: "src/main.rs:12:5 (2)".
    pub fn place(&self) -> String {
        format!("{}{}", self.made_at, Nth(self.nth))
    }
}

impl Identity {
    #[track_caller]
    pub(crate) fn new(kind: WaitPointKind) -> Self {
        Self::of_channel(kind, BufferCode::NONE)
    }

    #[track_caller]
    pub(crate) fn of_channel(kind: WaitPointKind, buffer: BufferCode) -> Self {
        static NEXT: AtomicU64 = AtomicU64::new(1);
        let made_at = Location::caller();
        let new = Self {
            id: NEXT.fetch_add(1, Ordering::Relaxed),
            made_at,
            nth: register::nth_at(made_at),
            buffer,
            values: ValueMethods::of(kind),
            name: OnceLock::new(),
            external: AtomicBool::new(false),
            has_stranger: AtomicBool::new(false),
            #[cfg(not(feature = "std"))]
            links: register::Links::new(),
        };
        if let Some(kind) = kind.in_events() {
            let (file, line) = (made_at.file(), made_at.line());
            let place = || format!("{file}:{line}{}", Nth(new.nth));
            events::name(kind, new.number(), buffer.0, place);
        }
        new
    }

    /// A number of its own, which rises from one that is made to the next.
    #[cfg(loom)]
    pub(crate) fn id(&self) -> u64 {
        self.id
    }

    /// Its number in events, of which there are as many as 32 bits have.
    pub(crate) fn number(&self) -> u32 {
        self.id as u32
    }

    /// What it is in events.
    pub(crate) fn kind_in_events(&self) -> events::Kind {
        let kind = self.values.kind.in_events();
        kind.unwrap_or(events::Kind::Channel)
    }

    /// The first name stays.
    pub(crate) fn set_name(&self, name: &str) {
        if self.name.set(name.into()).is_ok() {
            let number = self.number();
            events::name(self.kind_in_events(), number, self.buffer.0, || {
                name.to_owned()
            });
        }
    }

    pub(crate) fn set_external(&self) {
        self.external.store(true, Ordering::Relaxed);
    }

    /// A party unknown to every system has come to this barrier.
    pub(crate) fn set_stranger(&self) {
        self.has_stranger.store(true, Ordering::Relaxed);
    }

    fn has_stranger(&self) -> bool {
        self.has_stranger.load(Ordering::Relaxed)
    }
}

/// All channels, barriers and locks of the program that live, in the order in which they were made.
/// Allocates; O(wait points + waiters).
///
/// ```
/// use luna_channels::{channel, inspect};
///
/// let (sender, _receiver) = channel::<u32>();
/// let _sender = sender.named("setpoint");
/// let all = inspect::wait_points();
/// let point = all.iter().find(|point| point.name.as_deref() == Some("setpoint")).unwrap();
/// assert!(point.waiting.is_empty() && point.made_at.line() > 0);
/// assert_ne!(point.address, 0);
/// ```
pub fn wait_points() -> Vec<WaitPointView> {
    // SAFETY: `collect` gives registered wait points, which live until it has returned.
    let mut views = register::collect(|wait_point| unsafe { view(wait_point) });
    // An interrupt may have made one between another's making and its registration.
    #[cfg(not(feature = "std"))]
    views.sort_unstable_by_key(|view| view.id);
    views.extend(stopped());
    views
}

/// The stopped processes, if there are any.
fn stopped() -> Option<WaitPointView> {
    #[cfg_attr(loom, expect(unused_mut, reason = "a model looks at no reports"))]
    let mut waiting = Vec::new();
    #[cfg(not(loom))]
    while !crate::alternative::with_stopped(|list| {
        waiting.clear();
        // SAFETY: the list is lent under its lock.
        unsafe { copy_list(list, Role::Stopped, |_| true, &mut waiting) }
    }) {
        waiting.reserve(waiting.capacity().max(8) * 2);
    }
    (!waiting.is_empty()).then(|| WaitPointView {
        id: 0,
        address: 0,
        name: Some("STOP".to_owned()),
        made_at: Location::caller(),
        nth: 1,
        buffer: BufferCode::NONE,
        kind: WaitPointKind::Stop,
        buffered: 0,
        overwrites: false,
        external: false,
        strangers: false,
        ended: false,
        sender: None,
        receiver: None,
        waiting,
    })
}

/// # Safety
///
/// The wait point lives, and was registered by this pointer.
unsafe fn view(registered: NonNull<WaitPoint>) -> WaitPointView {
    // SAFETY: the wait point lives, as is demanded here: the caller holds the register's lock,
    // which unregistering needs.
    let wait_point = unsafe { registered.as_ref() };
    let mut waiting = Vec::new();
    // Processes on the real-time path take this lock: nothing is allocated under it.
    let values = wait_point.identity.values;
    let ((buffered, capacity), sender, receiver, ended) = loop {
        waiting.clear();
        let mut lists = wait_point.lock_briefly();
        if copy_waiting(&mut lists, values.kind, &mut waiting) {
            // SAFETY: `stored` can be called for a wait point by the pointer by which it was
            // registered, under its lock: see `register`. The lock is held.
            let stored = unsafe { (values.stored)(registered) };
            let ended = lists.ending != Ending::Open;
            break (stored, lists.sender.get(), lists.receiver.get(), ended);
        }
        drop(lists);
        waiting.reserve(waiting.capacity().max(8) * 2);
    };
    WaitPointView {
        id: wait_point.identity.id,
        address: registered.addr().get(),
        name: wait_point.identity.name.get().map(|name| name.to_string()),
        made_at: wait_point.identity.made_at,
        nth: wait_point.identity.nth,
        buffer: wait_point.identity.buffer,
        kind: match capacity {
            0 => values.kind,
            _ => WaitPointKind::Buffered(capacity),
        },
        buffered,
        overwrites: wait_point.identity.buffer.overwrites(),
        external: wait_point.identity.external.load(Ordering::Relaxed),
        strangers: wait_point.identity.has_stranger(),
        ended,
        sender,
        receiver,
        waiting,
    }
}

/// Copies the waiters, if there is room for all.
fn copy_waiting(lists: &mut WaitQueues, kind: WaitPointKind, into: &mut Vec<Waiting>) -> bool {
    let (first, second) = match kind {
        WaitPointKind::Barrier => (Role::Party, Role::Party),
        WaitPointKind::Mutex => (Role::Locker, Role::Locker),
        WaitPointKind::Condition => (Role::Notified, Role::Notified),
        WaitPointKind::Semaphore => (Role::Acquirer, Role::Acquirer),
        _ => (Role::Sender, Role::Receiver),
    };
    let all = [
        (&lists.senders, first),
        (&lists.receivers, second),
        (&lists.registered, second),
        (&lists.held, Role::Held),
    ];
    all.into_iter().all(|(list, role)| {
        // SAFETY: all nodes of these lists are those of waiters, which begin alike whatever the
        // type of their values is.
        let waits = |node: NonNull<WaitNode>| unsafe { is_waiting(node.cast()) };
        // A held sender waits, also if it is an alternative, which has chosen this guard.
        // SAFETY: the queues are borrowed from under their lock.
        unsafe { copy_list(list, role, |node| role == Role::Held || waits(node), into) }
    })
}

/// Copies those in `list` that wait indeed, if there is room for all.
///
/// # Safety
///
/// The lock that guards the nodes of `list` is held.
unsafe fn copy_list(
    list: &WaitList,
    role: Role,
    waits: impl Fn(NonNull<WaitNode>) -> bool,
    into: &mut Vec<Waiting>,
) -> bool {
    list.nodes().all(|node| {
        let has_room = into.len() < into.capacity();
        if has_room && waits(node) {
            // SAFETY: the node is in the list, and the lock that guards it is held, as is demanded
            // here.
            let user = unsafe { node.as_ref() }.user();
            into.push(Waiting::new(user, role));
        }
        has_room
    })
}

/// Whether a listed operation waits indeed: an alternative may have chosen another guard, or be
/// registered while its process does other things.
///
/// # Safety
///
/// The node is listed, and the lock is held that guards it. Of the waiter, only what comes before
/// its value is looked at.
unsafe fn is_waiting(waiter: NonNull<Waiter<()>>) -> bool {
    // SAFETY: the node is listed and its lock is held: what `select_state` demands. The select
    // state is live, since its owner needs that lock to withdraw the node, and does so before it
    // goes.
    unsafe {
        Waiter::select_state(waiter).is_none_or(|(select_state, _)| select_state.as_ref().is_open())
    }
}
