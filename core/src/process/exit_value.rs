//! Exit value: what a process returns as it ends, for the code that reaps it. It is kept where
//! there was room for it from the start, since a process ends on the real-time path.

use core::any::TypeId;
use core::mem::MaybeUninit;
use core::ptr::NonNull;

/// What a body ends with, beyond that it has ended: an error, say. Most end with nothing.
pub trait ExitValue: Send + 'static {
    /// Whether there is nothing to be kept. Called on the real-time path.
    fn is_nothing(&self) -> bool;

    /// What a process ends with that has [failed](crate::current::fail_current), whatever its
    /// body returned. Called on the real-time path, in the turn in which it failed.
    fn failed() -> Self;
}

impl ExitValue for () {
    fn is_nothing(&self) -> bool {
        true
    }

    fn failed() {}
}

/// An exit value, wherever it lies.
///
/// # Invariants
///
/// `place` leads to an exit value that may be sent to other threads, and that `methods` handle; it
/// is owned by this value alone.
pub(crate) struct ErasedExitValue {
    place: NonNull<()>,
    methods: &'static ExitValueMethods,
}

/// What is done with an exit value, each at most once, on any thread.
pub(crate) struct ExitValueMethods {
    pub(crate) type_id: fn() -> TypeId,
    /// Moves them out to the other place, and lets go of the first.
    pub(crate) take: unsafe fn(NonNull<()>, *mut ()),
    /// Drops them, and lets go of the place.
    pub(crate) discard: unsafe fn(NonNull<()>),
}

// SAFETY: by the invariant the exit value may be sent to other threads, and is owned by this value
// alone.
unsafe impl Send for ErasedExitValue {}

impl ErasedExitValue {
    /// # Safety
    ///
    /// `place` is one as the type's invariant requires, and its ownership passes to the new value.
    pub(crate) unsafe fn new(place: NonNull<()>, methods: &'static ExitValueMethods) -> Self {
        Self { place, methods }
    }

    /// Whether they are of this type.
    pub(crate) fn are<O: ExitValue>(&self) -> bool {
        (self.methods.type_id)() == TypeId::of::<O>()
    }

    /// Takes them, if they are of this type; else gives them back.
    pub(crate) fn take<O: ExitValue>(self) -> Result<O, Self> {
        if !self.are::<O>() {
            return Err(self);
        }
        let (place, methods) = (self.place, self.methods);
        core::mem::forget(self);
        let mut value = MaybeUninit::<O>::uninit();
        // SAFETY: by the invariant the exit value at the place is owned by this value alone, which
        // was forgotten: so it is taken once. It is of the type for which there is room.
        unsafe {
            (methods.take)(place, value.as_mut_ptr().cast());
            Ok(value.assume_init())
        }
    }
}

impl Drop for ErasedExitValue {
    fn drop(&mut self) {
        // SAFETY: by the invariant the exit value at the place is owned by this value alone. What
        // was taken is not dropped.
        unsafe { (self.methods.discard)(self.place) };
    }
}
