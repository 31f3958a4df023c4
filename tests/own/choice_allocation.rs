//! Choosing and meeting allocate nothing: alternatives with every kind of guard, an `Alternative`,
//! barriers, extended rendezvous, ticks.

use crate::ALLOCATOR;
use crate::common;

use common::watchdog;
use luna::prelude::*;
use std::time::Duration;

const ROUNDS: u64 = 1000;

#[test]
fn nothing_is_allocated_or_freed_by_choosing_and_meeting_on_the_path() {
    own_process!();
    let _watch = watchdog();
    let mut system = System::new("choices");
    let left = system.executor("left").build().unwrap();
    let right = system.executor("right").build().unwrap();
    let (one, from_one) = luna::channel::<u64>();
    let (two, from_two) = luna::channel::<u64>();
    let (many, inputs): (Vec<_>, Vec<_>) = (0..5).map(|_| luna::channel::<u64>()).unzip();
    let barrier = Barrier::new(2);
    let met = barrier.clone();

    left.process("offers")
        .spawn(async move {
            let mut slot = None;
            let counted = ALLOCATOR.here();
            for n in 0..ROUNDS {
                slot.get_or_insert(n);
                alt! {
                    sent = one.send_from(&mut slot) => sent?,
                    sent = two.send_with(move || n) => sent?,
                    _ = luna::after(Duration::from_secs(1000)) => unreachable!(),
                }
                pri_alt! {
                    sent = one.send(n), if n == u64::MAX => sent?,
                    skip => {}
                }
                many[n as usize % many.len()].send(n).await?;
                alt! { _ = barrier.sync() => {} }
            }
            assert_eq!(ALLOCATOR.here(), counted);
            Ok(())
        })
        .unwrap();
    right
        .process("takes")
        .spawn(async move {
            // Both allocate when they are made.
            let mut inputs = Alternative::fair(&inputs);
            let mut ticks = luna::ticks(Duration::from_secs(1000))?;
            let counted = ALLOCATOR.here();
            for _ in 0..ROUNDS {
                pri_alt! {
                    _ = ticks.tick() => unreachable!(),
                    value = from_one.recv_extended() => drop(value?),
                    value = from_two.recv() => drop(value?),
                }
                let (_, value) = inputs.recv().await;
                value?;
                met.sync().await;
            }
            assert_eq!(ALLOCATOR.here(), counted);
            Ok(())
        })
        .unwrap();
    system.run().unwrap();
    assert!(
        ALLOCATOR.on_path().0 > 0,
        "it does count: what is made in a body"
    );
}
