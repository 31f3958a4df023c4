//! Wakes from elsewhere: how other threads hand processes to an executor, and how it goes to sleep without missing one.
//!
//! One stack for each level, pushed to by compare-and-swap and taken whole by one swap, so that nobody ever waits for another's
//! progress, and a high wake never waits behind low ones. One word of signals says which stacks hold something:
//!
//! ```text
//!   pusher                              owner
//!   1 push the node                     a look at the signals: 0? queue empty?
//!   2 set the level's bit      <----->  b swap 0 for ASLEEP in one step: fails if a bit was set
//!   3 it was ASLEEP? ring               c wait for the bell
//!                                       d clear ASLEEP; a again
//! ```
//!
//! All of 2, b and d are read-modify-write operations on the one word, so they have one order: either 2 comes before b, which then
//! fails, or the pusher sees `ASLEEP` and rings. Everybody who sees it rings, not the first alone: that one may be preempted before
//! it does, and a more urgent one must not have to wait for it. While the owner is awake nobody makes a system call. It is the
//! protocol of the [`Bell`], which says what the bell is.

use crate::link::Link;
use crate::presence::Presence;
use luna_platform::bell::Bell;
use luna_platform::clock::Instant;
use luna_platform::current::LEVELS;
use luna_platform::sync::atomic::{AtomicPtr, AtomicU64, Ordering};
use std::ptr::{self, NonNull};

/// Set while the owner sleeps or is about to. Bits 0 to 31 are the levels.
const ASLEEP: u64 = 1 << 32;
/// Set to make the owner look beyond its queues: at processes to start, or at the request to stop.
const ATTENTION: u64 = 1 << 33;

/// What waits outside, as read at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Signals(u64);

impl Signals {
    /// The highest level at which somebody was pushed.
    #[inline]
    pub(crate) fn highest_level(self) -> Option<u8> {
        let levels = self.0 as u32;
        (levels != 0).then(|| (31 - levels.leading_zeros()) as u8)
    }

    /// Whether attention was asked for.
    #[inline]
    pub(crate) fn attention(self) -> bool {
        self.0 & ATTENTION != 0
    }

    /// Whether nothing waits.
    #[inline]
    pub(crate) fn is_empty(self) -> bool {
        self.0 == 0
    }
}

/// The stacks, the signals, and the bell.
///
/// # Invariants
///
/// A node on a stack is live, is in no other queue, and belongs to the owner from the moment it is taken.
#[derive(Debug)]
pub(crate) struct Inbound {
    signals: AtomicU64,
    stacks: [AtomicPtr<Link>; LEVELS as usize],
    bell: Bell,
}

impl Inbound {
    pub(crate) fn new() -> Self {
        Self {
            signals: AtomicU64::new(0),
            stacks: std::array::from_fn(|_| AtomicPtr::new(ptr::null_mut())),
            bell: Bell::new(),
        }
    }

    /// Hands `node` over, from any thread. Lock-free; a system call only if the owner sleeps.
    ///
    /// # Safety
    ///
    /// `node` is live until the owner has taken it and is in no queue. `level` is below [`LEVELS`].
    pub(crate) unsafe fn push(&self, level: u8, node: NonNull<Link>) {
        let stack = &self.stacks[usize::from(level)];
        let mut top = stack.load(Ordering::Relaxed);
        loop {
            // SAFETY: the node is the caller's until the exchange succeeds.
            unsafe { node.as_ref() }.set_next(NonNull::new(top));
            // Release: whoever takes the stack sees the node's link and all that happened before the wake.
            match stack.compare_exchange_weak(
                top,
                node.as_ptr(),
                Ordering::Release,
                Ordering::Relaxed,
            ) {
                Ok(_) => break,
                Err(now) => top = now,
            }
        }
        self.signal(1 << level);
    }

    /// Makes the owner look at what is beside its queues.
    pub(crate) fn ask_attention(&self) {
        self.signal(ATTENTION);
    }

    fn signal(&self, bit: u64) {
        if self.signals.fetch_or(bit, Ordering::AcqRel) & ASLEEP != 0 {
            self.bell.ring();
        }
    }

    /// What the owner sleeps in.
    #[inline]
    pub(crate) fn bell(&self) -> &Bell {
        &self.bell
    }

    /// What waits outside. One load; owner only.
    #[inline]
    pub(crate) fn signals(&self) -> Signals {
        Signals(self.signals.load(Ordering::Relaxed) & !ASLEEP)
    }

    /// Answers a request for attention: one that comes after this is a new one. Owner only.
    pub(crate) fn take_attention(&self) {
        self.signals.fetch_and(!ATTENTION, Ordering::AcqRel);
    }

    /// Takes all that wait at `level`, in the order of their arrival. O(their number); owner only.
    pub(crate) fn take(&self, level: u8) -> Taken {
        // The bit goes first: a node that is pushed after the swap sets it again.
        self.signals.fetch_and(!(1 << level), Ordering::AcqRel);
        let mut from = self.stacks[usize::from(level)].swap(ptr::null_mut(), Ordering::Acquire);
        // A stack gives the last first: turn it over.
        let mut turned = None;
        while let Some(node) = NonNull::new(from) {
            // SAFETY: the swap made the chain ours, and its nodes live.
            unsafe {
                from = node
                    .as_ref()
                    .next()
                    .map_or(ptr::null_mut(), NonNull::as_ptr);
                node.as_ref().set_next(turned);
            }
            turned = Some(node);
        }
        Taken(turned)
    }

    /// Whether something was pushed or asked for that the owner has not taken. From any thread.
    pub(crate) fn is_signalled(&self) -> bool {
        // Acquire: who sees that the owner has taken it sees what the owner did before.
        self.signals.load(Ordering::Acquire) & !ASLEEP != 0
    }

    /// Sleeps until somebody signals or `deadline` comes; returns at once if somebody has. Owner only. May return without a cause.
    pub(crate) fn sleep(&self, deadline: Instant) {
        self.sleep_between(deadline, || (), || ());
    }

    /// As `sleep`, with nothing that ends it but a signal; the owner is still meanwhile, and `ring`s if it is watched.
    pub(crate) fn sleep_still(&self, presence: &Presence, ring: impl FnOnce()) {
        self.sleep_between(
            Instant::NEVER,
            || {
                if presence.fall_still() {
                    ring();
                }
            },
            || presence.wake(),
        );
    }

    /// Sleeps, with `before` when others know it already, and `after` when what they have signalled is not taken yet.
    #[inline]
    fn sleep_between(&self, deadline: Instant, before: impl FnOnce(), after: impl FnOnce()) {
        self.bell.quiet();
        if self
            .signals
            .compare_exchange(0, ASLEEP, Ordering::AcqRel, Ordering::Relaxed)
            .is_ok()
        {
            before();
            // Whatever ended it, the owner looks again.
            self.bell.wait(deadline);
            after();
            self.signals.fetch_and(!ASLEEP, Ordering::AcqRel);
        }
    }
}

/// Processes taken from a stack, first come first.
#[derive(Debug)]
pub(crate) struct Taken(Option<NonNull<Link>>);

impl Iterator for Taken {
    type Item = NonNull<Link>;

    #[inline]
    fn next(&mut self) -> Option<NonNull<Link>> {
        let node = self.0?;
        // SAFETY: taken nodes are the owner's, and live.
        self.0 = unsafe { node.as_ref() }.next();
        Some(node)
    }
}
