//! Network management, heartbeats and EMCY messages.

use super::{id, master, node};
use crate::common::{Bench, SpawnOk, watchdog};
use luna::End;
use luna::prelude::*;
use luna_can::canopen::sim::Access;
use luna_can::canopen::{
    Emergency, Heartbeat, HeartbeatMissed, NmtCommand, NmtState, NodeEvent, NodeId, Object,
    OnMissed,
};
use luna_can::{Filter, Frame};
use std::time::Duration;

const LIMIT: Duration = Duration::from_millis(250);

#[test]
fn a_node_is_commanded_and_its_heartbeat_says_so() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let control = node(&mut bench, |node| node.heartbeat(100));
    let mut network = master(&mut bench);
    let (event, events) = luna::buffered(Buffer::fifo(16));
    let consumer = network
        .heartbeats(event)
        .watch(id(), LIMIT, OnMissed::Report);
    let nmt = network.nmt();
    bench.main.process("heartbeats").spawn_ok(consumer);
    bench.main.process("master").spawn_ok(network.controller());
    let bus = bench.control.clone();
    bench.main.process("user").spawn_ok(async move {
        let node = id();
        assert_eq!(events.recv().await?, NodeEvent::BootUp(node));
        let state = |state| NodeEvent::State(node, state);
        assert_eq!(events.recv().await?, state(NmtState::PreOperational));
        for (command, to, expected) in [
            (NmtCommand::Start, Some(node), NmtState::Operational),
            (NmtCommand::Stop, None, NmtState::Stopped),
            (
                NmtCommand::EnterPreOperational,
                Some(node),
                NmtState::PreOperational,
            ),
            (NmtCommand::Start, None, NmtState::Operational),
        ] {
            // It is for another one.
            nmt.command(NmtCommand::ResetNode, NodeId::new(6)).await?;
            nmt.command(command, to).await?;
            assert_eq!(events.recv().await?, state(expected));
            assert_eq!(control.state(), expected);
        }
        nmt.command(NmtCommand::ResetNode, Some(node)).await?;
        assert_eq!(events.recv().await?, NodeEvent::BootUp(node));
        assert_eq!(events.recv().await?, state(NmtState::PreOperational));

        // The report before this one came with a heartbeat.
        let begin = luna::now();
        bus.cut("node");
        assert_eq!(events.recv().await?, NodeEvent::Missed(node));
        assert_eq!(luna::now() - begin, LIMIT);
        luna::after(10 * LIMIT).await;
        assert!(events.try_recv().is_err());
        bus.connect("node");
        assert_eq!(events.recv().await?, state(NmtState::PreOperational));
        Ok(())
    });
    bench.run().unwrap();
}

#[test]
fn a_reset_of_the_communication_keeps_the_objects_of_the_application() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let (speed, period) = (Object::new(0x60FF, 0), Object::new(0x1017, 0));
    let control = node(&mut bench, |node| {
        node.object(speed, 1_i32, Access::ReadWrite)
    });
    let mut network = master(&mut bench);
    let (nmt, mut sdo) = (network.nmt(), network.sdo(id()).unwrap());
    bench.main.process("master").spawn_ok(network.controller());
    bench.main.process("user").spawn_ok(async move {
        for (command, kept) in [
            (NmtCommand::ResetCommunication, 2),
            (NmtCommand::ResetNode, 1),
        ] {
            sdo.write(speed, 2_i32).await?;
            sdo.write(period, 50_u16).await?;
            nmt.command(command, Some(id())).await?;
            luna::after(Duration::from_millis(10)).await;
            assert_eq!(control.get::<i32>(speed), Some(kept));
            assert_eq!(control.get::<u16>(period), Some(0));
        }
        Ok(())
    });
    bench.run().unwrap();
}

#[test]
fn a_missed_heartbeat_is_an_emergency_if_declared() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let control = node(&mut bench, |node| node.heartbeat(100));
    let mut network = master(&mut bench);
    let (event, events) = luna::buffered(Buffer::fifo(16));
    let consumer = network
        .heartbeats(event)
        .watch(id(), LIMIT, OnMissed::Emergency);
    bench.main.process("heartbeats").spawn_ok(consumer);
    bench.main.process("master").spawn_ok(network.controller());
    let bus = bench.control.clone();
    bench.main.process("user").spawn_ok(async move {
        assert_eq!(events.recv().await?, NodeEvent::BootUp(id()));
        let state = NodeEvent::State(id(), NmtState::PreOperational);
        assert_eq!(events.recv().await?, state);
        bus.cut("node");
        std::future::pending::<()>().await;
        drop((control, events));
        Ok(())
    });
    let error = bench.run().unwrap_err().to_string();
    let (node, limit) = (id(), LIMIT);
    let expected = HeartbeatMissed { node, limit }.to_string();
    assert!(error.contains(&expected), "{error}");
    assert_eq!(bench.system.report().unwrap().end, End::Emergency);
}

/// The end of a system with these watches of the node, which is cut off after its first heartbeat.
/// Its reports have no more room than for one, and `is_read` says whether they have a receiver.
fn end_after_a_cut(
    watches: &[(NodeId, Duration, OnMissed)],
    is_read: bool,
) -> (Option<String>, luna_can::Counts) {
    let mut bench = Bench::new();
    let control = node(&mut bench, |node| node.heartbeat(100));
    let listener = bench.node("listener");
    let mut network = master(&mut bench);
    let (event, events) = luna::buffered(Buffer::fifo(1));
    let mut consumer = network.heartbeats(event);
    for (node, limit, on_missed) in watches {
        consumer = consumer.watch(*node, *limit, *on_missed);
    }
    let (nmt, counts) = (network.nmt(), network.counts());
    bench.main.process("heartbeats").spawn_ok(consumer);
    bench.main.process("master").spawn_ok(network.controller());
    let bus = bench.control.clone();
    bench.main.process("user").spawn_ok(async move {
        let events = is_read.then_some(events);
        while listener.received.recv().await?.data() != [0x7F] {}
        bus.cut("node");
        luna::after(10 * LIMIT).await;
        drop((control, events, nmt, listener));
        Ok(())
    });
    let end = bench.run().err().map(|error| error.to_string());
    (end, counts)
}

#[test]
fn each_watch_of_a_node_has_its_own_limit() {
    let _watch = watchdog();
    let (end, _) = end_after_a_cut(
        &[
            (id(), LIMIT, OnMissed::Report),
            (id(), 2 * LIMIT, OnMissed::Emergency),
        ],
        true,
    );
    assert!(
        end.unwrap()
            .contains("no heartbeat has come from node 5 for 500ms")
    );
}

#[test]
fn a_report_that_has_no_room_does_not_stop_the_supervision() {
    let _watch = watchdog();
    // The boot-up takes the only room.
    let (end, counts) = end_after_a_cut(&[(id(), LIMIT, OnMissed::Emergency)], true);
    assert!(end.unwrap().contains("no heartbeat has come from node 5"));
    assert_eq!(counts.unreported(), 2);
    // So for reports: the state and the missed heartbeat.
    let (end, counts) = end_after_a_cut(&[(id(), LIMIT, OnMissed::Report)], true);
    assert_eq!((end, counts.unreported()), (None, 2));
}

#[test]
fn an_emergency_watch_needs_no_reader_of_reports() {
    let _watch = watchdog();
    let (end, _) = end_after_a_cut(&[(id(), LIMIT, OnMissed::Emergency)], false);
    assert!(end.unwrap().contains("no heartbeat has come from node 5"));
    let (end, _) = end_after_a_cut(&[(id(), LIMIT, OnMissed::Report)], false);
    assert_eq!(end, None);
    // It ends with all that uses the network.
    let (end, _) = end_after_a_cut(&[(id(), 20 * LIMIT, OnMissed::Emergency)], false);
    assert_eq!(end, None);
}

#[test]
fn a_program_is_a_node_with_a_heartbeat() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let network = master(&mut bench);
    let (state, states) = luna::buffered(Buffer::fifo(4));
    let producer = network.heartbeat(id(), Duration::from_millis(50), states);
    bench.main.process("heartbeat").spawn_ok(producer);
    bench.main.process("master").spawn_ok(network.controller());
    let listener = bench.node("listener");
    bench.main.process("user").spawn_ok(async move {
        let next = async || -> luna::Result<Option<NmtState>> {
            let frame = listener.received.recv().await?;
            Ok(Heartbeat::decode(&frame).map(|beat| beat.state))
        };
        assert_eq!(next().await?, Some(NmtState::BootUp));
        assert_eq!(next().await?, Some(NmtState::PreOperational));
        let begin = luna::now();
        assert_eq!(next().await?, Some(NmtState::PreOperational));
        assert_eq!(luna::now() - begin, Duration::from_millis(50));
        state.send(NmtState::Operational).await?;
        assert_eq!(next().await?, Some(NmtState::Operational));
        drop(state);
        drop(listener);
        Ok(())
    });
    bench.run().unwrap();
}

#[test]
fn emergencies_of_nodes_are_values_of_a_channel_and_sync_is_none() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let control = node(&mut bench, |node| node);
    let mut network = master(&mut bench);
    let (message, messages) = luna::buffered::<Emergency>(Buffer::fifo(16));
    network.emergencies(message);
    let (switch, switches) = luna::channel();
    let sync = network.sync(Duration::from_millis(1), switches);
    let counts = network.counts();
    bench.main.process("sync").spawn_ok(sync);
    bench.main.process("master").spawn_ok(network.controller());
    bench.main.process("user").spawn_ok(async move {
        luna::after(Duration::from_millis(10)).await;
        control.emergency(0x8130, 0x11, [1, 2, 3, 4, 5]).await?;
        let received = messages.recv().await?;
        assert_eq!(
            (received.node, received.code, received.register),
            (id(), 0x8130, 0x11)
        );
        assert_eq!(
            (received.data, received.meaning()),
            ([1, 2, 3, 4, 5], "communication")
        );
        control.emergency(0, 0, [0; 5]).await?;
        assert!(messages.recv().await?.is_reset());
        drop(switch);
        Ok(())
    });
    bench.run().unwrap();
    assert_eq!((counts.received(), counts.malformed()), (2, 0));
}

#[test]
fn a_heartbeat_of_another_kind_is_none() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let stranger = bench.node("stranger");
    let mut network = master(&mut bench);
    let (event, events) = luna::buffered(Buffer::fifo(16));
    let consumer = network
        .heartbeats(event)
        .watch(id(), LIMIT, OnMissed::Emergency);
    bench.main.process("heartbeats").spawn_ok(consumer);
    bench.main.process("master").spawn_ok(network.controller());
    let (all, _received) = luna::buffered::<Frame>(Buffer::fifo(16));
    let device = bench.open("listener");
    let listening = luna_can::controller(&device).receive(&[Filter::ANY], all);
    bench.main.process("listener").spawn_ok(listening);
    drop(device);
    bench.main.process("user").spawn_ok(async move {
        for (id, data) in [
            (0x705, &[9][..]),
            (0x705, &[]),
            (0x705, &[5, 5]),
            (0x700, &[5]),
        ] {
            stranger
                .send
                .send(Frame::standard(id, data).unwrap())
                .await?;
        }
        stranger
            .send
            .send(Frame::standard(0x705, &[0x85]).unwrap())
            .await?;
        // The upper bit is of node guarding, and does not count.
        let expected = NodeEvent::State(id(), NmtState::Operational);
        assert_eq!(events.recv().await?, expected);
        drop((events, stranger, _received));
        Ok(())
    });
    bench.run().unwrap();
}
