//! What a watch of heartbeats survives: restarts of the node, readers that end, a lost bus, a flood.

use super::id;
use crate::common::{Bench, Node, SpawnOk, watchdog};
use luna::End;
use luna::devices::OnLoss;
use luna::prelude::*;
use luna_can::canopen::{
    Heartbeat, HeartbeatConsumer, Nmt, NmtCommand, NmtState, NodeEvent, NodeId, OnMissed,
};
use std::future::Future;
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);
const LIMIT: Duration = Duration::from_millis(250);

fn beat(state: NmtState) -> luna_can::Frame {
    Heartbeat { node: id(), state }.frame()
}

/// How a system ends whose `user` has a node of its own on the bus, the reports of a consumer that
/// watches that node, and what poisons the reports. Also for how long it ran.
fn end_of<F>(
    watches: impl FnOnce(HeartbeatConsumer) -> HeartbeatConsumer,
    user: impl FnOnce(Node, Receiver<NodeEvent>, (luna_can::sim::Control, Nmt, Node)) -> F,
) -> (Option<String>, End, Duration)
where
    F: Future<Output = luna::Result<()>> + Send + 'static,
{
    let mut bench = Bench::new();
    let stranger = bench.node("stranger");
    // Frames are acknowledged also without the master.
    let listener = bench.node("listener");
    let device = bench.open("master");
    device.on_loss(OnLoss::Fail);
    let mut network = luna_can::canopen::Network::new(&device);
    drop(device);
    let (event, events) = luna::buffered(Buffer::fifo(64));
    let consumer = watches(network.heartbeats(event));
    let nmt = network.nmt();
    bench.main.process("heartbeats").spawn_ok(consumer);
    bench.main.process("master").spawn_ok(network.controller());
    let user = user(stranger, events, (bench.control.clone(), nmt, listener));
    bench.main.process("user").spawn_ok(user);
    let end = bench.run().err().map(|error| error.to_string());
    let report = bench.system.report().unwrap();
    (end, report.end, report.elapsed)
}

fn emergency(consumer: HeartbeatConsumer) -> HeartbeatConsumer {
    consumer.watch(id(), LIMIT, OnMissed::Emergency)
}

fn is_missed(end: &Option<String>) -> bool {
    let end = end.as_deref().unwrap_or_default();
    end.contains("no heartbeat has come from node 5 for 250ms")
}

#[test]
fn a_boot_up_ends_no_watch() {
    let _watch = watchdog();
    let (end, how, took) = end_of(emergency, async |stranger, events, _| {
        let send = |state| stranger.send.send(beat(state));
        // Before the first heartbeat a node may boot at leisure.
        send(NmtState::BootUp).await?;
        luna::after(10 * LIMIT).await;
        send(NmtState::Operational).await?;
        luna::after(100 * MS).await;
        send(NmtState::BootUp).await?;
        luna::after(10 * LIMIT).await;
        drop((events, stranger));
        Ok(())
    });
    assert!(is_missed(&end), "{end:?}");
    assert_eq!(how, End::Emergency);
    assert!(took < 12 * LIMIT, "{took:?}");
}

#[test]
fn a_node_that_boots_again_and_again_is_missed() {
    let _watch = watchdog();
    let (end, how, took) = end_of(emergency, async |stranger, events, _| {
        stranger.send.send(beat(NmtState::Operational)).await?;
        for _ in 0..100 {
            luna::after(LIMIT / 5).await;
            stranger.send.send(beat(NmtState::BootUp)).await?;
        }
        drop((events, stranger));
        Ok(())
    });
    assert!(is_missed(&end), "{end:?}");
    assert_eq!(how, End::Emergency);
    assert!(took < 2 * LIMIT, "{took:?}");
}

#[test]
fn a_node_that_restarts_in_time_is_not_missed() {
    let _watch = watchdog();
    let (end, how, _) = end_of(emergency, async |stranger, events, _| {
        for _ in 0..10 {
            for state in [NmtState::Operational, NmtState::BootUp] {
                stranger.send.send(beat(state)).await?;
                luna::after(LIMIT / 3).await;
            }
        }
        drop((events, stranger));
        Ok(())
    });
    assert_eq!((end, how), (None, End::Completed));
}

#[test]
fn a_node_that_never_comes_is_missed_if_its_first_heartbeat_is_due() {
    let _watch = watchdog();
    let wait = async |stranger: Node, events: Receiver<NodeEvent>, _| {
        stranger.send.send(beat(NmtState::BootUp)).await?;
        luna::after(10 * LIMIT).await;
        drop((events, stranger));
        Ok(())
    };
    let (end, how, _) = end_of(emergency, wait);
    assert_eq!((end, how), (None, End::Completed));
    let due = |consumer| emergency(consumer).first_within(2 * LIMIT);
    let (end, how, took) = end_of(due, wait);
    assert!(is_missed(&end), "{end:?}");
    assert_eq!((how, took), (End::Emergency, 2 * LIMIT));
}

#[test]
fn a_reader_that_poisons_the_reports_ends_no_emergency_watch() {
    let _watch = watchdog();
    let (end, how, _) = end_of(emergency, async |stranger, events, _| {
        stranger.send.send(beat(NmtState::Operational)).await?;
        luna::after(MS).await;
        events.poison();
        luna::after(10 * LIMIT).await;
        drop((events, stranger));
        Ok(())
    });
    assert!(is_missed(&end), "{end:?}");
    assert_eq!(how, End::Emergency);
}

/// Also if the loss of the bus itself is declared to be no emergency.
#[test]
fn a_lost_bus_ends_no_emergency_watch() {
    let _watch = watchdog();
    for (on_missed, expected) in [
        (OnMissed::Emergency, End::Emergency),
        (OnMissed::Report, End::Completed),
    ] {
        let (end, how, _) = end_of(
            |consumer| consumer.watch(id(), LIMIT, on_missed),
            async |stranger, events, (bus, nmt, listener)| {
                stranger.send.send(beat(NmtState::Operational)).await?;
                luna::after(MS).await;
                bus.corrupt("master", 1000);
                nmt.command(NmtCommand::Start, None).await?;
                for _ in 0..100 {
                    luna::after(LIMIT / 10).await;
                    stranger.send.send(beat(NmtState::Operational)).await?;
                }
                drop((nmt, listener));
                drop((events, stranger));
                Ok(())
            },
        );
        assert_eq!(how, expected, "{end:?}");
    }
}

/// Heartbeats of another node, as fast as the bus has them: the consumer always has a frame.
#[test]
fn a_flood_of_other_heartbeats_puts_nothing_off() {
    let _watch = watchdog();
    let (end, how, took) = end_of(emergency, async |stranger, events, _| {
        stranger.send.send(beat(NmtState::Operational)).await?;
        let other = Heartbeat {
            node: NodeId::new(6).unwrap(),
            state: NmtState::Operational,
        };
        let end = luna::now() + 4 * LIMIT;
        while luna::now() < end {
            stranger.send.send(other.frame()).await?;
        }
        drop((events, stranger));
        Ok(())
    });
    assert!(is_missed(&end), "{end:?}");
    assert_eq!(how, End::Emergency);
    assert!(took < 2 * LIMIT, "{took:?}");
}
