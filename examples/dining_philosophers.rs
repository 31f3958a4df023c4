//! Five philosophers dine: once into a deadlock, once with a footman that prevents it.
//!
//! ```text
//!     fork 0 -- philosopher 0 -- fork 1 -- philosopher 1 -- fork 2 -- ... -- fork 0
//! ```
//!
//! A philosopher needs the fork to the left and the fork to the right, and takes the left one
//! first. When all five have taken the left one, each waits for a neighbour, for ever. The system
//! detects that by itself and reports which process waits for which; a strict one ends with it as
//! its error.
//!
//! The footman lets philosophers sit down. As long as he admits at most four, one gets both forks.
//! The two dinners differ only in that number.
//!
//! The problem is E. W. Dijkstra's (1965), the footman C. S. Scholten's; after C. A. R. Hoare,
//! Communicating Sequential Processes (1985), 2.5.

use luna::prelude::*;
use std::time::Duration;

const PHILOSOPHERS: usize = 5;

/// What a philosopher's hand does with a fork.
#[derive(Debug, PartialEq)]
enum Hand {
    PicksUp,
    PutsDown,
}
use Hand::{PicksUp, PutsDown};

/// A fork between two hands. The hand that picks it up puts it down.
async fn fork(one: Receiver<Hand>, other: Receiver<Hand>) -> luna::Result<()> {
    let (mut one_dines, mut other_dines) = (true, true);
    while one_dines || other_dines {
        alt! {
            hand = one.recv(), if one_dines => match hand {
                Ok(_) => assert_eq!(one.recv().await?, PutsDown),
                Err(_) => one_dines = false, // has gone home
            },
            hand = other.recv(), if other_dines => match hand {
                Ok(_) => assert_eq!(other.recv().await?, PutsDown),
                Err(_) => other_dines = false,
            },
        }
    }
    Ok(())
}

/// The philosophers' connection to the footman.
#[derive(Clone)]
struct Footman {
    sit_down: Sender<()>,
    get_up: Sender<()>,
}

/// Admits no more than `seats` at a time: while all are taken he does not receive from `sit_down`.
async fn footman(seats: usize, sit_down: Receiver<()>, get_up: Receiver<()>) -> luna::Result<()> {
    let mut seated = 0;
    loop {
        alt! {
            guest = sit_down.recv(), if seated < seats => match guest {
                Ok(()) => seated += 1,
                Err(_) => return Ok(()), // all have gone home
            },
            guest = get_up.recv(), if seated > 0 => {
                guest?;
                seated -= 1;
            }
        }
    }
}

async fn philosopher(
    meals: u32,
    left: Sender<Hand>,
    right: Sender<Hand>,
    footman: Footman,
) -> luna::Result<()> {
    for _ in 0..meals {
        footman.sit_down.send(()).await?;
        left.send(PicksUp).await?;
        luna::after(Duration::from_millis(1)).await; // reaching across takes a moment
        right.send(PicksUp).await?;
        left.send(PutsDown).await?;
        right.send(PutsDown).await?;
        footman.get_up.send(()).await?;
    }
    Ok(())
}

/// A dinner of `meals` each, at which at most `seats` may sit.
fn dinner(meals: u32, seats: usize) -> luna::Result<()> {
    let mut system = System::new("college");
    system.strict(); // a deadlock is an error
    let table = system.executor("table").build()?;

    let (sit_down, sitting_down) = luna::channel();
    let (get_up, getting_up) = luna::channel();
    let servant = footman(seats, sitting_down, getting_up);
    table.process("footman").spawn(servant)?;
    let footman = Footman { sit_down, get_up };

    let channels = || (0..PHILOSOPHERS).map(|_| luna::channel());
    let (lefts, at_lefts): (Vec<_>, Vec<_>) = channels().unzip();
    let (rights, mut at_rights): (Vec<_>, Vec<_>) = channels().unzip();
    at_rights.rotate_right(1); // the fork to the left of one is to the right of the one before
    for (n, (one, other)) in at_lefts.into_iter().zip(at_rights).enumerate() {
        let process = table.process(format!("fork {n}"));
        process.spawn(fork(one, other))?;
    }
    for (n, (left, right)) in lefts.into_iter().zip(rights).enumerate() {
        let process = table.process(format!("philosopher {n}"));
        process.spawn(philosopher(meals, left, right, footman.clone()))?;
    }
    drop(footman); // the philosophers have theirs
    system.run()?;
    Ok(())
}

fn main() -> luna::Result<()> {
    let Err(luna::Error::Deadlock(deadlock)) = dinner(u32::MAX, PHILOSOPHERS) else {
        panic!("five seats, and no deadlock");
    };
    assert_eq!(deadlock.cycle.len(), 2 * PHILOSOPHERS);
    println!("five seats: {} -> ...", deadlock.cycle.join(" -> "));

    dinner(20, PHILOSOPHERS - 1)?;
    println!("four seats: all five had twenty meals");
    Ok(())
}
