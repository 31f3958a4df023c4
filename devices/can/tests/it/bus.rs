//! What the simulated bus has of a real one.

use crate::common::{Bench, Node, SpawnOk, frame, watchdog};
use luna::End;
use luna::devices::DeviceState;
use luna::prelude::*;
use luna_can::{BusError, Event, Filter, Frame, OnBusOff, StandardId, State};
use std::time::Duration;

#[test]
fn the_lower_identifier_goes_first_and_no_frame_is_lost() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let nodes: Vec<Node> = ["a", "b", "c"]
        .iter()
        .map(|name| bench.node(name))
        .collect();
    let listener = bench.node("listener");
    let control = bench.control.clone();
    bench.main.process("user").spawn_ok(async move {
        // While this one is on the bus, all others come to wait.
        nodes[0].send.send(frame(0x7FF, &[0; 8])).await?;
        luna::after(Duration::from_micros(10)).await;
        let long = |id| Frame::extended(id, &[]).unwrap();
        let remote = |id| Frame::remote(StandardId::new(id).unwrap(), 0).unwrap();
        nodes[0].send.send(long(0x100 << 18)).await?;
        nodes[1].send.send(remote(0x100)).await?;
        nodes[2].send.send(frame(0x100, &[1])).await?;
        nodes[1].send.send(frame(0x300, &[])).await?;
        nodes[2].send.send(frame(0x200, &[])).await?;
        let mut order = Vec::new();
        for _ in 0..6 {
            order.push(listener.received.recv().await?);
        }
        // A node's own frames keep their order.
        let expected = [
            frame(0x7FF, &[0; 8]),
            frame(0x100, &[1]),
            remote(0x100),
            long(0x100 << 18),
            frame(0x200, &[]),
            frame(0x300, &[]),
        ];
        assert_eq!(order, expected);
        // A node does not get its own.
        assert_eq!(nodes[2].received.buffered(), 4);
        Ok(())
    });
    bench.run().unwrap();
    assert_eq!((control.frames(), control.destroyed()), (6, 0));
}

#[test]
fn a_frame_takes_as_long_as_its_bits() {
    let _watch = watchdog();
    // 47 bits without data, 8 a byte, and a stuffed one after each four of the first.
    assert_eq!(frame(0, &[]).bits(), 47 + 8);
    assert_eq!(frame(0, &[0; 8]).bits(), 47 + 64 + 24);
    assert_eq!(Frame::extended(0, &[0; 8]).unwrap().bits(), 67 + 64 + 29);
    let mut bench = Bench::new();
    let (sender, receiver) = (bench.node("sender"), bench.node("receiver"));
    bench.main.process("user").spawn_ok(async move {
        let begin = luna::now();
        for _ in 0..10 {
            sender.send.send(frame(1, &[0; 8])).await?;
        }
        for _ in 0..10 {
            receiver.received.recv().await?;
        }
        assert_eq!(luna::now() - begin, 10 * Duration::from_micros(135 * 2));
        Ok(())
    });
    bench.run().unwrap();
}

#[test]
fn a_destroyed_frame_is_sent_again() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let (sender, receiver) = (bench.node("sender"), bench.node("receiver"));
    let control = bench.control.clone();
    let own = control.clone();
    let counts = receiver.counts.clone();
    bench.main.process("user").spawn_ok(async move {
        own.corrupt("sender", 3);
        for number in 0..5 {
            sender.send.send(frame(1, &[number])).await?;
            assert_eq!(receiver.received.recv().await?, frame(1, &[number]));
        }
        Ok(())
    });
    bench.run().unwrap();
    assert_eq!((control.frames(), control.destroyed()), (5, 3));
    assert_eq!(counts.errors(), 3);
}

#[test]
fn errors_lead_to_error_passive_and_to_bus_off_which_is_an_emergency() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let device = bench.open("drive");
    let (send, outgoing) = luna::channel();
    let (event, events) = luna::buffered(Buffer::fifo(128));
    let stop = frame(0, &[2, 0]);
    device
        .on_emergency("stop", move |port| {
            use luna_can::Port;
            port.transmit_at_once(stop).unwrap();
        })
        .unwrap();
    let controller = luna_can::controller(&device).send(outgoing).events(event);
    let counts = controller.counts();
    assert_eq!(counts.state(), None);
    bench.main.process("drive").spawn_ok(controller);
    drop(device);
    let listener = bench.node("listener");
    let control = bench.control.clone();
    let own = control.clone();
    let (seen, states) = std::sync::mpsc::channel();
    bench.main.process("user").spawn_ok(async move {
        own.corrupt("drive", 1_000);
        send.send(frame(1, &[])).await?;
        loop {
            if let Event::State(state) = events.recv().await? {
                seen.send(state).unwrap();
            }
            assert!(listener.received.try_recv().is_err());
        }
    });
    let devices = bench.system.devices();
    let error = bench.run().unwrap_err().to_string();
    assert!(error.contains("bus-off"), "{error}");
    assert_eq!(bench.system.report().unwrap().end, End::Emergency);
    // The emergency may be before the last report is received.
    let states: Vec<State> = states.try_iter().collect();
    assert_eq!(states[..2], [State::Warning, State::Passive]);
    assert_eq!(counts.state(), Some(State::BusOff));
    // 256 errors at 8 each.
    assert_eq!(control.destroyed(), 32);
    assert_eq!(control.sent_at_once("drive"), [stop]);
    assert_eq!(devices.list()[0].state, DeviceState::Closed);
}

#[test]
fn a_node_that_waits_in_bus_off_goes_on_after_a_restart() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let device = bench.open("drive");
    let (send, outgoing) = luna::buffered(Buffer::fifo(8));
    let (event, events) = luna::buffered(Buffer::fifo(128));
    let controller = luna_can::controller(&device)
        .send(outgoing)
        .events(event)
        .on_bus_off(OnBusOff::Wait);
    let counts = controller.counts();
    bench.main.process("drive").spawn_ok(controller);
    drop(device);
    let listener = bench.node("listener");
    let control = bench.control.clone();
    bench.main.process("user").spawn_ok(async move {
        control.corrupt("drive", 32);
        send.send(frame(1, &[])).await?;
        while events.recv().await? != Event::State(State::BusOff) {}
        assert_eq!(control.state("drive"), State::BusOff);
        send.send(frame(2, &[])).await?;
        luna::after(Duration::from_millis(10)).await;
        assert!(listener.received.try_recv().is_err());
        control.restart("drive");
        while events.recv().await? != Event::State(State::Active) {}
        send.send(frame(3, &[])).await?;
        assert_eq!(listener.received.recv().await?, frame(3, &[]));
        // The bus drops the frame that it had, the controller the one that comes after.
        assert_eq!(control.dropped(), 1);
        Ok(())
    });
    bench.run().unwrap();
    assert_eq!((counts.sent(), counts.dropped()), (2, 1));
}

#[test]
fn a_node_that_is_alone_is_not_acknowledged_and_does_not_become_bus_off() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let device = bench.open("alone");
    let (send, outgoing) = luna::buffered(Buffer::fifo(8));
    let (event, events) = luna::buffered(Buffer::fifo(4_096));
    let controller = luna_can::controller(&device).send(outgoing).events(event);
    bench.main.process("alone").spawn_ok(controller);
    drop(device);
    let other = bench.node("other");
    let control = bench.control.clone();
    bench.main.process("user").spawn_ok(async move {
        control.cut("other");
        send.send(frame(1, &[])).await?;
        assert_eq!(
            events.recv().await?,
            Event::Error(BusError::NotAcknowledged)
        );
        luna::after(Duration::from_millis(100)).await;
        assert_eq!(control.state("alone"), State::Passive);
        // When another node comes, the frame gets out.
        control.connect("other");
        assert_eq!(other.received.recv().await?, frame(1, &[]));
        Ok(())
    });
    bench.run().unwrap();
}

#[test]
fn two_nodes_with_one_identifier_destroy_each_others_frames() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let (one, other) = (bench.node("one"), bench.node("other"));
    let listener = bench.node("listener");
    let control = bench.control.clone();
    let own = control.clone();
    let waiting = other.counts.clone();
    bench.main.process("user").spawn_ok(async move {
        // The same frame is one for all.
        one.send.send(frame(5, &[7])).await?;
        other.send.send(frame(5, &[7])).await?;
        assert_eq!(listener.received.recv().await?, frame(5, &[7]));
        luna::after(Duration::from_millis(1)).await;
        let before = own.destroyed();
        one.send.send(frame(5, &[1])).await?;
        other.send.send(frame(5, &[2])).await?;
        luna::after(Duration::from_millis(1)).await;
        assert!(own.destroyed() > before);
        assert!(waiting.errors() > 0);
        // One of them leaves.
        own.cut("other");
        assert_eq!(listener.received.recv().await?, frame(5, &[1]));
        drop((one, other));
        Ok(())
    });
    bench.run().unwrap();
    assert_eq!(control.frames(), 2);
}

#[test]
fn a_node_misses_frames_and_its_queue_is_bounded() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let (sender, receiver) = (bench.node("sender"), bench.node("receiver"));
    let control = bench.control.clone();
    // Without a controller nothing is taken from its queue.
    let stuck = bench.open("stuck");
    let own = stuck.clone();
    bench.main.process("user").spawn_ok(async move {
        use luna_can::{Incoming, Port};
        control.lose("receiver", 2);
        for number in 0..100_u8 {
            sender.send.send(frame(1, &[number])).await?;
            if number >= 2 {
                assert_eq!(receiver.received.recv().await?, frame(1, &[number]));
            }
        }
        let Ok(Incoming::Report(report)) = own.receive().await else {
            panic!("no report of what was lost")
        };
        assert_eq!(report.lost, 100 - 64);
        for number in 0..64 {
            assert_eq!(
                own.receive().await,
                Ok(Incoming::Frame(frame(1, &[number])))
            );
        }
        Ok(())
    });
    drop(stuck);
    bench.run().unwrap();
}

#[test]
fn hundreds_of_frames_come_in_order_whatever_is_destroyed() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let nodes: Vec<Node> = ["a", "b", "c"]
        .iter()
        .map(|name| bench.node(name))
        .collect();
    let control = bench.control.clone();
    let device = bench.open("listener");
    let (incoming, received) = luna::buffered(Buffer::fifo(1_024));
    let listening = luna_can::controller(&device).receive(&[Filter::ANY], incoming);
    bench.main.process("listener").spawn_ok(listening);
    drop(device);
    let own = control.clone();
    bench.main.process("user").spawn_ok(async move {
        for number in 0..300_u16 {
            for (place, node) in nodes.iter().enumerate() {
                if number % 16 == 0 {
                    own.corrupt(["a", "b", "c"][place], 1);
                }
                let data = number.to_le_bytes();
                node.send.send(frame(0x100 + place as u16, &data)).await?;
                while node.received.try_recv().is_ok() {}
            }
        }
        let mut next = [0_u16; 3];
        for _ in 0..900 {
            let frame = received.recv().await?;
            let place = usize::from(frame.standard_id().unwrap() - 0x100);
            assert_eq!(frame.data(), next[place].to_le_bytes());
            next[place] += 1;
        }
        Ok(())
    });
    bench.run().unwrap();
    assert_eq!((control.frames(), control.destroyed()), (900, 57));
}
