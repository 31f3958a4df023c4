//! What is read and written while all is well.

use crate::common::{Bench, LONG, PERIOD, SpawnOk, newest, until, with_files};
use luna::prelude::*;
use luna_modbus::{Event, SetUpError, Table, WordOrder, coil, discrete, holding, input, sim};
use std::time::Duration;

#[test]
fn all_types_are_read_from_all_tables() {
    let Some(_watch) = with_files() else { return };
    let (bench, client, plc, _events) = Bench::new();
    plc.set(coil(3), true).unwrap();
    plc.set(discrete(4), true).unwrap();
    plc.set(input(0), -5_i16).unwrap();
    plc.set(input(1), 60_000_u16).unwrap();
    plc.set(holding(2), 3_000_000_000_u32).unwrap();
    plc.set(holding::<i32>(4).order(WordOrder::LowFirst), -70_000)
        .unwrap();
    plc.set(holding(900), -1.5_f32).unwrap();
    let (bit, bits) = newest();
    let (other_bit, other_bits) = newest();
    let (small, smalls) = newest::<i16>();
    let (word, words) = newest::<u16>();
    let (wide, wides) = newest::<u32>();
    let (signed, signeds) = newest::<i32>();
    let (float, floats) = newest::<f32>();
    let client = client
        .read(coil(3), bit)
        .and_then(|client| client.read(discrete(4), other_bit))
        .and_then(|client| client.read(holding(900), float))
        .and_then(|client| client.read(holding::<i32>(4).order(WordOrder::LowFirst), signed))
        .and_then(|client| client.read(holding(2), wide))
        .and_then(|client| client.read(input(0), small))
        .and_then(|client| client.read(input(1), word))
        .unwrap();
    let counts = client.counts();
    bench.run(client, async move {
        assert!(bits.recv().await?);
        assert!(other_bits.recv().await?);
        assert_eq!(smalls.recv().await?, -5);
        assert_eq!(words.recv().await?, 60_000);
        assert_eq!(wides.recv().await?, 3_000_000_000);
        assert_eq!(signeds.recv().await?, -70_000);
        assert_eq!(floats.recv().await?, -1.5);
        Ok(())
    });
    assert!(counts.values() >= 7);
    assert_eq!((counts.connections(), counts.exceptions()), (1, 0));
    // Coil; discrete; inputs 0 and 1 in one; holdings 2 to 5 in one; holding 900.
    assert!(plc.requests() >= 5 && plc.requests() <= 5 * (counts.cycles() + 1));
}

#[test]
fn values_are_written_in_order_and_read_back() {
    let Some(_watch) = with_files() else { return };
    let (bench, client, plc, _events) = Bench::new();
    let (set, setting) = luna::buffered::<f32>(Buffer::fifo(4));
    let (switch, switches) = newest::<bool>();
    let (small, smalls) = newest::<i16>();
    let (value, values) = newest::<f32>();
    let client = client
        .write(holding::<f32>(8).order(WordOrder::LowFirst), setting)
        .and_then(|client| client.write(coil(1), switches))
        .and_then(|client| client.write(holding(0), smalls))
        .and_then(|client| client.read(holding::<f32>(8).order(WordOrder::LowFirst), value))
        .unwrap();
    let counts = client.counts();
    bench.run(client, async move {
        for number in 0..100_u8 {
            set.send(number.into()).await?;
        }
        until(&values, 99.0).await?;
        switch.send(true).await?;
        small.send(-3).await?;
        // The last of them are written although the senders are gone.
        Ok(())
    });
    assert_eq!((counts.written(), counts.write_failures()), (102, 0));
    assert!(plc.get(coil(1)).unwrap());
    assert_eq!(plc.get(holding::<i16>(0)).unwrap(), -3);
    assert_eq!(plc.get(holding::<u16>(8)).unwrap(), 0);
    assert_eq!(plc.get(holding::<u16>(9)).unwrap(), 0x42C6);
}

#[test]
fn a_reader_that_does_not_read_delays_nothing() {
    let Some(_watch) = with_files() else { return };
    let (bench, client, plc, _events) = Bench::new();
    let (stuck, unread) = luna::channel::<u16>();
    let (value, values) = newest::<u16>();
    let client = client
        .read(input(0), stuck)
        .and_then(|client| client.read(input(1), value))
        .unwrap();
    let counts = client.counts();
    bench.run(client, async move {
        for number in 1..10 {
            plc.set(input(1), number)?;
            until(&values, number).await?;
        }
        drop(unread);
        Ok(())
    });
    assert!(counts.dropped() >= 9, "{counts:?}");
}

#[test]
fn two_clients_share_a_server() {
    let Some(_watch) = with_files() else { return };
    let (bench, fast, plc, _fast_events) = Bench::new();
    let (event, _events) = luna::buffered(Buffer::fifo(8));
    let slow = luna_modbus::client(&bench.device, 5 * PERIOD, event)
        .and_then(|client| client.unit(9).timeout(LONG))
        .unwrap();
    plc.set(input(0), 1_u16).unwrap();
    let (one, ones) = newest::<u16>();
    let (other, others) = newest::<u16>();
    let (fast, slow) = (
        fast.read(input(0), one).unwrap(),
        slow.read(input(0), other).unwrap(),
    );
    let Bench { mut system, device } = bench;
    let main = system.executor("main").build().unwrap();
    main.process("fast").spawn_ok(fast);
    main.process("slow").spawn_ok(slow);
    main.process("user").spawn_ok(async move {
        assert_eq!((ones.recv().await?, others.recv().await?), (1, 1));
        Ok(())
    });
    drop(device);
    system.run().unwrap();
}

#[test]
fn what_cannot_be_is_refused_at_set_up() {
    let plc = sim::Server::start().unwrap();
    let system = System::new("plant");
    let device = luna_modbus::open(&system.devices(), plc.address()).unwrap();
    let (event, _events) = luna::channel::<Event>();
    let none = luna_modbus::client(&device, Duration::ZERO, event.clone()).unwrap_err();
    assert_eq!(none, SetUpError::Zero { what: "period" });
    let client = luna_modbus::client(&device, PERIOD, event).unwrap();
    let (value, _values) = newest::<f32>();
    let refused = client.read(input(65_535), value).unwrap_err();
    let (table, address) = (Table::Input, 65_535);
    assert_eq!(refused, SetUpError::PastTheEnd { table, address });
    assert!(plc.set(holding(999), 1_u32).is_err());
}

#[test]
fn on_a_virtual_clock_it_does_not_start() {
    let Some(_watch) = with_files() else { return };
    let (bench, client, _plc, _events) = Bench::new();
    let (value, _values) = newest::<u16>();
    let client = client.read(input(0), value).unwrap();
    let mut system = bench.system;
    system.virtual_clock();
    let main = system.executor("main").build().unwrap();
    main.process("client").spawn_ok(client);
    let error = system.run().unwrap_err().to_string();
    assert!(error.contains("virtual clock"), "{error}");
}
