//! What an SDO client makes of servers that are late, brief or not there.

use super::{id, master, node};
use crate::common::{Bench, SpawnOk, frame, watchdog};
use luna_can::canopen::sim::Access;
use luna_can::canopen::{AbortCode, NodeId, Object, SdoError};
use std::time::Duration;

const SPEED: Object = Object::new(0x2000, 1);
const NAME: Object = Object::new(0x1008, 0);
const TIMEOUT: Duration = Duration::from_millis(100);

#[test]
fn a_bus_that_takes_no_frames_holds_up_no_transfer() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let mut network = master(&mut bench);
    let mut sdo = network.sdo(id()).unwrap().timeout(TIMEOUT);
    let sender = network.sender();
    bench.main.process("master").spawn_ok(network.controller());
    let other = bench.node("other");
    let control = bench.control.clone();
    // No other node acknowledges what the master sends, so its frame waits.
    control.cut("other");
    bench.main.process("user").spawn_ok(async move {
        while sender.try_send(frame(0x123, &[])).is_ok() {
            luna::after(Duration::from_millis(1)).await;
        }
        let begin = luna::now();
        for object in [SPEED, NAME] {
            let (node, limit) = (id(), TIMEOUT);
            let error = SdoError::TimedOut {
                node,
                object,
                limit,
            };
            assert_eq!(sdo.upload(object).await, Err(error));
        }
        assert_eq!(luna::now() - begin, 2 * TIMEOUT);
        control.connect("other");
        drop(other);
        Ok(())
    });
    bench.run().unwrap();
}

#[test]
fn a_node_has_one_client() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let mut network = master(&mut bench);
    let other = NodeId::new(6).unwrap();
    assert!(network.sdo(id()).is_ok() && network.sdo(other).is_ok());
    let error = network.sdo(id()).unwrap_err();
    assert_eq!(error, SdoError::HasClient { node: id() });
}

#[test]
fn a_size_that_is_not_stated_is_that_of_the_type() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let server = bench.node("server");
    let mut network = master(&mut bench);
    let mut sdo = network.sdo(id()).unwrap();
    bench.main.process("master").spawn_ok(network.controller());
    let [low, high] = SPEED.index.to_le_bytes();
    bench.main.process("answers").spawn_ok(async move {
        for _ in 0..3 {
            server.received.recv().await?;
            let answer = [0x42, low, high, SPEED.sub, 0xFD, 0xFF, 1, 0];
            let answer = frame(id().sdo_response(), &answer);
            server.send.send(answer).await?;
        }
        drop(server);
        Ok(())
    });
    bench.main.process("user").spawn_ok(async move {
        assert_eq!(sdo.read::<i16>(SPEED).await?, -3);
        assert_eq!(sdo.read::<u32>(SPEED).await?, 0x1_FFFD);
        assert_eq!(sdo.upload(SPEED).await?, [0xFD, 0xFF, 1, 0]);
        Ok(())
    });
    bench.run().unwrap();
}

#[test]
fn a_simulated_node_takes_a_value_whose_size_is_not_stated() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let control = node(&mut bench, |node| {
        node.object(SPEED, 0_i16, Access::ReadWrite)
    });
    let client = bench.node("client");
    bench.main.process("user").spawn_ok(async move {
        let [low, high] = SPEED.index.to_le_bytes();
        let request = [0x22, low, high, SPEED.sub, 0xFD, 0xFF, 9, 9];
        let request = frame(id().sdo_request(), &request);
        client.send.send(request).await?;
        while client.received.recv().await?.data()[0] != 0x60 {}
        assert_eq!(control.get::<i16>(SPEED), Some(-3));
        drop(client);
        Ok(())
    });
    bench.run().unwrap();
}

#[test]
fn a_late_answer_is_for_no_other_request() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let server = bench.node("server");
    let mut network = master(&mut bench);
    let mut sdo = network.sdo(id()).unwrap().timeout(TIMEOUT);
    bench.main.process("master").spawn_ok(network.controller());
    let [low, high] = SPEED.index.to_le_bytes();
    let written = [0x60, low, high, SPEED.sub, 0, 0, 0, 0];
    let refused = [0x80, low, high, SPEED.sub, 0, 0, 0, 8];
    let refused_other = [0x80, 0x08, 0x10, 0, 0x05, 0x00, 0x04, 0x05];
    bench.main.process("answers").spawn_ok(async move {
        let answer = async |data: &[u8]| server.send.send(frame(id().sdo_response(), data)).await;
        // The first write is confirmed when it was given up, and the client has said so.
        server.received.recv().await?;
        assert_eq!(server.received.recv().await?.data()[0], 0x80);
        luna::after(TIMEOUT / 2).await;
        answer(&written).await?;
        // The second is refused, after an abort for another object.
        assert_eq!(server.received.recv().await?.data()[4], 200);
        answer(&refused_other).await?;
        answer(&refused).await?;
        drop(server);
        Ok(())
    });
    bench.main.process("user").spawn_ok(async move {
        let first = sdo.write(SPEED, 100_i16).await;
        assert!(matches!(first, Err(SdoError::TimedOut { .. })), "{first:?}");
        let (node, object, code) = (id(), SPEED, AbortCode::GENERAL);
        let error = SdoError::Aborted { node, object, code };
        assert_eq!(sdo.write(SPEED, 200_i16).await, Err(error));
        Ok(())
    });
    bench.run().unwrap();
}
