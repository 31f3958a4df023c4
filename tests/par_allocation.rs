//! `par!` allocates nothing.

mod common;
mod counting;

use common::watchdog;
use counting::Counting;
use luna::Error;
use luna::prelude::*;
use std::time::Duration;

#[global_allocator]
static ALLOCATOR: Counting = Counting::new();

#[test]
fn nothing_is_allocated_or_freed_after_the_construction() {
    let _watch = watchdog();
    luna::run(async {
        let (a, b) = luna::channel();
        let (c, d) = luna::channel::<u64>();
        let counted = ALLOCATOR.here();
        assert!(counted.0 > 0, "it does count");
        let succeeding = par!(
            async {
                for n in 0..1000u64 {
                    a.send(n).await?;
                }
                Ok::<_, Error>(())
            },
            async {
                let mut sum = 0;
                for _ in 0..1000 {
                    sum += b.recv().await?;
                }
                Ok(sum)
            },
            async {
                for _ in 0..5 {
                    luna::after(Duration::from_micros(100)).await;
                }
                Ok::<_, Error>(())
            },
            par!(c.send(1), d.recv()),
        );
        let (_, sum, _, (_, received)) = succeeding.await?;
        assert_eq!((sum, received), (499_500, 1));
        let failing = par!(c.send(2), async { Err::<(), _>(Error::Timeout) }).await;
        assert_eq!(failing, Err(Error::Poisoned));
        drop(par!(a.send(1), b.recv()));
        assert_eq!(ALLOCATOR.here(), counted);
        Ok(())
    })
    .unwrap();
    assert_eq!(
        ALLOCATOR.on_path(),
        (0, 0),
        "there is no path without a system"
    );
}
