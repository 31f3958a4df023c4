//! What a server does wrong, and where it goes.

use crate::common::{AT_ONCE, Bench, LONG, PERIOD, SpawnOk, newest, until, with_files};
use luna::devices::DeviceState;
use luna::{Buffer, End};
use luna_modbus::sim::{self, Fault};
use luna_modbus::{AnswerUnit, Code, Event, Garbage, RequestError, Table, coil, input};
use std::io::ErrorKind;
use std::net::SocketAddr;
use std::time::Duration;

#[test]
fn a_refused_read_is_reported_once_and_the_others_go_on() {
    let Some(_watch) = with_files() else { return };
    let (bench, client, plc, events) = Bench::new();
    let (absent, nothing) = newest::<u16>();
    let (value, values) = newest::<u16>();
    let (leaving, left) = newest::<u16>();
    let client = client
        .read(input(5_000), absent)
        .and_then(|client| client.read(input(0), value))
        .and_then(|client| client.read(input(10), leaving))
        .unwrap();
    let counts = client.counts();
    bench.run(client, async move {
        assert_eq!(events.recv().await?, Event::Connected);
        let Event::ReadRefused(error) = events.recv().await? else {
            panic!("no refusal")
        };
        let request = error.request();
        assert_eq!((request.function, request.table), (4, Table::Input));
        assert_eq!((request.address, request.count), (5_000, 1));
        let code = Code::IllegalAddress;
        assert_eq!(error, RequestError::Exception { request, code });
        // Then the requests are made anew.
        drop(left);
        for number in 1..10 {
            plc.set(input(0), number)?;
            until(&values, number).await?;
        }
        // No second report of the same, but one of another.
        assert!(events.try_recv().is_err());
        plc.fault(Fault::Refuses(Code::Busy));
        let mut addresses = Vec::new();
        for _ in 0..2 {
            let Event::ReadRefused(error) = events.recv().await? else {
                panic!("no refusal")
            };
            addresses.push(error.request().address);
            assert!(error.to_string().contains("exception 6"), "{error}");
        }
        // It may have been between the two when the fault began.
        addresses.sort();
        assert_eq!(addresses, [0, 5_000]);
        drop(nothing);
        Ok(())
    });
    assert!(counts.exceptions() >= 10);
    assert_eq!(counts.connections(), 1);
}

#[test]
fn it_finds_a_server_that_was_away() {
    let Some(_watch) = with_files() else { return };
    let (bench, client, plc, events) = Bench::new();
    let (value, values) = newest::<u16>();
    let client = client.read(input(0), value).unwrap();
    let counts = client.counts();
    let address = plc.address();
    bench.run(client, async move {
        let mut plc = plc;
        for number in 1..4 {
            assert_eq!(events.recv().await?, Event::Connected);
            plc.set(input(0), number)?;
            until(&values, number).await?;
            plc.stop();
            let Event::Disconnected(error) = events.recv().await? else {
                panic!("no end")
            };
            assert!(matches!(error, RequestError::HungUp { .. }), "{error}");
            plc = again(address).await?;
        }
        Ok(())
    });
    assert!(counts.connections() >= 3, "{counts:?}");
}

/// Other tests' sockets may have the port for a moment.
async fn again(address: SocketAddr) -> luna::Result<sim::Server> {
    loop {
        match sim::Server::start_at(address) {
            Err(error) if error.kind() == ErrorKind::AddrInUse => luna::yield_now().await,
            started => return Ok(started?),
        }
    }
}

#[test]
fn a_slow_server_makes_cycles_late_and_one_beyond_the_limit_is_left() {
    let Some(_watch) = with_files() else { return };
    let (bench, client, plc, events) = Bench::new();
    let (value, values) = newest::<u16>();
    let limit = Duration::from_millis(500);
    let client = client
        .timeout(limit)
        .and_then(|client| client.read(input(0), value))
        .unwrap();
    let counts = client.counts();
    plc.fault(Fault::Slow(Duration::from_millis(20)));
    let seen = counts.clone();
    bench.run(client, async move {
        for number in 1..4 {
            plc.set(input(0), number)?;
            until(&values, number).await?;
        }
        assert!(seen.late() >= 2, "{seen:?}");
        plc.fault(Fault::Silent);
        // A busy machine may have been beyond the limit before.
        let error = loop {
            if let Event::Disconnected(error) = events.recv().await? {
                break error;
            }
        };
        let request = error.request();
        assert_eq!(error, RequestError::TimedOut { request, limit });
        plc.fault(Fault::None);
        plc.set(input(0), 9_u16)?;
        until(&values, 9).await?;
        Ok(())
    });
    assert!(counts.timeouts() >= 1 && counts.connections() >= 2);
}

#[test]
fn garbage_closes_the_connection_and_is_named() {
    let Some(_watch) = with_files() else { return };
    let (bench, client, plc, events) = Bench::new();
    let (value, values) = newest::<u16>();
    let client = client.read(input(0), value).unwrap();
    let counts = client.counts();
    bench.run(client, async move {
        assert_eq!(events.recv().await?, Event::Connected);
        let http = b"HTTP/1.1 400 Bad Request\r\n\r\n".to_vec();
        let cases = [
            (1_u16, Fault::Garbage(http), Garbage::Header),
            (2, Fault::Unit(9), Garbage::Unit),
        ];
        for (number, fault, why) in cases {
            plc.fault(fault);
            let Event::Disconnected(error) = events.recv().await? else {
                panic!("no end")
            };
            let request = error.request();
            assert_eq!(error, RequestError::Garbage { request, why });
            // Over the next connection it is well again, though it begins with garbage still.
            plc.fault(Fault::None);
            plc.set(input(0), number)?;
            until(&values, number).await?;
            while events.try_recv().is_ok() {}
        }
        Ok(())
    });
    assert!(counts.garbage() >= 2 && counts.connections() >= 3);
}

#[test]
fn an_answer_to_another_request_is_discarded() {
    let Some(_watch) = with_files() else { return };
    let (bench, client, plc, events) = Bench::new();
    let (value, values) = newest::<u16>();
    let client = client.read(input(0), value).unwrap();
    let counts = client.counts();
    let seen = counts.clone();
    bench.run(client, async move {
        assert_eq!(events.recv().await?, Event::Connected);
        // As of long ago, or doubled by a gateway: with values, and a refusal.
        let stale = [0xFF, 0xFF, 0, 0, 0, 5, 1, 4, 2, 0, 99];
        let refused = [0xFF, 0xFE, 0, 0, 0, 3, 1, 0x84, 2];
        plc.fault(Fault::Before([&stale[..], &refused].concat()));
        for number in 1..10 {
            plc.set(input(0), number)?;
            loop {
                let value = values.recv().await?;
                assert_ne!(value, 99);
                if value == number {
                    break;
                }
            }
        }
        assert!(seen.strays() >= 18, "{seen:?}");
        assert!(events.try_recv().is_err());
        Ok(())
    });
    assert_eq!((counts.garbage(), counts.connections()), (0, 1));
}

/// Gateways, and devices that take unit 255 and answer as another.
#[test]
fn a_server_may_answer_as_another_unit_where_that_is_stated() {
    for (asked, answered, answers) in [
        (255, 0, AnswerUnit::Is(0)),
        (0, 255, AnswerUnit::Is(255)),
        (17, 1, AnswerUnit::Any),
        (0, 0, AnswerUnit::Asked),
        (255, 255, AnswerUnit::Asked),
    ] {
        let Some(_watch) = with_files() else { return };
        let (bench, client, plc, events) = Bench::new();
        let (value, values) = newest::<u16>();
        let (switch, switches) = newest::<bool>();
        let client = client
            .unit(asked)
            .answer_unit(answers)
            .read(input(0), value)
            .and_then(|client| client.write(coil(0), switches))
            .unwrap();
        let counts = client.counts();
        plc.fault(Fault::Unit(answered));
        bench.run(client, async move {
            assert_eq!(events.recv().await?, Event::Connected);
            plc.set(input(0), 7_u16)?;
            until(&values, 7).await?;
            switch.send(true).await?;
            drop((switch, values));
            // The client ends without another report.
            assert_eq!(events.recv().await.ok(), None);
            assert!(plc.get(coil(0))?);
            Ok(())
        });
        assert_eq!((counts.written(), counts.connections()), (1, 1));
    }
}

#[test]
fn a_server_that_stays_away_is_a_lost_device_and_an_emergency() {
    let Some(_watch) = with_files() else { return };
    let (bench, client, plc, events) = Bench::new();
    let (value, values) = newest::<u16>();
    let (switch, switches) = newest::<bool>();
    let client = client
        .reconnect(AT_ONCE.attempts(3))
        .read(input(0), value)
        .and_then(|client| client.write(coil(0), switches))
        .unwrap();
    let counts = client.counts();
    let Bench { mut system, device } = bench;
    plc.stop();
    let devices = system.devices();
    let main = system.executor("main").build().unwrap();
    main.process("client").spawn_ok(client);
    switch.try_send(true).unwrap();
    drop(device);
    let error = system.run().unwrap_err().to_string();
    assert!(error.contains("no connection after 3 attempts"), "{error}");
    assert_eq!(system.report().unwrap().end, End::Emergency);
    assert_eq!(devices.list()[0].state, DeviceState::Closed);
    assert_eq!((counts.connections(), counts.write_failures()), (0, 1));
    let Event::WriteFailed { value, error } = events.try_recv().unwrap() else {
        panic!("no report")
    };
    assert_eq!(value, 1.0);
    assert!(
        matches!(error, RequestError::NotConnected { .. }),
        "{error}"
    );
    drop((switch, values));
}

#[test]
fn the_loss_does_not_wait_for_the_reader_of_the_events() {
    let Some(_watch) = with_files() else { return };
    let (bench, _, plc, _events) = Bench::new();
    let (event, events) = luna::buffered(Buffer::fifo(1));
    let (value, values) = newest::<u16>();
    let (switch, switches) = luna::buffered::<bool>(Buffer::fifo(4));
    let client = luna_modbus::client(&bench.device, PERIOD, event)
        .and_then(|client| client.timeout(LONG))
        .and_then(|client| client.read(input(0), value))
        .and_then(|client| client.write(coil(0), switches))
        .unwrap()
        .reconnect(AT_ONCE.attempts(3));
    let counts = client.counts();
    let Bench { mut system, device } = bench;
    let main = system.executor("main").build().unwrap();
    main.process("client").spawn_ok(client);
    let kept = switch.clone();
    main.process("user").spawn_ok(async move {
        values.recv().await?;
        plc.stop();
        for is_on in [true, false, true] {
            switch.try_send(is_on).unwrap();
        }
        std::future::pending().await
    });
    drop(device);
    let error = system.run().unwrap_err().to_string();
    assert!(error.contains("no connection after 3 attempts"), "{error}");
    assert_eq!(system.report().unwrap().end, End::Emergency);
    assert_eq!(counts.write_failures(), 3);
    // The others had no room.
    assert_eq!(events.try_recv(), Ok(Event::Connected));
    assert!(events.try_recv().is_err());
    drop(kept);
}

#[test]
fn a_server_that_hangs_up_at_once_uses_up_the_attempts() {
    let Some(_watch) = with_files() else { return };
    let (bench, client, plc, _events) = Bench::new();
    let (value, _values) = newest::<u16>();
    let client = client
        .reconnect(AT_ONCE.attempts(3))
        .read(input(0), value)
        .unwrap();
    let counts = client.counts();
    let Bench { mut system, device } = bench;
    plc.fault(Fault::HangsUp);
    let main = system.executor("main").build().unwrap();
    main.process("client").spawn_ok(client);
    drop(device);
    let error = system.run().unwrap_err().to_string();
    let reason = "the server has hung up on function 4, input register 0";
    assert!(error.contains(reason), "{error}");
    assert_eq!(counts.connections(), 3);
}
