//! `par!` allocates nothing.

use crate::ALLOCATOR;
use crate::common;

use common::watchdog;
use luna::Error;
use luna::prelude::*;
use std::time::Duration;

#[test]
fn nothing_is_allocated_or_freed_after_the_construction() {
    own_process!();
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
        assert!(
            failing
                .unwrap_err()
                .errors()
                .eq(&[Error::Poisoned, Error::Timeout])
        );
        // An ordinary end: every branch of a network finds its channels closed or poisoned, also in
        // a nested network.
        let (e, f) = luna::channel::<u64>();
        let counted = ALLOCATOR.here();
        e.poison();
        let ended = par!(
            e.send(1),
            f.recv(),
            par!(e.send(1), par!(f.recv(), f.recv()), f.recv()),
            async { Ok::<_, Error>(()) },
            async { Err::<(), _>(Error::Closed) },
            pri_par!(e.send(1), f.recv()),
        );
        let error = ended.await.unwrap_err();
        assert!(error.is_poisoned());
        assert_eq!(error.errors().count(), 9);
        assert!(
            error
                .errors()
                .skip(6)
                .eq(&[Error::Closed, Error::Poisoned, Error::Poisoned])
        );
        drop(error);
        assert_eq!(ALLOCATOR.here(), counted);
        drop((e, f));
        let counted = ALLOCATOR.here();
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
