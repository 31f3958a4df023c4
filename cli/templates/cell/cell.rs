//! The cell as processes and channels:
//!
//! ```text
//! feeder ──> conveyor ──> press ──> stacker
//!                                      ~> watch
//!
//! ──> rendezvous: the sender waits until the block was taken    ~> register: the latest value
//! ```
//!
//! A unit that ends drops its ends of the channels, so the next one ends too: the end goes through
//! the cell from the feeder on.

use luna::prelude::*;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::Duration;

/// Between two blocks of the feeder.
pub const FEED: Duration = Duration::from_millis(50);
/// How long the press takes for a block.
const PRESS: Duration = Duration::from_millis(30);
/// The conveyor has room for so many blocks.
const ROOM: usize = 4;
/// If no block comes out of the cell for so long, something is jammed.
pub const PATIENCE: Duration = Duration::from_millis(500);

/// A block, by its number. Neither `Copy` nor `Clone`: there is one of each.
#[derive(Debug, PartialEq)]
pub struct Block(u32);

/// What is seen of the cell from outside.
#[derive(Debug, Default)]
pub struct Cell {
    stacked: AtomicU32,
    press_is_open: AtomicBool,
}

impl Cell {
    pub fn stacked(&self) -> u32 {
        self.stacked.load(Ordering::Relaxed)
    }

    #[cfg_attr(not(test), expect(dead_code, reason = "the tests ask for it"))]
    pub fn press_is_open(&self) -> bool {
        self.press_is_open.load(Ordering::Relaxed)
    }
}

/// A cell that feeds for `duration`; the block of number `jam` never leaves the press.
pub fn describe(
    system: &mut System,
    duration: Duration,
    jam: Option<u32>,
) -> luna::Result<Arc<Cell>> {
    // Where real-time scheduling is not allowed it runs all the same, and one line says what to do.
    // On the machine `units` has a core too: see system.toml.
    let units = system.executor("units").policy(Policy::fifo(80)).build()?;
    let cell = Arc::new(Cell::default());
    let (fed, onto_conveyor) = luna::channel::<Block>();
    let (off_conveyor, into_press) = luna::channel::<Block>();
    let (pressed, onto_stack) = luna::channel::<Block>();
    let (progress, watched) = luna::buffered::<u32>(Buffer::overwrite_oldest(1));
    // What recordings, the scope and errors call them.
    let (fed, off_conveyor) = (fed.named("fed"), off_conveyor.named("off conveyor"));
    let (pressed, progress) = (pressed.named("pressed"), progress.named("progress"));

    units.process("feeder").spawn(async move {
        let mut tick = luna::periodic("feeder", FEED)?;
        for number in 0..(duration.as_millis() / FEED.as_millis()) as u32 {
            tick.next().await;
            fed.send(Block(number)).await?;
        }
        Ok(())
    })?;
    units
        .process("conveyor")
        .spawn(conveyor(onto_conveyor, off_conveyor))?;
    units.process("press").spawn(async move {
        while let Ok(block) = into_press.recv().await {
            if Some(block.0) == jam {
                std::future::pending::<()>().await;
            }
            luna::after(PRESS).await;
            pressed.send(block).await?;
        }
        Ok(())
    })?;
    let stack = cell.clone();
    units.process("stacker").spawn(async move {
        while let Ok(block) = onto_stack.recv().await {
            stack.stacked.fetch_add(1, Ordering::Relaxed);
            progress.send(block.0).await?; // waits for nobody: the register has room
        }
        Ok(())
    })?;
    units.process("watch").priority(25).spawn(watch(watched))?;

    // Runs above all others at an emergency, a panic, Ctrl-C: whatever ends the system early.
    let press = cell.clone();
    system.on_emergency("press open", move || {
        press.press_is_open.store(true, Ordering::Relaxed)
    });
    Ok(cell)
}

/// Takes blocks while it has room and, at the same time, offers the first one: both are guards of
/// one choice. A guard whose `if` is false is not offered.
async fn conveyor(input: Receiver<Block>, output: Sender<Block>) -> luna::Result<()> {
    let mut first = None;
    let mut behind = VecDeque::with_capacity(ROOM);
    let mut is_fed = true;
    while is_fed || first.is_some() {
        alt! {
            block = input.recv(), if is_fed && behind.len() < ROOM - 1 => match block {
                Ok(block) => behind.push_back(block),
                Err(_) => is_fed = false, // the feeder has ended: the rest goes on
            },
            sent = output.send_from(&mut first), if first.is_some() => sent?,
        }
        first = first.or_else(|| behind.pop_front());
    }
    Ok(())
}

/// Brings the cell to safety if nothing comes out of it. `pri_alt!` looks at its guards in the
/// order written.
async fn watch(progress: Receiver<u32>) -> luna::Result<()> {
    let mut last = None;
    loop {
        pri_alt! {
            number = progress.recv() => match number {
                Ok(number) => last = Some(number),
                Err(_) => return Ok(()), // the stacker has ended
            },
            _ = luna::after(PATIENCE) => {
                let cause = format!("the cell is jammed: the last block was {last:?}");
                return Err(luna::emergency(luna::Error::other(cause)));
            },
        }
    }
}
