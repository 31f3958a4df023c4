//! Large values that cross without a copy.
//!
//! Behind the place of a value lie the *slots*, and before them a word for each, which names the
//! holder. 0: it is free; else the *ticket* of a loan, which is never used twice, and in its last
//! bit the side that has it. What crosses is a slot's number and its ticket. The receiver takes the
//! slot by exchanging the sender's ticket with its own side's; the sender takes it back, when a
//! send has failed, by exchanging it with a new one. So one of them has it, also if they do so at
//! once.
//!
//! The handles keep the session open: so when a role is opened, no handle of an earlier opening is
//! left, and what was that side's is free.

use crate::codec::{Codec, Place};
use crate::error::TypeInfo;
use crate::link::Link;
use crate::memory::OFFSET;
use crate::receive_link::{Deliveries, Inward};
use crate::send_link::{Outward, Values};
use crate::session::Session;
use crate::{Endpoint, IpcError, ReceiveLink, Role, SendLink, ZeroCopySend};
use luna::{Receiver, Sender};
use std::fmt;
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};
use std::ptr::NonNull;
use std::sync::Arc;
use std::sync::atomic::Ordering::{Acquire, Relaxed, SeqCst};
use std::sync::atomic::{AtomicU32, AtomicU64};

const FREE: u64 = 0;

/// The slots of a session.
struct Pool<T> {
    session: Arc<Session>,
    slots: usize,
    /// Where the slots begin.
    begin: usize,
    epoch: u64,
    tickets: AtomicU32,
    _value: PhantomData<fn(T) -> T>,
}

impl<T> Pool<T> {
    fn new(session: Session, slots: usize, begin: usize) -> Self {
        Self {
            epoch: session.own().epoch.load(SeqCst),
            session: Arc::new(session),
            slots,
            begin,
            tickets: AtomicU32::new(0),
            _value: PhantomData,
        }
    }

    /// Where the words begin.
    const WORDS: usize = 2 * OFFSET;

    /// Where the slots begin, and where they end; `None`: beyond all addresses.
    fn layout(slots: usize) -> Option<(usize, usize)> {
        let words = slots.checked_mul(size_of::<AtomicU64>())?;
        let begin = Self::WORDS.checked_add(words)?;
        let begin = begin.checked_next_multiple_of(OFFSET)?;
        let end = begin.checked_add(slots.checked_mul(size_of::<T>())?)?;
        isize::try_from(end).is_ok().then_some((begin, end))
    }

    fn word(&self, slot: usize) -> &AtomicU64 {
        assert!(slot < self.slots);
        // No sum is larger than the layout, which was found.
        let offset = Self::WORDS.saturating_add(slot.saturating_mul(size_of::<AtomicU64>()));
        let word = self.session.memory().at(offset, size_of::<AtomicU64>());
        // SAFETY: it is in the mapping, which lives as long as the session; it is aligned, since
        // the offset is, and accessed atomically by all.
        unsafe { word.cast().as_ref() }
    }

    /// Aligned for `T`, since the slots begin at a page and a type's size is a multiple of its
    /// alignment.
    fn value(&self, slot: usize) -> NonNull<T> {
        assert!(slot < self.slots);
        // As for the words.
        let offset = self
            .begin
            .saturating_add(slot.saturating_mul(size_of::<T>()));
        self.session.memory().at(offset, size_of::<T>()).cast()
    }

    /// A ticket of this opening, with the sender's bit. One of 2^32 in each of 2^31 openings.
    fn ticket(&self) -> u64 {
        let number = self.tickets.fetch_add(1, Relaxed).wrapping_add(1);
        (self.epoch << 32 | u64::from(number)) << 1
    }

    fn exchange(&self, slot: usize, from: u64, to: u64) -> bool {
        self.word(slot)
            .compare_exchange(from, to, SeqCst, Relaxed)
            .is_ok()
    }

    /// Frees what belonged to earlier openings of the role; `with` sees each free slot first.
    fn recover(&self, role: Role, with: impl Fn(NonNull<T>)) {
        for slot in 0..self.slots {
            let there = self.word(slot).load(SeqCst);
            let is_own = match role {
                Role::Sender => there & 1 == 0,
                Role::Receiver => there & 1 == 1,
            };
            // A receiver of the last session may take a slot that was on its way to it.
            let ticket = self.ticket();
            if is_own && self.exchange(slot, there, ticket) {
                with(self.value(slot));
                self.word(slot).store(FREE, SeqCst);
            }
        }
    }
}

/// A place in shared memory that a handle has.
///
/// # Invariants
///
/// While the slot's word is `word`, this handle alone accesses the slot; its value is valid.
struct Slot<T> {
    pool: Arc<Pool<T>>,
    slot: usize,
    word: u64,
}

impl<T> Slot<T> {
    fn is_own(&self) -> bool {
        self.pool.word(self.slot).load(Acquire) == self.word
    }
}

impl<T> Drop for Slot<T> {
    fn drop(&mut self) {
        // Not if the other side has it.
        self.pool.exchange(self.slot, self.word, FREE);
    }
}

impl<T> fmt::Debug for Slot<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Slot").field(&self.slot).finish()
    }
}

/// The slots of the sending side, made by [`Endpoint::loan_sender`].
pub struct Loans<T>(Arc<Pool<T>>);

impl<T> Loans<T> {
    /// A place in shared memory for a value, if one is free. It holds a value that was sent
    /// earlier, or the initial one: overwrite it in place.
    ///
    /// Real-time path: yes; no allocation, O(slots). Dropping a loan gives the place back.
    pub fn loan(&self) -> Option<Loan<T>> {
        let pool = &self.0;
        let word = pool.ticket();
        let slot = (0..pool.slots).find(|slot| pool.exchange(*slot, FREE, word))?;
        let pool = pool.clone();
        Some(Loan(Slot { pool, slot, word }))
    }
}

impl<T> Clone for Loans<T> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

luna_platform::debug_fields!(impl[T] Loans<T>, |loans| slots: loans.0.slots);

/// A value in shared memory, to be written and then sent: see [`Loans::loan`].
///
/// It comes back from a send that fails. If the other program has the value nevertheless, this is a
/// [`lost`](Self::is_lost) one, which cannot be accessed.
#[derive(Debug)]
pub struct Loan<T>(Slot<T>);

impl<T> Loan<T> {
    /// Whether its send has failed after the other program has taken it.
    pub fn is_lost(&self) -> bool {
        !self.0.is_own()
    }

    /// Before a sender has it again.
    fn take_back(&mut self) {
        let word = self.0.pool.ticket();
        if self.0.pool.exchange(self.0.slot, self.0.word, word) {
            self.0.word = word;
        }
    }
}

impl<T> Deref for Loan<T> {
    type Target = T;

    /// # Panics
    ///
    /// If it is lost.
    fn deref(&self) -> &T {
        assert!(!self.is_lost(), "the other program has this value");
        // SAFETY: the word is this handle's, so by the invariants only it accesses the slot. While
        // it is borrowed its link takes nothing from it: that has the handle itself.
        unsafe { self.0.pool.value(self.0.slot).as_ref() }
    }
}

impl<T> DerefMut for Loan<T> {
    /// # Panics
    ///
    /// If it is lost.
    fn deref_mut(&mut self) -> &mut T {
        assert!(!self.is_lost(), "the other program has this value");
        // SAFETY: the word is this handle's, so by the invariants only it accesses the slot. The
        // handle is borrowed exclusively, and its link has nothing of it meanwhile.
        unsafe { self.0.pool.value(self.0.slot).as_mut() }
    }
}

/// A value of the other program, in shared memory. Dropping it gives its place back to the sender:
/// real-time path, O(1), no system call.
#[derive(Debug)]
pub struct Lent<T>(Slot<T>);

impl<T> Deref for Lent<T> {
    type Target = T;

    fn deref(&self) -> &T {
        // SAFETY: the word was changed to this handle's by an exchange, which only this handle, or
        // the next opening of this role after it, changes. So by the invariants nobody writes.
        unsafe { self.0.pool.value(self.0.slot).as_ref() }
    }
}

impl Endpoint {
    /// Opens the sending side of a channel whose values are written and read in shared memory: none
    /// is copied, however large. There are `slots` places: for one that is written, one under way
    /// and one that the receiver holds, take three; both programs state the same number. `initial`
    /// is in them at first.
    ///
    /// The channel carries [`Loan`]s, as any other channel its values; the receiver gets [`Lent`]s.
    /// They keep the session open: a side is opened again when its link and its values are dropped.
    ///
    /// # Errors
    ///
    /// As for [`sender`](Self::sender).
    ///
    /// # Panics
    ///
    /// `slots` is 0.
    ///
    /// ```
    /// use luna::prelude::*;
    ///
    /// static BLACK: [u8; 1 << 20] = [0; 1 << 20];
    ///
    /// let name = format!("doc/{}/images", std::process::id());
    /// let endpoint = luna_ipc::Endpoint::new(&name);
    /// let (images, sender, link) = endpoint.loan_sender(3, &BLACK)?;
    /// # let endpoint = endpoint.clone();
    /// let other = std::thread::spawn(move || -> luna::Result<()> {
    ///     let (receiver, link) = endpoint.loan_receiver::<[u8; 1 << 20]>(3)?;
    ///     let mut system = System::new("display");
    ///     let main = system.executor("main").build()?;
    ///     main.process("link").spawn(link)?;
    ///     main.process("display").spawn(async move {
    ///         let image = receiver.recv().await?;
    ///         assert_eq!(image[17], 255);
    ///         Ok(())
    ///     })?;
    ///     system.run().map(drop)
    /// });
    /// let mut system = System::new("camera");
    /// let main = system.executor("main").build()?;
    /// main.process("link").spawn(link)?;
    /// main.process("camera").spawn(async move {
    ///     let mut image = images.loan().expect("all are free");
    ///     image[17] = 255;
    ///     sender.send(image).await?;
    ///     Ok(())
    /// })?;
    /// system.run()?;
    /// other.join().unwrap()?;
    /// # Ok::<(), luna::Error>(())
    /// ```
    #[expect(clippy::type_complexity, reason = "an end and its link, as for all")]
    pub fn loan_sender<T: ZeroCopySend + Send + Sync + 'static>(
        &self,
        slots: usize,
        initial: &T,
    ) -> Result<(Loans<T>, Sender<Loan<T>>, SendLink<Loan<T>>), IpcError> {
        let (pool, info) = self.pool::<T>(Role::Sender, slots)?;
        // SAFETY: the slot is this side's, so no one else accesses it, and `initial` is elsewhere.
        // The type has no drop, so a copy is harmless.
        pool.recover(Role::Sender, |place| unsafe {
            place.copy_from_nonoverlapping(initial.into(), 1);
        });
        let codec = Codec::handle(
            info,
            Box::new(|loan: &Loan<T>| [loan.0.slot as u64, loan.0.word]),
            Box::new(|_| Err("the sender reads nothing".to_owned())),
            Loan::take_back,
        );
        let (sender, receiver) = luna::channel();
        let session = pool.session.clone();
        let near = Outward(Values::new(receiver, Place::first(codec)));
        let sender = sender.named(&self.name);
        Ok((Loans(pool), sender, Link::new(session, near)))
    }

    /// Opens the receiving side: see [`loan_sender`](Self::loan_sender).
    ///
    /// # Errors
    ///
    /// As for [`sender`](Self::sender).
    ///
    /// # Panics
    ///
    /// As for `loan_sender`.
    #[expect(clippy::type_complexity, reason = "an end and its link, as for all")]
    pub fn loan_receiver<T: ZeroCopySend + Send + Sync + 'static>(
        &self,
        slots: usize,
    ) -> Result<(Receiver<Lent<T>>, ReceiveLink<Lent<T>>), IpcError> {
        let (pool, info) = self.pool::<T>(Role::Receiver, slots)?;
        pool.recover(Role::Receiver, |_| ());
        let session = pool.session.clone();
        let take = move |[slot, ticket]: [u64; 2]| {
            let (slot, word) = (slot as usize, ticket | 1);
            let is_there = slot < pool.slots && pool.exchange(slot, ticket, word);
            let pool = pool.clone();
            match is_there {
                true => Ok(Lent(Slot { pool, slot, word })),
                false => Err("its sender has taken it back".to_owned()),
            }
        };
        let unsent = Box::new(|lent: &Lent<T>| [lent.0.slot as u64, lent.0.word]);
        let codec = Codec::handle(info, unsent, Box::new(take), |_| ());
        let (sender, receiver) = luna::channel();
        let near = Inward(Deliveries::new(sender, Place::first(codec)));
        Ok((receiver.named(&self.name), Link::new(session, near)))
    }

    fn pool<T: ZeroCopySend>(
        &self,
        role: Role,
        slots: usize,
    ) -> Result<(Arc<Pool<T>>, TypeInfo), IpcError> {
        const {
            assert!(
                !std::mem::needs_drop::<T>(),
                "a value that is to be dropped is no plain data: it would be dropped in two programs"
            );
            assert!(
                align_of::<T>() <= OFFSET,
                "shared memory is aligned to pages of 4096 bytes"
            );
        }
        assert!(
            slots > 0,
            "a channel of values that are lent has one place or more"
        );
        let info = TypeInfo::of::<T>(self.version).lent(slots);
        let (begin, end) = Pool::<T>::layout(slots).unzip();
        let session = self.open(role, info.clone(), end)?;
        // Without an end nothing was opened.
        let pool = Pool::new(session, slots, begin.unwrap_or(0));
        Ok((Arc::new(pool), info))
    }
}
