//! The kernel keeps the wish as long as the file is open.

use crate::shortfall::LatencyRefusal;
use nix::libc;
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Write};

/// The open device.
pub(crate) type Held = File;

const DEVICE: &str = "/dev/cpu_dma_latency";

pub(crate) fn hold() -> Result<Held, LatencyRefusal> {
    open(DEVICE)
}

fn open(path: &str) -> Result<Held, LatencyRefusal> {
    let mut device = OpenOptions::new().write(true).open(path).map_err(why)?;
    // The wish is a 32-bit number of microseconds, in the machine's byte order.
    device.write_all(&0_i32.to_ne_bytes()).map_err(why)?;
    Ok(device)
}

fn why(error: std::io::Error) -> LatencyRefusal {
    if matches!(error.raw_os_error(), Some(libc::EMFILE | libc::ENFILE)) {
        return LatencyRefusal::NoDescriptors;
    }
    match error.kind() {
        ErrorKind::NotFound => LatencyRefusal::Missing,
        ErrorKind::PermissionDenied => LatencyRefusal::NotPermitted,
        _ => LatencyRefusal::Kernel {
            message: error.to_string(),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_device_is_named_so() {
        assert_eq!(
            open("/dev/no_such_latency").unwrap_err(),
            LatencyRefusal::Missing
        );
        // A directory cannot be written to, as root either.
        assert!(matches!(
            open("/dev").unwrap_err(),
            LatencyRefusal::Kernel { .. } | LatencyRefusal::NotPermitted
        ));
    }
}
