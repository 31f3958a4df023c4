//! Call channels between programs.

use crate::child::{Program, now};
use crate::shared::watchdog;
use crate::{Block, block, channel_name, files, has_real_time, policies, run, shared, spawn};
use luna::prelude::*;
use luna_platform::thread::current_policy;
use std::path::Path;

/// Serves until the clients are gone, and leaves every fifth call without a reply.
fn serves(name: &str, policy: Policy) -> std::thread::JoinHandle<luna::Result<()>> {
    let (server, link) = luna_ipc::server::<Block, u64>(name).unwrap();
    spawn(policy, link, async move {
        while let Ok(call) = server.accept().await {
            let number = call.number;
            if number % 5 == 0 {
                drop(call);
            } else {
                call.reply(number * 2).unwrap();
            }
        }
        Ok(())
    })
}

#[test]
fn each_call_gets_its_own_answer_or_none() {
    let _watchdog = watchdog();
    for policy in policies() {
        let name = channel_name("calls");
        let served = serves(&name, policy);
        let (client, link) = luna_ipc::client::<Block, u64>(&name).unwrap();
        let status = link.status();
        run(policy, link, async move {
            let other = client.clone();
            let half = async |client: &luna::channel::Client<Block, u64>, numbers| {
                for number in numbers {
                    let answer = client.call(block(number)).await;
                    if number % 5 == 0 {
                        assert!(answer.unwrap_err().is_unanswered());
                    } else {
                        assert_eq!(answer.unwrap(), number * 2);
                    }
                }
                Ok::<(), luna::Error>(())
            };
            par!(half(&client, 1..200), half(&other, 200..400)).await?;
            Ok(())
        })
        .unwrap();
        served.join().unwrap().unwrap();
        assert_eq!(status.acknowledged(), 399);
        assert!(files(&name).is_empty());
    }
}

#[test]
fn a_call_waits_for_a_program_that_comes_later_and_may_be_given_up() {
    let _watchdog = watchdog();
    let name = channel_name("late-server");
    let (client, link) = luna_ipc::client::<Block, u64>(&name).unwrap();
    let (gone, given_up) = std::sync::mpsc::channel();
    let called = spawn(Policy::Other, link, async move {
        // No link has taken it: so a deadline withdraws it.
        alt! {
            _ = client.call(block(1)) => panic!("nobody serves"),
            () = luna::after(std::time::Duration::from_millis(1)) => {}
        }
        gone.send(()).unwrap();
        assert_eq!(client.call(block(3)).await.unwrap(), 6);
        Ok(())
    });
    given_up.recv().unwrap();
    let served = serves(&name, Policy::Other);
    called.join().unwrap().unwrap();
    served.join().unwrap().unwrap();
}

#[test]
fn a_call_ends_when_its_server_is_killed_and_the_next_program_serves() {
    let _watchdog = watchdog();
    let name = channel_name("killed-server");
    let mut program = Program::start("holds-call", &name, Path::new(""));
    let (client, link) = luna_ipc::client::<u64, u64>(&name).unwrap();
    let (failed, failure) = std::sync::mpsc::channel();
    let called = spawn(Policy::fifo(30), link, async move {
        let error = client.call(5).await.unwrap_err();
        failed.send(now()).unwrap();
        assert!(error.is_unanswered() || error.is_poisoned(), "{error}");
        assert!(client.call(6).await.unwrap_err().is_poisoned());
        Ok(())
    });
    program.wait_until_there();
    let killed = program.kill();
    let noticed = failure.recv().unwrap() - killed;
    println!("a pending call failed {} us after the kill", noticed / 1000);
    let error = called.join().unwrap().unwrap_err().to_string();
    assert!(error.contains("has ended without closing it"), "{error}");
    program.wait();
    assert!(files(&name).is_empty());

    let served = serves(&name, Policy::Other);
    let (client, link) = luna_ipc::client::<Block, u64>(&name).unwrap();
    run(Policy::Other, link, async move {
        assert_eq!(client.call(block(7)).await.unwrap(), 14);
        Ok(())
    })
    .unwrap();
    served.join().unwrap().unwrap();
}

#[test]
fn a_server_whose_client_is_killed_is_set_back_and_poisoned() {
    let _watchdog = watchdog();
    let name = channel_name("killed-client");
    let mut program = Program::start("calls", &name, Path::new(""));
    let (server, link) = luna_ipc::server::<u64, u64>(&name).unwrap();
    let (accepted, is_accepted) = std::sync::mpsc::channel();
    let served = spawn(Policy::Other, link, async move {
        let call = server.accept().await?;
        let inherits = [Policy::Other, Policy::fifo(30)][usize::from(has_real_time())];
        assert_eq!(current_policy(), inherits);
        accepted.send(()).unwrap();
        assert!(server.accept().await.unwrap_err().is_poisoned());
        assert_eq!(current_policy(), Policy::Other);
        assert!(call.reply(2).is_err());
        Ok(())
    });
    is_accepted.recv().unwrap();
    program.kill();
    let error = served.join().unwrap().unwrap_err().to_string();
    assert!(error.contains("has ended without closing it"), "{error}");
    program.wait();
    assert!(files(&name).is_empty());
}

#[test]
fn a_servers_thread_has_its_callers_priority_until_the_answer() {
    let _watchdog = watchdog();
    if !has_real_time() {
        return shared::skip("SCHED_FIFO is not granted");
    }
    let name = channel_name("priority");
    let (server, link) = luna_ipc::server::<u64, u64>(&name).unwrap();
    let own = Policy::fifo(20);
    let served = spawn(own, link, async move {
        while let Ok(call) = server.accept().await {
            assert_eq!(current_policy(), Policy::fifo(40));
            let _ = call.reply(0);
        }
        // The client's link sets it back before it ends.
        assert_eq!(current_policy(), own);
        Ok(())
    });
    let (client, link) = luna_ipc::client::<u64, u64>(&name).unwrap();
    let status = link.status();
    run(Policy::fifo(40), link, async move {
        for number in 0..100 {
            client.call(number).await?;
        }
        Ok(())
    })
    .unwrap();
    served.join().unwrap().unwrap();
    assert_eq!(
        (status.acknowledged(), status.refused_priorities()),
        (100, 0)
    );
}

#[test]
fn other_answers_are_an_error_that_names_both() {
    let name = channel_name("other-answer");
    let (_client, _link) = luna_ipc::client::<u32, u64>(&name).unwrap();
    let error = luna_ipc::server::<u32, u32>(&name).unwrap_err().to_string();
    for part in [
        "u32 (4 bytes) -> u64 (8 bytes)",
        "u32 (4 bytes) -> u32 (4 bytes)",
    ] {
        assert!(error.contains(part), "{error}");
    }
    let error = luna_ipc::receiver::<u32>(&name).unwrap_err();
    assert!(matches!(error, luna_ipc::IpcError::Type { .. }), "{error}");
}

#[cfg(feature = "serde")]
#[test]
fn types_of_serde_are_asked_and_answered() {
    let _watchdog = watchdog();
    let name = channel_name("serde-calls");
    let endpoint = luna_ipc::Endpoint::new(&name);
    let (server, link) = endpoint
        .serde_server::<String, Vec<String>>(64, 64)
        .unwrap();
    let served = spawn(Policy::Other, link, async move {
        while let Ok(call) = server.accept().await {
            let words = call.split(' ').map(str::to_owned).collect();
            call.reply(words).unwrap();
        }
        Ok(())
    });
    let (client, link) = endpoint
        .serde_client::<String, Vec<String>>(64, 64)
        .unwrap();
    run(Policy::Other, link, async move {
        assert_eq!(
            client.call("open the door".to_owned()).await?,
            ["open", "the", "door"]
        );
        Ok(())
    })
    .unwrap();
    served.join().unwrap().unwrap();
}
