//! TCP on loopback: records in pieces, resets, stalled peers, and connecting again.

#![cfg(feature = "net")]

use crate::common;
use common::{SpawnOk, run_to_loss, with_files};
use luna::external::{Frame, Framing, LinkError, Prefix};
use luna::prelude::*;
use luna_links::OnBad;
use luna_links::tcp::{self, Connector, Reconnect};
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::Duration;

type Text = Frame<64>;

fn any() -> SocketAddr {
    "127.0.0.1:0".parse().unwrap()
}

fn text(text: &str) -> Text {
    Text::new(text.as_bytes()).unwrap()
}

/// At once, and as often as it takes.
const AT_ONCE: Reconnect =
    Reconnect::backing_off(Duration::from_millis(1), Duration::from_millis(10));

#[test]
fn records_in_pieces_of_one_byte_are_whole_again() {
    let Some(_watch) = with_files() else { return };
    let mut system = System::new("server");
    let port = tcp::listen(&system.devices(), any()).unwrap();
    let address = port.address().unwrap();
    let (answers, outgoing) = luna::channel::<Text>();
    let (incoming, requests) = luna::channel::<Text>();
    let framing = Framing::prefixed(Prefix::U8, 64);
    let link = tcp::link(&port, outgoing, incoming, framing).unwrap();
    let (sent, received) = (link.sent(), link.received());
    let main = system.executor("main").build().unwrap();
    main.process("link").spawn_ok(link);
    main.process("echo").spawn_ok(async move {
        while let Ok(request) = requests.recv().await {
            answers.send(request).await?;
            if *request == *b"end" {
                break;
            }
        }
        Ok(())
    });
    drop(port);
    let client = std::thread::spawn(move || {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.set_nodelay(true).unwrap();
        for request in ["", "one", "a longer one", "end"] {
            let mut record = vec![request.len() as u8];
            record.extend(request.as_bytes());
            for byte in &record {
                stream.write_all(&[*byte]).unwrap();
            }
            let mut answer = vec![0; record.len()];
            stream.read_exact(&mut answer).unwrap();
            assert_eq!(answer, record);
        }
        // Nothing more comes, since its sender is gone.
        assert_eq!(stream.read(&mut [0]).unwrap(), 0);
    });
    system.run().unwrap();
    client.join().unwrap();
    assert_eq!((sent.records(), received.records()), (4, 4));
    assert_eq!(received.connections(), 1);
}

#[test]
fn after_a_reset_it_connects_again_and_what_was_cut_off_is_counted() {
    let Some(_watch) = with_files() else { return };
    let listener = TcpListener::bind(any()).unwrap();
    let address = listener.local_addr().unwrap();
    let server = std::thread::spawn(move || {
        // Three connections: one that is cut off in a record, one that is reset, and one that
        // works.
        let (mut first, _) = listener.accept().unwrap();
        first.write_all(b"whole\nhal").unwrap();
        drop(first);
        let (mut second, _) = listener.accept().unwrap();
        second.write_all(b"reset me\n").unwrap();
        // Closing a socket with unread data resets the connection.
        second.peek(&mut [0]).unwrap();
        drop(second);
        let (mut third, _) = listener.accept().unwrap();
        third.write_all(b"again\n").unwrap();
        let mut line = [0; 6];
        third.read_exact(&mut line).unwrap();
        assert_eq!(&line, b"hello\n");
    });
    let mut system = System::new("client");
    let port = tcp::connect(&system.devices(), address).unwrap();
    let (requests, outgoing) = luna::channel::<Text>();
    let (incoming, replies) = luna::channel::<Text>();
    let link = tcp::link(&port, outgoing, incoming, Framing::lines(64))
        .unwrap()
        .reconnect(AT_ONCE);
    let received = link.received();
    let main = system.executor("main").build().unwrap();
    main.process("link").spawn_ok(link);
    main.process("client").spawn_ok(async move {
        assert_eq!(replies.recv().await?.text(), Ok("whole"));
        assert_eq!(replies.recv().await?.text(), Ok("reset me"));
        requests.send(text("never read")).await?;
        assert_eq!(replies.recv().await?.text(), Ok("again"));
        requests.send(text("hello")).await?;
        Ok(())
    });
    drop(port);
    system.run().unwrap();
    server.join().unwrap();
    assert_eq!((received.connections(), received.bad()), (3, 1));
}

#[test]
fn a_record_under_way_at_a_break_is_sent_again_whole() {
    let Some(_watch) = with_files() else { return };
    let listener = TcpListener::bind(any()).unwrap();
    let address = listener.local_addr().unwrap();
    let mut system = System::new("client");
    let port = tcp::connect(&system.devices(), address).unwrap();
    let (requests, outgoing) = luna::channel::<[u8; 4096]>();
    let (incoming, replies) = luna::channel::<[u8; 4096]>();
    // The first connection is not read, so a record gets stuck in it.
    let link = tcp::link(&port, outgoing, incoming, Framing::fixed(4096))
        .unwrap()
        .reconnect(AT_ONCE)
        .patience(Duration::from_millis(20));
    let (sent, received) = (link.sent(), link.received());
    let main = system.executor("main").build().unwrap();
    main.process("link").spawn_ok(link);
    let counted = received.clone();
    main.process("source").spawn_ok(async move {
        let mut number = 0_u32;
        // Until the second connection has taken some.
        let mut after = 0;
        while after < 3 {
            let mut record = [0; 4096];
            record[..4].copy_from_slice(&number.to_be_bytes());
            record[4092..].copy_from_slice(&number.to_be_bytes());
            requests.send(record).await?;
            number += 1;
            if counted.connections() >= 2 {
                after += 1;
            }
        }
        drop(requests);
        while replies.recv().await.is_ok() {}
        Ok(())
    });
    drop(port);
    let server = std::thread::spawn(move || {
        let (stalled, _) = listener.accept().unwrap();
        let (mut second, _) = listener.accept().unwrap();
        let mut all = Vec::new();
        second.read_to_end(&mut all).unwrap();
        drop(stalled);
        all
    });
    system.run().unwrap();
    let all = server.join().unwrap();
    // Records from its first byte on, in order, including the one that got stuck.
    assert_eq!(all.len() % 4096, 0);
    let numbers: Vec<u32> = all
        .chunks(4096)
        .map(|record| {
            assert_eq!(record[..4], record[4092..]);
            u32::from_be_bytes(record[..4].try_into().unwrap())
        })
        .collect();
    assert!(
        numbers.windows(2).all(|pair| pair[1] == pair[0] + 1),
        "{numbers:?}"
    );
    assert_eq!(u64::from(*numbers.last().unwrap()) + 1, sent.records());
    // What a connection holds, and no more: nothing grows.
    assert!(u64::from(numbers[0]) < 10_000, "{numbers:?}");
    assert_eq!(received.connections(), 2);
}

#[test]
fn without_a_second_attempt_the_loss_is_an_emergency() {
    let Some(_watch) = with_files() else { return };
    let listener = TcpListener::bind(any()).unwrap();
    let address = listener.local_addr().unwrap();
    let mut system = System::new("client");
    let devices = system.devices();
    let port = tcp::connect(&devices, address).unwrap();
    let (requests, outgoing) = luna::channel::<Text>();
    let (incoming, replies) = luna::channel::<Text>();
    let link = tcp::link(&port, outgoing, incoming, Framing::lines(64))
        .unwrap()
        .reconnect(Reconnect::NEVER);
    let main = system.executor("main").build().unwrap();
    main.process("link").spawn_ok(link);
    main.process("client").spawn_ok(async move {
        assert!(replies.recv().await.is_err());
        std::future::pending::<()>().await;
        drop(requests);
        Ok(())
    });
    drop(port);
    let server = std::thread::spawn(move || drop(listener.accept().unwrap()));
    let error = run_to_loss(&system, &devices);
    server.join().unwrap();
    assert!(error.contains("the other side has hung up"), "{error}");
}

#[test]
fn attempts_that_all_fail_are_counted_in_the_error() {
    let Some(_watch) = with_files() else { return };
    // A port that was just free.
    let gone = TcpListener::bind(any()).unwrap().local_addr().unwrap();
    let mut system = System::new("client");
    let devices = system.devices();
    let port = tcp::connect(&devices, gone).unwrap();
    let (requests, outgoing) = luna::channel::<Text>();
    let (incoming, replies) = luna::channel::<Text>();
    let link = tcp::link(&port, outgoing, incoming, Framing::lines(64))
        .unwrap()
        .reconnect(AT_ONCE.attempts(3));
    let main = system.executor("main").build().unwrap();
    main.process("link").spawn_ok(link);
    drop(port);
    let error = run_to_loss(&system, &devices);
    assert!(error.contains("no connection after 3 attempts"), "{error}");
    drop((requests, replies));
}

#[test]
fn a_server_that_hangs_up_at_once_is_an_attempt_that_failed() {
    let Some(_watch) = with_files() else { return };
    let listener = TcpListener::bind(any()).unwrap();
    let address = listener.local_addr().unwrap();
    let mut system = System::new("client");
    let devices = system.devices();
    let port = tcp::connect(&devices, address).unwrap();
    let (requests, outgoing) = luna::channel::<Text>();
    let (incoming, replies) = luna::channel::<Text>();
    let pause = Duration::from_millis(20);
    let link = tcp::link(&port, outgoing, incoming, Framing::lines(64))
        .unwrap()
        .reconnect(Reconnect::backing_off(pause, pause).attempts(3));
    let received = link.received();
    let main = system.executor("main").build().unwrap();
    main.process("link").spawn_ok(link);
    main.process("client").spawn_ok(async move {
        // The second connection brings a record: attempts are counted from there on.
        assert_eq!(replies.recv().await?.text(), Ok("hello"));
        assert!(replies.recv().await.is_err());
        std::future::pending::<()>().await;
        drop(requests);
        Ok(())
    });
    drop(port);
    let server = std::thread::spawn(move || {
        for number in 0..5 {
            let (mut stream, _) = listener.accept().unwrap();
            if number == 1 {
                stream.write_all(b"hello\n").unwrap();
            }
        }
        std::time::Instant::now()
    });
    let begun = std::time::Instant::now();
    let error = run_to_loss(&system, &devices);
    let last = server.join().unwrap();
    assert!(error.contains("the other side has hung up"), "{error}");
    assert_eq!(received.connections(), 5);
    // A pause before each but the first, and after the useful connection. The server may see one
    // late, but none early.
    assert!(last - begun >= pause * 3, "{:?}", last - begun);
}

/// The results of a connector, until it gives an error; it takes no connection for useful but the
/// first if `is_first_useful`.
async fn used_up(mut connector: Connector, is_first_useful: bool) -> (u32, LinkError) {
    let mut connections = 0;
    loop {
        match connector.connect().await {
            Ok(_) => connections += 1,
            Err(error) => {
                // It stays so.
                assert_eq!(connector.connect().await.unwrap_err(), error);
                return (connections, error);
            }
        }
        if connections == 1 && is_first_useful {
            connector.useful();
        }
    }
}

#[test]
fn a_connector_names_what_it_has_found() {
    let Some(_watch) = with_files() else { return };
    let listener = TcpListener::bind(any()).unwrap();
    let open = listener.local_addr().unwrap();
    let gone = TcpListener::bind(any()).unwrap().local_addr().unwrap();
    let mut system = System::new("client");
    let main = system.executor("main").build().unwrap();
    main.process("client").spawn_ok(async move {
        let new = |address, attempts| Connector::new(address, AT_ONCE.attempts(attempts));
        let attempts = 3;
        let unused = LinkError::NoAttemptLeft { attempts };
        assert_eq!(used_up(new(open, 3), false).await, (3, unused.clone()));
        assert_eq!(used_up(new(open, 3), true).await, (4, unused));
        let never = Connector::new(open, Reconnect::NEVER);
        let once = LinkError::NoAttemptLeft { attempts: 1 };
        assert_eq!(used_up(never, true).await, (1, once));
        let error = ErrorKind::ConnectionRefused;
        match used_up(new(gone, 3), false).await {
            (
                0,
                LinkError::NotConnected {
                    attempts: 3,
                    error: found,
                },
            ) => {
                assert_eq!(found.kind(), error);
            }
            other => panic!("{other:?}"),
        }
        Ok(())
    });
    system.run().unwrap();
    drop(listener);
}

#[test]
fn a_server_takes_one_client_after_the_other_and_garbage_is_dropped_if_set() {
    let Some(_watch) = with_files() else { return };
    let mut system = System::new("server");
    let port = tcp::listen(&system.devices(), any()).unwrap();
    let address = port.address().unwrap();
    let (answers, outgoing) = luna::channel::<Text>();
    let (incoming, requests) = luna::channel::<Frame<8>>();
    let link = tcp::link(&port, outgoing, incoming, Framing::lines(8))
        .unwrap()
        .on_bad(OnBad::Drop);
    let received = link.received();
    let main = system.executor("main").build().unwrap();
    main.process("link").spawn_ok(link);
    main.process("user").spawn_ok(async move {
        for number in 0..3 {
            assert_eq!(requests.recv().await?.text(), Ok(["a", "b", "c"][number]));
        }
        drop((answers, requests));
        Ok(())
    });
    drop(port);
    let clients = std::thread::spawn(move || {
        for line in ["a\n", "much too long\nb\n", "c\n"] {
            let mut stream = TcpStream::connect(address).unwrap();
            stream.write_all(line.as_bytes()).unwrap();
        }
    });
    system.run().unwrap();
    clients.join().unwrap();
    assert_eq!(received.bad(), 1);
    assert_eq!(received.records(), 3);
}
