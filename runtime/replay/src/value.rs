//! Values with a byte form.

/// The most bytes that a value has.
pub const LONGEST: usize = 256;

/// A value of fixed size with a byte form: what an [`input`](super::input) or
/// [`output`](super::output) can be.
///
/// Numbers, `bool`, and arrays and pairs of such have one. At most 256 bytes.
///
/// ```
/// use luna::replay::Value;
///
/// struct Pose { x: f64, y: f64 }
///
/// impl Value for Pose {
///     const SIZE: usize = 16;
///     fn write(&self, into: &mut [u8]) {
///         [self.x, self.y].write(into);
///     }
///     fn read(from: &[u8]) -> Self {
///         let [x, y] = Value::read(from);
///         Pose { x, y }
///     }
/// }
/// assert_eq!(luna::replay::input("pose", || Pose { x: 1.0, y: 2.0 }).y, 2.0);
/// ```
pub trait Value {
    /// How many bytes it has.
    const SIZE: usize;
    /// Writes it; there is room for exactly `SIZE` bytes.
    fn write(&self, into: &mut [u8]);
    /// Makes it of any `SIZE` bytes.
    fn read(from: &[u8]) -> Self;
}

macro_rules! numbers {
    ($($number:ty),+) => {$(
        impl Value for $number {
            const SIZE: usize = size_of::<$number>();
            fn write(&self, into: &mut [u8]) {
                into.copy_from_slice(&self.to_le_bytes());
            }
            fn read(from: &[u8]) -> Self {
                from.try_into().map_or_else(|_| Default::default(), <$number>::from_le_bytes)
            }
        }
    )+};
}

numbers!(u8, u16, u32, u64, u128, i8, i16, i32, i64, i128, f32, f64);

impl Value for bool {
    const SIZE: usize = 1;
    fn write(&self, into: &mut [u8]) {
        u8::from(*self).write(into);
    }
    fn read(from: &[u8]) -> Self {
        u8::read(from) != 0
    }
}

impl<T: Value, const N: usize> Value for [T; N] {
    const SIZE: usize = T::SIZE * N;
    fn write(&self, into: &mut [u8]) {
        for (one, into) in self.iter().zip(into.chunks_exact_mut(T::SIZE.max(1))) {
            one.write(into);
        }
    }
    fn read(from: &[u8]) -> Self {
        std::array::from_fn(|index| T::read(&from[index * T::SIZE..(index + 1) * T::SIZE]))
    }
}

impl<A: Value, B: Value> Value for (A, B) {
    const SIZE: usize = A::SIZE + B::SIZE;
    fn write(&self, into: &mut [u8]) {
        let (first, second) = into.split_at_mut(A::SIZE);
        self.0.write(first);
        self.1.write(second);
    }
    fn read(from: &[u8]) -> Self {
        let (first, second) = from.split_at(A::SIZE);
        (A::read(first), B::read(second))
    }
}

/// A name as a number, by FNV-1a.
pub(super) fn name_of(name: &str) -> u32 {
    name.bytes().fold(0x811c_9dc5, |hash, byte| {
        (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193)
    })
}
