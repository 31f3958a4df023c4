//! The node of a waiting operation, and its outcome.

mod steps;

pub(crate) use steps::Waits;

use crate::select_state::SelectState;
use crate::wait_point::{Ending, Mover};
use core::mem::MaybeUninit;
use core::ptr::NonNull;
use luna_core::wait_list::WaitNode;
use luna_platform::sync::UnsafeCell;
use luna_platform::sync::atomic::{AtomicU8, Ordering};

/// Outcome of a waiting operation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Outcome {
    Waiting,
    Done,
    Closed,
    Poisoned,
    /// An alternative's, which has chosen another guard; or withdrawn.
    Stale,
    /// A send that is held after its value was received, until the receiver is done with it. It is
    /// in the list `held`.
    Held,
    /// A send that was held, and was given a value back.
    Answered,
    /// A send without a value, since its closure panicked.
    Broken,
}

impl Outcome {
    /// Of an operation that the end of its channel lets fail.
    pub(crate) fn of(ending: Ending) -> Self {
        match ending {
            Ending::Poisoned => Outcome::Poisoned,
            _ => Outcome::Closed,
        }
    }
}

/// Makes the value of a waiting send, when it is taken. `None`: its closure has panicked.
pub(crate) type Make<T> = unsafe fn(NonNull<Waiter<T>>) -> Option<T>;

/// How a node was begun.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Begun {
    /// In full: all fields are written.
    InFull,
    /// In full, as a receiver's that holds its sender.
    Holding,
    /// As `Holding`, and the [note](crate::extended::Noted::Note) is an inheritor.
    Serving,
    /// As a plain operation's that waits, alone or in a queue, on the executor that owns the bias
    /// of the lock, with a wake handle that wakes its process without a waker. While the bias
    /// stays, its partners need not look any further. It has no alternative, and holds its value:
    /// its other fields were not written.
    Plainly,
    /// As `Plainly`, but its wake handle may have been replaced since.
    PlainlyAndChanged,
    /// As a plain operation's that is a guard of an alternative: without a wake handle, but with a
    /// select state.
    AsGuard,
}

impl Begun {
    /// Of a receiver: whether it holds its sender.
    #[inline(always)]
    pub(crate) fn holds(self) -> bool {
        matches!(self, Begun::Holding | Begun::Serving)
    }
}

/// The part of a node by which others find it. The fields that all of them touch come first.
#[repr(C)]
pub(crate) struct Link {
    /// First, so that the list's node leads back to this.
    pub(crate) wait: WaitNode,
    pub(crate) outcome: AtomicU8,
    begun: Begun,
    /// A settled extended receiver's, and a held sender's: number of the rendezvous. There if it
    /// was begun in full, or is held.
    pub(crate) ticket: u32,
    /// An alternative's: its select state, and the number of this guard. There if it was begun in
    /// full or as a guard. Before the value, since code that looks at it may not know the type of
    /// the value.
    select_state: MaybeUninit<Option<(NonNull<SelectState>, u32)>>,
}

/// Fields that few nodes use.
#[repr(C)]
struct Seldom<T> {
    /// A recorded process' node: the stamp of its result. Not there in one of a plain turn, which
    /// belongs to no recorded process.
    order: MaybeUninit<u64>,
    /// A sender's, if its value is not in the node. There if it was begun in full.
    make: MaybeUninit<Option<Make<T>>>,
}

impl Link {
    /// Of an operation that waits, begun in full.
    #[inline(always)]
    fn in_full(wait: WaitNode, select_state: Option<(NonNull<SelectState>, u32)>) -> Self {
        Self {
            wait,
            outcome: AtomicU8::new(Outcome::Waiting as u8),
            begun: Begun::InFull,
            ticket: 0,
            select_state: MaybeUninit::new(select_state),
        }
    }
}

/// The node of a waiting operation, inside its future.
///
/// Most operations never wait, so the link is written only when one begins to
/// ([`begin`](Waiter::begin)): a new node costs no more to write than its value.
///
/// # Invariants
///
/// The link is there once the node was begun, and its fields describe the node. While `outcome` is
/// `Waiting` or `Held` and the node is listed, the channel's lock guards all of it. A settled node
/// belongs to its future. Its wake handle was taken: bits of it may be left, and are not used. So
/// nothing of the link is to be dropped.
/// `value` holds a value if it is a receiver's that is done, a sender's that is answered, or a
/// sender's without `make` that is neither done nor held. A listed sender's `make`, if it has one,
/// can be called once, under the lock.
#[repr(C)]
pub struct Waiter<T> {
    /// First, so that the list's node leads back to this.
    link: MaybeUninit<Link>,
    value: UnsafeCell<MaybeUninit<T>>,
    /// Last, so that the value of a plain operation lies beside its link.
    seldom: Seldom<T>,
}

impl<T> Seldom<T> {
    const NOTHING: Self = Self {
        order: MaybeUninit::uninit(),
        make: MaybeUninit::uninit(),
    };
}

impl<T> core::fmt::Debug for Waiter<T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("Waiter")
    }
}

impl<T> Waiter<T> {
    /// A node that holds a value.
    #[inline]
    pub(crate) fn with_value(value: T) -> Self {
        Self {
            link: MaybeUninit::uninit(),
            value: UnsafeCell::new(MaybeUninit::new(value)),
            seldom: Seldom::NOTHING,
        }
    }

    /// Makes the waiter at `place` one with a value. Only the value is written.
    ///
    /// # Safety
    ///
    /// `place` is room for a waiter, and no other thread accesses it.
    #[inline(always)]
    pub(crate) unsafe fn write_value(place: *mut Self, value: T) {
        // SAFETY: `place` is room for a waiter, as is demanded here, so it is not null and its
        // fields may be written. No other thread accesses it, and nothing of it is read.
        unsafe {
            // A pointer right before the value: without it the compiler takes the two for one piece
            // of memory, and copies unwritten fields with the written ones.
            (*Self::link(NonNull::new_unchecked(place)))
                .select_state
                .write(None);
            (&raw mut (*place).value).write(UnsafeCell::new(MaybeUninit::new(value)));
        }
    }

    /// A node that holds no value.
    #[inline]
    pub(crate) fn empty() -> Self {
        Self {
            link: MaybeUninit::uninit(),
            value: UnsafeCell::new(MaybeUninit::uninit()),
            seldom: Seldom::NOTHING,
        }
    }

    /// How the fast path moves values of this type from node to node. `None`: as one word, which
    /// lies behind the link.
    pub(crate) const MOVER: Option<Mover> = match size_of::<T>() {
        1..=8 if align_of::<T>() <= align_of::<u64>() => None,
        _ => Some(Self::move_value),
    };

    /// # Safety
    ///
    /// As for [`Mover`]: `from` is the node of a sender with a value of this type, and `to` that of
    /// a receiver without. No other thread accesses either value.
    unsafe fn move_value(from: NonNull<Waiter<()>>, to: NonNull<Waiter<()>>) {
        // SAFETY: by `# Safety` a value of this type lies in `from`, none in `to`, and no other
        // thread accesses either: so one can be taken, and the other put in. The mover belongs to
        // channels of this type alone (`ValueMethods`).
        unsafe { Self::put_value_of(to.cast(), Self::take_value_of(from.cast())) };
    }

    /// The link of a node, which is there once the node was begun. Not to be made a reference to as
    /// a whole: its parts have different owners.
    #[inline(always)]
    pub(crate) fn link(node: NonNull<Waiter<T>>) -> *mut Link {
        node.as_ptr().cast()
    }

    /// The select state of the node's alternative and the number of this guard, if it has one. The
    /// value is not accessed, so its type does not matter.
    ///
    /// # Safety
    ///
    /// `node` is listed, or was just taken off its list, and the lock is held that guards it; or it
    /// was settled, and this is its future; or it is a registered alternative's, which never
    /// changes its select state.
    #[inline(always)]
    pub(crate) unsafe fn select_state(
        node: NonNull<Waiter<T>>,
    ) -> Option<(NonNull<SelectState>, u32)> {
        // SAFETY: the node was begun, and no other thread changes these two fields: the lock is
        // held, or the node belongs to the caller, or they never change. The select state was
        // written if the node was begun in full or as a guard, as `begun` says.
        unsafe {
            let link = Self::link(node);
            match (*link).begun {
                Begun::Plainly | Begun::PlainlyAndChanged => None,
                _ => (*link).select_state.assume_init(),
            }
        }
    }

    /// As [`select_state`](Self::select_state), of a node that was begun with a select state.
    ///
    /// # Safety
    ///
    /// As for `select_state`; and it was begun with one, and has not left it.
    #[inline(always)]
    pub(crate) unsafe fn guard_of(node: NonNull<Waiter<T>>) -> (NonNull<SelectState>, u32) {
        // SAFETY: no other thread changes the link, as for `select_state`. The node was begun with
        // a select state, so the field was written, and holds `Some`.
        unsafe {
            debug_assert!(Self::select_state(node).is_some());
            (*Self::link(node))
                .select_state
                .assume_init()
                .unwrap_unchecked()
        }
    }

    /// Detaches the node from its alternative, which has chosen it.
    ///
    /// # Safety
    ///
    /// `node` is listed, or was just taken off its list, and the lock is held that guards it.
    pub(crate) unsafe fn leave_select_state(node: NonNull<Waiter<T>>) {
        // SAFETY: the lock is held that guards the link, so no other thread accesses the field. It
        // has nothing to drop.
        unsafe { (*Self::link(node)).select_state.write(None) };
    }

    /// The operation's outcome. Acquire: a thread that sees an outcome sees the value that came
    /// with it.
    ///
    /// Takes a pointer, since without the lock there must be no reference to the parts of a listed
    /// node that others change.
    ///
    /// # Safety
    ///
    /// `node` is live, and was begun.
    #[inline]
    pub(crate) unsafe fn outcome(node: NonNull<Waiter<T>>) -> Outcome {
        // SAFETY: the node is live and was begun, as is demanded here, so the field was written.
        // Only this field is borrowed: it is atomic, and others may store to it meanwhile.
        match unsafe { (*Self::link(node)).outcome.load(Ordering::Acquire) } {
            0 => Outcome::Waiting,
            1 => Outcome::Done,
            2 => Outcome::Closed,
            3 => Outcome::Poisoned,
            4 => Outcome::Stale,
            5 => Outcome::Held,
            6 => Outcome::Answered,
            _ => Outcome::Broken,
        }
    }

    /// Whether its [outcome](Self::outcome) is `Waiting`: one compare.
    ///
    /// # Safety
    ///
    /// As for [`outcome`](Self::outcome): `node` is live, and was begun.
    #[inline]
    pub(crate) unsafe fn is_waiting(node: NonNull<Waiter<T>>) -> bool {
        // SAFETY: the node is live and was begun, so the field was written; only this atomic field
        // is borrowed.
        unsafe { (*Self::link(node)).outcome.load(Ordering::Acquire) == Outcome::Waiting as u8 }
    }

    /// Moves the value out of a node that others may look at.
    ///
    /// # Safety
    ///
    /// There is a value, and no other thread accesses it.
    #[inline]
    pub(crate) unsafe fn take_value_of(node: NonNull<Waiter<T>>) -> T {
        // SAFETY: by `# Safety` there is a value, which no other thread accesses; from here on
        // there is none, so it is read once. Only this field is borrowed: others may load the
        // outcome.
        unsafe {
            (*node.as_ptr())
                .value
                .with(|value| (*value).assume_init_read())
        }
    }

    /// Puts a value into a node that others may look at.
    ///
    /// # Safety
    ///
    /// There is no value, and no other thread accesses its place.
    #[inline]
    pub(crate) unsafe fn put_value_of(node: NonNull<Waiter<T>>, new: T) {
        // SAFETY: by `# Safety` no other thread accesses the value's place, and there is no value
        // that would be lost. Only this field is borrowed: others may load the outcome.
        unsafe {
            (*node.as_ptr()).value.with_mut(|value| {
                (*value).write(new);
            });
        }
    }

    /// How it was begun.
    ///
    /// # Safety
    ///
    /// `node` was begun, and the lock is held that guards it; or only its future knows it.
    #[inline(always)]
    pub(crate) unsafe fn begun(node: NonNull<Waiter<T>>) -> Begun {
        // SAFETY: the node was begun, so the field was written, and no other thread changes it.
        unsafe { (*Self::link(node)).begun }
    }

    /// Takes a sender's value, or has it made by `make`. `None` if making it panicked.
    ///
    /// # Safety
    ///
    /// `node` is a sender's that holds its value, or `make` makes it, which is called once. No
    /// other thread accesses it.
    #[inline]
    pub(crate) unsafe fn take_or_make(
        node: NonNull<Waiter<T>>,
        make: Option<Make<T>>,
    ) -> Option<T> {
        // SAFETY: no other thread accesses the node, and without `make` it holds its value, as is
        // demanded here. A `make` can be called once: the caller takes each sender once.
        unsafe {
            match make {
                None => Some(Self::take_value_of(node)),
                Some(make) => make(node),
            }
        }
    }

    /// What makes a sender's value when it is taken; its node has no place then for one that comes
    /// back.
    ///
    /// # Safety
    ///
    /// `node` is a sender's that was begun, and no other thread accesses it.
    #[inline]
    pub(crate) unsafe fn make(node: NonNull<Waiter<T>>) -> Option<Make<T>> {
        // SAFETY: no other thread changes the node, and it was begun: `make` was written if that
        // was in full, as `begun` says.
        unsafe {
            match (*Self::link(node)).begun {
                Begun::InFull => (*node.as_ptr()).seldom.make.assume_init(),
                _ => None,
            }
        }
    }

    /// Notes the stamp of the operation's coming result.
    ///
    /// # Safety
    ///
    /// `node` is listed, or is about to be, or was just taken off and is not settled; and the lock
    /// is held that guards it.
    #[inline]
    pub(crate) unsafe fn put_order(node: NonNull<Waiter<T>>, stamp: u64) {
        // SAFETY: the lock that guards the node is held, and it is not settled yet: its future does
        // not look at the stamp before. The field has nothing to drop.
        unsafe {
            if stamp != 0 {
                (*node.as_ptr()).seldom.order.write(stamp);
            }
        }
    }

    /// Notes that the operation's result has no stamp yet.
    ///
    /// # Safety
    ///
    /// `node` is live, and no other thread accesses it.
    pub(crate) unsafe fn clear_order(node: NonNull<Waiter<T>>) {
        // SAFETY: the node is live, and no other thread accesses it, as is demanded here. The field
        // has nothing to drop.
        unsafe { (*node.as_ptr()).seldom.order.write(0) };
    }

    /// The stamp of the operation's result; 0 if it has none.
    ///
    /// # Safety
    ///
    /// `node` was begun, in no plain turn, or [cleared](Self::clear_order). No other thread
    /// accesses it any more.
    pub(crate) unsafe fn order(node: NonNull<Waiter<T>>) -> u64 {
        // SAFETY: the stamp was written: `begin` and `clear_order` do that, and by
        // `# Safety` one of them was called. No other thread writes it any more.
        unsafe { (*node.as_ptr()).seldom.order.assume_init() }
    }
}

impl Waiter<()> {
    /// Moves a value of a type without a [mover](Self::MOVER).
    ///
    /// # Safety
    ///
    /// As for [`Mover`], of nodes of such a type.
    #[inline(always)]
    pub(crate) unsafe fn move_word(from: NonNull<Self>, to: NonNull<Self>) {
        // SAFETY: a type without a mover has one to eight bytes, and by the test of `MOVER` its
        // value begins where that of a node of words does. More fields lie behind the value, so a
        // word can be accessed there; its bytes beyond the value have no meaning, so it is moved as
        // one that may be unwritten. By `# Safety` no other thread accesses either value.
        unsafe {
            let word = from.cast::<Waiter<MaybeUninit<u64>>>();
            Waiter::put_value_of(to.cast(), Waiter::take_value_of(word));
        }
    }
}

#[cfg(all(test, not(loom), target_pointer_width = "64"))]
mod tests {
    use super::*;
    use core::mem::offset_of;

    /// Bounds the size of a node: a ring of many processes is bound by memory accesses, and each
    /// hop would fetch what is added before the value.
    #[test]
    fn what_a_plain_operation_touches_lies_together() {
        assert_eq!(offset_of!(Waiter<u64>, value), size_of::<Link>());
        assert!(size_of::<Link>() <= 72, "{}", size_of::<Link>());
        assert!(size_of::<Waiter<u64>>() <= 96);
    }
}
