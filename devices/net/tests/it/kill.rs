//! Programs that are killed at random instants.

use crate::address;
use crate::child::{Program, read_log};
use crate::shared::{Random, is_long, watchdog};
use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Waits until more was taken than `before`: both sides have joined and go on.
pub(crate) fn wait_for_progress(taken: &Path, before: u64) -> u64 {
    let deadline = Instant::now() + Duration::from_secs(60);
    loop {
        let size = std::fs::metadata(taken).map_or(0, |about| about.len());
        if size > before {
            return size;
        }
        assert!(
            Instant::now() < deadline,
            "hang: nothing was taken for 60 s"
        );
        // Leaves the cores to the programs.
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// A new folder for the programs' logs.
pub(crate) fn folder(test: &str) -> PathBuf {
    let name = format!("luna-net-{test}-{}", std::process::id());
    let folder = std::env::temp_dir().join(name);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// No value was taken twice, those of a program were taken in order, and all that were acknowledged
/// were taken.
pub(crate) fn check(folder: &Path, what: &str) {
    let taken = read_log(&folder.join("taken"));
    let mut last = HashMap::new();
    for value in &taken {
        // The sending program's number is in the upper half.
        let before = last.insert(value >> 32, *value);
        assert!(before.is_none_or(|before| before < *value), "out of order");
    }
    let distinct: HashSet<u64> = taken.iter().copied().collect();
    assert_eq!(distinct.len(), taken.len(), "a value was taken twice");
    let acknowledged = read_log(&folder.join("acknowledged"));
    let lost = acknowledged
        .iter()
        .filter(|value| !distinct.contains(value));
    assert_eq!(lost.count(), 0, "an acknowledged value was lost");
    crate::shared::say(&format!(
        "{what}: {} values taken, {} acknowledged, none lost or doubled",
        taken.len(),
        acknowledged.len(),
    ));
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn kills_at_random_instants() {
    kills("send");
}

#[test]
fn kills_at_random_instants_of_a_stream() {
    kills("stream");
}

/// Kills programs, of which one sends as this task says.
fn kills(sends: &str) {
    let is_long = is_long();
    // The watchdog allows five minutes, less than a long run.
    let _watchdog = (!is_long).then(watchdog);
    let kills = if is_long { 1000 } else { 30 };
    let mut random = Random::seeded();
    let folder = folder(&format!("kill-{sends}"));
    let taken = folder.join("taken");
    let address = address();
    let place = folder.to_str().unwrap();
    let start = |task| Program::start(task, &[&address, place]);
    let tasks = [sends, "receive"];
    let mut programs = tasks.map(start);
    let mut size = 0;
    for _ in 0..kills {
        // Mostly while they work, at times while one still starts.
        if random.chance(230) {
            size = wait_for_progress(&taken, size);
        }
        // The random instant; nothing depends on how long it takes.
        std::thread::sleep(Duration::from_micros(random.below(20_000)));
        let both = random.chance(25);
        let first = random.below(2_usize);
        for index in [first, 1 - first].into_iter().take(1 + usize::from(both)) {
            programs[index].kill();
            programs[index].wait();
            programs[index] = start(tasks[index]);
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
    check(&folder, &format!("{kills} kills, {sends}"));
}
