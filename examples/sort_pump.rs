//! The sort pump: a pipeline of cells that sorts values streaming through it, in any number of
//! groups.
//!
//! A cell holds the largest value of a group so far and passes on the others. So the output of a
//! pump of n - 1 cells is sorted, smallest first, for groups of up to n values. All cells work at
//! the same time: with a processor for each, n values take about 2n steps. While the end of one
//! group is still leaving, the next one enters.
//!
//! From the occam course of P. H. Welch, University of Kent (1984).

use luna::prelude::*;

/// The longest group that the pump sorts.
const LONGEST: usize = 64;
const GROUPS: usize = 100;

/// What goes through the pump: values, and after each group a mark.
#[derive(Clone, Copy, PartialEq)]
enum Item {
    Value(u32),
    EndOfGroup,
}

/// Holds the largest value, passes on the others, and sends it at the end of the group.
async fn cell(input: Receiver<Item>, output: Sender<Item>) -> luna::Result<()> {
    let mut held: Option<u32> = None;
    while let Ok(item) = input.recv().await {
        match item {
            Item::Value(value) => {
                let largest = held.map_or(value, |held| held.max(value));
                if let Some(smaller) = held.replace(largest).map(|held| held.min(value)) {
                    output.send(Item::Value(smaller)).await?;
                }
            }
            Item::EndOfGroup => {
                if let Some(largest) = held.take() {
                    output.send(Item::Value(largest)).await?;
                }
                output.send(Item::EndOfGroup).await?;
            }
        }
    }
    Ok(()) // the input is closed: dropping the output closes the next cell's
}

/// Groups of different lengths and of values in no order.
fn groups() -> impl Iterator<Item = Vec<u32>> {
    let mut seed: u32 = 1;
    let mut random = move || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        seed >> 16
    };
    (0..GROUPS).map(move |group| (0..group % (LONGEST + 1)).map(|_| random()).collect())
}

fn main() -> luna::Result<()> {
    let mut system = System::new("sort pump");
    let main = system.executor("main").build()?;

    let (source, mut pipe) = luna::channel();
    main.process("source").spawn(async move {
        for group in groups() {
            for value in group {
                source.send(Item::Value(value)).await?;
            }
            source.send(Item::EndOfGroup).await?;
        }
        Ok(())
    })?;
    for number in 1..LONGEST {
        let (output, next) = luna::channel();
        main.process(format!("cell {number}"))
            .spawn(cell(pipe, output))?;
        pipe = next;
    }
    main.process("sink").spawn(async move {
        for mut expected in groups() {
            expected.sort_unstable();
            for value in expected {
                assert!(pipe.recv().await? == Item::Value(value));
            }
            assert!(pipe.recv().await? == Item::EndOfGroup);
        }
        println!("{GROUPS} groups of up to {LONGEST} values came out sorted");
        Ok(())
    })?;
    system.run()?;
    Ok(())
}
