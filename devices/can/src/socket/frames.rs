//! Frames of the kernel as bytes: data, remote and error frames.

use crate::{BusError, BusReport, Frame, Incoming, State};
use embedded_can::{ExtendedId, StandardId};

/// The kernel's `struct can_frame`.
pub(super) fn decode(bytes: &[u8; 16]) -> Option<Incoming> {
    let [a, b, c, d, len, _, _, _, data @ ..] = *bytes;
    let id = u32::from_ne_bytes([a, b, c, d]);
    let len = usize::from(len).min(8);
    if id & libc::CAN_ERR_FLAG != 0 {
        let report = report(id & libc::CAN_ERR_MASK, &data);
        return Some(Incoming::Report(report));
    }
    let is_remote = id & libc::CAN_RTR_FLAG != 0;
    let id: embedded_can::Id = match id & libc::CAN_EFF_FLAG {
        0 => StandardId::new((id & libc::CAN_SFF_MASK) as u16)?.into(),
        _ => ExtendedId::new(id & libc::CAN_EFF_MASK)?.into(),
    };
    let frame = match is_remote {
        true => Frame::remote(id, len),
        false => Frame::new(id, &data[..len]),
    };
    frame.map(Incoming::Frame)
}

/// What an error frame says, by its classes (`linux/can/error.h`). It is decoded here, since the
/// list of causes that `socketcan` makes of one is on the heap when they are more than two.
fn report(classes: u32, data: &[u8; 8]) -> BusReport {
    let mut report = BusReport::default();
    let has = |class: u32| classes & class != 0;
    if has(libc::CAN_ERR_CRTL) {
        let problems = i32::from(data[1]);
        let has = |some: i32| problems & some != 0;
        report.lost = has(libc::CAN_ERR_CRTL_RX_OVERFLOW | libc::CAN_ERR_CRTL_TX_OVERFLOW).into();
        report.state = if has(libc::CAN_ERR_CRTL_RX_PASSIVE | libc::CAN_ERR_CRTL_TX_PASSIVE) {
            Some(State::Passive)
        } else if has(libc::CAN_ERR_CRTL_RX_WARNING | libc::CAN_ERR_CRTL_TX_WARNING) {
            Some(State::Warning)
        } else if has(libc::CAN_ERR_CRTL_ACTIVE) {
            Some(State::Active)
        } else {
            None
        };
    }
    if has(libc::CAN_ERR_BUSOFF) {
        report.state = Some(State::BusOff);
    }
    if has(libc::CAN_ERR_RESTARTED) {
        report.state = Some(State::Active);
    }
    // A frame that has lost arbitration is sent again: no error.
    report.error = if has(libc::CAN_ERR_ACK) {
        Some(BusError::NotAcknowledged)
    } else if has(libc::CAN_ERR_TRX) {
        Some(BusError::Transceiver)
    } else if has(libc::CAN_ERR_PROT) {
        Some(BusError::Protocol)
    } else if has(libc::CAN_ERR_TX_TIMEOUT) {
        Some(BusError::TransmitTimeout)
    } else if has(libc::CAN_ERR_BUSERROR) || classes & !KNOWN != 0 || classes == 0 {
        Some(BusError::Other)
    } else {
        None
    };
    report
}

/// The classes of error frames that have a meaning here.
const KNOWN: u32 = libc::CAN_ERR_TX_TIMEOUT
    | libc::CAN_ERR_LOSTARB
    | libc::CAN_ERR_CRTL
    | libc::CAN_ERR_PROT
    | libc::CAN_ERR_TRX
    | libc::CAN_ERR_ACK
    | libc::CAN_ERR_BUSOFF
    | libc::CAN_ERR_BUSERROR
    | libc::CAN_ERR_RESTARTED
    | libc::CAN_ERR_CNT;

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn kernel(id: u32, data: &[u8]) -> [u8; 16] {
        let mut bytes = [0; 16];
        bytes[..4].copy_from_slice(&id.to_ne_bytes());
        bytes[4] = data.len() as u8;
        bytes[8..8 + data.len()].copy_from_slice(data);
        bytes
    }

    #[test]
    fn frames_of_the_kernel_are_decoded() {
        let plain = Frame::standard(0x123, &[1, 2]).unwrap();
        let decoded = decode(&kernel(0x123, &[1, 2]));
        assert_eq!(decoded, Some(Incoming::Frame(plain)));
        let long = Frame::extended(0x1234_5678, &[3]).unwrap();
        let decoded = decode(&kernel(0x1234_5678 | libc::CAN_EFF_FLAG, &[3]));
        assert_eq!(decoded, Some(Incoming::Frame(long)));
        let request = Frame::remote(StandardId::new(5).unwrap(), 4).unwrap();
        let decoded = decode(&kernel(5 | libc::CAN_RTR_FLAG, &[0; 4]));
        assert_eq!(decoded, Some(Incoming::Frame(request)));
    }

    #[test]
    fn error_frames_of_the_kernel_are_reports() {
        let decoded = |id: u32, data: [u8; 8]| match decode(&kernel(id | libc::CAN_ERR_FLAG, &data))
        {
            Some(Incoming::Report(report)) => report,
            other => panic!("{other:?}"),
        };
        let off = decoded(libc::CAN_ERR_BUSOFF, [0; 8]);
        assert_eq!(off, BusReport::new(Some(State::BusOff), 0, None));
        let passive = decoded(
            libc::CAN_ERR_CRTL | libc::CAN_ERR_CNT,
            [0, 0x10, 0, 0, 0, 0, 1, 129],
        );
        assert_eq!(passive, BusReport::new(Some(State::Passive), 0, None));
        let alone = decoded(libc::CAN_ERR_ACK, [0; 8]);
        let error = Some(BusError::NotAcknowledged);
        assert_eq!(alone, BusReport::new(None, 0, error));
        let overrun = decoded(libc::CAN_ERR_CRTL, [0, 1, 0, 0, 0, 0, 0, 0]);
        assert_eq!(overrun, BusReport::new(None, 1, None));
        let back = decoded(libc::CAN_ERR_RESTARTED, [0; 8]);
        assert_eq!(back, BusReport::new(Some(State::Active), 0, None));
        // Many causes at once: a wrong bit, no acknowledgement, counters, and a state.
        let classes = libc::CAN_ERR_PROT | libc::CAN_ERR_ACK | libc::CAN_ERR_BUSERROR;
        let classes = classes | libc::CAN_ERR_CRTL | libc::CAN_ERR_CNT;
        let many = decoded(classes, [0, 0x04, 1, 0, 0, 0, 97, 0]);
        assert_eq!(many, BusReport::new(Some(State::Warning), 0, error));
        for (class, error) in [
            (libc::CAN_ERR_LOSTARB, None),
            (libc::CAN_ERR_CNT, None),
            (libc::CAN_ERR_PROT, Some(BusError::Protocol)),
            (libc::CAN_ERR_TRX, Some(BusError::Transceiver)),
            (libc::CAN_ERR_TX_TIMEOUT, Some(BusError::TransmitTimeout)),
            (libc::CAN_ERR_BUSERROR, Some(BusError::Other)),
            (1 << 20, Some(BusError::Other)),
            (0, Some(BusError::Other)),
        ] {
            let report = BusReport::new(None, 0, error);
            assert_eq!(decoded(class, [0; 8]), report, "{class:X}");
        }
    }

    proptest! {
        #[test]
        fn any_bytes_of_the_kernel_are_decoded(bytes: [u8; 16]) {
            let _ = decode(&bytes);
        }

        #[test]
        fn what_is_sent_is_what_comes(id in 0..0x2000_0000_u32, is_long: bool, data in prop::collection::vec(any::<u8>(), 0..=8)) {
            let (frame, raw) = match is_long {
                true => (Frame::extended(id, &data), id | libc::CAN_EFF_FLAG),
                false => (Frame::standard((id & 0x7FF) as u16, &data), id & 0x7FF),
            };
            prop_assert_eq!(decode(&kernel(raw, &data)), frame.map(Incoming::Frame));
        }
    }
}
