//! What a controller does between a port and channels.

use crate::common::{Bench, SpawnOk, frame, watchdog};
use luna::devices::Sharing;
use luna::prelude::*;
use luna_can::{
    BusReport, Event, ExtendedId, Filter, Frame, Incoming, OnBusOff, Port, PortError, StandardId,
    State,
};
use std::time::Duration;

#[test]
fn each_receiver_gets_what_its_filters_match() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let sender = bench.node("sender");
    let device = bench.open("receiver");
    let (one, ones) = luna::buffered(Buffer::fifo(8));
    let (group, groups) = luna::buffered(Buffer::fifo(8));
    let (long, longs) = luna::buffered(Buffer::fifo(8));
    let (none, nothing) = luna::buffered(Buffer::fifo(8));
    let filters = [
        Filter::standard(0x180, 0x780),
        Filter::standard(0x80, 0x7FF),
    ];
    let controller = luna_can::controller(&device)
        .receive(&[Filter::exact(StandardId::new(0x181).unwrap())], one)
        .receive(&filters, group)
        .receive(&[Filter::exact(ExtendedId::new(0x181).unwrap())], long)
        .receive(&[], none);
    let counts = controller.counts();
    bench.main.process("receiver").spawn_ok(controller);
    drop(device);
    bench.main.process("user").spawn_ok(async move {
        let extended = Frame::extended(0x181, &[9]).unwrap();
        let remote = Frame::remote(StandardId::new(0x181).unwrap(), 3).unwrap();
        for frame in [
            frame(0x80, &[]),
            frame(0x181, &[1]),
            frame(0x182, &[2]),
            extended,
            remote,
        ] {
            sender.send.send(frame).await?;
        }
        luna::after(Duration::from_millis(10)).await;
        let all = |receiver: &Receiver<Frame>| -> Vec<Frame> {
            std::iter::from_fn(|| receiver.try_recv().ok()).collect()
        };
        assert_eq!(all(&ones), [frame(0x181, &[1]), remote]);
        let expected = [
            frame(0x80, &[]),
            frame(0x181, &[1]),
            frame(0x182, &[2]),
            remote,
        ];
        assert_eq!(all(&groups), expected);
        assert_eq!(all(&longs), [extended]);
        assert!(all(&nothing).is_empty());
        assert_eq!((remote.dlc(), remote.data().len()), (3, 0));
        Ok(())
    });
    bench.run().unwrap();
    assert_eq!(counts.received(), 7);
}

#[test]
fn an_overrun_is_counted_and_reported_once_and_delays_no_other() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let sender = bench.node("sender");
    let device = bench.open("receiver");
    let (all, received) = luna::buffered(Buffer::fifo(64));
    let (small, full) = luna::buffered(Buffer::fifo(2));
    let (newest, last) = luna::buffered(Buffer::overwrite_oldest(1));
    let (event, events) = luna::buffered(Buffer::fifo(8));
    let controller = luna_can::controller(&device)
        .receive(&[Filter::ANY], all)
        .receive(&[Filter::ANY], small)
        .receive(&[Filter::ANY], newest)
        .events(event);
    let counts = controller.counts();
    bench.main.process("receiver").spawn_ok(controller);
    drop(device);
    bench.main.process("user").spawn_ok(async move {
        for number in 0..10 {
            sender.send.send(frame(1, &[number])).await?;
        }
        for number in 0..10 {
            assert_eq!(received.recv().await?, frame(1, &[number]));
        }
        luna::after(Duration::from_millis(1)).await;
        assert_eq!(events.try_recv(), Ok(Event::Overrun { receiver: 1 }));
        assert!(events.try_recv().is_err());
        assert_eq!(last.try_recv(), Ok(frame(1, &[9])));
        // It is over when one has room again; the next is another.
        assert_eq!(full.recv().await?, frame(1, &[0]));
        for number in 10..13 {
            sender.send.send(frame(1, &[number])).await?;
            received.recv().await?;
        }
        assert_eq!(events.recv().await?, Event::Overrun { receiver: 1 });
        Ok(())
    });
    bench.run().unwrap();
    assert_eq!(counts.overruns(), 8 + 2);
    assert_eq!(counts.unreported(), 0);
}

#[test]
fn a_poisoned_channel_ends_a_controller() {
    let _watch = watchdog();
    for poisons_sender in [false, true] {
        let mut bench = Bench::new();
        let node = bench.node("node");
        bench.main.process("user").spawn_ok(async move {
            match poisons_sender {
                true => node.send.poison(),
                false => node.received.poison(),
            }
            Ok(())
        });
        let error = bench.run().unwrap_err().to_string();
        assert!(
            error.contains("`node`") && error.contains("poison"),
            "{error}"
        );
    }
}

#[test]
fn a_poisoned_channel_ends_a_controller_whose_frame_waits_for_the_bus() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let (node, other) = (bench.node("node"), bench.node("other"));
    let control = bench.control.clone();
    // No other node acknowledges the frame.
    control.cut("other");
    let (end, ended) = std::sync::mpsc::channel();
    bench.main.process("user").spawn_ok(async move {
        // The bus has the first, the second waits.
        node.send.send(frame(1, &[])).await?;
        node.send.send(frame(2, &[])).await?;
        luna::after(Duration::from_millis(1)).await;
        node.send.poison();
        let limit = Duration::from_secs(1);
        end.send(node.received.recv_timeout(limit).await).unwrap();
        control.connect("other");
        drop((node, other));
        Ok(())
    });
    let error = bench.run().unwrap_err().to_string();
    assert!(
        error.contains("`node`") && error.contains("poison"),
        "{error}"
    );
    assert!(!ended.recv().unwrap().unwrap_err().is_timeout());
}

/// An interface to outside, on which nothing comes.
struct Outside;

impl Port for Outside {
    const IS_OUTSIDE: bool = true;

    async fn transmit(&self, _: Frame) -> Result<(), PortError> {
        Ok(())
    }

    async fn receive(&self) -> Result<Incoming, PortError> {
        std::future::pending().await
    }

    fn listen(&self, _: &[Filter]) -> Result<(), PortError> {
        Ok(())
    }

    fn transmit_at_once(&self, _: Frame) -> Result<(), PortError> {
        Ok(())
    }
}

#[test]
fn a_bus_outside_of_the_system_does_not_run_on_a_virtual_clock() {
    let _watch = watchdog();
    for is_virtual in [false, true] {
        let mut system = System::new("outside");
        if is_virtual {
            system.virtual_clock();
        }
        let devices = system.devices();
        let device = devices.open("port", "port", Sharing::Exclusive, || Ok(Outside));
        let controller = luna_can::controller(&device.unwrap());
        let main = system.executor("main").build().unwrap();
        main.process("can").spawn_ok(controller);
        let error = system.run().err().map(|error| error.to_string());
        let is_refused = error.is_some_and(|error| error.contains("virtual clock"));
        assert_eq!(is_refused, is_virtual);
    }
}

/// A bus that reports states, and takes frames when they are asked for.
struct Slow {
    states: Receiver<State>,
    taken: Sender<Frame>,
}

impl Port for Slow {
    const IS_OUTSIDE: bool = false;

    async fn transmit(&self, frame: Frame) -> Result<(), PortError> {
        self.taken.send(frame).await.map_err(|_| PortError::Gone)
    }

    async fn receive(&self) -> Result<Incoming, PortError> {
        let state = self.states.recv().await.map_err(|_| PortError::Gone)?;
        Ok(Incoming::Report(BusReport::new(Some(state), 0, None)))
    }

    fn listen(&self, _: &[Filter]) -> Result<(), PortError> {
        Ok(())
    }

    fn transmit_at_once(&self, _: Frame) -> Result<(), PortError> {
        Ok(())
    }
}

#[test]
fn what_waits_at_bus_off_is_not_sent_after_it() {
    let _watch = watchdog();
    let mut system = System::new("bus-off");
    system.virtual_clock();
    let (state, states) = luna::channel();
    let (taken, sent) = luna::channel();
    let open = || Ok(Slow { states, taken });
    let device = system
        .devices()
        .open("slow", "port", Sharing::Exclusive, open)
        .unwrap();
    let (send, outgoing) = luna::buffered(Buffer::fifo(8));
    let controller = luna_can::controller(&device)
        .send(outgoing)
        .on_bus_off(OnBusOff::Wait);
    let counts = controller.counts();
    drop(device);
    let main = system.executor("main").build().unwrap();
    main.process("can").spawn_ok(controller);
    let own = counts.clone();
    main.process("user").spawn_ok(async move {
        // One waits in the port, others in the channel, and one comes later.
        for number in 0..3 {
            send.send(frame(1, &[number])).await?;
        }
        luna::after(Duration::from_millis(1)).await;
        state.send(State::BusOff).await?;
        luna::after(Duration::from_millis(1)).await;
        send.send(frame(1, &[3])).await?;
        luna::after(Duration::from_millis(1)).await;
        assert_eq!(own.dropped(), 4);
        state.send(State::Active).await?;
        luna::after(Duration::from_millis(1)).await;
        send.send(frame(1, &[4])).await?;
        assert_eq!(sent.recv().await?, frame(1, &[4]));
        // The port lives as long as this.
        drop(send);
        luna::after(Duration::from_millis(1)).await;
        drop((state, sent));
        Ok(())
    });
    system.run().unwrap();
    assert_eq!((counts.sent(), counts.dropped()), (1, 4));
}

#[test]
fn what_was_sent_last_gets_out_before_a_controller_ends() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let (sender, receiver) = (bench.node("sender"), bench.node("receiver"));
    bench.main.process("source").spawn_ok(async move {
        for number in 0..20 {
            sender.send.send(frame(1, &[number])).await?;
        }
        Ok(())
    });
    bench.main.process("sink").spawn_ok(async move {
        for number in 0..20 {
            assert_eq!(receiver.received.recv().await?, frame(1, &[number]));
        }
        Ok(())
    });
    bench.run().unwrap();
}

#[test]
fn a_wait_for_a_frame_that_cannot_come_is_a_deadlock() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let (sender, receiver) = (bench.node("sender"), bench.node("receiver"));
    bench.main.process("user").spawn_ok(async move {
        receiver.received.recv().await?;
        drop(sender);
        Ok(())
    });
    let error = bench.run().unwrap_err().to_string();
    assert!(error.contains("deadlock"), "{error}");
}
