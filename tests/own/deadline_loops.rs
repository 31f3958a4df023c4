//! Loops under SCHED_DEADLINE: on OS threads alone, on any core, with a report of what they got.

use crate::common;
use common::{COMPLETE, SpawnOk, setup_error, skip};
use luna::End;
use luna::error::SetupError;
use luna::prelude::*;
use luna_platform::thread::{AttributeError, current_policy};
use std::time::Duration;

const PERIOD: Duration = Duration::from_millis(10);

fn policy() -> Policy {
    Policy::deadline(Duration::from_millis(2), PERIOD, PERIOD)
}

#[test]
fn a_loop_on_a_thread_of_its_own_keeps_its_slots() {
    own_process!();
    let mut system = System::new("deadline");
    system
        .thread("servo")
        .policy(policy())
        .process("servo")
        .spawn_ok(async {
            let mut tick = luna::periodic("servo", PERIOD)?.guard_spin(PERIOD / 50)?;
            for _ in 0..20 {
                tick.next().await;
            }
            Ok(())
        });
    let report = system.run().unwrap();
    assert_eq!(report.end, End::Completed);
    let servo = &report.loops["servo"];
    assert_eq!(servo.cycles, 20);
    assert_eq!(servo.cycles + servo.missed, servo.slots_elapsed);
    let thread = &report.threads[0];
    if thread.policy != policy() {
        // Then it says why, and what to do.
        assert_eq!(thread.policy, Policy::Other);
        let found = report.all_shortfalls().find(|(who, _)| *who == "servo");
        let (_, shortfall) = found.expect("a refused policy is a shortfall");
        skip(&shortfall.to_string());
    }
}

#[test]
fn a_call_from_a_fifo_server_to_a_deadline_client_changes_neither_policy_for_good() {
    own_process!();
    // Both come at the same time, in either order.
    for _ in 0..30 {
        let Some(raised) = policy_of_a_server_of_a_deadline_client() else {
            return;
        };
        // Below the emergency manager's.
        assert_eq!(raised, Policy::fifo(97));
    }
}

/// The policy of the server's thread while it serves. `None` without the privileges.
fn policy_of_a_server_of_a_deadline_client() -> Option<Policy> {
    let (client, server) = luna::channel::call_channel::<(), Policy>();
    let (notify, notified) = luna::buffered(Buffer::fifo(2));
    let mut system = System::new("inherits");
    system
        .thread("client")
        .policy(policy())
        .process("client")
        .spawn_ok({
            let notify = notify.clone();
            async move {
                let mine = current_policy();
                let while_served = client.call(()).await?;
                notify.try_send(("client", mine, current_policy(), while_served))?;
                Ok(())
            }
        });
    let place = system.thread("server").policy(Policy::fifo(10));
    place.process("server").spawn_ok(async move {
        let mine = current_policy();
        let call = server.accept().await?;
        let now = current_policy();
        let _ = call.reply(now);
        notify.try_send(("server", mine, current_policy(), now))?;
        Ok(())
    });
    let report = system.run().unwrap();
    let mut raised = None;
    for _ in 0..2 {
        let (who, before, after, served) = notified.try_recv().unwrap();
        assert_eq!(before, after, "{who}");
        raised = Some(served);
    }
    if report
        .threads
        .iter()
        .any(|thread| thread.policy == Policy::Other)
    {
        skip("needs SCHED_DEADLINE and SCHED_FIFO");
        return None;
    }
    raised
}

#[test]
fn what_cannot_be_is_refused_before_the_start() {
    own_process!();
    let mut system = System::new("refused");
    let shared = system.executor("many").policy(policy()).build();
    let error = setup_error(shared, &["`many`", "OS thread"]);
    assert!(matches!(
        error,
        SetupError::Attributes(AttributeError::SharedDeadline { .. })
    ));
    let pinned = system
        .thread("pinned")
        .core(0)
        .policy(policy())
        .process("pinned")
        .spawn(async { Ok(()) });
    let error = setup_error(pinned, &["`pinned`", "core 0"]);
    assert!(matches!(
        error,
        SetupError::Attributes(AttributeError::PinnedDeadline { .. })
    ));
    let reversed = system
        .thread("reversed")
        .policy(Policy::deadline(PERIOD, PERIOD / 2, PERIOD))
        .process("reversed")
        .spawn(async { Ok(()) });
    setup_error(reversed, &["`reversed`", "runtime <= deadline <= period"]);
}

#[test]
fn a_strict_system_says_what_was_refused() {
    own_process!();
    let mut system = System::new("strict");
    system.strict();
    // No kernel's limits allow such a period. A thread without privilege is refused for that.
    let impossible = Duration::from_secs(1_000_000);
    system
        .thread("slow")
        .policy(Policy::deadline(PERIOD, impossible, impossible))
        .process("slow")
        .spawn_ok(async { Ok(()) });
    let error = setup_error(system.run(), &["deadline:10000000/"]);
    assert!(matches!(error, SetupError::Refused { .. }), "{error:?}");
    if !COMPLETE {
        assert!(error.to_string().contains("portable"), "{error}");
    }
}
