//! A program that drives a card is killed (`kill -9`) at random instants: the card's outputs are
//! neutral within its watchdog's time, each time.
//!
//! The card is simulated in this program, the link runs in a child. 20 times; `LUNA_LONG=1` makes
//! it 1 000 times, with a seed from the clock.

#[path = "../common/mod.rs"]
mod common;
use common::{FASTEST, PERIOD, register, samples, seed, turning};
use luna::prelude::*;
use luna_mesa::{Actuator, Card};
use luna_mesa_sim::Server;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// Where the child finds the card.
const ADDRESS: &str = "LUNA_TEST_CARD";
const WATCHDOG: Duration = Duration::from_millis(100);

fn main() {
    match std::env::var(ADDRESS) {
        Ok(address) => drive(&address).unwrap(),
        Err(_) => kill_again_and_again(),
    }
}

/// The child: drives as fast as possible, until it is killed.
fn drive(address: &str) -> luna::Result<()> {
    let card = Card::open(address).map_err(luna::Error::other)?;
    let (count, counts) = samples();
    let (duty, duties) = register();
    let (level, levels) = register();
    let mut link = card.link("card", PERIOD);
    link.watchdog(WATCHDOG).encoder(0, FASTEST, count);
    link.pwm(0, duties).output(12, false, levels);
    // Set once, for the duty shows that the writer is alive.
    link.greatest_age(Actuator::Output(12), None);
    let process = link.process().map_err(luna::Error::other)?;
    let mut system = System::new("child");
    let main = system.executor("main").build()?;
    main.process("card").spawn(process)?;
    main.process("control").spawn(async move {
        level.send(true).await?;
        loop {
            counts.recv().await?;
            duty.send(0.5).await?;
        }
    })?;
    system.run().map(drop)
}

fn kill_again_and_again() {
    let is_long = std::env::var("LUNA_LONG").is_ok_and(|long| long == "1");
    let mut random = if is_long {
        luna::now().as_nanos()
    } else {
        seed()
    };
    let rounds = if is_long { 1_000 } else { 20 };
    let server = turning();
    let (mut driven, mut ended, mut least, mut most) = (0, 0, u64::MAX, 0);
    for round in 0..rounds {
        // Most of the time while it drives, sometimes while it begins.
        random = random.wrapping_mul(0x5851_F42D_4C95_7F2D).wrapping_add(1);
        let delay = Duration::from_micros((random >> 40) % 30_000);
        let mut child = spawn(&server);
        // On a busy machine a child may miss the watchdog's time: it has ended as it should, and
        // another one is killed.
        while round % 8 != 0 && !comes_to_drive(&server, &mut child) {
            ended += 1;
            assert!(ended <= 2 * rounds, "the children end by themselves");
            child = spawn(&server);
        }
        std::thread::sleep(delay);
        child.kill().unwrap();
        // From here on it sends nothing.
        child.wait().unwrap();
        let (dead, was_neutral) = server.with_card(|card, now| (now, card.is_neutral()));
        common::wait_until(&server, |card| card.is_neutral());
        let watchdog = server.with_card(|card, _| card.watchdog());
        if was_neutral {
            continue;
        }
        driven += 1;
        // Packets in transit when it died are in the card's socket, and restart the watchdog when
        // the simulation reads them.
        let since = watchdog.fed_at().unwrap().max(dead);
        let bitten = watchdog.bitten_at().unwrap();
        assert!(watchdog.has_bitten());
        assert!(
            bitten <= since + WATCHDOG.as_nanos() as u64,
            "round {round}: too late"
        );
        let took = watchdog.seen_to_bite_at().unwrap() - dead;
        least = least.min(took);
        most = most.max(took);
    }
    assert!(
        driven >= rounds / 2,
        "only {driven} of {rounds} were driving"
    );
    println!(
        "{rounds} times killed, {driven} of them with outputs driven: neutral each time, seen {:.1} to {:.1} ms after its death (watchdog {WATCHDOG:?})",
        least as f64 / 1e6,
        most as f64 / 1e6
    );
}

fn spawn(server: &Server) -> Child {
    Command::new(std::env::current_exe().unwrap())
        .env(ADDRESS, server.address().to_string())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

/// Waits until the outputs are driven; false if the child has ended before.
fn comes_to_drive(server: &Server, child: &mut Child) -> bool {
    let deadline = luna::now() + Duration::from_secs(20);
    while !server.with_card(|card, _| card.duty(0) == 0.5 && card.driven_level(12) == Some(true)) {
        if child.try_wait().unwrap().is_some() {
            return false;
        }
        assert!(luna::now() < deadline, "the child does not drive");
        std::thread::sleep(Duration::from_micros(200));
    }
    true
}
