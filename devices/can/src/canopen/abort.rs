//! Why a transfer is aborted.

use std::fmt;

/// The code of an aborted SDO transfer.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct AbortCode(pub u32);

macro_rules! codes {
    ($($name:ident = $code:literal, $text:literal;)*) => {
        impl AbortCode {
            $(
                #[doc = concat!("`", stringify!($code), "`: ", $text, ".")]
                pub const $name: AbortCode = AbortCode($code);
            )*

            /// What it means; none for a code that the standard does not have.
            pub const fn meaning(self) -> Option<&'static str> {
                match self.0 {
                    $($code => Some($text),)*
                    _ => None,
                }
            }
        }
    };
}

codes! {
    TOGGLE = 0x0503_0000, "the toggle bit has not changed";
    TIMED_OUT = 0x0504_0000, "the transfer has timed out";
    UNKNOWN_COMMAND = 0x0504_0001, "the command is not valid or unknown";
    BLOCK_SIZE = 0x0504_0002, "invalid block size";
    SEQUENCE_NUMBER = 0x0504_0003, "invalid sequence number";
    CRC = 0x0504_0004, "wrong checksum";
    OUT_OF_MEMORY = 0x0504_0005, "out of memory";
    UNSUPPORTED_ACCESS = 0x0601_0000, "the object cannot be accessed so";
    WRITE_ONLY = 0x0601_0001, "the object can only be written";
    READ_ONLY = 0x0601_0002, "the object can only be read";
    NO_OBJECT = 0x0602_0000, "the object does not exist";
    NOT_MAPPABLE = 0x0604_0041, "the object cannot be mapped to a PDO";
    PDO_TOO_LONG = 0x0604_0042, "the mapped objects are longer than a PDO";
    INCOMPATIBLE_PARAMETERS = 0x0604_0043, "the parameters are incompatible";
    INCOMPATIBLE_DEVICE = 0x0604_0047, "the parameters do not fit the device";
    HARDWARE = 0x0606_0000, "the hardware has failed";
    WRONG_LENGTH = 0x0607_0010, "the value has another length";
    TOO_LONG = 0x0607_0012, "the value is too long";
    TOO_SHORT = 0x0607_0013, "the value is too short";
    NO_SUBINDEX = 0x0609_0011, "the sub-index does not exist";
    INVALID_VALUE = 0x0609_0030, "the value is not valid";
    TOO_HIGH = 0x0609_0031, "the value is too high";
    TOO_LOW = 0x0609_0032, "the value is too low";
    MAXIMUM_BELOW_MINIMUM = 0x0609_0036, "the maximum is less than the minimum";
    NO_CONNECTION = 0x060A_0023, "the resource is not available";
    GENERAL = 0x0800_0000, "a general error";
    NOT_STORED = 0x0800_0020, "the data cannot be transferred or stored";
    LOCAL_CONTROL = 0x0800_0021, "the data cannot be transferred: local control";
    DEVICE_STATE = 0x0800_0022, "the data cannot be transferred in this state of the device";
    NO_DICTIONARY = 0x0800_0023, "there is no object dictionary";
    NO_DATA = 0x0800_0024, "there is no data";
}

impl fmt::Display for AbortCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let meaning = self.meaning().unwrap_or("no code of the standard");
        write!(f, "{meaning} ({:08X}h)", self.0)
    }
}

impl fmt::Debug for AbortCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "AbortCode({self})")
    }
}
