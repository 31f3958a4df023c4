//! A loop hands records to a writer that is too slow at times.
// ANCHOR: dropping
use luna::prelude::*;
use std::time::Duration;

struct Record {
    number: u64,
    place: f64,
}

async fn control(records: Sender<Record>) -> luna::Result<()> {
    let mut tick = luna::periodic("control", Duration::from_millis(1))?;
    let mut place = 0.0;
    for number in 0..500 {
        tick.next().await;
        place += (1.0 - place) * 0.01;
        // Never waits: a full buffer drops its oldest record.
        records.send(Record { number, place }).await?;
    }
    Ok(())
}

/// Has a thread of its own, since on a machine it writes to a disk or a socket that may block.
async fn writer(records: Receiver<Record>) -> luna::Result<()> {
    let (mut written, mut dropped, mut expected, mut last) = (0, 0, 0, 0.0);
    while let Ok(record) = records.recv().await {
        dropped += record.number - expected;
        expected = record.number + 1;
        if record.number == 200 {
            luna::after(Duration::from_millis(150)).await; // the disk is busy
        }
        (written, last) = (written + 1, record.place);
    }
    println!("{written} records are written, {dropped} dropped; the last place is {last:.2}");
    Ok(())
}

fn main() -> luna::Result<()> {
    let mut system = System::new("drive");
    system.virtual_clock();
    let fast = system.executor("fast").policy(Policy::fifo(80)).build()?;
    let slow = system.thread("slow");
    let (put, records) = luna::buffered(Buffer::overwrite_oldest(64));
    let put = put.named("records");
    fast.process("control").spawn(control(put))?;
    slow.process("writer").spawn(writer(records))?;
    let report = system.run()?;
    println!("{} cycles missed", report.loops["control"].missed);
    Ok(())
}
// ANCHOR_END: dropping
