//! Three nodes on a simulated bus: the most urgent frame goes first, a node with a broken wire
//! becomes bus-off, and what its system does then. It ends by itself with a verdict.

use luna::End;
use luna::prelude::*;
use luna_can::{Event, Filter, Frame, Port, sim};
use std::sync::mpsc;
use std::time::Duration;

fn main() -> luna::Result<()> {
    let mut system = System::new("cell");
    system.virtual_clock();
    // In place of this and the devices below: luna_can::open(&system.devices(), "can0").
    let mut bus = sim::Bus::new(500_000)?;
    let control = bus.control();
    let drive = bus.open(&system.devices(), "drive")?;
    let sensor = bus.open(&system.devices(), "sensor")?;
    let master = bus.open(&system.devices(), "master")?;
    let main = system.executor("main").build()?;
    main.process("bus").spawn(bus)?;

    let frame = |id, data: &[u8]| Frame::standard(id, data).ok_or(luna::Error::other("too long"));
    let stop = frame(0x000, &[2, 0])?;
    drive.on_emergency("stop", move |port| {
        port.transmit_at_once(stop).expect("the stop was not sent");
    })?;

    let (speed, speeds) = luna::buffered::<Frame>(Buffer::fifo(16));
    let (event, events) = luna::buffered::<Event>(Buffer::fifo(256));
    let controller = luna_can::controller(&drive).send(speeds).events(event);
    main.process("drive").spawn(controller)?;
    let (measured, measurements) = luna::buffered::<Frame>(Buffer::fifo(16));
    main.process("sensor")
        .spawn(luna_can::controller(&sensor).send(measurements))?;
    let (incoming, received) = luna::buffered::<Frame>(Buffer::fifo(64));
    let filters = [Filter::standard(0x100, 0x700)];
    main.process("master")
        .spawn(luna_can::controller(&master).receive(&filters, incoming))?;
    drop((drive, sensor, master));

    let (seen, order) = mpsc::channel();
    let breaks = control.clone();
    main.process("story").spawn(async move {
        // The bus is busy while these come to wait for it.
        measured.send(frame(0x1FF, &[0; 8])?).await?;
        luna::after(Duration::from_micros(10)).await;
        measured.send(frame(0x180, &[1])?).await?;
        speed.send(frame(0x101, &[2])?).await?;
        for _ in 0..3 {
            let frame = received.recv().await?;
            println!("{:?} {frame}", luna::now());
            let _ = seen.send(frame.standard_id());
        }
        println!("the drive's wire breaks");
        breaks.corrupt("drive", u32::MAX);
        speed.send(frame(0x101, &[3])?).await?;
        loop {
            let event = events.recv().await?;
            if let Event::State(state) = event {
                println!("{:?} the drive is {state}", luna::now());
            }
        }
    })?;
    let error = system.run().err();
    println!(
        "the system ends: {}",
        error.map_or("well".to_owned(), |error| error.to_string())
    );

    let order: Vec<_> = order.try_iter().flatten().collect();
    let is_urgent_first = order == [0x1FF, 0x101, 0x180];
    let is_emergency = system
        .report()
        .is_some_and(|report| report.end == End::Emergency);
    let is_stopped = control.sent_at_once("drive") == [stop];
    match is_urgent_first && is_emergency && is_stopped {
        true => println!("ok: the urgent frame was first, and bus-off was an emergency"),
        false => return Err(luna::Error::other("the bus is not as expected")),
    }
    Ok(())
}
