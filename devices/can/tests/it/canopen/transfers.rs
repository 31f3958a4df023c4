//! SDO transfers with a simulated node, and with a server against the protocol.

use super::{id, master, node};
use crate::common::{Bench, Node, SpawnOk, frame, watchdog};
use luna_can::canopen::sim::Access;
use luna_can::canopen::{AbortCode, Object, SdoClient, SdoError};
use proptest::prelude::*;
use std::time::Duration;

const SPEED: Object = Object::new(0x2000, 1);
const LIMIT: Object = Object::new(0x2000, 2);
const SECRET: Object = Object::new(0x2000, 3);
const NAME: Object = Object::new(0x1008, 0);
const PROGRAM: Object = Object::new(0x1F50, 1);
const TIMEOUT: Duration = Duration::from_millis(100);

/// A bus with a node and a client for it.
fn with_node() -> (Bench, luna_can::canopen::sim::NodeControl, SdoClient) {
    let mut bench = Bench::new();
    let control = node(&mut bench, |node| {
        node.object(SPEED, 0_i16, Access::ReadWrite)
            .object(LIMIT, 7.5_f32, Access::ReadOnly)
            .object(SECRET, 0_u8, Access::WriteOnly)
            .bytes(NAME, b"a drive with a long name", Access::ReadOnly)
            .bytes(PROGRAM, &[], Access::ReadWrite)
    });
    let mut network = master(&mut bench);
    let sdo = network.sdo(id()).unwrap().timeout(TIMEOUT);
    bench.main.process("master").spawn_ok(network.controller());
    (bench, control, sdo)
}

#[test]
fn values_are_read_and_written_by_one_frame_or_in_segments() {
    let _watch = watchdog();
    let (mut bench, control, mut sdo) = with_node();
    bench.main.process("user").spawn_ok(async move {
        assert_eq!(sdo.read::<f32>(LIMIT).await?, 7.5);
        sdo.write(SPEED, -3_i16).await?;
        assert_eq!(control.get::<i16>(SPEED), Some(-3));
        assert_eq!(sdo.read::<i16>(SPEED).await?, -3);
        sdo.write(SECRET, 9_u8).await?;
        assert_eq!(control.get::<u8>(SECRET), Some(9));
        assert_eq!(sdo.upload(NAME).await?, b"a drive with a long name");
        for len in [0, 1, 4, 5, 7, 8, 14, 15, 1_000] {
            let program: Vec<u8> = (0..len).map(|number| number as u8).collect();
            sdo.download(PROGRAM, &program).await?;
            assert_eq!(control.bytes(PROGRAM), Some(program.clone()));
            assert_eq!(sdo.upload(PROGRAM).await?, program, "{len}");
        }
        Ok(())
    });
    bench.run().unwrap();
}

#[test]
fn what_a_node_refuses_has_a_name() {
    let _watch = watchdog();
    let (mut bench, _control, mut sdo) = with_node();
    bench.main.process("user").spawn_ok(async move {
        let code = |result: Result<(), SdoError>| match result {
            Err(SdoError::Aborted { code, .. }) => code,
            other => panic!("{other:?}"),
        };
        let none = Object::new(0x3000, 0);
        assert_eq!(code(sdo.write(none, 0_u8).await), AbortCode::NO_OBJECT);
        assert_eq!(code(sdo.upload(none).await.map(drop)), AbortCode::NO_OBJECT);
        let no_sub = Object::new(0x2000, 9);
        assert_eq!(code(sdo.write(no_sub, 0_u8).await), AbortCode::NO_SUBINDEX);
        assert_eq!(code(sdo.write(LIMIT, 0_f32).await), AbortCode::READ_ONLY);
        assert_eq!(
            code(sdo.download(NAME, &[1; 9]).await),
            AbortCode::READ_ONLY
        );
        assert_eq!(
            code(sdo.upload(SECRET).await.map(drop)),
            AbortCode::WRITE_ONLY
        );
        assert_eq!(code(sdo.write(SPEED, 0_u32).await), AbortCode::WRONG_LENGTH);
        assert_eq!(
            code(sdo.download(SPEED, &[0; 8]).await),
            AbortCode::WRONG_LENGTH
        );
        let error = sdo.read::<u32>(SPEED).await.unwrap_err();
        let (node, object, len, expected) = (id(), SPEED, 2, 4);
        assert_eq!(
            error,
            SdoError::Length {
                node,
                object,
                len,
                expected
            }
        );
        let error = sdo.write(none, 0_u8).await.unwrap_err().to_string();
        let expected =
            "node 5 aborts the transfer of 3000h:00h: the object does not exist (06020000h)";
        assert_eq!(error, expected);
        // It goes on as if nothing had been.
        assert_eq!(sdo.read::<f32>(LIMIT).await?, 7.5);
        drop(_control);
        Ok(())
    });
    bench.run().unwrap();
}

#[test]
fn without_an_answer_a_transfer_times_out_and_the_next_is_as_usual() {
    let _watch = watchdog();
    let (mut bench, control, mut sdo) = with_node();
    let bus = bench.control.clone();
    let listener = bench.node("listener");
    let (go, gone) = luna::channel();
    bench.main.process("user").spawn_ok(async move {
        assert_eq!(sdo.read::<i16>(SPEED).await?, 0);
        bus.cut("node");
        let begin = luna::now();
        let error = sdo.read::<i16>(SPEED).await.unwrap_err();
        let (node, object, limit) = (id(), SPEED, TIMEOUT);
        assert_eq!(
            error,
            SdoError::TimedOut {
                node,
                object,
                limit
            }
        );
        assert_eq!(luna::now() - begin, TIMEOUT);
        bus.connect("node");
        assert_eq!(sdo.read::<i16>(SPEED).await?, 0);
        // An answer that is lost in the middle of a long value.
        go.send(()).await?;
        assert!(matches!(
            sdo.upload(NAME).await,
            Err(SdoError::TimedOut { .. })
        ));
        let begun = luna::now();
        assert_eq!(sdo.upload(NAME).await?, b"a drive with a long name");
        assert!(luna::now() - begun >= TIMEOUT);
        drop(control);
        Ok(())
    });
    let (bus, lost) = (bench.control.clone(), std::sync::mpsc::channel());
    bench.main.process("loser").spawn_ok(async move {
        gone.recv().await?;
        while listener.received.try_recv().is_ok() {}
        // The answer to the begin says the size, the next one is a segment: the second is lost.
        for command in [0x40, 0x41, 0x60, 0x00, 0x70] {
            let seen = listener.received.recv().await?;
            lost.0.send(seen.data()[0] == command).unwrap();
        }
        bus.lose("master", 1);
        drop(listener);
        Ok(())
    });
    bench.run().unwrap();
    assert_eq!(lost.1.try_iter().collect::<Vec<_>>(), [true; 5]);
}

/// Answers each request of a client with the next of these bytes, and returns the last frame
/// that it received.
async fn answer(server: &Node, answers: &[[u8; 8]]) -> luna::Result<[u8; 8]> {
    for answer in answers {
        server.received.recv().await?;
        server.send.send(frame(id().sdo_response(), answer)).await?;
    }
    let last = server.received.recv().await?;
    Ok(last.data().try_into().unwrap())
}

#[test]
fn a_server_against_the_protocol_is_told_and_the_transfer_ends() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let server = bench.node("server");
    let mut network = master(&mut bench);
    let mut sdo = network.sdo(id()).unwrap().timeout(TIMEOUT).longest(100);
    bench.main.process("master").spawn_ok(network.controller());
    let begin = |size: u8| [0x41, 0x08, 0x10, 0, size, 0, 0, 0];
    let cases: Vec<(Vec<[u8; 8]>, AbortCode)> = vec![
        // A command that there is not.
        (
            vec![[0xE0, 0, 0, 0, 0, 0, 0, 0]],
            AbortCode::UNKNOWN_COMMAND,
        ),
        // An answer to a write, and the answer for another object.
        (
            vec![[0x60, 0x08, 0x10, 0, 0, 0, 0, 0]],
            AbortCode::UNKNOWN_COMMAND,
        ),
        (
            vec![[0x4F, 0x09, 0x10, 0, 1, 0, 0, 0]],
            AbortCode::UNKNOWN_COMMAND,
        ),
        // More than is wanted.
        (vec![begin(101)], AbortCode::OUT_OF_MEMORY),
        // The wrong toggle bit, in the first segment and in the second.
        (
            vec![begin(20), [0x10, 1, 2, 3, 4, 5, 6, 7]],
            AbortCode::TOGGLE,
        ),
        (vec![begin(20), [0; 8], [0; 8]], AbortCode::TOGGLE),
        // More than was said, and less.
        (vec![begin(3), [0; 8]], AbortCode::TOO_LONG),
        (
            vec![begin(20), [1, 0, 0, 0, 0, 0, 0, 0]],
            AbortCode::WRONG_LENGTH,
        ),
        // Segments without data, which could go on for ever.
        (
            vec![
                [0x40, 0x08, 0x10, 0, 0, 0, 0, 0],
                [0x0E, 0, 0, 0, 0, 0, 0, 0],
            ],
            AbortCode::UNKNOWN_COMMAND,
        ),
        // An answer to another request in the middle.
        (
            vec![begin(20), [0x60, 0x08, 0x10, 0, 0, 0, 0, 0]],
            AbortCode::UNKNOWN_COMMAND,
        ),
    ];
    let expected: Vec<AbortCode> = cases.iter().map(|(_, code)| *code).collect();
    bench.main.process("answers").spawn_ok(async move {
        for (answers, code) in cases {
            let last = answer(&server, &answers).await?;
            assert_eq!(last[..4], [0x80, 0x08, 0x10, 0]);
            assert_eq!(last[4..], code.0.to_le_bytes());
        }
        Ok(())
    });
    bench.main.process("user").spawn_ok(async move {
        for code in expected {
            let error = sdo.upload(NAME).await.unwrap_err();
            let (node, object) = (id(), NAME);
            assert_eq!(error, SdoError::Protocol { node, object, code });
        }
        Ok(())
    });
    bench.run().unwrap();
}

#[test]
fn frames_of_another_length_are_no_answers_and_end_no_transfer() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let server = bench.node("server");
    let mut network = master(&mut bench);
    let mut sdo = network.sdo(id()).unwrap().timeout(TIMEOUT);
    bench.main.process("master").spawn_ok(network.controller());
    bench.main.process("answers").spawn_ok(async move {
        server.received.recv().await?;
        let answer = [0x4B, 0x00, 0x20, 1, 7, 0, 0, 0];
        for len in 0..=8 {
            let frame = frame(id().sdo_response(), &answer[..len]);
            server.send.send(frame).await?;
        }
        Ok(())
    });
    bench.main.process("user").spawn_ok(async move {
        assert_eq!(sdo.read::<i16>(SPEED).await?, 7);
        Ok(())
    });
    bench.run().unwrap();
}

/// Bytes that are near to those of a server, in part.
fn answers() -> impl Strategy<Value = Vec<[u8; 8]>> {
    let commands = prop::sample::select(vec![
        0x00, 0x01, 0x10, 0x20, 0x30, 0x40, 0x41, 0x43, 0x60, 0x80, 0xE0,
    ]);
    let near = (commands, any::<bool>(), 0..40_u8, any::<[u8; 4]>()).prop_map(
        |(command, is_alike, size, data)| match is_alike {
            true => [command, 0x08, 0x10, 0, size, 0, 0, 0],
            false => [command, data[0], data[1], data[2], data[3], 0, 0, 0],
        },
    );
    prop::collection::vec(prop_oneof![near, any::<[u8; 8]>()], 0..12)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever a server answers, a transfer ends, and with an answer or an error.
    #[test]
    fn a_transfer_ends_whatever_is_answered(answers in answers(), is_read: bool) {
        let _watch = watchdog();
        let mut bench = Bench::new();
        let server = bench.node("server");
        let mut network = master(&mut bench);
        let mut sdo = network.sdo(id()).unwrap().timeout(TIMEOUT).longest(100);
        bench.main.process("master").spawn_ok(network.controller());
        bench.main.process("answers").spawn_ok(async move {
            for answer in answers {
                if server.received.recv_timeout(10 * TIMEOUT).await.is_err() {
                    break;
                }
                server.send.send(frame(id().sdo_response(), &answer)).await?;
            }
            Ok(())
        });
        bench.main.process("user").spawn_ok(async move {
            let begin = luna::now();
            let read = match is_read {
                true => sdo.upload(NAME).await,
                false => sdo.download(NAME, &[7; 30]).await.map(|()| Vec::new()),
            };
            if let Ok(bytes) = read {
                assert!(bytes.len() <= 100);
            }
            assert!(luna::now() - begin < 2 * TIMEOUT);
            Ok(())
        });
        bench.run().unwrap();
    }
}
