//! What a signal can carry.

use crate::format::{MAX_ELEMENTS, Type};

mod sealed {
    pub trait Sealed {}
}

/// A number or a boolean: an element of a sample.
///
/// Sealed: the format has just these.
pub trait Element: sealed::Sealed + Copy + Send + 'static {
    /// Its type in a recording.
    #[doc(hidden)]
    const TYPE: Type;

    /// The value in the lowest bits of a word.
    #[doc(hidden)]
    fn word(self) -> u64;
}

/// What a [`Signal`](crate::Signal) carries: a number, a boolean, or an array of 1 to 16 of them.
///
/// Sealed: the format has only these types.
///
/// ```
/// use luna_logger::Sample;
/// fn takes(_: impl Sample) {}
/// takes(0.5);
/// takes([1i32, 2, 3]);
/// ```
///
/// ```compile_fail
/// use luna_logger::Sample;
/// fn takes(_: impl Sample) {}
/// takes("text");
/// ```
#[diagnostic::on_unimplemented(
    message = "`{Self}` cannot be recorded as a signal",
    label = "not a sample",
    note = "a sample is a number, a boolean, or an array of 1 to 16 of them; text goes into messages"
)]
pub trait Sample: sealed::Sealed + Copy + Send + 'static {
    /// The type of its elements.
    #[doc(hidden)]
    const TYPE: Type;

    /// How many there are.
    #[doc(hidden)]
    const ELEMENTS: usize;

    /// Calls `f` with an entry for a ring: the two given words, and a word for each element.
    #[doc(hidden)]
    fn with_entry<R>(self, head: [u64; 2], f: impl FnOnce(&[u64]) -> R) -> R;
}

macro_rules! elements {
    ($($of:ty, $name:ident, |$value:ident| $word:expr;)*) => {$(
        impl sealed::Sealed for $of {}
        impl Element for $of {
            const TYPE: Type = Type::$name;

            #[inline(always)]
            fn word(self) -> u64 {
                let $value = self;
                $word
            }
        }
        impl Sample for $of {
            const TYPE: Type = Type::$name;
            const ELEMENTS: usize = 1;

            #[inline(always)]
            fn with_entry<R>(self, [first, second]: [u64; 2], f: impl FnOnce(&[u64]) -> R) -> R {
                f(&[first, second, self.word()])
            }
        }
    )*};
}

// Only the lowest bytes of the type's size count; the recording omits the upper bytes that the cast
// adds.
elements! {
    bool, Bool, |value| u64::from(value);
    i8, I8, |value| value as u64;
    i16, I16, |value| value as u64;
    i32, I32, |value| value as u64;
    i64, I64, |value| value as u64;
    u8, U8, |value| value.into();
    u16, U16, |value| value.into();
    u32, U32, |value| value.into();
    u64, U64, |value| value;
    f32, F32, |value| value.to_bits().into();
    f64, F64, |value| value.to_bits();
}

impl<E: Element, const N: usize> sealed::Sealed for [E; N] {}

impl<E: Element, const N: usize> Sample for [E; N] {
    const TYPE: Type = E::TYPE;
    const ELEMENTS: usize = {
        assert!(N >= 1 && N <= MAX_ELEMENTS, "a sample has 1 to 16 elements");
        N
    };

    #[inline(always)]
    fn with_entry<R>(self, [first, second]: [u64; 2], f: impl FnOnce(&[u64]) -> R) -> R {
        let mut entry = [0; 2 + MAX_ELEMENTS];
        entry[0] = first;
        entry[1] = second;
        for (word, element) in entry[2..].iter_mut().zip(self) {
            *word = element.word();
        }
        f(&entry[..2 + Self::ELEMENTS])
    }
}
