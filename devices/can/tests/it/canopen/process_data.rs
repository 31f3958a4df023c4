//! PDOs as typed channels, and SYNC.

use super::{id, master, node};
use crate::common::{Bench, SpawnOk, frame, watchdog};
use embedded_can::StandardId;
use luna::prelude::*;
use luna_can::canopen::sim::Access;
use luna_can::canopen::{
    AbortCode, Direction, NmtCommand, Object, PdoError, PdoSetting, SdoError, Transmission,
};
use luna_can::{Event, Filter, Frame};
use std::time::Duration;

const STATUS: Object = Object::new(0x6041, 0);
const CONTROL: Object = Object::new(0x6040, 0);
const POSITION: Object = Object::new(0x6064, 0);
const TARGET: Object = Object::new(0x607A, 0);

fn drive(bench: &mut Bench) -> luna_can::canopen::sim::NodeControl {
    node(bench, |node| {
        node.object(STATUS, 0_u16, Access::ReadOnly)
            .object(CONTROL, 0_u16, Access::ReadWrite)
            .object(POSITION, 0_i32, Access::ReadOnly)
            .object(TARGET, 0_i32, Access::ReadWrite)
    })
}

#[test]
fn process_data_goes_both_ways_by_event_and_by_sync() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let control = drive(&mut bench);
    let mut network = master(&mut bench);
    let (transmitted, received) = (id().tpdo(1).unwrap(), id().rpdo(1).unwrap());
    let (value, values) = luna::buffered::<(u16, i32)>(Buffer::fifo(16));
    network.tpdo(transmitted, value).unwrap();
    let (status, statuses) = luna::buffered::<u16>(Buffer::fifo(16));
    network.tpdo(id().tpdo(2).unwrap(), status).unwrap();
    let (target, targets) = luna::channel::<(u16, i32)>();
    let producer = network.rpdo(received, targets).unwrap();
    let (switch, switches) = luna::channel::<bool>();
    let sync = network.sync(Duration::from_millis(10), switches);
    let (mut sdo, nmt) = (network.sdo(id()).unwrap(), network.nmt());
    let sender = network.sender();
    bench.main.process("target").spawn_ok(producer);
    bench.main.process("sync").spawn_ok(sync);
    bench.main.process("master").spawn_ok(network.controller());
    bench.main.process("user").spawn_ok(async move {
        let (tpdo, rpdo) = (Direction::Tpdo, Direction::Rpdo);
        PdoSetting::new(tpdo, 1, transmitted, Transmission::Synchronous(2))?
            .map::<u16>(STATUS)?
            .map::<i32>(POSITION)?
            .write(&mut sdo)
            .await?;
        PdoSetting::new(tpdo, 2, id().tpdo(2).unwrap(), Transmission::OnEvent)?
            .map::<u16>(STATUS)?
            .write(&mut sdo)
            .await?;
        PdoSetting::new(rpdo, 1, received, Transmission::OnEvent)?
            .map::<u16>(CONTROL)?
            .map::<i32>(TARGET)?
            .write(&mut sdo)
            .await?;
        // No process data before the start.
        control.set(STATUS, 1_u16).await?;
        luna::after(Duration::from_millis(50)).await;
        assert!(values.try_recv().is_err() && statuses.try_recv().is_err());

        nmt.command(NmtCommand::Start, Some(id())).await?;
        luna::after(Duration::from_millis(1)).await;
        control.set(STATUS, 0x237_u16).await?;
        assert_eq!(statuses.recv().await?, 0x237);
        control.set(POSITION, -70_000_i32).await?;
        assert_eq!(values.recv().await?, (0x237, -70_000));
        let begin = luna::now();
        for _ in 0..10 {
            values.recv().await?;
        }
        assert_eq!(luna::now() - begin, Duration::from_millis(200));
        target.send((0xF, 123_456)).await?;
        luna::after(Duration::from_millis(1)).await;
        assert_eq!(control.get::<u16>(CONTROL), Some(0xF));
        assert_eq!(control.get::<i32>(TARGET), Some(123_456));
        // One that is too short is for none of its objects; of one that is longer the first bytes
        // count.
        sender.send(frame(received, &[1; 5])).await?;
        luna::after(Duration::from_millis(1)).await;
        assert_eq!(control.get::<u16>(CONTROL), Some(0xF));
        sender
            .send(frame(received, &[7, 0, 8, 0, 0, 0, 9, 9]))
            .await?;
        luna::after(Duration::from_millis(1)).await;
        assert_eq!(control.get::<u16>(CONTROL), Some(7));
        assert_eq!(control.get::<i32>(TARGET), Some(8));
        drop(sender);

        switch.send(false).await?;
        luna::after(Duration::from_millis(20)).await;
        while values.try_recv().is_ok() {}
        luna::after(Duration::from_millis(100)).await;
        assert!(values.try_recv().is_err());
        switch.send(true).await?;
        values.recv().await?;
        Ok(())
    });
    bench.run().unwrap();
}

#[test]
fn a_mapping_that_cannot_be_is_refused_here_or_there() {
    let _watch = watchdog();
    let (tpdo, event) = (Direction::Tpdo, Transmission::OnEvent);
    let new = move |number, id| PdoSetting::new(tpdo, number, id, event);
    assert_eq!(new(0, 0x185).unwrap_err(), PdoError::Number);
    for every in [0, 241, 255] {
        let setting = PdoSetting::new(tpdo, 1, 0x185, Transmission::Synchronous(every));
        assert_eq!(setting.unwrap_err(), PdoError::Transmission(every));
    }
    let full = new(1, 0x185)
        .and_then(|setting| setting.map::<u64>(POSITION))
        .unwrap();
    assert_eq!(full.map::<u8>(STATUS).unwrap_err(), PdoError::TooLong(9));
    let mut bench = Bench::new();
    let control = drive(&mut bench);
    let mut network = master(&mut bench);
    let mut sdo = network.sdo(id()).unwrap();
    bench.main.process("master").spawn_ok(network.controller());
    bench.main.process("user").spawn_ok(async move {
        let none = Object::new(0x7000, 0);
        for object in [none, STATUS] {
            // There is no such object, or it has another length.
            let setting = new(1, 0x185)?.map::<u32>(object)?;
            let error = setting.write(&mut sdo).await.unwrap_err();
            let SdoError::Aborted { code, object, .. } = error else {
                panic!("{error}")
            };
            assert_eq!(code, AbortCode::NOT_MAPPABLE);
            assert_eq!(object, Object::new(0x1A00, 0));
        }
        // A TPDO that allows remote frames, and a mapping of one that is on.
        let code = |refused: Result<(), SdoError>| match refused {
            Err(SdoError::Aborted { code, .. }) => code,
            other => panic!("{other:?}"),
        };
        let remote = sdo.write(Object::new(0x1800, 1), 0x185_u32).await;
        assert_eq!(code(remote), AbortCode::INVALID_VALUE);
        new(1, 0x185)?.map::<u16>(STATUS)?.write(&mut sdo).await?;
        assert_eq!(control.get(Object::new(0x1800, 1)), Some(0x4000_0185_u32));
        let refused = sdo.write(Object::new(0x1A00, 0), 0_u8).await;
        assert_eq!(code(refused), AbortCode::UNSUPPORTED_ACCESS);
        let setting = PdoSetting::new(Direction::Rpdo, 2, 0x205, event)?;
        setting.write(&mut sdo).await?;
        assert_eq!(control.get(Object::new(0x1401, 1)), Some(0x205_u32));
        drop(control);
        Ok(())
    });
    bench.run().unwrap();
}

#[test]
fn identifiers_of_other_services_are_for_no_pdo() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let mut network = master(&mut bench);
    let others = [
        0, 1, 0x7F, 0x80, 0x85, 0x100, 0x180, 0x580, 0x585, 0x600, 0x605, 0x67F, 0x6E0, 0x700,
        0x705, 0x7FF, 0x800, 0x985, 0x8000, 0xFFFF,
    ];
    for (id, is_one) in others
        .map(|id| (id, false))
        .into_iter()
        .chain([0x181, 0x205, 0x57F, 0x680, 0x6DF].map(|id| (id, true)))
    {
        let expected = match is_one {
            true => Ok(()),
            false => Err(PdoError::Identifier(id)),
        };
        let setting = PdoSetting::new(Direction::Rpdo, 1, id, Transmission::OnEvent);
        assert_eq!(setting.map(drop), expected);
        assert_eq!(network.tpdo(id, luna::channel::<u16>().0), expected);
        let producer = network.rpdo(id, luna::channel::<u16>().1);
        assert_eq!(producer.map(drop), expected);
    }
}

#[test]
fn a_bus_that_is_back_gets_the_newest_set_point_soon() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let other = bench.node("other");
    let network = master(&mut bench);
    let (target, targets) = luna::buffered::<u8>(Buffer::overwrite_oldest(1));
    let producer = network.rpdo(0x205, targets).unwrap();
    bench.main.process("targets").spawn_ok(producer);
    bench.main.process("master").spawn_ok(network.controller());
    let control = bench.control.clone();
    bench.main.process("user").spawn_ok(async move {
        // No other node acknowledges what the master sends.
        control.cut("other");
        for number in 0..20 {
            target.send(number).await?;
            luna::after(Duration::from_millis(1)).await;
        }
        control.connect("other");
        luna::after(Duration::from_millis(10)).await;
        let frames = std::iter::from_fn(|| other.received.try_recv().ok());
        let values: Vec<u8> = frames.map(|frame| frame.data()[0]).collect();
        // One on the bus, one at the port, one of the producer, and the newest.
        assert_eq!(values, [0, 1, 2, 19]);
        drop((target, other));
        Ok(())
    });
    bench.run().unwrap();
}

#[test]
fn process_data_that_is_longer_counts_and_that_is_shorter_is_reported() {
    let _watch = watchdog();
    let mut bench = Bench::new();
    let stranger = bench.node("stranger");
    let (event, events) = luna::buffered(Buffer::fifo(16));
    let mut network = master(&mut bench).events(event);
    let (value, values) = luna::buffered::<(u16, i32)>(Buffer::fifo(16));
    network.tpdo(0x185, value).unwrap();
    let counts = network.counts();
    bench.main.process("master").spawn_ok(network.controller());
    let listener = bench.open("listener");
    let (all, received) = luna::buffered(Buffer::fifo(16));
    let listening = luna_can::controller(&listener).receive(&[Filter::ANY], all);
    bench.main.process("listener").spawn_ok(listening);
    drop(listener);
    bench.main.process("user").spawn_ok(async move {
        // Reported once until a good one comes. Of one that is longer the first bytes count.
        for whole in [6, 7, 8] {
            for len in [0, 5, whole] {
                let bytes = [1, 2, 3, 4, 5, 6, 0xFF, 0xFF];
                stranger.send.send(frame(0x185, &bytes[..len])).await?;
            }
            assert_eq!(values.recv().await?, (0x201, 0x605_0403));
            assert_eq!(events.try_recv(), Ok(Event::Malformed { receiver: 0 }));
            assert!(events.try_recv().is_err());
        }
        let id = StandardId::new(0x185).unwrap();
        let remote = Frame::remote(id, 8).unwrap();
        stranger.send.send(remote).await?;
        assert_eq!(events.recv().await?, Event::Malformed { receiver: 0 });
        drop((received, stranger));
        Ok(())
    });
    bench.run().unwrap();
    assert_eq!((counts.malformed(), counts.received()), (7, 3));
}
