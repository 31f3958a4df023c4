//! A reference to a record.

use super::{How, Record};
use crate::deferred_free::{self, Retired};
use crate::process::registry::ProcessRegistry;
use alloc::boxed::Box;
use core::mem::ManuallyDrop;
use core::ops::Deref;
use core::ptr::NonNull;

/// A counted reference to a record.
///
/// # Invariants
///
/// It is counted, so the record is live. The pointer may be used for all of the memory that the
/// record lies in.
pub(crate) struct RecordRef(NonNull<Record>);

// SAFETY: a record is used by shared references on any thread, and what frees it runs on any.
unsafe impl Send for RecordRef {}
// SAFETY: `&RecordRef` gives `&Record`, which is `Sync`, and clones, which are counted by an
// atomic.
unsafe impl Sync for RecordRef {}

/// A reference may go to any thread because of this.
const _: () = {
    const fn shared<T: Send + Sync>() {}
    shared::<Record>();
};

impl RecordRef {
    /// The first reference to a record in memory of its own. Allocates.
    pub(crate) fn boxed(record: Record) -> Self {
        Self(NonNull::from(Box::leak(Box::new(record))))
    }

    /// # Safety
    ///
    /// One reference was counted for this one, and the pointer may be used for all of the memory
    /// that the record lies in.
    pub(crate) unsafe fn from_raw(record: NonNull<Record>) -> Self {
        Self(record)
    }

    /// The pointer. The reference stays counted.
    pub(crate) fn into_raw(self) -> NonNull<Record> {
        ManuallyDrop::new(self).0
    }

    /// Drops two references, without counting if they are the last ones to one record. Off the
    /// real-time path: those free at once.
    #[inline]
    pub(in crate::process) fn drop_with(self, other: Self) {
        if self.0 != other.0 {
            return;
        }
        core::mem::forget(other);
        // SAFETY: two references to this record were counted for these, which are not used any
        // more. Their pointer may be used for all of the record's memory.
        unsafe { Record::count_less(self.into_raw(), 2, deferred_free::free) };
    }

    /// Reports the end of this process, which has [finished](Record::finish), to the registry that
    /// counts and lists it. The list takes this reference.
    pub(crate) fn report(self, registry: &ProcessRegistry) {
        let is_listed = self.is(How::LISTED);
        let in_a_hurry = self.has_ended_in_a_hurry();
        let Err(record) = registry.keep(is_listed.then_some(self), in_a_hurry) else {
            return;
        };
        // In the order of their ends.
        registry.report_kept();
        if let Some(record) = record {
            let record = record.into_raw().as_ptr().cast();
            // SAFETY: it is owned, and not in the chain yet.
            unsafe { registry.list_chain(record, record) };
        }
        registry.leave(in_a_hurry);
    }
}

impl Deref for RecordRef {
    type Target = Record;

    #[inline]
    fn deref(&self) -> &Record {
        // SAFETY: this reference is counted, so the record is live.
        unsafe { self.0.as_ref() }
    }
}

impl Clone for RecordRef {
    #[inline]
    fn clone(&self) -> Self {
        self.count_one_more();
        Self(self.0)
    }
}

impl Drop for RecordRef {
    #[inline]
    fn drop(&mut self) {
        // SAFETY: this reference was counted, and is not used any more. Its pointer may be used for
        // all of the record's memory.
        unsafe { Record::count_less(self.0, 1, deferred_free::retire) };
    }
}

/// # Safety
///
/// `head` begins a record that [`boxed`](RecordRef::boxed) made, without any reference.
pub(in crate::process) unsafe fn free_boxed(head: NonNull<Retired>) {
    // SAFETY: the caller promises that `boxed` made the record, so `head`, its first field, is the
    // pointer of a box; and that no reference is left.
    drop(unsafe { Box::from_raw(head.cast::<Record>().as_ptr()) });
}
