//! Standard input as a channel of lines: whatever it is, and also while nothing comes.

#![cfg(unix)]

use crate::common;
use common::{Program, SpawnOk, TempFile, part_of_caller, with_files};
use luna::Exit;
use luna::external::{self, Frame, Framing};
use luna::prelude::*;
use nix::fcntl::{FcntlArg, OFlag, fcntl};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::process::{Command, Stdio};

/// A console and its operator; the operator ends at the end of standard input, at the line `quit`,
/// and when `stop` has ended.
fn console(place: &str, stop: Receiver<()>) -> luna::Result<System> {
    let mut system = System::new("console");
    let main = system.executor("main").build()?;
    let (sender, lines) = luna::channel::<Frame<80>>();
    let framing = Framing::lines(80).or_end_of_file();
    let link = external::stdin(sender, framing)?;
    match place {
        "thread" => system.thread("console").process("link").spawn_ok(link),
        _ => main.process("link").spawn_ok(link),
    };
    main.process("operator").spawn_ok(async move {
        println!("ready");
        loop {
            alt! {
                line = lines.recv() => match line {
                    Ok(line) => {
                        println!("line {}", line.text().unwrap());
                        if line.text() == Ok("quit") {
                            return Ok(());
                        }
                    }
                    Err(_) => {
                        println!("over");
                        return Ok(());
                    }
                },
                _ = stop.recv() => return Ok(()),
            }
        }
    });
    Ok(system)
}

fn play(part: &str) -> luna::Result<()> {
    let (action, place) = part.split_once(' ').unwrap();
    let (keeps, stop) = luna::channel();
    // Dropped at once, where the run is to end.
    let keeps = (action == "reads").then_some(keeps);
    let report = console(place, stop)?.run()?;
    // A thread that is blocked in a read would have been left behind.
    let exits = report.processes.iter().map(|process| process.exit.clone());
    assert!(
        exits.eq([Some(Exit::Completed), Some(Exit::Completed)]),
        "{report}"
    );
    drop(keeps);
    println!("has ended");
    Ok(())
}

/// What the child program runs; nothing when this program runs it as a test.
#[test]
fn part() {
    if let Some(part) = common::part() {
        play(&part).unwrap();
    }
}

/// What the operator says of this input.
fn said(input: impl Into<Stdio>) -> Vec<String> {
    let mut program = own_program("reads thread");
    program.stdin(input);
    let output = common::output(&mut program);
    assert!(output.status.success(), "{output:?}");
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines().filter_map(reported).collect()
}

/// The line of the operator in a line of the program: the harness writes before the first.
fn reported(line: &str) -> Option<String> {
    let place = line.find("line ").or_else(|| line.find("over"))?;
    Some(line[place..].to_owned())
}

fn own_program(part: &str) -> Command {
    let mut program = Command::new(std::env::current_exe().unwrap());
    program
        .args([
            &*part_of_caller(),
            "--exact",
            "--nocapture",
            "--test-threads=1",
        ])
        .env(common::PART, part);
    program
}

#[test]
fn a_run_ends_although_standard_input_is_open_and_silent() {
    let Some(_watch) = with_files() else { return };
    for place in ["thread", "executor"] {
        // The input stays open until the program has ended.
        let ended = Program::start(&format!("ends {place}")).end();
        assert!(ended.status.success(), "{ended:?}");
        assert!(ended.output.contains("has ended"), "{ended:?}");
        assert!(!ended.output.contains("over"), "{ended:?}");
    }
}

#[test]
fn a_signal_ends_a_run_that_waits_for_a_line() {
    let Some(_watch) = with_files() else { return };
    let ended = common::end_by("reads thread", 2);
    assert!(!ended.status.success(), "{ended:?}");
    assert!(!ended.errors.contains("left"), "{ended:?}");
}

#[test]
fn pipes_files_and_what_is_empty_are_read_to_their_end() {
    let Some(_watch) = with_files() else { return };
    let mut file = tempfile("a\nb\r\n\nlast");
    let expected = ["line a", "line b", "line ", "line last", "over"];
    assert_eq!(said(file.try_clone().unwrap()), expected);
    file.seek(SeekFrom::Start(0)).unwrap();
    let (pipe, mut far) = std::io::pipe().unwrap();
    let mut text = Vec::new();
    file.read_to_end(&mut text).unwrap();
    far.write_all(&text).unwrap();
    drop(far);
    assert_eq!(said(pipe), expected);
    assert_eq!(said(Stdio::null()), ["over"]);
    // Closed by the shell: the standard library opens `/dev/null` in its place.
    let mut shell = Command::new("sh");
    let program = own_program("reads thread");
    shell
        .args(["-c", "exec \"$0\" \"$@\" <&-"])
        .arg(program.get_program());
    shell
        .args(program.get_args())
        .env(common::PART, "reads thread");
    let output = common::output(&mut shell);
    assert!(output.status.success(), "{output:?}");
    assert!(
        String::from_utf8_lossy(&output.stdout).contains("over"),
        "{output:?}"
    );
}

fn tempfile(text: &str) -> File {
    File::open(&TempFile::with("input", text).0).unwrap()
}

/// Whether the open file, which others have too, is in non-blocking mode.
fn is_non_blocking(file: &impl std::os::fd::AsFd) -> bool {
    let flags = OFlag::from_bits_retain(fcntl(file.as_fd(), FcntlArg::F_GETFL).unwrap());
    flags.contains(OFlag::O_NONBLOCK)
}

#[test]
fn a_terminal_is_read_line_by_line_and_its_mode_stays_as_it_is() {
    let Some(_watch) = with_files() else { return };
    let terminal = nix::pty::openpty(None, None).unwrap();
    let (mut keyboard, screen) = (File::from(terminal.master), terminal.slave);
    let mut program = own_program("reads thread");
    program.stdin(screen.try_clone().unwrap());
    program.stdout(Stdio::piped());
    let mut child = common::spawn(&mut program);
    keyboard.write_all(b"first\n").unwrap();
    let mut output = child.stdout.take().unwrap();
    let mut text = Vec::new();
    let mut byte = [0];
    while !String::from_utf8_lossy(&text).contains("line first") {
        assert_eq!(output.read(&mut byte).unwrap(), 1, "{text:?}");
        text.push(byte[0]);
    }
    assert!(!is_non_blocking(&screen));
    keyboard.write_all(b"quit\n").unwrap();
    output.read_to_end(&mut text).unwrap();
    assert!(child.wait().unwrap().success());
    let text = String::from_utf8_lossy(&text);
    assert!(
        text.contains("line quit") && text.contains("has ended"),
        "{text}"
    );
    assert!(!is_non_blocking(&screen));
}
