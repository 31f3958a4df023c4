//! Messages as bytes: round trips, and any frame.

use luna_can::Frame;
use luna_can::canopen::{Emergency, Heartbeat, NmtCommand, NmtState, NodeId, PdoValue};
use proptest::prelude::*;

fn nodes() -> impl Strategy<Value = NodeId> {
    (1..=127_u8).prop_map(|number| NodeId::new(number).unwrap())
}

fn frames() -> impl Strategy<Value = Frame> {
    let data = prop::collection::vec(any::<u8>(), 0..=8);
    (any::<bool>(), 0..0x800_u16, data).prop_map(|(is_short, id, data)| match is_short {
        true => Frame::standard(id, &data).unwrap(),
        false => Frame::extended(id.into(), &data).unwrap(),
    })
}

#[test]
fn identifiers_are_those_of_the_standard() {
    let node = NodeId::new(5).unwrap();
    assert_eq!((node.emergency(), node.heartbeat()), (0x85, 0x705));
    assert_eq!((node.sdo_request(), node.sdo_response()), (0x605, 0x585));
    assert_eq!((node.tpdo(1), node.tpdo(4)), (Some(0x185), Some(0x485)));
    assert_eq!((node.rpdo(1), node.rpdo(4)), (Some(0x205), Some(0x505)));
    assert_eq!((node.tpdo(0), node.rpdo(5)), (None, None));
    assert_eq!((NodeId::new(0), NodeId::new(128)), (None, None));
}

#[test]
fn an_emergency_says_what_it_is() {
    let frame = Frame::standard(0x85, &[0x10, 0x42, 8, 1, 2, 3, 4, 5]).unwrap();
    let message = Emergency::decode(&frame).unwrap();
    assert_eq!((message.code, message.register), (0x4210, 8));
    assert_eq!(message.data, [1, 2, 3, 4, 5]);
    assert_eq!(message.to_string(), "node 5: 4210h, device temperature");
    assert!(!message.is_reset());
}

proptest! {
    #[test]
    fn any_frame_is_decoded(frame in frames()) {
        if let Some(beat) = Heartbeat::decode(&frame) {
            prop_assert_eq!(Heartbeat::decode(&beat.frame()), Some(beat));
        }
        if let Some((command, to)) = NmtCommand::decode(&frame) {
            prop_assert_eq!(command.frame(to), frame);
        }
        if let Some(message) = Emergency::decode(&frame) {
            prop_assert_eq!(message.frame(), frame);
        }
        let _ = (u64::decode(frame.data()), bool::decode(frame.data()));
        if let Some(value) = <(u16, i8, bool)>::decode(frame.data()) {
            let mut bytes = [0; 4];
            value.encode(&mut bytes);
            prop_assert_eq!(&bytes[..], frame.data());
        }
    }

    #[test]
    fn messages_come_back(node in nodes(), code: u16, register: u8, data: [u8; 5]) {
        let message = Emergency { node, code, register, data };
        prop_assert_eq!(Emergency::decode(&message.frame()), Some(message));
        for state in [NmtState::BootUp, NmtState::Stopped, NmtState::PreOperational, NmtState::Operational] {
            let beat = Heartbeat { node, state };
            prop_assert_eq!(Heartbeat::decode(&beat.frame()), Some(beat));
        }
        for command in [
            NmtCommand::Start,
            NmtCommand::Stop,
            NmtCommand::EnterPreOperational,
            NmtCommand::ResetNode,
            NmtCommand::ResetCommunication,
        ] {
            for to in [None, Some(node)] {
                prop_assert_eq!(NmtCommand::decode(&command.frame(to)), Some((command, to)));
            }
        }
    }

    #[test]
    fn process_data_comes_back(value: (u16, i32, bool, i8), float: f64) {
        let mut bytes = [0; 8];
        value.encode(&mut bytes);
        prop_assert_eq!(<(u16, i32, bool, i8)>::decode(&bytes), Some(value));
        prop_assert_eq!(<(u16, i32, bool, i8)>::decode(&bytes[..7]), None);
        PdoValue::encode(&float, &mut bytes);
        let back: Option<f64> = PdoValue::decode(&bytes);
        prop_assert_eq!(back.map(f64::to_bits), Some(float.to_bits()));
    }
}
