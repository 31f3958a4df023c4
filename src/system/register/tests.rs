use super::*;
use crate::{Process, System};

#[test]
fn ranges_of_numbers_grow_together() {
    let mut numbers = Numbers::default();
    for number in [5, 7, 1, u32::MAX, 6, 2, 6] {
        numbers.insert(number);
    }
    for number in [1, 2, 5, 6, 7, u32::MAX] {
        assert!(numbers.contains(number));
    }
    for number in [0, 3, 4, 8, u32::MAX - 1] {
        assert!(!numbers.contains(number));
    }
    let ranges = |numbers: &Numbers| numbers.0.clone().into_iter().collect::<Vec<_>>();
    assert_eq!(ranges(&numbers), [(1, 2), (5, 7), (u32::MAX, u32::MAX)]);
    for number in [3, 4, 5, 6, 7, 8, 9] {
        numbers.insert(number);
    }
    assert_eq!(ranges(&numbers), [(1, 9), (u32::MAX, u32::MAX)]);
}

/// A process that is reaped.
struct Phased;

impl Process for Phased {
    async fn run(&mut self) -> crate::Result<()> {
        Ok(())
    }
}

#[test]
fn the_end_of_a_system_looks_at_each_process_a_few_times() {
    const PROCESSES: usize = 3000;
    let mut system = System::new("many");
    let main = system.executor("main").build().unwrap();
    for number in 0..PROCESSES {
        let process = main.process(number.to_string());
        match number % 3 {
            0 => process.spawn(Phased),
            1 => process.spawn(async { Ok(()) }),
            // It ends when all others have.
            _ => process.priority(1).spawn(async {
                crate::yield_now().await;
                Ok(())
            }),
        }
        .unwrap();
    }
    assert_eq!(system.run().unwrap().processes.len(), PROCESSES);
    let looks = system.plan.members().started.looks.get();
    // One for each end, two for the report; a look for a deadlock, which takes a moment in which
    // all sleep, is one more.
    assert!((3 * PROCESSES..=10 * PROCESSES).contains(&looks), "{looks}");
}

#[test]
fn what_is_kept_of_processes_that_come_and_go_does_not_grow() {
    const REMEMBERED: usize = 10;
    const CHILDREN: u64 = 1000;
    for elsewhere in [false, true] {
        let mut system = System::new("coming and going");
        system.remember_ended(REMEMBERED);
        let main = system.executor("main").build().unwrap();
        let other = system.executor("other").build().unwrap();
        let (on, plan) = (
            if elsewhere { other } else { main.clone() },
            system.plan.clone(),
        );
        main.process("parent")
            .spawn(async move {
                for number in 0..CHILDREN {
                    // The names come again, but not while they are remembered.
                    let name = format!("child {}", number % (REMEMBERED as u64 + 2));
                    let child = match number % 3 {
                        0 => on.process(&name).spawn(Phased),
                        1 => on
                            .process(&name)
                            .spawn(async { Err(Error::other("failed")) }),
                        _ => on.process(&name).spawn(async { Ok(()) }),
                    }?;
                    on.process_handle(child).unwrap().join().await;
                    let members = plan.members();
                    // Each has an entry and a name, a place in the order of the ends, perhaps two
                    // exit records before a waiter comes to hold them; and some have not been
                    // looked at since they ended, where the system's own thread is slow to come.
                    let (size, reaped) = (members.started.size(), members.started.reaped.len());
                    assert!(size - reaped <= 10 * (REMEMBERED + 2), "{size}, {reaped}");
                }
                Ok(())
            })
            .unwrap();
        let error = system.run().unwrap_err();
        assert_eq!(error.to_string(), "process `child 1`: failed");
        let report = system.report().unwrap();
        assert_eq!(report.processes.len(), 1 + REMEMBERED);
        let earlier = &report.earlier;
        assert_eq!(earlier.number(), CHILDREN - REMEMBERED as u64);
        assert_eq!((earlier.cancelled, earlier.panicked), (0, 0));
        assert_eq!(earlier.completed + earlier.failed, earlier.polls);
        assert!((CHILDREN / 3 - REMEMBERED as u64..=CHILDREN / 3).contains(&earlier.failed));
    }
}
