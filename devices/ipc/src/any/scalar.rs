//! The types without parts.

use std::fmt;

macro_rules! scalars {
    ($($variant:ident $type:ident),*) => {
        /// A number, a truth value or a character.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub(super) enum Scalar {
            $($variant,)*
            Bool,
            Char,
        }

        impl Scalar {
            /// By the name that Rust gives it.
            pub(super) fn named(name: &str) -> Option<Self> {
                Some(match name {
                    $(stringify!($type) => Scalar::$variant,)*
                    "bool" => Scalar::Bool,
                    "char" => Scalar::Char,
                    _ => return None,
                })
            }

            pub(super) fn size(self) -> usize {
                match self {
                    $(Scalar::$variant => size_of::<$type>(),)*
                    Scalar::Bool => 1,
                    Scalar::Char => 4,
                }
            }

            pub(super) fn align(self) -> usize {
                match self {
                    $(Scalar::$variant => align_of::<$type>(),)*
                    Scalar::Bool => align_of::<bool>(),
                    Scalar::Char => align_of::<char>(),
                }
            }

            /// The value of as many bytes as it has.
            pub(super) fn read(self, bytes: &[u8]) -> Option<Part> {
                Some(match self {
                    $(Scalar::$variant => Part::from($type::from_ne_bytes(bytes.try_into().ok()?)),)*
                    Scalar::Bool => Part::Bool(match bytes {
                        [0] => false,
                        [1] => true,
                        _ => return None,
                    }),
                    Scalar::Char => {
                        Part::Char(char::from_u32(u32::from_ne_bytes(bytes.try_into().ok()?))?)
                    }
                })
            }

            /// The bytes of a value, added to `bytes`.
            pub(super) fn parse(self, text: &str, bytes: &mut Vec<u8>) -> Result<(), String> {
                let failed = |why: &dyn fmt::Display| format!("`{text}`: {why}");
                match self {
                    $(Scalar::$variant => {
                        let value: $type = text.parse().map_err(|error| failed(&error))?;
                        bytes.extend(value.to_ne_bytes());
                    })*
                    Scalar::Bool => match text {
                        "true" => bytes.push(1),
                        "false" => bytes.push(0),
                        _ => return Err(failed(&"it is true or false")),
                    },
                    Scalar::Char => {
                        let one: char = text.parse().map_err(|error| failed(&error))?;
                        bytes.extend(u32::from(one).to_ne_bytes());
                    }
                }
                Ok(())
            }
        }
    };
}

scalars!(
    U8 u8, U16 u16, U32 u32, U64 u64, U128 u128, Usize usize,
    I8 i8, I16 i16, I32 i32, I64 i64, I128 i128, Isize isize,
    F32 f32, F64 f64
);

/// A value without parts, to be printed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Part {
    Unsigned(u128),
    Signed(i128),
    /// With the digits that are its own.
    Single(f32),
    Double(f64),
    Bool(bool),
    Char(char),
}

macro_rules! parts {
    ($($variant:ident $wide:ident: $($type:ident)*),*) => {
        $($(impl From<$type> for Part {
            fn from(value: $type) -> Self {
                Part::$variant(value as $wide)
            }
        })*)*
    };
}

parts!(
    Unsigned u128: u8 u16 u32 u64 u128 usize,
    Signed i128: i8 i16 i32 i64 i128 isize,
    Single f32: f32,
    Double f64: f64
);

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Part::Unsigned(value) => write!(f, "{value}"),
            Part::Signed(value) => write!(f, "{value}"),
            Part::Single(value) => write!(f, "{value:?}"),
            Part::Double(value) => write!(f, "{value:?}"),
            Part::Bool(value) => write!(f, "{value}"),
            Part::Char(value) => write!(f, "{value}"),
        }
    }
}
