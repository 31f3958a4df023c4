//! Plain data that crosses to another computer, and how its type is distinguished from others.

use luna::external::{FromBytes, ToBytes};
use std::fmt;

/// A value that crosses in one datagram: always of the same length, the same bytes on every
/// computer. [`cycle_data!`](crate::cycle_data) makes a structure of numbers one.
///
/// Both programs state the same name, size and version: a datagram that states others is not
/// decoded.
pub trait CycleData: ToBytes + FromBytes + Send + 'static {
    /// The type's name for both programs, such as "cell/command". Not Rust's, which may change from
    /// compiler to compiler.
    const NAME: &'static str;
    /// The bytes of each value: what [`length`](ToBytes::length) gives.
    const SIZE: usize;
    /// To be counted up when the fields get another meaning in the same size.
    const VERSION: u32 = 0;
}

/// Bytes as they are.
impl<const N: usize> CycleData for [u8; N] {
    const NAME: &'static str = "bytes";
    const SIZE: usize = N;
}

/// A part of a [`CycleData`]: a number, or an array of parts. Little-endian.
pub trait Field: Sized {
    /// Its bytes.
    const SIZE: usize;

    /// Writes it to exactly so many bytes.
    fn put(&self, to: &mut [u8]);

    /// Reads it from exactly so many bytes. All bytes mean something.
    fn take(from: &[u8]) -> Self;
}

macro_rules! number_fields {
    ($($number:ty)*) => {$(
        impl Field for $number {
            const SIZE: usize = size_of::<$number>();

            fn put(&self, to: &mut [u8]) {
                to.copy_from_slice(&self.to_le_bytes());
            }

            fn take(from: &[u8]) -> Self {
                let mut bytes = [0; size_of::<$number>()];
                bytes.copy_from_slice(from);
                <$number>::from_le_bytes(bytes)
            }
        }
    )*};
}

number_fields!(u8 u16 u32 u64 i8 i16 i32 i64 f32 f64);

impl<F: Field, const N: usize> Field for [F; N] {
    const SIZE: usize = N * F::SIZE;

    fn put(&self, to: &mut [u8]) {
        for (number, field) in self.iter().enumerate() {
            field.put(&mut to[number * F::SIZE..(number + 1) * F::SIZE]);
        }
    }

    fn take(from: &[u8]) -> Self {
        std::array::from_fn(|number| F::take(&from[number * F::SIZE..(number + 1) * F::SIZE]))
    }
}

/// Declares a structure of numbers and arrays of numbers that crosses to another computer: a
/// [`CycleData`](crate::cycle::CycleData), little-endian, without padding.
///
/// ```
/// luna_links::cycle_data! {
///     /// What the arm is to do.
///     #[derive(Debug, Clone, Copy, PartialEq)]
///     pub struct Command: "cell/command", version 2 {
///         /// In radians.
///         pub target: [f64; 2],
///         /// Counts up.
///         pub number: u32,
///     }
/// }
///
/// use luna::external::{FromBytes, ToBytes};
/// use luna_links::cycle::CycleData;
///
/// let command = Command { target: [0.5, -0.5], number: 7 };
/// let mut bytes = [0; Command::SIZE];
/// command.to_bytes(&mut bytes);
/// assert_eq!((bytes.len(), bytes[16]), (20, 7));
/// assert_eq!(Command::from_bytes(&bytes), Ok(command));
/// ```
#[macro_export]
macro_rules! cycle_data {
    (
        $(#[$about:meta])*
        $visible:vis struct $name:ident : $type_name:literal, version $version:literal {
            $($(#[$field_about:meta])* $field_visible:vis $field:ident : $field_type:ty),* $(,)?
        }
    ) => {
        $(#[$about])*
        $visible struct $name {
            $($(#[$field_about])* $field_visible $field: $field_type,)*
        }

        impl $crate::cycle::CycleData for $name {
            const NAME: &'static str = $type_name;
            const SIZE: usize = 0 $(+ <$field_type as $crate::cycle::Field>::SIZE)*;
            const VERSION: u32 = $version;
        }

        impl $crate::cycle::ToBytes for $name {
            fn length(&self) -> usize {
                <Self as $crate::cycle::CycleData>::SIZE
            }

            fn to_bytes(&self, to: &mut [u8]) {
                let _rest = to;
                $(
                    let (here, _rest) =
                        _rest.split_at_mut(<$field_type as $crate::cycle::Field>::SIZE);
                    $crate::cycle::Field::put(&self.$field, here);
                )*
            }
        }

        impl $crate::cycle::FromBytes for $name {
            fn from_bytes(bytes: &[u8]) -> ::std::result::Result<Self, $crate::cycle::Malformed> {
                if bytes.len() != <Self as $crate::cycle::CycleData>::SIZE {
                    return Err($crate::cycle::Malformed("its length is not that of the type"));
                }
                let _rest = bytes;
                $(
                    let (here, _rest) =
                        _rest.split_at(<$field_type as $crate::cycle::Field>::SIZE);
                    let $field = $crate::cycle::Field::take(here);
                )*
                Ok(Self { $($field),* })
            }
        }
    };
}

/// What a program states of the type that it sends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub struct TypeIdentity {
    /// A hash of [`CycleData::NAME`] (FNV-1a of 64 bits).
    pub name_hash: u64,
    /// [`CycleData::SIZE`].
    pub size: u32,
    /// [`CycleData::VERSION`].
    pub version: u32,
}

impl TypeIdentity {
    /// Of this type.
    pub const fn of<T: CycleData>() -> Self {
        Self {
            name_hash: fnv(T::NAME.as_bytes()),
            size: T::SIZE as u32,
            version: T::VERSION,
        }
    }

    pub(crate) const fn stated(name_hash: u64, size: u32, version: u32) -> Self {
        Self {
            name_hash,
            size,
            version,
        }
    }
}

impl fmt::Display for TypeIdentity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            name_hash,
            size,
            version,
        } = self;
        write!(
            f,
            "{size} bytes, version {version}, name of hash {name_hash:016x}"
        )
    }
}

const fn fnv(bytes: &[u8]) -> u64 {
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    let mut number = 0;
    while number < bytes.len() {
        hash = (hash ^ bytes[number] as u64).wrapping_mul(0x100_0000_01b3);
        number += 1;
    }
    hash
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_type_is_told_by_name_size_and_version() {
        // The test vectors of the hash's authors.
        assert_eq!(fnv(b""), 0xcbf2_9ce4_8422_2325);
        assert_eq!(fnv(b"foobar"), 0x8594_4171_f739_67e8);
        assert_ne!(TypeIdentity::of::<[u8; 4]>(), TypeIdentity::of::<[u8; 5]>());
    }

    #[test]
    fn fields_are_little_endian_and_lie_one_after_the_other() {
        let mut bytes = [0; 6];
        [1_u16, 0x203, 0xffff].put(&mut bytes);
        assert_eq!(bytes, [1, 0, 3, 2, 255, 255]);
        assert_eq!(<[u16; 3]>::take(&bytes), [1, 0x203, 0xffff]);
    }
}
