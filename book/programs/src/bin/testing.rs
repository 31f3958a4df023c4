//! A process that reports silence, and tests of it to the microsecond.
// ANCHOR: process
use luna::prelude::*;
use std::time::Duration;

const PATIENCE: Duration = Duration::from_millis(50);

/// Passes values on. If none comes for 50 ms it says so, once for each silence.
async fn watch(input: Receiver<u32>, output: Sender<Result<u32, Silence>>) -> luna::Result<()> {
    let mut is_silent = false;
    loop {
        alt! {
            value = input.recv() => match value {
                Ok(value) => {
                    is_silent = false;
                    output.send(Ok(value)).await?;
                }
                Err(_) => return Ok(()),
            },
            _ = luna::after(PATIENCE), if !is_silent => {
                is_silent = true;
                output.send(Err(Silence)).await?;
            }
        }
    }
}

/// No value came in time.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Silence;
// ANCHOR_END: process

// ANCHOR: scenario
/// Sends values at the given milliseconds. Gives what came out, and when.
fn run(sent_at: Vec<u64>, until: u64) -> luna::Result<Vec<(u64, Result<u32, Silence>)>> {
    let ms = Duration::from_millis;
    let mut system = System::new("watched");
    system.virtual_clock();
    let main = system.executor("main").build()?;
    let (put, input) = luna::channel();
    let (output, got) = luna::channel();
    let (seen, all) = luna::buffered(Buffer::allocating_unbounded());
    main.process("watch").spawn(watch(input, output))?;
    main.process("source").spawn(async move {
        let start = luna::now();
        for (value, at) in (0..).zip(sent_at) {
            luna::at(start + ms(at)).await;
            put.send(value).await?;
        }
        luna::at(start + ms(until)).await;
        Ok(())
    })?;
    main.process("sink").spawn(async move {
        let start = luna::now();
        while let Ok(value) = got.recv().await {
            let after = luna::now() - start;
            seen.send((after.as_millis() as u64, value)).await?;
        }
        Ok(())
    })?;
    system.run()?;
    Ok(std::iter::from_fn(|| all.try_recv().ok()).collect())
}
// ANCHOR_END: scenario

fn main() -> luna::Result<()> {
    for (after, value) in run(vec![0, 40, 200], 210)? {
        println!("{after:3} ms: {value:?}");
    }
    Ok(())
}

// ANCHOR: tests
#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn silence_is_reported_once_and_in_time() -> luna::Result<()> {
        let seen = run(vec![0, 40, 200], 210)?;
        let expected = [(0, Ok(0)), (40, Ok(1)), (90, Err(Silence)), (200, Ok(2))];
        assert_eq!(seen, expected);
        Ok(())
    }

    #[test]
    fn an_hour_without_silence() -> luna::Result<()> {
        let seen = run((0..90_000).map(|n| 40 * n).collect(), 3_600_000)?;
        assert_eq!(seen.len(), 90_000);
        assert!(seen.iter().all(|(_, value)| value.is_ok()));
        Ok(())
    }
}
// ANCHOR_END: tests
