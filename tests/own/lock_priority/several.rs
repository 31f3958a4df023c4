//! A process that holds or wants several mutexes: which boost it has when another one ends.

use super::*;

#[test]
fn one_that_holds_several_falls_to_the_highest_of_what_remains() {
    own_process!();
    for (high_first, is_biased) in [(false, false), (false, true), (true, false), (true, true)] {
        on_one_executor(|process| {
            let [one, other] = mutexes(process, is_biased);
            let go_nine = locker(process("nine", 9), &one);
            let go_twenty = locker(process("twenty", 20), &other);
            process("holder", 1).spawn_ok(async move {
                let (nine, twenty) = (one.lock().await?, other.lock().await?);
                go_nine.send(()).await?;
                yield_now().await;
                assert_eq!(level(), 9);
                go_twenty.send(()).await?;
                yield_now().await;
                assert_eq!(level(), 20);
                if high_first {
                    drop(twenty);
                    assert_eq!(level(), 9);
                    drop(nine);
                } else {
                    drop(nine);
                    assert_eq!(level(), 20);
                    drop(twenty);
                }
                assert_eq!(level(), 1);
                Ok(())
            });
        });
    }
}

/// The waiter behind it did not raise it when the mutex was handed over, but does afterwards.
#[test]
fn a_new_holder_falls_to_the_level_of_those_behind_it_when_another_boost_ends() {
    own_process!();
    for is_biased in IS_BIASED {
        on_one_executor(|process| {
            let [first, second] = mutexes(process, is_biased);
            let go_behind = locker(process("behind", 15), &first);
            let go_high = locker(process("high", 20), &second);
            let (go, gone) = luna::channel::<()>();
            let wanted = first.clone();
            process("next", 5).spawn_ok(async move {
                gone.recv().await?;
                let held = second.lock().await?;
                let guard = wanted.lock().await?;
                assert_eq!(level(), 20);
                drop(held);
                assert_eq!(level(), 15);
                drop(guard);
                assert_eq!(level(), 5);
                Ok(())
            });
            process("holder", 1).spawn_ok(async move {
                let guard = first.lock().await?;
                for (go, expected) in [(go, 5), (go_behind, 15), (go_high, 20)] {
                    go.send(()).await?;
                    yield_now().await;
                    assert_eq!(level(), expected);
                }
                drop(guard);
                assert_eq!(level(), 1);
                Ok(())
            });
        });
    }
}

/// One branch holds what the urgent process waits for, and the other waits for what the least
/// urgent process holds.
#[test]
fn what_a_branch_passes_on_ends_when_another_branch_unlocks() {
    own_process!();
    for is_biased in IS_BIASED {
        on_one_executor(|process| {
            let [first, second] = mutexes(process, is_biased);
            let go_high = locker(process("high", 20), &first);
            let (go, gone) = luna::channel::<()>();
            let (unlock, may_unlock) = luna::channel::<()>();
            let (unlocks, unlocked) = luna::channel::<()>();
            let wanted = second.clone();
            process("both", 5).spawn_ok(async move {
                gone.recv().await?;
                par!(
                    async {
                        let guard = first.lock().await?;
                        go_high.send(()).await?;
                        may_unlock.recv().await?;
                        drop(guard);
                        unlocks.send(()).await?;
                        Ok(())
                    },
                    async {
                        drop(wanted.lock().await?);
                        Ok(())
                    }
                )
                .await?;
                Ok(())
            });
            process("low", 1).spawn_ok(async move {
                let guard = second.lock().await?;
                go.send(()).await?;
                assert_eq!(level(), 20);
                unlock.send(()).await?;
                unlocked.recv().await?;
                assert_eq!(level(), 5, "the other branch waits on");
                drop(guard);
                assert_eq!(level(), 1);
                Ok(())
            });
        });
    }
}
