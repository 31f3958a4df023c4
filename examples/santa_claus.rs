//! The Santa Claus problem: a prioritized alternative, and groups that form before they are served.
//!
//! Santa sleeps until all nine reindeer are back from their holidays or three of his ten elves want
//! to consult him. With the reindeer he delivers the toys, with the elves he discusses toys; then
//! he lets the group go. If both wait, the reindeer come first. No helper joins a group that he has
//! started with, and none leaves it before he ends.
//!
//! Each kind has a room where groups form (`gather`). A helper sends there the end of a channel on
//! which it then waits for Santa: a channel's end is an ordinary value. Santa retires after some
//! years, and that ends all: his channels close, then the rooms', then each helper's send fails.
//!
//! From J. A. Trono, A new exercise in concurrency (1994); it is known for wrong solutions, his own
//! with semaphores among them (M. Ben-Ari, How to solve the Santa Claus problem, 1998). An exercise
//! of P. H. Welch's courses on occam-pi.

use luna::prelude::*;
use std::time::Duration;

const REINDEER: usize = 9;
const ELVES: usize = 10;
const CONSULTING: usize = 3;
const YEARS: usize = 5;

/// A helper that waits for Santa.
struct Helper {
    number: usize,
    dismissed: Sender<()>,
}

/// Works (or is on holiday), goes to Santa, and comes back when he lets it go, until he has
/// retired.
async fn helper(number: usize, longest: Duration, room: Sender<Helper>) -> luna::Result<()> {
    let mut random = number as u32;
    loop {
        let (dismissed, word) = luna::channel();
        if room.send(Helper { number, dismissed }).await.is_err() || word.recv().await.is_err() {
            return Ok(());
        }
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        luna::after(longest.mul_f64(f64::from(random) / f64::from(u32::MAX))).await;
    }
}

/// Collects helpers until there are `size`, then sends them to Santa. Meanwhile the next ones wait.
async fn gather(
    size: usize,
    door: Receiver<Helper>,
    santa: Sender<Vec<Helper>>,
) -> luna::Result<()> {
    loop {
        let mut group = Vec::with_capacity(size);
        while group.len() < size {
            group.push(door.recv().await?);
        }
        if santa.send(group).await.is_err() {
            return Ok(());
        }
    }
}

async fn santa(reindeer: Receiver<Vec<Helper>>, elves: Receiver<Vec<Helper>>) -> luna::Result<()> {
    let mut deliveries = 0;
    let mut consultations = 0;
    while deliveries < YEARS {
        let group = pri_alt! {
            team = reindeer.recv() => {
                let team = team?;
                assert_eq!(team.len(), REINDEER);
                deliveries += 1;
                team
            }
            group = elves.recv() => {
                let group = group?;
                assert_eq!(group.len(), CONSULTING);
                assert!(deliveries > 0, "both waited at the beginning, and the elves came first");
                consultations += 1;
                group
            }
        };
        let mut numbers: Vec<usize> = group.iter().map(|helper| helper.number).collect();
        numbers.sort_unstable();
        numbers.dedup();
        assert_eq!(numbers.len(), group.len(), "someone is in the group twice");
        luna::after(Duration::from_millis(1)).await;
        for helper in group {
            helper.dismissed.send(()).await?;
        }
    }
    println!("{deliveries} Christmases and {consultations} consultations");
    Ok(())
}

fn main() -> luna::Result<()> {
    let mut system = System::new("north pole");
    let pole = system.executor("pole").build()?;
    let (stable, stable_door) = luna::channel();
    let (study, study_door) = luna::channel();
    let (team, teams) = luna::channel();
    let (group, groups) = luna::channel();

    // At the lowest priority, Santa runs only when all others wait for him.
    pole.process("santa")
        .priority(0)
        .spawn(santa(teams, groups))?;
    pole.process("stable")
        .spawn(gather(REINDEER, stable_door, team))?;
    pole.process("study")
        .spawn(gather(CONSULTING, study_door, group))?;
    for n in 0..REINDEER {
        let reindeer = helper(n, Duration::from_millis(40), stable.clone());
        pole.process(format!("reindeer {n}")).spawn(reindeer)?;
    }
    for n in 0..ELVES {
        let elf = helper(n, Duration::from_millis(10), study.clone());
        pole.process(format!("elf {n}")).spawn(elf)?;
    }
    drop((stable, study)); // the helpers have theirs
    system.run()?;
    Ok(())
}
