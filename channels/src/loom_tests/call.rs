//! Calls: whatever happens at once, the client gets the answer or an error, the server learns
//! which, and every value ends once.

use super::{Drops, Token, check, check_within, poll};
use crate::{CallError, Client, Server, alt, call_channel, channel};
use loom::future::block_on;
use loom::thread;

/// Answers one call; returns whether the client has the answer.
fn serve(server: &Server<Token, Token>, drops: &Drops) -> Option<bool> {
    let call = block_on(server.accept()).ok()?;
    assert_eq!(call.id, 1);
    Some(call.reply(drops.token(2)).is_ok())
}

fn call(client: &Client<Token, Token>, drops: &Drops) -> Result<(), CallError<Token>> {
    let answer = block_on(client.call(drops.token(1)))?;
    assert_eq!(answer.id, 2);
    Ok(())
}

#[test]
fn a_call_and_its_reply() {
    check(|| {
        let drops = Drops::default();
        let (client, server) = call_channel();
        let of_client = drops.clone();
        let thread = thread::spawn(move || call(&client, &of_client).is_ok());
        assert_eq!(serve(&server, &drops), Some(true));
        assert!(thread.join().unwrap());
        assert_eq!(drops.count(), 2);
    });
}

#[test]
fn the_client_goes_as_it_is_served() {
    check(|| {
        let drops = Drops::default();
        let (client, server) = call_channel();
        let mut call = Box::pin(client.call(drops.token(1)));
        assert!(poll(&mut call).is_pending());
        let of_server = drops.clone();
        let thread = thread::spawn(move || match poll(&mut Box::pin(server.accept())) {
            std::task::Poll::Ready(Ok(call)) => {
                let _ = call.reply(of_server.token(2));
                2
            }
            _ => 1,
        });
        drop(call);
        assert_eq!(thread.join().unwrap(), drops.count());
    });
}

#[test]
fn poison_as_a_call_is_served() {
    check_within(2, || {
        let drops = Drops::default();
        let (client, server) = call_channel();
        let (of_client, poisoner) = (drops.clone(), client.clone());
        let calls = thread::spawn(move || match call(&client, &of_client) {
            Ok(()) => Some(true),
            Err(CallError::Interrupted) => Some(false),
            Err(CallError::Poisoned(request)) => {
                assert_eq!(request.id, 1);
                None
            }
            Err(error) => panic!("{error}"),
        });
        let poison = thread::spawn(move || poisoner.poison());
        let served = serve(&server, &drops);
        assert_eq!(calls.join().unwrap(), served, "both say the same");
        poison.join().unwrap();
        assert_eq!(drops.count(), if served.is_some() { 2 } else { 1 });
    });
}

#[test]
fn the_accept_goes_as_a_client_comes() {
    check(|| {
        let drops = Drops::default();
        let (client, server) = call_channel();
        let mut accept = Box::pin(server.accept());
        assert!(poll(&mut accept).is_pending());
        let of_client = drops.clone();
        let thread = thread::spawn(move || call(&client, &of_client).is_ok());
        drop(accept);
        assert_eq!(serve(&server, &drops), Some(true));
        assert!(thread.join().unwrap());
        assert_eq!(drops.count(), 2);
    });
}

#[test]
fn the_accept_goes_as_its_client_does() {
    check(|| {
        let drops = Drops::default();
        let (client, server) = call_channel::<Token, Token>();
        let mut accept = Box::pin(server.accept());
        assert!(poll(&mut accept).is_pending());
        let of_client = drops.clone();
        let thread = thread::spawn(move || {
            let mut call = Box::pin(client.call(of_client.token(1)));
            assert!(poll(&mut call).is_pending());
        });
        drop(accept);
        thread.join().unwrap();
        assert!(server.try_accept().is_err());
        assert_eq!(drops.count(), 1);
    });
}

#[test]
fn the_call_is_dropped_as_its_client_looks() {
    check(|| {
        let drops = Drops::default();
        let (client, server) = call_channel();
        let of_client = drops.clone();
        let thread = thread::spawn(move || {
            call(&client, &of_client).is_err_and(|error| error.is_unanswered())
        });
        drop(block_on(server.accept()).unwrap());
        assert!(thread.join().unwrap());
        assert_eq!(drops.count(), 1);
    });
}

#[test]
fn an_alternative_calls_and_waits_again_as_an_accept_goes() {
    check(|| {
        let drops = Drops::default();
        let (client, server) = call_channel();
        let (_idle, never) = channel::<u8>();
        let mut accept = Box::pin(server.accept());
        assert!(poll(&mut accept).is_pending());
        let of_client = drops.clone();
        let thread = thread::spawn(move || {
            block_on(async {
                alt! {
                    answer = client.call(of_client.token(1)) => answer.is_ok_and(|answer: Token| answer.id == 2),
                    _ = never.recv() => unreachable!(),
                }
            })
        });
        drop(accept);
        assert_eq!(serve(&server, &drops), Some(true));
        assert!(thread.join().unwrap());
        assert_eq!(drops.count(), 2);
    });
}
