//! Processes that work on files.

use super::{Places, ROUNDS};
use luna::external::{BadRecord, Frame, Framing, Prefix};
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;

pub(crate) fn files_that_become_ready(places: &mut Places) {
    let (mut near, far) = UnixStream::pair().unwrap();
    near.set_nonblocking(true).unwrap();
    far.set_nonblocking(true).unwrap();
    places.process("reads", async move {
        // What waiting for files needs is there after this.
        luna::realtime::off_path(luna::external::prepare_files).map_err(luna::Error::other)?;
        let mut byte = [0];
        for n in 0..ROUNDS {
            luna::external::readable(&near).await.map_err(luna::Error::other)?;
            // The standard library's call is the process' own.
            luna::realtime::off_path(|| near.read_exact(&mut byte)).unwrap();
            assert_eq!(u64::from(byte[0]), n % 200);
        }
        luna::realtime::off_path(|| drop(near));
        Ok(())
    });
    places.process("writes", async move {
        luna::realtime::off_path(luna::external::prepare_files).map_err(luna::Error::other)?;
        for n in 0..ROUNDS {
            luna::external::writable(&far).await.map_err(luna::Error::other)?;
            luna::realtime::off_path(|| (&far).write_all(&[(n % 200) as u8])).unwrap();
            luna::yield_now().await;
        }
        luna::realtime::off_path(|| drop(far));
        Ok(())
    });
}

/// Each link has records that it cannot pass on, and fails at the last one.
pub(crate) fn links(places: &mut Places) {
    places.error = Some("more than the 31 bytes");
    for (name, framing) in [
        ("lines", Framing::lines(31)),
        ("prefixed", Framing::prefixed(Prefix::U16Big, 31)),
        ("delimited", Framing::delimited(0, 31)),
    ] {
        let (near, far) = UnixStream::pair().unwrap();
        let (source, outgoing) = luna::channel::<Frame<32>>();
        let (incoming, drain) = luna::channel::<Result<Frame<24>, BadRecord>>();
        let output = luna::external::output(outgoing, near, framing);
        places
            .next(&format!("output of {name}"))
            .spawn(output)
            .unwrap();
        let input = luna::external::input(far, incoming, framing);
        places
            .next(&format!("input of {name}"))
            .spawn(input)
            .unwrap();
        places.process(&format!("source of {name}"), async move {
            for length in 0..ROUNDS as usize {
                let record = [b'x'; 31];
                source
                    .send(Frame::new(&record[..length % 32]).unwrap_or_default())
                    .await?;
            }
            source.send(Frame::new(&[b'x'; 32]).unwrap()).await?;
            Ok(())
        });
        places.process(&format!("drain of {name}"), async move {
            let mut records = 0;
            // Records of a wrong size are reported as broken.
            while drain.recv().await.is_ok() {
                records += 1;
            }
            assert_eq!(records, ROUNDS);
            Ok(())
        });
    }
}
