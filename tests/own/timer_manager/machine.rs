//! What the machine does to the timers: programs that are suspended, clocks that jump, priorities.

use super::*;
use crate::common::SpawnOk;

#[test]
#[cfg(unix)]
fn a_suspended_program_misses_slots_counts_them_and_goes_on() {
    own_process!();
    use nix::sys::signal::Signal;
    let Some(_watch) = common::with_signals() else {
        return;
    };
    for part in ["executor", "manager"] {
        let mut program = Program::start(part);
        program.wait_for("ready");
        program.signal(Signal::SIGSTOP as i32);
        // What is tested: how long it is suspended, no point at which it is.
        std::thread::sleep(Duration::from_secs(1));
        program.signal(Signal::SIGCONT as i32);
        let ended = program.end();
        assert!(ended.status.success(), "{part}: {ended:?}");
    }
}

#[test]
fn its_thread_has_a_priority_of_its_own_where_the_system_has_any() {
    own_process!();
    let has_real_time = common::has_real_time();
    for asks in [false, true] {
        let mut system = managed("ranks");
        let mut main = system.executor("main");
        if asks {
            main = main.policy(Policy::fifo(10));
        }
        let main = main.build().unwrap();
        main.process("one").spawn_ok(async {
            let mut tick = luna::periodic("one", PERIOD)?;
            for _ in 0..3 {
                tick.next().await;
            }
            Ok(())
        });
        let report = system.run().unwrap();
        let expected = match asks && has_real_time {
            true => Policy::fifo(98),
            false => Policy::Other,
        };
        assert_eq!(timers(&report).policy, expected);
        let is_missing = report
            .shortfalls
            .iter()
            .any(|one| one.to_string().contains("fifo:98"));
        assert_eq!(is_missing, asks && !has_real_time);
    }
}

/// Threads of one priority on one core run in the order in which they are woken: so that is seen.
#[test]
fn the_loops_of_a_tick_are_woken_in_order_of_priority() {
    own_process!();
    if !COMPLETE || !common::has_real_time() {
        skip("no real-time policies here");
        return;
    }
    const CYCLES: u64 = 100;
    let mut system = managed("order");
    system.timer_core(0);
    let begun: Arc<Mutex<BTreeMap<u64, Vec<u8>>>> = Arc::default();
    // The first to come is the least urgent at first.
    for level in [3, 10, 20, 30] {
        let begun = begun.clone();
        let name: &'static str = format!("level {level}").leak();
        let thread = system.thread(name).core(0).policy(Policy::fifo(10));
        thread.process(name).priority(level).spawn_ok(async move {
            let mut tick = luna::periodic(name, PERIOD)?.phase(Duration::ZERO)?;
            for _ in 0..CYCLES {
                let number = tick.next().await.number;
                begun.lock().unwrap().entry(number).or_default().push(level);
            }
            Ok(())
        });
    }
    system.run().unwrap();
    let begun = begun.lock().unwrap();
    let whole = || begun.values().filter(|levels| levels.len() == 4);
    let in_order = whole().filter(|levels| **levels == [30, 20, 10, 3]).count();
    // Where the machine stood still for more than a period, loops go on by themselves.
    assert!(2 * in_order > whole().count(), "{begun:?}");
    assert!(whole().count() > 0, "{begun:?}");
}
