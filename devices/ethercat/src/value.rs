//! The types of values in process data.

mod sealed {
    /// A value in process data, at a bit that the type allows.
    pub trait Field: Copy + Send + 'static {
        /// How many bits it has.
        const BITS: usize;

        /// Reads it; the place is within `from`.
        fn read(from: &[u8], bit: usize) -> Self;

        /// Writes it; the place is within `to`.
        fn write(self, to: &mut [u8], bit: usize);
    }
}

pub(crate) use sealed::Field;

/// A number in process data, in the order of bytes of EtherCAT (the lowest first): `u8` to `u64`,
/// `i8` to `i64`, `f32` and `f64`.
pub trait Value: Field {}

impl Field for bool {
    const BITS: usize = 1;

    fn read(from: &[u8], bit: usize) -> Self {
        from[bit / 8] >> (bit % 8) & 1 != 0
    }

    fn write(self, to: &mut [u8], bit: usize) {
        let mask = 1 << (bit % 8);
        let byte = &mut to[bit / 8];
        *byte = *byte & !mask | if self { mask } else { 0 };
    }
}

macro_rules! numbers {
    ($($number:ty),*) => {$(
        impl Field for $number {
            const BITS: usize = 8 * size_of::<Self>();

            fn read(from: &[u8], bit: usize) -> Self {
                let at = bit / 8;
                Self::from_le_bytes(std::array::from_fn(|index| from[at + index]))
            }

            fn write(self, to: &mut [u8], bit: usize) {
                to[bit / 8..][..size_of::<Self>()].copy_from_slice(&self.to_le_bytes());
            }
        }

        impl Value for $number {}
    )*};
}

numbers!(u8, u16, u32, u64, i8, i16, i32, i64, f32, f64);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_is_where_it_was_written_and_nowhere_else() {
        let mut bytes = [0xff; 8];
        (-2_i32).write(&mut bytes, 16);
        assert_eq!(bytes, [0xff, 0xff, 0xfe, 0xff, 0xff, 0xff, 0xff, 0xff]);
        assert_eq!(i32::read(&bytes, 16), -2);
        let mut bytes = [0; 2];
        true.write(&mut bytes, 11);
        assert_eq!(bytes, [0, 8]);
        assert!(bool::read(&bytes, 11) && !bool::read(&bytes, 10));
        false.write(&mut bytes, 11);
        assert_eq!(bytes, [0, 0]);
    }
}
