//! External channels: terminals, files on a disk, and devices that are always ready.

#![cfg(unix)]

use crate::common;
use crate::external::{run_beside_thread, run_on_one};
use common::{PLACEMENTS, SpawnOk, TempFile, watchdog, with_ends};
use futures_lite::future;
use luna::Buffer;
use luna::external::{BadRecord, Frame, Framing};
use luna::prelude::*;
use std::fs::File;
use std::io::{Read, Seek, Write};

/// A terminal, which passes bytes on as they are: the device's side and the user's.
#[cfg(target_os = "linux")]
fn terminal() -> (File, File) {
    use nix::sys::termios::{SetArg, cfmakeraw, tcgetattr, tcsetattr};
    let pair = nix::pty::openpty(None, None).unwrap();
    let mut mode = tcgetattr(&pair.slave).unwrap();
    cfmakeraw(&mut mode);
    tcsetattr(&pair.slave, SetArg::TCSANOW, &mode).unwrap();
    (pair.master.into(), pair.slave.into())
}

#[cfg(target_os = "linux")]
#[test]
fn a_terminal_in_both_directions_until_it_hangs_up() {
    let Some(_watch) = with_ends() else { return };
    for place in PLACEMENTS {
        let (near, mut far) = terminal();
        let (sender, commands) = luna::channel::<Frame<16>>();
        let (answers, receiver) = luna::channel::<Frame<16>>();
        let mut system = System::new("terminal");
        let clone = near.try_clone().unwrap();
        place
            .process(&mut system, "in", "input")
            .spawn_ok(luna::external::input(clone, sender, Framing::lines(16)));
        place
            .process(&mut system, "out", "output")
            .spawn_ok(luna::external::output(receiver, near, Framing::lines(16)));
        system
            .executor("server")
            .build()
            .unwrap()
            .process("server")
            .spawn_ok(async move {
                let mut count = 0;
                while let Ok(mut command) = commands.recv().await {
                    assert!(command.append(b"!"));
                    answers.send(command).await?;
                    count += 1;
                }
                assert_eq!(count, 3);
                Ok(())
            });
        let user = std::thread::spawn(move || {
            for command in ["go", "left", "stop"] {
                writeln!(far, "{command}").unwrap();
                let mut answer = vec![0; command.len() + 2];
                far.read_exact(&mut answer).unwrap();
                assert_eq!(answer, format!("{command}!\n").as_bytes());
            }
            // And hangs up.
        });
        system.run().unwrap();
        user.join().unwrap();
    }
}

/// A file without a name.
fn scratch() -> File {
    let path = TempFile::new("external");
    let mut options = File::options();
    options.read(true).write(true).create_new(true);
    options.open(&path.0).unwrap()
}

/// The kernel refuses to wait for plain files, so they are never waited for. So this works wherever
/// there are files.
#[test]
fn files_on_a_disk() {
    let _watch = watchdog();
    for place in PLACEMENTS {
        let mut file = scratch();
        let (source, outgoing) = luna::channel::<[u8; 8]>();
        let link = luna::external::output(outgoing, file.try_clone().unwrap(), Framing::fixed(8));
        let sends = async move {
            for number in 0..3000_u64 {
                source.send(number.to_le_bytes()).await?;
            }
            Ok(())
        };
        run_beside_thread(place, "output", link, sends).unwrap();

        file.rewind().unwrap();
        let (sender, numbers) = luna::buffered::<[u8; 8]>(Buffer::fifo(5));
        let link = luna::external::input(file, sender, Framing::fixed(8));
        let drain = async move {
            for number in 0..3000_u64 {
                assert_eq!(numbers.recv().await?, number.to_le_bytes());
            }
            assert!(numbers.recv().await.unwrap_err().is_closed());
            Ok(())
        };
        run_beside_thread(place, "input", link, drain).unwrap();
    }
}

/// A device that always has data, none of which is a record: the others on its executor have their
/// turns all the same.
#[test]
fn a_device_without_end_lets_others_run() {
    let _watch = watchdog();
    let zero = File::open("/dev/zero").unwrap();
    let (sender, receiver) = luna::channel::<Result<Frame<8>, BadRecord>>();
    let mut link = luna::external::input(zero, sender, Framing::lines(8));
    luna::run(async {
        link.pre_run()?;
        let other = async {
            assert!(receiver.recv().await?.is_err(), "the line is too long");
            for _ in 0..100 {
                luna::yield_now().await;
            }
            Ok(())
        };
        // In one process: it is the link's turns that end, or `other` has none.
        future::or(async { link.run().await }, other).await
    })
    .unwrap();
}

/// Values that are overwritten never hold up the link, and the device neither.
#[test]
fn the_newest_of_a_device_without_end() {
    let _watch = watchdog();
    let zero = File::open("/dev/zero").unwrap();
    let (sender, newest) = luna::buffered::<[u8; 64]>(Buffer::overwrite_oldest(1));
    let link = luna::external::input(zero, sender, Framing::fixed(64));
    let reader = async move {
        for _ in 0..10 {
            assert_eq!(newest.recv().await?, [0; 64]);
            luna::yield_now().await;
        }
        Ok(())
    };
    run_on_one("input", link, reader).unwrap();
}

#[test]
fn nowhere_takes_all() {
    let _watch = watchdog();
    let null = File::create("/dev/null").unwrap();
    let (source, outgoing) = luna::channel::<[u8; 64]>();
    let link = luna::external::output(outgoing, null, Framing::fixed(64));
    let sends = async move {
        for _ in 0..200 {
            source.send([1; 64]).await?;
        }
        Ok(())
    };
    run_on_one("output", link, sends).unwrap();
}

/// A file that is open for the other direction alone.
#[test]
fn a_file_that_cannot_be_read() {
    let _watch = watchdog();
    let null = File::create("/dev/null").unwrap();
    let (sender, receiver) = luna::channel::<[u8; 1]>();
    let link = luna::external::input(null, sender, Framing::fixed(1));
    let reader = async move {
        assert!(receiver.recv().await.unwrap_err().is_closed());
        Ok(())
    };
    let error = run_on_one("input", link, reader).unwrap_err().to_string();
    assert!(
        error.contains("`input`") && error.contains("reading failed: Bad file descriptor"),
        "{error}"
    );
}
