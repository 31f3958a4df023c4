//! Programs that are killed at random instants: of a channel, of calls, and of lent values.

use crate::child::{Program, read_log};
use crate::kill_tasks::PAIRS;
use crate::shared::{Random, is_long, watchdog};
use crate::{channel_name, files, policies};
use std::collections::{HashMap, HashSet};
use std::path::Path;
use std::time::{Duration, Instant};

/// Waits until more was taken than `before`: both sides have joined and go on.
fn wait_for_progress(taken: &Path, before: u64) -> u64 {
    let deadline = Instant::now() + Duration::from_secs(20);
    loop {
        let size = std::fs::metadata(taken).map_or(0, |about| about.len());
        if size > before {
            return size;
        }
        assert!(
            Instant::now() < deadline,
            "hang: nothing was taken for 20 s"
        );
        // Leaves the cores to the programs.
        std::thread::sleep(Duration::from_micros(200));
    }
}

#[test]
fn kills_at_random_instants() {
    for tasks in PAIRS {
        kill_at_random_instants(tasks);
    }
}

fn kill_at_random_instants(tasks: [&str; 2]) {
    let is_long = is_long();
    // The watchdog allows five minutes, less than a long run.
    let _watchdog = (!is_long).then(watchdog);
    let kills = if is_long { 1000 } else { 20 };
    let mut random = Random::seeded();
    let name = channel_name(&format!("kill-{}", tasks[0]));
    let folder =
        std::env::temp_dir().join(format!("luna-ipc-kill-{}-{}", tasks[0], std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let taken = folder.join("taken");
    let mut programs = tasks.map(|task| Program::start(task, &name, &folder));
    let mut killed_at = HashMap::new();
    let mut size = 0;
    for _ in 0..kills {
        // Mostly while they work, at times while one still starts.
        if random.chance(200) {
            size = wait_for_progress(&taken, size);
        }
        // The random instant; nothing depends on how long it takes.
        std::thread::sleep(Duration::from_micros(random.below(8000)));
        let both = random.chance(25);
        let first = random.below(2_usize);
        for index in [first, 1 - first].into_iter().take(1 + usize::from(both)) {
            let at = programs[index].kill();
            killed_at.insert(u64::from(programs[index].id()), at);
            programs[index].wait();
            programs[index] = Program::start(tasks[index], &name, &folder);
        }
    }
    // Two values more: one may still be of a sender that was killed. So the last programs have a
    // session, and close it in order.
    let size = std::fs::metadata(&taken).map_or(0, |about| about.len());
    wait_for_progress(&taken, size + 8);
    std::fs::write(folder.join("stop"), "").unwrap();
    for program in &mut programs {
        assert!(program.wait().success());
    }

    let taken = read_log(&taken);
    let distinct: HashSet<u64> = taken.iter().copied().collect();
    assert_eq!(distinct.len(), taken.len(), "a value was taken twice");
    let acknowledged = read_log(&folder.join("acknowledged"));
    let lost = acknowledged
        .iter()
        .filter(|value| !distinct.contains(value));
    assert_eq!(lost.count(), 0, "an acknowledged value was lost");
    assert!(files(&name).is_empty(), "{:?}", files(&name));

    // How long after a kill the pending operation of the other program failed. Without an end the
    // two had no session, or both were killed.
    let ends = read_log(&folder.join("ends"));
    // Of programs with SCHED_FIFO, which do not look for their partners.
    let ends = ends.as_chunks::<3>().0.iter().filter(|end| end[2] == 0);
    let mut delays: Vec<u64> = ends
        .filter_map(|end| Some(end[1].checked_sub(*killed_at.get(&end[0])?)? / 1000))
        .collect();
    delays.sort_unstable();
    println!(
        "{tasks:?}: {kills} kills, {} values taken, {} acknowledged, none lost or doubled",
        taken.len(),
        acknowledged.len(),
    );
    let share = |percent: usize| delays[(delays.len() - 1) * percent / 100];
    if !delays.is_empty() {
        println!(
            "{} pending operations failed after {} us (median), {} us (p99), {} us (longest)",
            delays.len(),
            share(50),
            share(99),
            share(100),
        );
        // With the policy the survivor does not wait for a core, and the kernel's share remains. A
        // median of a few says nothing on a loaded machine.
        assert!(policies().len() < 2 || delays.len() < 100 || share(50) < 10_000);
    }
    std::fs::remove_dir_all(&folder).unwrap();
}
