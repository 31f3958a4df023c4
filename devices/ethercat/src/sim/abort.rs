//! Why an SDO is aborted.

/// The code of it.
pub(super) type Abort = u32;

pub(super) const COMMAND: Abort = 0x0504_0001;
pub(super) const UNSUPPORTED: Abort = 0x0601_0000;
pub(super) const READ_ONLY: Abort = 0x0601_0002;
pub(super) const NOT_EMPTIED: Abort = 0x0601_0003;
pub(super) const TOO_LARGE: Abort = 0x0601_0005;
pub(super) const IS_OUTPUT: Abort = 0x0601_0006;
pub(super) const NO_OBJECT: Abort = 0x0602_0000;
pub(super) const NOT_MAPPABLE: Abort = 0x0604_0041;
pub(super) const TOO_MUCH_DATA: Abort = 0x0604_0042;
pub(super) const TOO_LONG: Abort = 0x0607_0012;
pub(super) const TOO_SHORT: Abort = 0x0607_0013;
pub(super) const NO_SUB_INDEX: Abort = 0x0609_0011;
pub(super) const VALUE: Abort = 0x0609_0030;
pub(super) const STATE: Abort = 0x0800_0022;
