//! Partners that are killed, stopped, or restarted.

use crate::child::Program;
use crate::shared::{skip, watchdog};
use crate::{address, run, spawn};
use luna::Policy;
use luna_net::{Config, Network};
use std::time::{Duration, Instant};

/// Longer than a test waits: so a death that is noticed was noticed by its connection.
fn patient() -> Config {
    Config::loopback().lost_after(Duration::from_secs(20))
}

#[test]
fn a_send_whose_receiver_is_killed_gets_its_value_back() {
    let _watchdog = watchdog();
    let address = address();
    let network = Network::open(&patient().listen(&address)).unwrap();
    let mut program = Program::start("hold", &[&address]);
    let pid = program.id();
    let (sender, link) = network.sender::<u64>("test/hold").unwrap();
    let status = link.status();
    let (failed, failure) = std::sync::mpsc::channel();
    let sent = spawn(Policy::fifo(30), link, async move {
        let error = sender.send(5).await.unwrap_err();
        failed.send(Instant::now()).unwrap();
        assert!(error.is_poisoned());
        assert_eq!(error.into_inner(), 5);
        Ok(())
    });
    program.wait_until_there();
    let killed = Instant::now();
    program.kill();
    let noticed = failure.recv().unwrap() - killed;
    println!("a pending send failed {noticed:?} after the kill");
    assert!(noticed < Duration::from_secs(15));
    let text = sent.join().unwrap().unwrap_err().to_string();
    for part in [
        format!("process {pid}"),
        "connection has ended".to_owned(),
        "of 1 it is unknown whether they were taken".to_owned(),
    ] {
        assert!(text.contains(&part), "{text}");
    }
    assert_eq!((status.session(), status.in_doubt()), (1, 1));
    program.wait();

    // The next session does not see the value, and counts it.
    let there = Config::loopback().connect(&address);
    let there = Network::open(&there.connect_within(Duration::from_secs(30))).unwrap();
    let (receiver, link) = there.receiver::<u64>("test/hold").unwrap();
    let received = spawn(Policy::Other, link, async move {
        assert_eq!(receiver.recv().await?, 6);
        Ok(())
    });
    let (sender, link) = network.sender::<u64>("test/hold").unwrap();
    let status = link.status();
    run(Policy::Other, link, async move {
        sender.send(6).await?;
        Ok(())
    })
    .unwrap();
    received.join().unwrap().unwrap();
    assert_eq!((status.session(), status.number()), (2, 2));
    assert_eq!((status.missing(), status.in_doubt()), (1, 0));
}

#[test]
fn a_receive_whose_sender_is_killed_is_poisoned() {
    let _watchdog = watchdog();
    let address = address();
    let network = Network::open(&patient().listen(&address)).unwrap();
    let mut program = Program::start("feed", &[&address]);
    let pid = program.id();
    let (receiver, link) = network.receiver::<u64>("test/feed").unwrap();
    let (failed, failure) = std::sync::mpsc::channel();
    let received = spawn(Policy::fifo(30), link, async move {
        assert_eq!(receiver.recv().await?, 1);
        assert!(receiver.recv().await.unwrap_err().is_poisoned());
        failed.send(Instant::now()).unwrap();
        Ok(())
    });
    program.wait_until_there();
    let killed = Instant::now();
    program.kill();
    let noticed = failure.recv().unwrap() - killed;
    println!("a pending receive failed {noticed:?} after the kill");
    assert!(noticed < Duration::from_secs(15));
    let text = received.join().unwrap().unwrap_err().to_string();
    assert!(
        text.contains(&format!("the sender, process {pid}")),
        "{text}"
    );
}

#[test]
fn a_partner_that_is_stopped_is_lost_after_the_stated_time() {
    let _watchdog = watchdog();
    let address = address();
    let config = Config::loopback().lost_after(Duration::from_millis(500));
    let network = Network::open(&config.listen(&address)).unwrap();
    let mut program = Program::start("hold", &[&address]);
    let (sender, link) = network.sender::<u64>("test/hold").unwrap();
    let (failed, failure) = std::sync::mpsc::channel();
    let sent = spawn(Policy::fifo(30), link, async move {
        assert!(sender.send(5).await.unwrap_err().is_poisoned());
        failed.send(Instant::now()).unwrap();
        Ok(())
    });
    program.wait_until_there();
    let stopped = Instant::now();
    program.stop();
    let noticed = failure.recv().unwrap() - stopped;
    println!("a pending send failed {noticed:?} after the partner was stopped");
    // The bound is 750 ms; the rest is for a machine that is busy.
    assert!(noticed < Duration::from_secs(10));
    let text = sent.join().unwrap().unwrap_err().to_string();
    assert!(text.contains("is lost"), "{text}");
}

#[test]
fn the_threads_of_a_network_have_no_priority() {
    let _watchdog = watchdog();
    let mut program = Program::start("policies", &[]);
    let threads = program.line_with("threads:");
    program.wait();
    let mut real_time = 0;
    let mut of_network = 0;
    for thread in threads.split_whitespace().skip(1) {
        let (name, policy) = thread.rsplit_once('=').unwrap();
        let is_ordinary = policy == "0";
        real_time += u32::from(!is_ordinary);
        // zenoh's, and the link's own.
        if ["net-", "rx-", "tx-", "acc-", "app-"]
            .iter()
            .any(|p| name.starts_with(p))
        {
            of_network += 1;
            assert!(is_ordinary, "{threads}");
        }
    }
    if real_time == 0 {
        skip("SCHED_FIFO is not granted");
    }
    assert!(of_network > 2, "{threads}");
}
