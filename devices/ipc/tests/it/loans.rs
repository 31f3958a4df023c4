//! Values that are lent.

use crate::child::Program;
use crate::shared::watchdog;
use crate::{channel_name, files, run, spawn};
use luna::Policy;
use luna_ipc::Endpoint;
use std::path::Path;

/// Larger than any thread's stack: a copy on its way would overflow it.
type Huge = [u8; 16 << 20];
static EMPTY: Huge = [0; 16 << 20];

#[test]
fn values_larger_than_a_stack_cross() {
    let _watchdog = watchdog();
    let name = channel_name("huge");
    let endpoint = Endpoint::new(&name);
    let (receiver, link) = endpoint.loan_receiver::<Huge>(2).unwrap();
    let received = spawn(Policy::Other, link, async move {
        for number in 1..=20 {
            let huge = receiver.recv().await?;
            assert_eq!((huge[0], huge[huge.len() - 1]), (number, number));
        }
        assert!(receiver.recv().await.is_err_and(|error| error.is_closed()));
        Ok(())
    });
    let (loans, sender, link) = endpoint.loan_sender(2, &EMPTY).unwrap();
    run(Policy::Other, link, async move {
        for number in 1..=20 {
            // The receiver may still hold the one before.
            let mut huge = loans.loan().expect("there are two");
            huge[0] = number;
            *huge.last_mut().unwrap() = number;
            sender.send(huge).await?;
        }
        Ok(())
    })
    .unwrap();
    received.join().unwrap().unwrap();
    assert!(files(&name).is_empty());
}

#[test]
fn what_the_receiver_holds_is_not_lent_again_until_it_is_dropped() {
    let _watchdog = watchdog();
    let name = channel_name("held");
    let endpoint = Endpoint::new(&name);
    let (receiver, link) = endpoint.loan_receiver::<u64>(2).unwrap();
    let (hold, held) = std::sync::mpsc::channel();
    let received = spawn(Policy::Other, link, async move {
        for _ in 0..2 {
            hold.send(receiver.recv().await?).unwrap();
        }
        Ok(())
    });
    let (loans, sender, link) = endpoint.loan_sender(2, &7_u64).unwrap();
    let pool = loans.clone();
    run(Policy::Other, link, async move {
        for number in 0..2 {
            let mut loan = loans.loan().unwrap();
            assert_eq!(*loan, 7, "the initial value");
            *loan = number;
            sender.send(loan).await?;
        }
        Ok(())
    })
    .unwrap();
    received.join().unwrap().unwrap();
    let (first, second) = (held.recv().unwrap(), held.recv().unwrap());
    assert!(pool.loan().is_none());
    assert_eq!((*first, *second), (0, 1));
    drop(first);
    let loan = pool.loan().unwrap();
    assert_eq!(*loan, 0, "the value that was sent in it");
    assert!(pool.loan().is_none());
    drop(loan);
    drop((pool, second));
    assert!(files(&name).is_empty());
}

#[test]
fn a_loan_comes_back_unless_the_killed_receiver_had_it() {
    let _watchdog = watchdog();
    let name = channel_name("loan-killed");
    let endpoint = Endpoint::new(&name);
    let mut program = Program::start("holds-loan", &name, Path::new(""));
    let (loans, sender, link) = endpoint.loan_sender(2, &0_u64).unwrap();
    let sent = spawn(Policy::Other, link, async move {
        sender.send(loans.loan().unwrap()).await?;
        let error = sender.send(loans.loan().unwrap()).await.unwrap_err();
        // The other program had it, and was not done with it.
        assert!(error.is_poisoned() && error.into_inner().is_lost());
        // Its places are not free before the channel is opened again.
        assert!(loans.loan().is_none());
        Ok(())
    });
    program.wait_until_there();
    program.kill();
    assert!(sent.join().unwrap().is_err());
    program.wait();

    // The next session has all places. A value that nobody takes comes back.
    let (receiver, link) = endpoint.loan_receiver::<u64>(2).unwrap();
    let closes = spawn(Policy::Other, link, async move {
        assert_eq!(*receiver.recv().await?, 1);
        Ok(())
    });
    let (loans, sender, link) = endpoint.loan_sender(2, &0_u64).unwrap();
    run(Policy::Other, link, async move {
        let [mut one, mut two] = [loans.loan().unwrap(), loans.loan().unwrap()];
        (*one, *two) = (1, 2);
        sender.send(one).await?;
        let error = sender.send(two).await.unwrap_err();
        assert!(error.is_closed());
        let two = error.into_inner();
        assert!(two.is_lost() || *two == 2);
        Ok(())
    })
    .unwrap();
    closes.join().unwrap().unwrap();
    assert!(files(&name).is_empty());
}

#[test]
fn both_sides_state_the_number_of_slots() {
    let name = channel_name("slots");
    let endpoint = Endpoint::new(&name);
    let _sender = endpoint.loan_sender(2, &0_u64).unwrap();
    let error = endpoint.loan_receiver::<u64>(3).unwrap_err().to_string();
    assert!(
        error.contains("lent in 2 slots") && error.contains("lent in 3 slots"),
        "{error}"
    );
    let error = endpoint.receiver::<u64>().unwrap_err().to_string();
    assert!(error.contains("lent in 2 slots"), "{error}");
}
