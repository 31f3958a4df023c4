//! Two programs: a feeder that sends blocks to a press, asks it for their weight, and reads its
//! temperature from a blackboard. The press is this program, started again.
//!
//! `cargo run -p luna-ipc --example two_programs`

use luna::Error;
use luna::prelude::*;
use luna_ipc::{Blackboard, WriterState, ZeroCopySend};
use std::process::Command;

#[repr(C)]
#[derive(Debug, ZeroCopySend)]
#[type_name("two_programs::Block")]
struct Block {
    number: u64,
    height: f32,
}

fn main() -> luna::Result<()> {
    let mut arguments = std::env::args().skip(1);
    match (arguments.next().as_deref(), arguments.next()) {
        (Some("press"), Some(cell)) => press(&cell),
        _ => {
            // In a plant the name is known to both, such as "cell/press".
            let cell = format!("example/{}", std::process::id());
            let program = std::env::current_exe().map_err(Error::other)?;
            let press = Command::new(program).arg("press").arg(&cell).spawn();
            let mut press = press.map_err(Error::other)?;
            feeder(&cell)?;
            let ended = press.wait().map_err(Error::other)?;
            println!("feeder: the press has ended: {ended}");
            assert!(ended.success());
            Ok(())
        }
    }
}

// ANCHOR: feeder
fn feeder(cell: &str) -> luna::Result<()> {
    let (blocks, to_press) = luna_ipc::sender::<Block>(&format!("{cell}/blocks"))?;
    let (weight, to_scales) = luna_ipc::client::<u64, f32>(&format!("{cell}/weight"))?;
    let board = format!("{cell}/state");
    let mut system = System::new("feeder");
    let main = system.executor("main").build()?;
    main.process("link of blocks").priority(2).spawn(to_press)?;
    main.process("link of weights")
        .priority(2)
        .spawn(to_scales)?;
    main.process("feeder").spawn(async move {
        for number in 1..=3 {
            let height = number as f32 * 10.0;
            blocks.send(Block { number, height }).await?; // the press has taken it
            let weight = weight.call(number).await?;
            println!("feeder: block {number} weighs {weight} g");
        }
        // The press has opened its blackboard before it took a block.
        let board = luna::blocking(move || Blackboard::new(&board).read()).await?;
        let temperature = board.entry::<f64>("temperature")?;
        let reading = temperature.get().map_err(Error::other)?;
        assert_eq!((reading.number, reading.writer), (4, WriterState::Open));
        println!("feeder: the press has {} degrees", reading.value);
        // The press goes when the feeder has closed its channels: after this.
        luna::blocking(move || drop((board, temperature))).await;
        Ok(())
    })?;
    system.run().map(drop)
}
// ANCHOR_END: feeder

fn press(cell: &str) -> luna::Result<()> {
    let board = Blackboard::new(&format!("{cell}/state")).entry("temperature", 20.0);
    let mut writer = board.write()?;
    let mut temperature = writer.take::<f64>("temperature")?;
    let (blocks, from_feeder) = luna_ipc::receiver::<Block>(&format!("{cell}/blocks"))?;
    let (weights, to_feeder) = luna_ipc::server::<u64, f32>(&format!("{cell}/weight"))?;
    let mut system = System::new("press");
    let main = system.executor("main").build()?;
    main.process("link of blocks")
        .priority(31)
        .spawn(from_feeder)?;
    main.process("link of weights")
        .priority(31)
        .spawn(to_feeder)?;
    main.process("press").spawn(async move {
        let mut height = 0.0;
        loop {
            alt! {
                block = blocks.recv() => match block {
                    Ok(block) => {
                        println!("press: {block:?}");
                        height = block.height;
                        temperature.set(20.0 + block.number as f64);
                    }
                    Err(error) if error.is_closed() => break Ok(()),
                    Err(error) => break Err(error.into()),
                },
                call = weights.accept() => match call {
                    Ok(call) => {
                        let weight = height * 2.5 + *call as f32;
                        let _ = call.reply(weight); // the feeder may have gone
                    }
                    Err(error) if error.is_closed() => break Ok(()),
                    Err(error) => break Err(error.into()),
                },
            }
        }
    })?;
    let ran = system.run().map(drop);
    drop(writer);
    ran
}
