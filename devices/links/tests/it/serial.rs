//! Serial ports, by pseudo-terminals: both directions, garbled records, hanging up, and exclusive
//! access.

#![cfg(feature = "serial")]

use crate::common;
use common::{SpawnOk, counter, run_to_loss, skip, watchdog, with_files};
use luna::devices::{DeviceError, DeviceState, Holder, OnLoss};
use luna::external::{Frame, Framing, Prefix};
use luna::prelude::*;
use luna::{End, Error};
use luna_links::serial::{self, Settings};
use luna_links::{OnBad, reader, writer};
use std::fs::File;
use std::io::{Read, Write};
use std::os::fd::AsRawFd;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// The device's side of a terminal, and the path of ours. The second descriptor keeps the terminal
/// alive before it is opened.
fn terminal() -> (File, File, String) {
    let pair = nix::pty::openpty(None, None).unwrap();
    let path = nix::unistd::ttyname(&pair.slave).unwrap();
    let path = path.to_str().unwrap().to_owned();
    (pair.master.into(), pair.slave.into(), path)
}

fn settings() -> Settings {
    Settings::new(115_200)
}

#[test]
fn records_go_both_ways_whatever_pieces_they_come_in() {
    let Some(_watch) = with_files() else { return };
    let (mut far, near, path) = terminal();
    let mut system = System::new("serial");
    let devices = system.devices();
    let port = serial::open(&devices, &path, &settings()).unwrap();
    drop(near);
    let framing = Framing::prefixed(Prefix::U16Big, 300);
    let (sender, commands) = luna::channel::<Frame<300>>();
    let (answers, receiver) = luna::channel::<Frame<300>>();
    let input = reader(&port, sender, framing).unwrap();
    let output = writer(&port, receiver, framing).unwrap();
    let (came, went) = (input.counts(), output.counts());
    let main = system.executor("main").build().unwrap();
    main.process("in").spawn_ok(input);
    main.process("out").spawn_ok(output);
    main.process("echo").spawn_ok(async move {
        for _ in 0..20 {
            answers.send(commands.recv().await?).await?;
        }
        Ok(())
    });
    drop(port);
    let device = std::thread::spawn(move || {
        for length in (0..20_u16).map(|number| number * 15) {
            let mut record = length.to_be_bytes().to_vec();
            record.extend((0..length).map(|byte| byte as u8));
            // One byte at a time, its own framing split too.
            for byte in &record {
                far.write_all(&[*byte]).unwrap();
            }
            let mut answer = vec![0; record.len()];
            far.read_exact(&mut answer).unwrap();
            assert_eq!(answer, record);
        }
        far
    });
    system.run().unwrap();
    device.join().unwrap();
    assert_eq!((came.records(), went.records(), came.bad()), (20, 20, 0));
    assert_eq!(devices.list()[0].state, DeviceState::Closed);
}

#[test]
fn a_garbled_record_is_dropped_or_ends_the_link_as_set() {
    let Some(_watch) = with_files() else { return };
    for policy in [OnBad::Drop, OnBad::End] {
        let (mut far, _near, path) = terminal();
        let mut system = System::new("garbled");
        let port = serial::open(&system.devices(), &path, &settings()).unwrap();
        let (sender, lines) = luna::channel::<Frame<8>>();
        let input = reader(&port, sender, Framing::lines(8))
            .unwrap()
            .on_bad(policy);
        let counts = input.counts();
        let main = system.executor("main").build().unwrap();
        main.process("in").spawn_ok(input);
        main.process("user").spawn_ok(async move {
            assert_eq!(lines.recv().await?.text(), Ok("one"));
            match policy {
                OnBad::Drop => assert_eq!(lines.recv().await?.text(), Ok("two")),
                _ => assert!(lines.recv().await.is_err_and(|error| error.is_closed())),
            }
            Ok(())
        });
        far.write_all(b"one\nfar too long\ntwo\n").unwrap();
        let ran = system.run();
        assert_eq!(counts.bad(), 1, "{policy:?}");
        match (policy, ran) {
            (OnBad::Drop, Ok(_)) => {}
            // Not lost: the device is all right.
            (_, Err(error)) => {
                assert!(
                    error.to_string().contains("more than the 8 bytes"),
                    "{error}"
                );
                assert_eq!(system.report().unwrap().end, End::Completed);
            }
            (policy, ran) => panic!("{policy:?}: {ran:?}"),
        }
        drop(port);
    }
}

#[test]
fn a_port_that_hangs_up_is_an_emergency_and_is_closed() {
    let Some(_watch) = with_files() else { return };
    let (mut far, near, path) = terminal();
    let mut system = System::new("unplugged");
    let devices = system.devices();
    let port = serial::open(&devices, &path, &settings()).unwrap();
    drop(near);
    let (ran, mut function) = counter();
    port.on_emergency("stop", move |port| {
        function();
        // The other side has gone, so it fails; it must not hang.
        assert!(port.write_at_once(b"STOP\n").is_err());
    })
    .unwrap();
    let (sender, lines) = luna::channel::<Frame<8>>();
    let main = system.executor("main").build().unwrap();
    let input = reader(&port, sender, Framing::lines(8)).unwrap();
    main.process("in").spawn_ok(input);
    // It would run for ever.
    main.process("control")
        .spawn_ok(std::future::pending::<luna::Result<()>>());
    // Its last records are still delivered, and the record that it cuts off is not the cause.
    far.write_all(b"last\nhal").unwrap();
    main.process("user").spawn_ok(async move {
        assert_eq!(lines.recv().await?.text(), Ok("last"));
        drop(far);
        assert!(lines.recv().await.is_err_and(|error| error.is_closed()));
        Ok(())
    });
    drop(port);
    let error = run_to_loss(&system, &devices);
    assert_eq!(
        error,
        format!(
            "process `in`: the serial port `{path}` is lost: the other side has hung up, or the device was unplugged"
        )
    );
    assert_eq!(ran.load(Ordering::Relaxed), 1);
}

#[test]
fn a_loss_that_is_no_emergency_ends_the_link_alone() {
    let Some(_watch) = with_files() else { return };
    let (far, near, path) = terminal();
    let mut system = System::new("console");
    let devices = system.devices();
    let port = serial::open(&devices, &path, &settings()).unwrap();
    drop((near, far));
    port.on_loss(OnLoss::Fail);
    let (ran, mut function) = counter();
    port.on_emergency("stop", move |_| function()).unwrap();
    let (sender, lines) = luna::channel::<Frame<8>>();
    let main = system.executor("main").build().unwrap();
    let input = reader(&port, sender, Framing::lines(8)).unwrap();
    main.process("in").spawn_ok(input);
    main.process("user").spawn_ok(async move {
        assert!(lines.recv().await.is_err_and(|error| error.is_closed()));
        Ok(())
    });
    assert!(matches!(system.run(), Err(Error::Process { .. })));
    assert_eq!(system.report().unwrap().end, End::Completed);
    assert_eq!(ran.load(Ordering::Relaxed), 0);
    assert_eq!(devices.list()[0].state, DeviceState::Lost);
    drop(port);
    assert_eq!(devices.list()[0].state, DeviceState::Closed);
}

#[test]
fn a_side_that_does_not_read_is_given_up_after_the_patience() {
    let Some(_watch) = with_files() else { return };
    let (_far, _near, path) = terminal();
    let mut system = System::new("stalled");
    let devices = system.devices();
    let port = serial::open(&devices, &path, &settings()).unwrap();
    let (numbers, receiver) = luna::channel::<[u8; 64]>();
    let output = writer(&port, receiver, Framing::fixed(64))
        .unwrap()
        .patience(Duration::from_millis(20));
    let counts = output.counts();
    let main = system.executor("main").build().unwrap();
    main.process("out").spawn_ok(output);
    main.process("source").spawn_ok(async move {
        loop {
            numbers.send([0; 64]).await?;
        }
    });
    drop(port);
    let error = run_to_loss(&system, &devices);
    assert!(
        error.contains("nothing could be written for 20ms"),
        "{error}"
    );
    // What a terminal holds, and no more: nothing grows.
    assert!((1..10_000).contains(&counts.records()), "{counts:?}");
}

#[test]
fn an_emergency_command_gets_out_before_what_was_queued() {
    let Some(_watch) = with_files() else { return };
    let (mut far, _near, path) = terminal();
    let mut system = System::new("stop");
    let port = serial::open(&system.devices(), &path, &settings()).unwrap();
    port.on_emergency("stop", |port| {
        assert_eq!(port.write_at_once(b"STOP\n").unwrap(), 5);
    })
    .unwrap();
    let main = system.executor("main").build().unwrap();
    main.process("panics")
        .spawn_ok(async { Err(luna::emergency(Error::other("a test"))) });
    assert!(system.run().is_err());
    let mut command = [0; 5];
    far.read_exact(&mut command).unwrap();
    assert_eq!(&command, b"STOP\n");
    drop(port);
}

nix::ioctl_read_bad!(
    /// Whether a terminal refuses further opens.
    get_exclusive,
    nix::libc::TIOCGEXCL,
    i32
);

fn is_claimed(terminal: &File) -> bool {
    let mut claimed = 0;
    // SAFETY: the call writes one number, and the descriptor is open.
    unsafe { get_exclusive(terminal.as_raw_fd(), &mut claimed) }.unwrap();
    claimed != 0
}

#[test]
fn a_port_is_one_device_by_whatever_name() {
    let _watch = watchdog();
    let (_far, near, path) = terminal();
    let link = std::env::temp_dir().join(format!("luna-serial-{}", std::process::id()));
    let _ = std::fs::remove_file(&link);
    std::os::unix::fs::symlink(&path, &link).unwrap();
    let system = System::new("one");
    let devices = system.devices();
    let port = serial::open(&devices, &path, &settings()).unwrap();
    let again = serial::open(&devices, link.to_str().unwrap(), &settings());
    assert!(matches!(
        again,
        Err(DeviceError::Busy {
            by: Holder::ThisProgram,
            ..
        })
    ));
    // Another system of this program: refused by the kernel's lock.
    let other = System::new("other");
    let elsewhere = serial::open(&other.devices(), &path, &settings());
    assert!(
        matches!(
            &elsewhere,
            Err(DeviceError::Busy {
                by: Holder::ThisProgram,
                ..
            })
        ),
        "{elsewhere:?}"
    );
    // The terminal refuses programs that check no lock (except root, which this may run as).
    assert!(is_claimed(&near));
    drop(port);
    assert!(!is_claimed(&near));
    // Closed: it can be opened again, by its other name.
    drop(serial::open(&devices, link.to_str().unwrap(), &settings()).unwrap());
    std::fs::remove_file(&link).unwrap();
    drop(near);
}

#[test]
fn another_process_that_has_the_port_is_named() {
    let _watch = watchdog();
    let (_far, _near, path) = terminal();
    let child = std::process::Command::new("flock")
        .args([
            "--exclusive",
            "--no-fork",
            &path,
            "sh",
            "-c",
            "echo locked; read wait",
        ])
        .stdin(std::process::Stdio::piped())
        .stdout(std::process::Stdio::piped())
        .spawn();
    let Ok(mut child) = child else {
        return skip("flock (util-linux) is missing");
    };
    let mut line = [0; 7];
    child
        .stdout
        .as_mut()
        .unwrap()
        .read_exact(&mut line)
        .unwrap();
    assert_eq!(&line, b"locked\n");
    let system = System::new("busy");
    let opened = serial::open(&system.devices(), &path, &settings());
    drop(child.stdin.take());
    let pid = child.id();
    child.wait().unwrap();
    match opened {
        Err(DeviceError::Busy {
            by: Holder::Process { pid: holder, name },
            ..
        }) => {
            assert_eq!(holder, pid);
            assert!(!name.is_empty());
        }
        other => panic!("{other:?}"),
    }
    // And when it has gone, the port is free.
    serial::open(&system.devices(), &path, &settings()).unwrap();
}

/// The kernel cannot wait for it, since it never has to be waited for.
#[test]
fn a_file_that_is_always_ready_is_read_while_others_run() {
    use luna::devices::Sharing;
    use luna_links::Transport;
    let _watch = watchdog();
    struct Zeros(File);
    impl Transport for Zeros {
        fn file(&self) -> std::io::Result<std::os::fd::OwnedFd> {
            Ok(self.0.try_clone()?.into())
        }
    }
    let mut system = System::new("zeros");
    let opened = system
        .devices()
        .open("/dev/zero", "source of zeros", Sharing::Shared, || {
            Ok(Zeros(File::open("/dev/zero").unwrap()))
        });
    let zeros = opened.unwrap();
    let (sender, numbers) = luna::channel::<[u8; 1000]>();
    let main = system.executor("main").build().unwrap();
    let input = reader(&zeros, sender, Framing::fixed(1000)).unwrap();
    main.process("in").spawn_ok(input);
    main.process("user").spawn_ok(async move {
        for _ in 0..100 {
            assert_eq!(numbers.recv().await?, [0; 1000]);
        }
        Ok(())
    });
    system.run().unwrap();
    drop(zeros);
}
