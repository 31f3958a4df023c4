//! Two programs on two computers: a feeder that sends blocks to a press and reads its temperature.
//!
//! On one computer: `cargo run -p luna-net --example two_computers`. The press is this program,
//! started again. On two, with the press at 192.168.7.2:
//!
//! ```text
//! two_computers press  tcp/192.168.7.2:7447
//! two_computers feeder tcp/192.168.7.2:7447
//! ```

use luna::prelude::*;
use luna::{Buffer, Error};
use luna_net::{Config, Network};
use serde::{Deserialize, Serialize};
use std::process::Command;
use std::time::Duration;

#[derive(Debug, Serialize, Deserialize)]
struct Block {
    number: u64,
    color: String,
}

fn main() -> luna::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments.as_slice() {
        ["press", address] => press(address),
        ["feeder", address] => feeder(address),
        _ => {
            let free = std::net::TcpListener::bind("127.0.0.1:0").map_err(Error::other)?;
            let address = format!("tcp/{}", free.local_addr().map_err(Error::other)?);
            drop(free);
            let program = std::env::current_exe().map_err(Error::other)?;
            let press = Command::new(program).args(["press", &address]).spawn();
            let mut press = press.map_err(Error::other)?;
            feeder(&address)?;
            let ended = press.wait().map_err(Error::other)?;
            println!("feeder: the press has ended: {ended}");
            assert!(ended.success());
            Ok(())
        }
    }
}

fn feeder(address: &str) -> luna::Result<()> {
    let network = Network::open(&Config::network().connect(address))?;
    let (blocks, to_press) = network.sender::<Block>("cell/blocks")?;
    // The newest value is here whenever the feeder looks, and says how old it is.
    let newest = Buffer::overwrite_oldest(1);
    let endpoint = network.endpoint("cell/temperature");
    let (temperature, from_press) = endpoint.buffered_receiver::<f64>(newest)?;
    let mut system = System::new("feeder");
    let main = system.executor("main").build()?;
    main.process("link of blocks").priority(2).spawn(to_press)?;
    main.process("link of temperature")
        .priority(2)
        .spawn(from_press)?;
    main.process("feeder").spawn(async move {
        for number in 1..=3 {
            let color = ["red", "green", "blue"][number as usize % 3].to_owned();
            blocks.send(Block { number, color }).await?; // the press has taken it
            let reading = temperature.recv().await?;
            println!(
                "feeder: block {number} is in the press, which has {} degrees, {:?} ago",
                reading.get(),
                reading.age().at_least,
            );
        }
        Ok(())
    })?;
    system.run().map(drop)
}

fn press(address: &str) -> luna::Result<()> {
    let network = Network::open(&Config::network().listen(address))?;
    let (blocks, from_feeder) = network.receiver::<Block>("cell/blocks")?;
    let newest = Buffer::overwrite_oldest(1);
    let endpoint = network.endpoint("cell/temperature").window(1);
    let (temperature, to_feeder) = endpoint.buffered_sender::<f64>(newest)?;
    let mut system = System::new("press");
    let main = system.executor("main").build()?;
    main.process("link of blocks")
        .priority(2)
        .spawn(from_feeder)?;
    main.process("link of temperature")
        .priority(2)
        .spawn(to_feeder)?;
    main.process("press").spawn(async move {
        let mut degrees = 20.0;
        loop {
            alt! {
                block = blocks.recv() => match block {
                    Ok(block) => println!("press: {block:?}"),
                    Err(error) if error.is_closed() => break Ok(()),
                    Err(error) => break Err(error.into()),
                },
                () = luna::after(Duration::from_millis(10)) => {
                    degrees += 0.5;
                    // The feeder may have gone: the blocks' channel reports it.
                    let _ = temperature.try_send(degrees);
                },
            }
        }
    })?;
    system.run().map(drop)
}
