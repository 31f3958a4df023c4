//! The set of woken branches of a process, for processes with too many branches to poll them all.

use super::{PendingWake, QueueEnd, WakeHandle, ready_again};
use crate::deferred_free::Shared;
use alloc::boxed::Box;
use core::mem::ManuallyDrop;
use core::task::{Context, RawWaker, RawWakerVTable, Waker};
use luna_platform::lock::PiLock;
use luna_platform::sync::atomic::{AtomicBool, AtomicU64, Ordering};

const WORD: usize = u64::BITS as usize;

/// One bit for each branch, one for each word of these, and the parent's wake handle. It is an
/// allocation of its own, shared by the collection and the branches' wakers.
///
/// A wake sets the branch's bit, then that of its word, then readies the parent if the parent
/// waits: a fixed number of steps, whatever other threads wake. The parent takes the bits in the
/// opposite order. On another thread, every wake while the parent waits readies it, not the first
/// alone: the thread of the first may be preempted before it does. On the parent's own thread the
/// first wake suffices, because that thread must go on in any case. For a foreign waker the first
/// suffices too: it cannot be cloned under the lock.
///
/// # Invariants
///
/// The collection and each waker are owners of the block. `slots` does not change.
#[derive(Debug)]
struct Block {
    words: Box<[AtomicU64]>,
    summary: Box<[AtomicU64]>,
    /// The parent waits, so a wake has to take `parent`.
    is_waiting: AtomicBool,
    parent: PiLock<Option<WakeHandle>>,
    slots: Box<[BranchSlot]>,
}

/// The data of a branch's waker.
#[derive(Debug)]
struct BranchSlot {
    /// An owner of the block that holds this, as a pointer: that of each waker of this data.
    owner: *const (),
    number: usize,
}

// SAFETY: an owner of a block may be used and dropped on any thread.
unsafe impl Send for BranchSlot {}
// SAFETY: `&BranchSlot` gives a copy of the pointer and of the number, which do not change; an
// owner made of the pointer may be used on any thread.
unsafe impl Sync for BranchSlot {}

fn zeros(bits: usize) -> Box<[AtomicU64]> {
    (0..bits.div_ceil(WORD))
        .map(|_| AtomicU64::new(0))
        .collect()
}

/// The branches of one parent, each with a waker of its own.
///
/// The parent polls a branch with its waker ([`with_waker`](Self::with_waker)) and asks for the
/// woken ones ([`next`](Self::next)). If there is none it calls [`wait`](Self::wait). The next wake
/// then readies it, as its own context does, at the level of the branch that it is itself.
#[derive(Debug)]
pub struct Branches {
    block: Shared<Block>,
    count: usize,
    /// The word being taken, and its branches that are still to have their turn.
    word: usize,
    bits: u64,
}

impl Branches {
    /// A collection for `count` branches, none of them woken. Allocates; O(branches).
    pub fn new(count: usize) -> Branches {
        let words = zeros(count);
        let summary = zeros(words.len());
        let last = words.len().saturating_sub(1);
        let block = Shared::new_cyclic(|owner| Block {
            words,
            summary,
            is_waiting: AtomicBool::new(false),
            parent: PiLock::new(None),
            slots: (0..count)
                .map(|number| BranchSlot { owner, number })
                .collect(),
        });
        Branches {
            block,
            count,
            // The search begins behind it, at the first word.
            word: last,
            bits: 0,
        }
    }

    /// Calls `f` with the waker of a branch. O(1).
    ///
    /// # Panics
    ///
    /// Panics if there is no such branch.
    pub fn with_waker<R>(&self, branch: usize, f: impl FnOnce(&mut Context<'_>) -> R) -> R {
        let slot = &raw const self.block.slots[branch];
        // SAFETY: the functions of the table fulfil the contract of wakers. The waker is not
        // counted, so it must not be dropped; this reference keeps the block alive for longer.
        let waker = unsafe { ManuallyDrop::new(Waker::new(slot.cast(), &TABLE)) };
        f(&mut Context::from_waker(&waker))
    }

    /// Marks all branches as woken. O(branches / 64).
    pub fn wake_all(&self) {
        for word in 0..self.count.div_ceil(WORD) {
            let branches = (self.count - word * WORD).min(WORD);
            self.block.set(word, !0 >> (WORD - branches));
        }
    }

    /// The next branch that was woken since the last time it was returned. Woken branches take
    /// turns by number, cyclically. O(branches / 4096).
    #[expect(clippy::should_implement_trait, reason = "it goes on after a `None`")]
    pub fn next(&mut self) -> Option<usize> {
        if self.bits == 0 {
            (self.word, self.bits) = self.block.take(self.word + 1)?;
        }
        let bit = self.bits.trailing_zeros() as usize;
        self.bits &= self.bits - 1;
        Some(self.word * WORD + bit)
    }

    /// Notes that the parent waits, before it returns `Pending`: from now on a wake readies it, as
    /// `cx` would. If a woken branch has not been returned by [`next`](Self::next) yet, the parent
    /// is readied at once, behind the others of its level.
    pub fn wait(&self, cx: &Context<'_>) {
        let block = &*self.block;
        if self.bits == 0 {
            let wake_handle = WakeHandle::of(cx);
            // Dropped after the lock is released.
            let _before = block.parent.lock().replace(wake_handle);
            block.is_waiting.store(true, Ordering::Release);
        }
        // A waker writes the summary before it looks for the parent. This writes it too, so one of
        // the two comes second, and sees what the other did before.
        let is_set = |summary: &AtomicU64| summary.fetch_or(0, Ordering::AcqRel) != 0;
        if self.bits != 0 || block.summary.iter().any(is_set) {
            self.stop_waiting();
            ready_again(cx, QueueEnd::Back);
        }
    }

    /// Notes that the parent does not wait, so that wakes need not ready it.
    pub fn stop_waiting(&self) {
        let block = &*self.block;
        if block.is_waiting.load(Ordering::Relaxed) {
            let _before = block.take_parent();
        }
    }
}

impl Drop for Branches {
    fn drop(&mut self) {
        // Wakers may outlive this, but have no process to wake any more.
        self.stop_waiting();
    }
}

impl Block {
    fn set(&self, word: usize, bits: u64) {
        self.words[word].fetch_or(bits, Ordering::AcqRel);
        // Also if the word had bits already: the thread that set them may have been preempted
        // before this step.
        self.summary[word / WORD].fetch_or(1 << (word % WORD), Ordering::AcqRel);
    }

    /// Takes the next word with a woken branch, at `from` or behind it, cyclically.
    fn take(&self, from: usize) -> Option<(usize, u64)> {
        let words = self.summary.len();
        let (first, bit) = (from / WORD, from % WORD);
        // One step more: the first word is searched again, for the part before `from`.
        for step in 0..=words {
            let at = (first + step) % words.max(1);
            let wanted = if step == 0 && at == first {
                !0 << bit
            } else {
                !0
            };
            let summary = self.summary.get(at)?;
            let mut found = summary.load(Ordering::Relaxed) & wanted;
            while found != 0 {
                let bit = found.trailing_zeros();
                found &= found - 1;
                // Clear the summary bit first: a branch that is woken after its word was taken sets
                // it again.
                summary.fetch_and(!(1 << bit), Ordering::AcqRel);
                let word = at * WORD + bit as usize;
                let bits = self.words[word].swap(0, Ordering::AcqRel);
                if bits != 0 {
                    return Some((word, bits));
                }
            }
        }
        None
    }

    fn take_parent(&self) -> Option<WakeHandle> {
        let mut parent = self.parent.lock();
        self.is_waiting.store(false, Ordering::Relaxed);
        parent.take()
    }

    fn wake(&self, branch: usize) {
        self.set(branch / WORD, 1 << (branch % WORD));
        if self.is_waiting.load(Ordering::Acquire) {
            self.wake_parent();
        }
    }

    fn wake_parent(&self) {
        let ready = {
            let mut parent = self.parent.lock();
            match parent.take_if(|wake_handle| wake_handle.is_woken_once()) {
                Some(wake_handle) => {
                    self.is_waiting.store(false, Ordering::Relaxed);
                    wake_handle.take()
                }
                None => parent
                    .as_ref()
                    .map_or(PendingWake::NONE, WakeHandle::wake_again),
            }
        };
        ready.wake();
    }
}

static TABLE: RawWakerVTable = RawWakerVTable::new(clone, wake, wake_by_ref, drop_waker);

/// The owner and the number of the waker with this data.
///
/// # Safety
///
/// `slot` is the data of a live waker of this table.
unsafe fn held(slot: *const ()) -> (ManuallyDrop<Shared<Block>>, usize) {
    // SAFETY: the caller promises that the waker is live; its data lies in the block, which the
    // waker owns.
    unsafe {
        let BranchSlot { owner, number } = *slot.cast::<BranchSlot>();
        (ManuallyDrop::new(Shared::from_raw(owner)), number)
    }
}

unsafe fn clone(slot: *const ()) -> RawWaker {
    // SAFETY: a `Waker` calls its table with its own data while it lives: `held` needs that of a
    // live waker of this table.
    let (block, _) = unsafe { held(slot) };
    let _of_the_clone = block.clone();
    RawWaker::new(slot, &TABLE)
}

unsafe fn wake(slot: *const ()) {
    // SAFETY: a `Waker` calls its table with its own data, and ends by this call: until then it is
    // live, as `held` needs, and its owner of the block is dropped here, once.
    let (block, number) = unsafe { held(slot) };
    ManuallyDrop::into_inner(block).wake(number);
}

unsafe fn wake_by_ref(slot: *const ()) {
    // SAFETY: a `Waker` calls its table with its own data while it lives: `held` needs that of a
    // live waker of this table.
    let (block, number) = unsafe { held(slot) };
    block.wake(number);
}

unsafe fn drop_waker(slot: *const ()) {
    // SAFETY: a `Waker` calls its table with its own data, and ends by this call: until then it is
    // live, as `held` needs, and its owner of the block is dropped here, once.
    let (block, _) = unsafe { held(slot) };
    drop(ManuallyDrop::into_inner(block));
}

#[cfg(all(test, loom))]
mod loom_tests;
#[cfg(all(test, not(loom)))]
mod tests;
