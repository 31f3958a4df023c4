//! No value that is taken to be written is lost without a report.

use crate::common::{AT_ONCE, Bench, LONG, PERIOD, SpawnOk, newest, until, with_files};
use crate::recorder::{self, Treatment};
use luna::prelude::*;
use luna_modbus::sim::Fault;
use luna_modbus::{Code, Event, RequestError, holding};
use std::io::{Read, Write};
use std::net::TcpListener;
use std::time::Duration;

#[test]
fn a_refused_write_is_reported_with_its_value() {
    let Some(_watch) = with_files() else { return };
    let (bench, client, _plc, events) = Bench::new();
    let (set, setting) = luna::buffered::<i32>(Buffer::fifo(4));
    let client = client.write(holding(1_234), setting).unwrap();
    let counts = client.counts();
    bench.run(client, async move {
        set.send(-70_000).await?;
        assert_eq!(events.recv().await?, Event::Connected);
        let Event::WriteFailed { value, error } = events.recv().await? else {
            panic!("no report")
        };
        let request = error.request();
        assert_eq!(
            (value, request.function, request.address),
            (-70_000.0, 16, 1_234)
        );
        let code = Code::IllegalAddress;
        assert_eq!(error, RequestError::Exception { request, code });
        Ok(())
    });
    assert_eq!((counts.written(), counts.write_failures()), (0, 1));
    assert_eq!(counts.connections(), 1);
}

#[test]
fn a_write_without_an_answer_is_reported_and_not_repeated() {
    let Some(_watch) = with_files() else { return };
    let (bench, client, plc, events) = Bench::new();
    let (set, setting) = luna::channel::<u16>();
    let (value, values) = newest::<u16>();
    let client = client
        .write(holding(0), setting)
        .and_then(|client| client.read(holding(0), value))
        .unwrap();
    let counts = client.counts();
    bench.run(client, async move {
        assert_eq!(events.recv().await?, Event::Connected);
        set.send(1).await?;
        until(&values, 1).await?;
        plc.fault(Fault::HangsUp);
        // The fault may be found by a read first.
        set.send(2).await?;
        let error = loop {
            match events.recv().await? {
                Event::WriteFailed { value, error } => {
                    assert_eq!(value, 2.0);
                    break error;
                }
                other => assert!(!matches!(other, Event::ReadRefused(_)), "{other}"),
            }
        };
        assert!(matches!(error, RequestError::HungUp { .. }), "{error}");
        plc.fault(Fault::None);
        plc.set(holding(0), 7_u16)?;
        until(&values, 7).await?;
        set.send(3).await?;
        until(&values, 3).await?;
        Ok(())
    });
    assert_eq!((counts.written(), counts.write_failures()), (2, 1));
}

#[test]
fn a_connection_that_was_closed_meanwhile_takes_no_value() {
    let Some(_watch) = with_files() else { return };
    let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
    let address = listener.local_addr().unwrap();
    let server = std::thread::spawn(move || {
        drop(listener.accept().unwrap());
        let (mut second, _) = listener.accept().unwrap();
        let mut request = [0; 12];
        second.read_exact(&mut request).unwrap();
        second.write_all(&request).unwrap();
        request
    });
    let mut system = System::new("plant");
    let device = luna_modbus::open(&system.devices(), address).unwrap();
    let (event, events) = luna::buffered(Buffer::fifo(64));
    let (set, setting) = luna::channel::<u16>();
    let client = luna_modbus::client(&device, PERIOD, event)
        .and_then(|client| client.timeout(LONG))
        .and_then(|client| client.write(holding(3), setting))
        .unwrap()
        .reconnect(AT_ONCE);
    let counts = client.counts();
    let main = system.executor("main").build().unwrap();
    main.process("client").spawn_ok(client);
    main.process("user").spawn_ok(async move {
        assert_eq!(events.recv().await?, Event::Connected);
        // It is found without a request.
        let Event::Disconnected(error) = events.recv().await? else {
            panic!("no end")
        };
        assert!(matches!(error, RequestError::HungUp { .. }), "{error}");
        set.send(0x102).await?;
        assert_eq!(events.recv().await?, Event::Connected);
        Ok(())
    });
    drop(device);
    system.run().unwrap();
    assert_eq!(server.join().unwrap()[6..], [1, 6, 0, 3, 1, 2]);
    assert_eq!((counts.written(), counts.write_failures()), (1, 0));
}

#[test]
fn every_value_is_written_once_or_reported() {
    let Some(_watch) = with_files() else { return };
    const SENT: u16 = 101;
    let (address, server) = recorder::start(SENT - 1);
    let mut system = System::new("plant");
    let device = luna_modbus::open(&system.devices(), address).unwrap();
    let (event, events) = luna::buffered(Buffer::fifo(8));
    let (set, setting) = luna::buffered::<u16>(Buffer::fifo(8));
    let client = luna_modbus::client(&device, PERIOD, event)
        .and_then(|client| client.timeout(Duration::from_millis(20)))
        .and_then(|client| client.write(holding(0), setting))
        .unwrap()
        .reconnect(AT_ONCE);
    let counts = client.counts();
    let counted = counts.clone();
    let main = system.executor("main").build().unwrap();
    main.process("client").spawn_ok(client);
    main.process("source").spawn_ok(async move {
        for number in 0..SENT {
            set.send(number).await?;
        }
        // Without a sender and a connection it would end.
        while counted.written() + counted.write_failures() < u64::from(SENT) {
            luna::yield_now().await;
        }
        Ok(())
    });
    let (report, reported) = std::sync::mpsc::channel();
    main.process("reports").spawn_ok(async move {
        while let Ok(event) = events.recv().await {
            if let Event::WriteFailed { value, .. } = event {
                report.send(value as u16).unwrap();
            }
        }
        Ok(())
    });
    drop(device);
    system.run().unwrap();
    let taken = server.join().unwrap();
    let reported: Vec<u16> = reported.try_iter().collect();
    assert!(taken.is_sorted_by(|one, next| one < next), "{taken:?}");
    assert!(
        reported.is_sorted_by(|one, next| one < next),
        "{reported:?}"
    );
    for number in 0..SENT {
        let treatment = Treatment::of(number);
        let is_taken = taken.contains(&number);
        let is_reported = reported.contains(&number);
        // A busy machine may make a good answer late.
        let is_confirmed = treatment == Treatment::Confirm && !is_reported;
        assert!(is_confirmed || is_reported, "{number}");
        assert!(is_taken || treatment == Treatment::HangUp, "{number}");
    }
    assert_eq!(reported.len() as u64, counts.write_failures());
    assert_eq!(
        counts.written() + counts.write_failures(),
        u64::from(SENT),
        "{counts:?}"
    );
}

#[test]
fn what_waits_at_the_end_without_a_server_is_reported() {
    let Some(_watch) = with_files() else { return };
    let (bench, client, plc, events) = Bench::new();
    let (set, setting) = luna::buffered::<f32>(Buffer::fifo(4));
    let client = client.write(holding(10), setting).unwrap();
    plc.stop();
    bench.run(client, async move {
        set.send(0.5).await?;
        set.send(1.5).await?;
        drop(set);
        for expected in [0.5, 1.5] {
            let Event::WriteFailed { value, error } = events.recv().await? else {
                panic!("no report")
            };
            assert_eq!(value, expected);
            assert_eq!(
                error.to_string(),
                "no connection for function 16, holding register 10 to 11"
            );
        }
        Ok(())
    });
}
