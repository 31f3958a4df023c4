//! A loop follows the ticks of another computer, on the virtual clock and a simulated wire.

use super::wire::SimulatedClock;
use crate::common::{Random, SpawnOk, seed, watchdog};
use luna::prelude::*;
use luna::time::{FollowState, Follower, LeaderTick, Stamp};
use luna_links::cycle::{Moment, Protocol, Received, Settings};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const PERIOD: Duration = Duration::from_millis(1);
/// The leader's period on this clock: its quartz is 80 ppm slow.
const LEADER_PERIOD: u64 = 1_000_080;
/// The leader's clock is that far ahead.
const AHEAD: i64 = 5_000_000_000;

type Side = Protocol<[u8; 4], [u8; 4]>;

/// Datagrams under way each way, by the time of arrival.
#[derive(Default)]
struct Wires([Vec<(u64, Vec<u8>)>; 2]);

type Shared = Arc<Mutex<Wires>>;

fn put(wires: &Shared, to: usize, random: &mut Random, bytes: &[u8]) {
    // One in ten is lost.
    if !random.chance(26) {
        let arrival = luna::now().as_nanos() + 20_000 + random.below(60_000_u64);
        wires.lock().unwrap().0[to].push((arrival, bytes.to_vec()));
    }
}

/// What has arrived, by the time of arrival.
fn arrived(wires: &Shared, to: usize) -> Vec<(u64, Vec<u8>)> {
    let now = luna::now().as_nanos();
    let mut wires = wires.lock().unwrap();
    let mut there: Vec<_> = wires.0[to].extract_if(.., |(at, _)| *at <= now).collect();
    there.sort();
    there
}

/// As both clocks of the leader show an instant of the simulation.
fn ahead(nanos: u64) -> Moment {
    let stamp = Stamp::from_nanos(nanos).plus_nanos(AHEAD);
    Moment {
        stamp,
        instant: luna::Instant::from_nanos(nanos),
    }
}

fn same(nanos: u64) -> Moment {
    Moment {
        stamp: Stamp::from_nanos(nanos),
        instant: luna::Instant::from_nanos(nanos),
    }
}

/// Until the follower has gone.
async fn leader(
    wires: Shared,
    mut side: Side,
    mut random: Random,
    is_over: Arc<AtomicBool>,
) -> luna::Result<()> {
    let period = Duration::from_nanos(LEADER_PERIOD);
    let mut tick = luna::periodic("leader", period)?;
    while !is_over.load(Relaxed) {
        let cycle = tick.next().await;
        for (at, bytes) in arrived(&wires, 0) {
            if side.receive(&bytes, ahead(at)) == Received::Answer {
                let hello = side.hello(ahead(luna::now().as_nanos())).to_vec();
                put(&wires, 1, &mut random, &hello);
            }
        }
        // It is silent for a while.
        if !(1_000..1_100).contains(&cycle.number) {
            let slot = ahead(cycle.deadline.as_nanos()).stamp;
            let now = ahead(luna::now().as_nanos());
            let bytes = side.send(&[0; 4], Some(slot), now).to_vec();
            put(&wires, 1, &mut random, &bytes);
        }
    }
    Ok(())
}

/// How far a slot is from the leader's, on the only clock there is.
fn real_error(slot: luna::Instant, begin: luna::Instant) -> u64 {
    let after = slot.nanos_since(begin) % LEADER_PERIOD;
    after.min(LEADER_PERIOD - after)
}

async fn follower(wires: Shared, mut side: Side, mut random: Random) -> luna::Result<()> {
    let begin = luna::now();
    luna::after(Duration::from_micros(437)).await;
    let mut tick = luna::periodic("follower", PERIOD)?;
    let mut follower = Follower::new(PERIOD)?;
    let mut locked_at = None;
    let mut greatest = 0;
    for number in 1..=2_000_u64 {
        let cycle = tick.next().await;
        let mut leader = None;
        for (at, bytes) in arrived(&wires, 1) {
            match side.receive(&bytes, same(at)) {
                Received::Sample(sample) => {
                    leader = sample.tick.map(|tick| LeaderTick {
                        at: luna::Instant::from_nanos(tick.at.as_nanos()),
                        error: tick.error,
                    });
                }
                Received::Answer => {
                    let hello = side.hello(same(luna::now().as_nanos())).to_vec();
                    put(&wires, 0, &mut random, &hello);
                }
                Received::Nothing => {}
            }
        }
        let bytes = side
            .send(&[0; 4], None, same(luna::now().as_nanos()))
            .to_vec();
        put(&wires, 0, &mut random, &bytes);
        let followed = follower.follow(&mut tick, &cycle, leader);
        if followed.state == FollowState::Locked {
            locked_at.get_or_insert(number);
        }
        if number > 300 {
            greatest = greatest.max(real_error(cycle.deadline, begin));
        }
        if number == 1_050 {
            assert_eq!(followed.state, FollowState::FreeRunning);
        }
    }
    println!(
        "locked in cycle {locked_at:?}, at most {greatest} ns from the leader, 99 of 100 seem {:?}",
        follower.phase_error().percentile(99.0)
    );
    assert!(locked_at.is_some_and(|cycle| cycle <= 150), "{locked_at:?}");
    assert_eq!(
        (follower.state(), follower.losses()),
        (FollowState::Locked, 1)
    );
    assert!(
        (follower.rate_ppm() - 80.0).abs() < 40.0,
        "{}",
        follower.rate_ppm()
    );
    // The wire's delay differs by 60 µs from datagram to datagram.
    assert!(greatest < 20_000, "{greatest} ns");
    assert!(follower.phase_error().count() > 1_000);
    Ok(())
}

#[test]
fn a_loop_follows_the_other_computers_tick_and_goes_on_without_it() {
    let _watch = watchdog();
    let mut random = Random::new(seed());
    let mut system = System::new("follow");
    system.virtual_clock();
    let settings = Settings::new(PERIOD).drift_ppm(100);
    let origin = SimulatedClock::default().moment(super::wire::BEGIN);
    let [here, there] = [1, 2].map(|session| Side::new(session, &settings, origin));
    let wires = Shared::default();
    let main = system.executor("main").build().unwrap();
    let is_over = Arc::new(AtomicBool::new(false));
    let leading = leader(wires.clone(), there, random.split(), is_over.clone());
    main.process("leader").spawn_ok(leading);
    main.process("follower").spawn_ok(async move {
        let followed = follower(wires, here, random).await;
        is_over.store(true, Relaxed);
        followed
    });
    system.run().unwrap();
}
