//! Values of objects and PDOs: little-endian, one after the other.

/// A value of an object: integers, floats and `bool`, in the size of their type.
pub trait Value: Copy + Send + 'static {
    /// In bytes.
    const LEN: usize;

    /// Writes it to `LEN` bytes.
    fn encode(&self, to: &mut [u8]);

    /// From `LEN` bytes.
    fn decode(bytes: &[u8]) -> Option<Self>;
}

macro_rules! numbers {
    ($($type:ty)*) => {
        $(impl Value for $type {
            const LEN: usize = size_of::<$type>();

            fn encode(&self, to: &mut [u8]) {
                to.copy_from_slice(&self.to_le_bytes());
            }

            fn decode(bytes: &[u8]) -> Option<Self> {
                Some(Self::from_le_bytes(bytes.try_into().ok()?))
            }
        })*
    };
}

numbers!(u8 i8 u16 i16 u32 i32 u64 i64 f32 f64);

impl Value for bool {
    const LEN: usize = 1;

    fn encode(&self, to: &mut [u8]) {
        to.copy_from_slice(&[u8::from(*self)]);
    }

    fn decode(bytes: &[u8]) -> Option<Self> {
        match bytes {
            [0] => Some(false),
            [1] => Some(true),
            _ => None,
        }
    }
}

/// What a PDO carries: one [`Value`], or a tuple of up to eight in the order of its mapping. In all
/// it has at most 8 bytes: with more it does not compile.
///
/// ```
/// use luna_can::canopen::PdoValue;
///
/// // A status word and a position.
/// let value = (0x0237_u16, -1_000_i32);
/// let mut bytes = [0; 8];
/// value.encode(&mut bytes[..<(u16, i32)>::LEN]);
/// assert_eq!(bytes, [0x37, 0x02, 0x18, 0xFC, 0xFF, 0xFF, 0, 0]);
/// assert_eq!(<(u16, i32)>::decode(&bytes[..6]), Some(value));
/// ```
pub trait PdoValue: Send + 'static {
    /// In bytes.
    const LEN: usize;

    /// Writes it to `LEN` bytes.
    fn encode(&self, to: &mut [u8]);

    /// From `LEN` bytes; none for another number.
    fn decode(bytes: &[u8]) -> Option<Self>
    where
        Self: Sized;
}

impl<T: Value> PdoValue for T {
    const LEN: usize = T::LEN;

    fn encode(&self, to: &mut [u8]) {
        Value::encode(self, to);
    }

    fn decode(bytes: &[u8]) -> Option<Self> {
        <T as Value>::decode(bytes)
    }
}

macro_rules! tuples {
    ($($name:ident)*) => {
        impl<$($name: Value),*> PdoValue for ($($name,)*) {
            const LEN: usize = 0 $(+ $name::LEN)*;

            #[allow(non_snake_case, reason = "a name for each type")]
            fn encode(&self, to: &mut [u8]) {
                let ($($name,)*) = self;
                let rest = to;
                $(
                    let (own, rest) = rest.split_at_mut($name::LEN);
                    $name.encode(own);
                )*
                let _ = rest;
            }

            fn decode(bytes: &[u8]) -> Option<Self> {
                let rest = bytes;
                $(
                    let (own, rest) = rest.split_at_checked($name::LEN)?;
                    #[allow(non_snake_case, reason = "a name for each type")]
                    let $name = $name::decode(own)?;
                )*
                rest.is_empty().then_some(($($name,)*))
            }
        }
    };
}

tuples!(A B);
tuples!(A B C);
tuples!(A B C D);
tuples!(A B C D E);
tuples!(A B C D E F);
tuples!(A B C D E F G);
tuples!(A B C D E F G H);
