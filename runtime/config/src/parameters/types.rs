//! The types that parameters have.

use super::form::Kind;

/// The most elements of an array.
pub(super) const MAX_ELEMENTS: usize = 32;

mod sealed {
    pub trait Sealed {}
}

/// What a [`Parameter`](super::Parameter) can be: a number (`f64`, `f32`, `i8` to `i64`, `u8` to
/// `u64`), `bool`, an array of up to 32 numbers, or a [`Choice`].
pub trait Tunable: Copy + Send + 'static {
    /// Its element: itself, or the array's numbers.
    type Element;

    /// How many words it has.
    #[doc(hidden)]
    const WORDS: usize;
    /// Whether it is an array.
    #[doc(hidden)]
    const IS_ARRAY: bool;

    #[doc(hidden)]
    fn kind() -> Kind;
    /// The word of an element.
    #[doc(hidden)]
    fn word(self, index: usize) -> u64;
    /// It, of its words.
    #[doc(hidden)]
    fn of_words(word: impl FnMut(usize) -> u64) -> Self;
}

/// A number that a parameter can be, or an array have.
pub trait Number: Tunable<Element = Self> + PartialOrd + sealed::Sealed {}

macro_rules! scalars {
    ($($of:ty, $kind:expr, $to:expr, $from:expr;)*) => {$(
        impl Tunable for $of {
            type Element = $of;
            const WORDS: usize = 1;
            const IS_ARRAY: bool = false;
            fn kind() -> Kind {
                $kind
            }
            #[inline(always)]
            fn word(self, _: usize) -> u64 {
                $to(self)
            }
            #[inline(always)]
            fn of_words(mut word: impl FnMut(usize) -> u64) -> Self {
                $from(word(0))
            }
        }
    )*};
}

macro_rules! numbers {
    ($($of:ty)*) => {$(
        impl sealed::Sealed for $of {}
        impl Number for $of {}
    )*};
}

numbers!(f32 f64 i8 i16 i32 i64 u8 u16 u32 u64);

scalars! {
    bool, Kind::Bool, u64::from, |word| word != 0;
    f64, Kind::F64, f64::to_bits, f64::from_bits;
    f32, Kind::F32, |number: f32| number.to_bits().into(), |word| f32::from_bits(word as u32);
}

macro_rules! integers {
    ($($of:ty)*) => {
        scalars! {$(
            $of,
            Kind::Integer { name: stringify!($of), least: <$of>::MIN as i128, most: <$of>::MAX as i128 },
            |number| number as u64,
            |word| word as $of;
        )*}
    };
}

integers!(i8 i16 i32 i64 u8 u16 u32 u64);

impl<T: Number, const N: usize> Tunable for [T; N] {
    type Element = T;
    const WORDS: usize = {
        assert!(
            N >= 1 && N <= MAX_ELEMENTS,
            "a parameter has 1 to 32 elements"
        );
        N
    };
    const IS_ARRAY: bool = true;
    fn kind() -> Kind {
        T::kind()
    }
    #[inline(always)]
    fn word(self, index: usize) -> u64 {
        self[index].word(0)
    }
    #[inline(always)]
    fn of_words(mut word: impl FnMut(usize) -> u64) -> Self {
        std::array::from_fn(|index| T::of_words(|_| word(index)))
    }
}

/// One of several, which files and command lines call by name: implemented for an enumeration,
/// which then can be a parameter.
///
/// ```
/// use luna::parameters::Choice;
///
/// #[derive(Debug, Clone, Copy, PartialEq)]
/// enum Mode { Position, Speed }
///
/// impl Choice for Mode {
///     const CHOICES: &'static [(&'static str, Mode)] = &[("position", Mode::Position), ("speed", Mode::Speed)];
/// }
/// ```
pub trait Choice: Copy + PartialEq + Send + Sync + 'static {
    /// The choices, with names: at least one, and each that is used as a default.
    const CHOICES: &'static [(&'static str, Self)];
}

impl<C: Choice> Tunable for C {
    type Element = C;
    const WORDS: usize = {
        assert!(!C::CHOICES.is_empty(), "there must be something to choose");
        1
    };
    const IS_ARRAY: bool = false;
    fn kind() -> Kind {
        Kind::Choice(C::CHOICES.iter().map(|(name, _)| *name).collect())
    }
    fn word(self, _: usize) -> u64 {
        let index = C::CHOICES.iter().position(|(_, choice)| *choice == self);
        index.map_or(u64::MAX, |index| index as u64)
    }
    #[inline(always)]
    fn of_words(mut word: impl FnMut(usize) -> u64) -> Self {
        // A replay that has gone astray reads zeroes; anything else was checked.
        C::CHOICES[(word(0) as usize).min(C::CHOICES.len() - 1)].1
    }
}
