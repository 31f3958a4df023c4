//! Links allocate and free nothing on the real-time path. One test alone, since the allocator
//! counts what the whole program does.

#![cfg(unix)]

use crate::ALLOCATOR;
use crate::common;

use common::{COMPLETE, PLACES, skip, watchdog};
use luna::external::{BadRecord, Frame, Framing, Prefix};
use luna::prelude::*;
use std::os::unix::net::UnixStream;

/// All that a link does: its first wait and thousands of others, both ways, broken records, a
/// failure, and its end.
#[test]
fn links_allocate_nothing() {
    own_process!();
    let _watch = watchdog();
    if !COMPLETE {
        return skip("the portable layer cannot wait for files");
    }
    for place in PLACES {
        let framings = [
            Framing::lines(31),
            Framing::prefixed(Prefix::U16Big, 31),
            Framing::delimited(0, 31),
        ];
        for framing in framings {
            let (near, far) = UnixStream::pair().unwrap();
            let (source, outgoing) = luna::channel::<Frame<32>>();
            let (incoming, drain) = luna::channel::<Result<Frame<24>, BadRecord>>();
            let mut system = System::new("quiet");
            place
                .process(&mut system, "out", "output")
                .spawn(luna::external::output(outgoing, near, framing))
                .unwrap();
            place
                .process(&mut system, "in", "input")
                .spawn(luna::external::input(far, incoming, framing))
                .unwrap();
            let ends = system.executor("ends").build().unwrap();
            ends.process("source")
                .spawn(async move {
                    for length in 0..1000 {
                        let record = [b'x'; 31];
                        let frame = Frame::new(&record[..length % 32]).unwrap_or_default();
                        source.send(frame).await?;
                    }
                    // It has one byte too many: the link fails.
                    source.send(Frame::new(&[b'x'; 32]).unwrap()).await?;
                    Ok(())
                })
                .unwrap();
            ends.process("drain")
                .spawn(async move {
                    let (mut good, mut bad) = (0, 0);
                    while let Ok(record) = drain.recv().await {
                        match record {
                            Ok(_) => good += 1,
                            Err(_) => bad += 1,
                        }
                    }
                    assert_eq!((good, good + bad), (1000 - 7 * 31, 1000));
                    Ok(())
                })
                .unwrap();
            let error = system.run().unwrap_err().to_string();
            assert!(error.contains("more than the 31 bytes"), "{error}");
            assert_eq!(ALLOCATOR.on_path(), (0, 0), "{place:?}, {framing:?}");
        }
    }
    assert!(ALLOCATOR.everywhere().0 > 0, "it does count");
}
