//! 64-bit atomics for processors that have none: each operation is a critical section.
//!
//! Not those of the crate `portable-atomic`: on a processor that has 32-bit compare-and-swap, as
//! from the Cortex-M3 on, its 64-bit ones are a spin lock. An interrupt would spin for ever on the
//! lock that the interrupted program holds.

use core::cell::UnsafeCell;
use core::fmt;
use core::sync::atomic::Ordering;

macro_rules! atomic {
    ($name:ident, $value:ty) => {
        /// A number with the names of the atomic one of the language. A critical section gives all
        /// orders that can be asked for.
        #[derive(Default)]
        pub struct $name(UnsafeCell<$value>);

        // SAFETY: the number is used in critical sections alone.
        unsafe impl Sync for $name {}

        impl $name {
            /// With this value.
            #[inline]
            pub const fn new(value: $value) -> Self {
                Self(UnsafeCell::new(value))
            }

            /// Changes the value in one step, and returns the former one.
            #[inline]
            fn change(&self, change: impl FnOnce($value) -> $value) -> $value {
                critical_section::with(|_| {
                    // SAFETY: nothing else uses it in this critical section.
                    unsafe {
                        let before = *self.0.get();
                        *self.0.get() = change(before);
                        before
                    }
                })
            }

            /// The value.
            #[inline]
            pub fn load(&self, _: Ordering) -> $value {
                // SAFETY: as in `change`.
                critical_section::with(|_| unsafe { *self.0.get() })
            }

            /// Sets the value.
            #[inline]
            pub fn store(&self, value: $value, _: Ordering) {
                self.change(|_| value);
            }

            /// Sets the value, and returns the former one.
            #[inline]
            pub fn swap(&self, value: $value, _: Ordering) -> $value {
                self.change(|_| value)
            }

            /// Sets the value if it is `current`.
            ///
            /// # Errors
            ///
            /// The value, if it is another.
            #[inline]
            pub fn compare_exchange(
                &self,
                current: $value,
                new: $value,
                _: Ordering,
                _: Ordering,
            ) -> Result<$value, $value> {
                let before = self.change(|value| if value == current { new } else { value });
                if before == current {
                    Ok(before)
                } else {
                    Err(before)
                }
            }

            /// As [`compare_exchange`](Self::compare_exchange).
            ///
            /// # Errors
            ///
            /// The value, if it is another.
            #[inline]
            pub fn compare_exchange_weak(
                &self,
                current: $value,
                new: $value,
                success: Ordering,
                failure: Ordering,
            ) -> Result<$value, $value> {
                self.compare_exchange(current, new, success, failure)
            }

            /// Adds, wrapping; returns the former value.
            #[inline]
            pub fn fetch_add(&self, more: $value, _: Ordering) -> $value {
                self.change(|value| value.wrapping_add(more))
            }

            /// Subtracts, wrapping; returns the former value.
            #[inline]
            pub fn fetch_sub(&self, less: $value, _: Ordering) -> $value {
                self.change(|value| value.wrapping_sub(less))
            }

            /// Keeps the bits that are set in `mask`; returns the former value.
            #[inline]
            pub fn fetch_and(&self, mask: $value, _: Ordering) -> $value {
                self.change(|value| value & mask)
            }

            /// Sets the bits that are set in `bits`; returns the former value.
            #[inline]
            pub fn fetch_or(&self, bits: $value, _: Ordering) -> $value {
                self.change(|value| value | bits)
            }

            /// Raises the value to `other`, if that is greater; returns the former value.
            #[inline]
            pub fn fetch_max(&self, other: $value, _: Ordering) -> $value {
                self.change(|value| value.max(other))
            }

            /// The value, of which the exclusive borrow shows that nothing else uses it.
            #[inline]
            pub fn get_mut(&mut self) -> &mut $value {
                self.0.get_mut()
            }
        }

        impl fmt::Debug for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                self.load(Ordering::Relaxed).fmt(f)
            }
        }
    };
}

atomic!(AtomicU64, u64);
atomic!(AtomicI64, i64);
