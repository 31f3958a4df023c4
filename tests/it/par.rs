//! `par!`: branches that borrow, all errors in written order, and how siblings of a failed branch
//! end.

use crate::common;
use common::{PLACEMENTS, SpawnOk, watchdog};
use futures_lite::future;
use luna::prelude::*;
use luna::{Error, RecvError, SendError};
use std::cell::{Cell, RefCell};
use std::time::Duration;

#[test]
fn values_come_in_written_order() {
    let _watch = watchdog();
    let wait = |millis, value: &'static str| async move {
        luna::after(Duration::from_millis(millis)).await;
        Ok::<_, Error>(value)
    };
    let values =
        luna::run(async { par!(wait(4, "late"), wait(0, "early"), wait(2, "between")).await });
    assert_eq!(values, Ok(("late", "early", "between")));
    // A single branch, and a comma behind the last.
    assert_eq!(
        luna::run(async { par!(wait(0, "alone"),).await }),
        Ok(("alone",))
    );
}

#[test]
fn branches_borrow_from_their_surroundings() {
    let _watch = watchdog();
    let text = String::from("shared");
    let calls = Cell::new(0);
    let (mut left, mut right) = (Vec::new(), Vec::new());
    luna::run(async {
        par!(
            async {
                luna::yield_now().await;
                left.push(text.len());
                calls.set(calls.get() + 1);
                Ok::<_, Error>(())
            },
            async {
                right.push(&text[..2]);
                calls.set(calls.get() + 1);
                Ok::<_, Error>(())
            },
        )
        .await?;
        Ok(())
    })
    .unwrap();
    assert_eq!(
        (left, right, calls.get(), text.as_str()),
        (vec![6], vec!["sh"], 2, "shared")
    );
}

#[test]
fn all_errors_in_written_order_after_all_have_ended() {
    let _watch = watchdog();
    let ended = RefCell::new(Vec::new());
    // Yields that often before it fails: so the last written ends before the first does.
    let fail = |yields, name: &'static str| {
        let ended = &ended;
        async move {
            for _ in 0..yields {
                luna::yield_now().await;
            }
            ended.borrow_mut().push(name);
            Err::<(), _>(Error::other(name))
        }
    };
    let outcome =
        luna::run(async { par!(fail(6, "first"), fail(0, "second"), fail(3, "third")).await });
    let error = outcome.unwrap_err();
    let texts: Vec<String> = error.errors().map(Error::to_string).collect();
    assert_eq!(texts, ["first", "second", "third"]);
    assert_eq!(*ended.borrow(), ["second", "third", "first"]);
}

#[test]
fn siblings_of_a_failed_branch_are_poisoned_where_they_wait_and_later() {
    let _watch = watchdog();
    for place in PLACEMENTS {
        let (pending, _kept_open) = luna::channel::<u32>();
        let (served, service) = luna::buffered::<u32>(Buffer::fifo(8));
        let body = async move {
            let outcome = par!(
                async {
                    // Waits when its sibling fails.
                    let error = pending.send(7).await.unwrap_err();
                    assert!(error.is_poisoned());
                    assert_eq!(error.into_inner(), 7, "the value comes back");
                    // What could be done at once fails too, with timeouts and nested.
                    assert!(served.send(1).await.unwrap_err().is_poisoned());
                    assert!(service.recv().await.unwrap_err().is_poisoned());
                    assert!(
                        service
                            .recv_timeout(Duration::from_secs(100))
                            .await
                            .unwrap_err()
                            .is_poisoned()
                    );
                    let nested = par!(async { Ok::<_, Error>(served.send(2).await?) }).await;
                    assert_eq!(nested, Err(Error::Poisoned));
                    Ok::<_, Error>(())
                },
                async {
                    luna::yield_now().await;
                    Err::<(), _>(Error::other("the cause"))
                },
            )
            .await;
            assert_eq!(outcome.unwrap_err().to_string(), "the cause");
            // The construct is over, and with it the poison; the channels themselves had none.
            served.send(3).await?;
            assert_eq!(service.recv().await, Ok(3));
            Ok(())
        };
        let mut system = System::new("siblings");
        place.process(&mut system, "place", "parent").spawn_ok(body);
        system.run().unwrap();
    }
}

#[test]
fn a_branch_that_failed_is_dropped_before_its_siblings_go_on() {
    let _watch = watchdog();
    let (sender, receiver) = luna::channel::<()>();
    let outcome = luna::run(async move {
        par!(
            async move {
                let _owned = sender;
                luna::yield_now().await;
                Err::<(), _>(Error::other("the cause"))
            },
            async {
                // Not through the construct, so only the end of the sender says it.
                luna::after(Duration::from_millis(1)).await;
                assert!(receiver.try_recv().unwrap_err().is_closed());
                Ok::<_, Error>(())
            }
        )
        .await
    });
    assert_eq!(outcome.unwrap_err().to_string(), "the cause");
}

#[test]
fn branches_with_errors_of_different_types() {
    let _watch = watchdog();
    let (sender, receiver) = luna::channel();
    let outcome = luna::run(async {
        par!(
            async { sender.send(1).await },                // SendError<i32>
            async { receiver.recv().await },               // RecvError
            async { Ok::<_, Error>("luna") },              // luna::Error
            async { Ok::<_, std::io::Error>("standard") }, // one that turns into it
            async { Ok(()) },                              // none said
        )
        .await
    });
    assert_eq!(outcome, Ok(((), 1, "luna", "standard", ())));

    let (sender, receiver) = luna::channel::<String>();
    receiver.poison();
    let send = |text: &str| {
        let text = text.to_owned();
        let sender = &sender;
        async move { sender.send(text).await }
    };
    let sent = luna::run(async { par!(async { Ok::<_, RecvError>(()) }, send("x")).await });
    assert_eq!(sent, Err(Error::Poisoned));
    drop(receiver);
    let (sender, receiver) = luna::channel::<u8>();
    drop(receiver);
    let closed =
        luna::run(async { par!(async { Ok::<_, SendError<u8>>(()) }, sender.send(1)).await });
    assert_eq!(closed, Err(Error::Closed));
}

#[test]
fn nested() {
    let _watch = watchdog();
    let (a, b) = luna::channel();
    let (c, d) = luna::channel();
    let sum = luna::run(async {
        let ((_, x), (_, y)) = par!(par!(a.send(1), b.recv()), async {
            par!(async { Ok(c.send(20).await?) }, d.recv()).await
        })
        .await?;
        Ok(x + y)
    });
    assert_eq!(sum, Ok(21));
    // A failure reaches the branches of constructs within, and comes out of them.
    let outcome: luna::Result<_> = luna::run(async {
        par!(par!(a.send(1), async { par!(c.send(2)).await }), async {
            Err::<(), _>(Error::other("outer"))
        })
        .await
    });
    let error = outcome.unwrap_err();
    assert!(error.is_poisoned(), "the first in written order is");
    assert_eq!(
        error.to_string(),
        "3 errors in a parallel construct: \
         branches 1.1 to 1.2: the channel is poisoned, or a sibling in a parallel construct has failed; branch 2: outer"
    );
    // One within does not reach those without, but by its value.
    let outcome = luna::run(async {
        par!(
            async {
                let inner = par!(a.send(1), async { Err::<(), _>(Error::other("inner")) }).await;
                let inner: Vec<_> = inner.unwrap_err().errors().map(Error::to_string).collect();
                assert_eq!(inner, [Error::Poisoned.to_string(), "inner".to_owned()]);
                Ok::<_, Error>(())
            },
            async {
                luna::after(Duration::from_millis(1)).await;
                par!(a.send(3), b.recv()).await
            },
        )
        .await
    });
    assert_eq!(outcome, Ok(((), ((), 3))));
}

#[test]
fn twelve_branches() {
    let _watch = watchdog();
    let (sender, receiver) = luna::channel();
    let send = |n: u32| sender.send(n);
    let outcome = luna::run(async {
        par!(
            send(0),
            send(1),
            send(2),
            send(3),
            send(4),
            send(5),
            send(6),
            send(7),
            send(8),
            send(9),
            send(10),
            async {
                let mut seen = Vec::new();
                for _ in 0..11 {
                    seen.push(receiver.recv().await?);
                }
                Ok::<_, Error>(seen)
            },
        )
        .await
    });
    let (.., seen) = outcome.unwrap();
    assert_eq!(
        seen,
        (0..11).collect::<Vec<_>>(),
        "polled in the order written, served in that of arrival"
    );
}

#[test]
fn dropping_it_withdraws_what_its_branches_offered() {
    let _watch = watchdog();
    let (sender, receiver) = luna::channel();
    let (other, others) = luna::channel::<u8>();
    let counted = std::sync::Arc::new(());
    luna::run(async {
        {
            let offers = par!(sender.send(counted.clone()), others.recv(), async {
                luna::after(Duration::from_secs(1000)).await;
                Ok::<_, Error>(())
            });
            assert!(future::poll_once(offers).await.is_none());
        }
        assert_eq!(
            std::sync::Arc::strong_count(&counted),
            1,
            "the value is gone with the offer"
        );
        assert!(receiver.try_recv().unwrap_err().is_empty());
        assert!(other.try_send(1).unwrap_err().is_full());
        // One that was never polled offers nothing.
        drop(par!(sender.send(counted.clone())));
        assert_eq!(std::sync::Arc::strong_count(&counted), 1);
        Ok(())
    })
    .unwrap();
}

#[test]
#[should_panic(expected = "in a branch")]
fn a_panic_passes_through() {
    let _watch = watchdog();
    let _ = luna::run(async {
        par!(async { Ok::<_, Error>(()) }, async {
            luna::yield_now().await;
            if true {
                panic!("in a branch");
            }
            Ok::<_, Error>(())
        })
        .await
    });
}
