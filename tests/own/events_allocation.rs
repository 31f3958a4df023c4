//! Recording events neither allocates nor frees on the real-time path. One test alone, since the
//! allocator counts what the whole program does.

use crate::ALLOCATOR;

use luna::log::{Logging, WriterSink};
use luna::prelude::*;
use std::time::Duration;

const ROUNDS: u64 = 2000;

#[test]
fn nothing_is_allocated_on_the_path() -> luna::Result<()> {
    let mut system = System::new("events");
    let sink = WriterSink::new(std::io::sink());
    system.log(Logging::to_sink(sink).room_for_events(1 << 18));
    let (there, from_there) = luna::channel::<u64>();
    let (back, from_back) = luna::channel::<u64>();
    let (notify, notified) = luna::channel::<u64>();
    let main = system.executor("main").build()?;
    main.process("ping").spawn(async move {
        // Its name comes on the path.
        let mut tick = luna::periodic("ticks", Duration::from_micros(500))?;
        for number in 0..ROUNDS {
            there.send(number).await?;
            assert_eq!(from_back.recv().await?, number);
            if number % 500 == 0 {
                tick.next().await;
                notify.send(number).await?;
            }
        }
        Ok(())
    })?;
    main.process("pong").spawn(async move {
        while let Ok(number) = from_there.recv().await {
            if back.send(number).await.is_err() {
                break;
            }
        }
        Ok(())
    })?;
    system
        .thread("console")
        .process("console")
        .spawn(async move {
            while notified.recv().await.is_ok() {}
            Ok(())
        })?;
    let report = system.run()?;
    let events = report.logging.unwrap().events;
    assert!(
        events.recorded > 8 * ROUNDS && events.lost == 0,
        "{events:?}"
    );
    assert_eq!(ALLOCATOR.on_path(), (0, 0));
    Ok(())
}
