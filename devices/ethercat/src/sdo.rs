//! Objects of a subdevice that are written and compared over its mailbox, at set-up.

use crate::Expected;
use crate::bus::{Failed, Group, block_on};
use crate::error::{OpenError, SdoError};
use crate::exchange::{Broken, Exchange};
use ethercrab::MainDevice;
use ethercrab::error::{Error, MailboxError};
use ethercrab::subdevice_group::PreOp;
use std::fmt;

/// The value of an object of 1, 2 or 4 bytes: made of a number of that type.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SdoValue {
    /// UNSIGNED8.
    U8(u8),
    /// UNSIGNED16.
    U16(u16),
    /// UNSIGNED32.
    U32(u32),
    /// INTEGER8.
    I8(i8),
    /// INTEGER16.
    I16(i16),
    /// INTEGER32.
    I32(i32),
}

macro_rules! conversions {
    ($($name:ident $number:ident $bits:ident),*) => {
        $(impl From<$number> for SdoValue {
            fn from(number: $number) -> Self {
                Self::$name(number)
            }
        })*

        impl SdoValue {
            /// How many bytes it has.
            pub(crate) const fn size(self) -> usize {
                match self {
                    $(Self::$name(_) => size_of::<$number>(),)*
                }
            }

            /// Its bytes, the lowest first; zeros after them.
            pub(crate) fn bytes(self) -> [u8; 4] {
                let mut bytes = [0; 4];
                match self {
                    $(Self::$name(number) => {
                        bytes[..size_of::<$number>()].copy_from_slice(&number.to_le_bytes());
                    })*
                }
                bytes
            }

            /// A value of the same type with these bytes.
            pub(crate) fn with(self, bytes: [u8; 4]) -> Self {
                let bits = u32::from_le_bytes(bytes);
                match self {
                    $(Self::$name(_) => Self::$name(bits as $bits as $number),)*
                }
            }
        }

        impl fmt::Display for SdoValue {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                match self {
                    $(Self::$name(number) => {
                        write!(f, concat!("{} ({:#x}, ", stringify!($number), ")"), number, number)
                    })*
                }
            }
        }
    };
}

conversions!(U8 u8 u8, U16 u16 u16, U32 u32 u32, I8 i8 u8, I16 i16 u16, I32 i32 u32);

/// An object that is to be written, or to be compared, at set-up: see [`Expected::sdo`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub struct Sdo {
    /// The object's index.
    pub index: u16,
    /// The index within the object.
    pub sub: u8,
    /// What is written, or is to be there.
    pub value: SdoValue,
    /// Whether it is only compared.
    pub is_check: bool,
}

impl fmt::Display for Sdo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            index, sub, value, ..
        } = self;
        let verb = if self.is_check { "is to be" } else { "=" };
        write!(f, "{index:#06x}:{sub:02x} {verb} {value}")
    }
}

/// Writes and compares what is listed for each subdevice, in order.
pub(crate) fn configure(
    main: &MainDevice<'static>,
    exchange: &mut Exchange,
    group: &Group<PreOp>,
    expected: &[Expected],
) -> Result<(), OpenError> {
    for (position, expected) in expected.iter().enumerate() {
        for sdo in &expected.sdos {
            let doing = Box::pin(transfer(main, group, position, *sdo));
            let error = match block_on(exchange, doing) {
                Ok(there) if sdo.is_check && there != sdo.value => SdoError::Differs { there },
                Ok(_) => continue,
                Err(Failed::Emergency) => SdoError::OtherMessage,
                Err(Failed::Broken(Broken::System(error))) => SdoError::System(error),
                Err(Failed::Broken(Broken::Panicked(text))) => SdoError::Panicked(text),
                Err(Failed::Bus(error)) => error.into(),
            };
            return Err(OpenError::Sdo {
                position,
                name: expected.name.clone(),
                sdo: *sdo,
                error,
            });
        }
    }
    Ok(())
}

/// Returns what was written, or is there.
async fn transfer(
    main: &MainDevice<'static>,
    group: &Group<PreOp>,
    position: usize,
    sdo: Sdo,
) -> Result<SdoValue, Error> {
    let Sdo {
        index, sub, value, ..
    } = sdo;
    let subdevice = group.subdevice(main, position)?;
    let bytes = value.bytes();
    let [first, second, ..] = bytes;
    if sdo.is_check {
        let mut there = [0; 4];
        match value.size() {
            1 => there[..1].copy_from_slice(&subdevice.sdo_read::<[u8; 1]>(index, sub).await?),
            2 => there[..2].copy_from_slice(&subdevice.sdo_read::<[u8; 2]>(index, sub).await?),
            _ => there = subdevice.sdo_read::<[u8; 4]>(index, sub).await?,
        }
        return Ok(value.with(there));
    }
    match value.size() {
        1 => subdevice.sdo_write(index, sub, first).await?,
        2 => {
            let both = u16::from_le_bytes([first, second]);
            subdevice.sdo_write(index, sub, both).await?;
        }
        _ => {
            let all = u32::from_le_bytes(bytes);
            subdevice.sdo_write(index, sub, all).await?;
        }
    }
    Ok(value)
}

impl From<Error> for SdoError {
    fn from(error: Error) -> Self {
        match error {
            Error::Mailbox(MailboxError::NoReadMailbox | MailboxError::NoWriteMailbox) => {
                Self::NoMailbox
            }
            Error::Mailbox(MailboxError::Aborted { code, .. }) => {
                // The library's text begins with the number.
                let text = code.to_string();
                let reason = text.split_once(": ").map_or("", |(_, reason)| reason);
                Self::Aborted {
                    code: code.into(),
                    reason: reason.trim().to_owned(),
                }
            }
            Error::Timeout(_) => Self::Silent,
            // An emergency's code is read as a command.
            Error::Wire(_)
            | Error::Mailbox(
                MailboxError::Emergency { .. } | MailboxError::SdoResponseInvalid { .. },
            ) => Self::OtherMessage,
            other => Self::Bus(other.to_string()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_keeps_its_type_and_its_sign() {
        let value = SdoValue::from(-2_i16);
        assert_eq!((value.size(), value.bytes()), (2, [0xfe, 0xff, 0, 0]));
        assert_eq!(SdoValue::I16(0).with(value.bytes()), value);
        assert_eq!(value.to_string(), "-2 (0xfffe, i16)");
        assert_eq!(SdoValue::U8(0).with([9, 8, 7, 6]), SdoValue::U8(9));
    }
}
