//! `luna record`: what other programs send is in a file of each, whole, however it ends.
#![cfg(unix)]

use crate::run::{command, luna, text};
use luna_logger::format::{Reader, Record};
use luna_logger::{Hub, Level, Logging, Recorder, Signal, message};
use nix::sys::signal::{Signal as Number, kill};
use nix::unistd::Pid;
use std::fs;
use std::io::{BufRead, BufReader, Lines, Write};
use std::net::{Shutdown, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Stdio};
use std::time::Duration;

/// Longer than any test takes.
const LONG: Duration = Duration::from_secs(600);

/// The program, which listens.
struct Listening {
    child: Child,
    lines: Lines<BufReader<ChildStdout>>,
    /// `tcp://HOST:PORT`.
    address: String,
}

impl Listening {
    fn start(folder: &Path, arguments: &[&str]) -> Self {
        let mut child = command(&["record", "--listen", "127.0.0.1:0"])
            .args(arguments)
            .current_dir(folder)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let first = lines.next().unwrap().unwrap();
        let address = first.strip_prefix("listening on ").unwrap();
        let (address, _) = address.split_once(';').unwrap();
        Self {
            child,
            lines,
            address: address.to_owned(),
        }
    }

    /// The next line that has `part` in it.
    fn line(&mut self, part: &str) -> String {
        let mut lines = self.lines.by_ref().map(Result::unwrap);
        lines.find(|line| line.contains(part)).expect(part)
    }

    /// All further lines, and whether it ended well.
    fn end(mut self) -> (Vec<String>, Option<i32>) {
        let lines = self.lines.map(Result::unwrap).collect();
        (lines, self.child.wait().unwrap().code())
    }
}

fn folder(test: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("record-{test}"));
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    folder
}

/// How many samples and messages are in a file, and whether it is whole.
fn read(file: &Path) -> (u64, u64, bool) {
    let mut reader = Reader::new(fs::File::open(file).unwrap()).unwrap();
    let (mut samples, mut messages) = (0, 0);
    while let Some(record) = reader.next().unwrap() {
        samples += u64::from(matches!(record, Record::Sample { .. }));
        messages += u64::from(matches!(record, Record::Message { .. }));
    }
    (samples, messages, reader.has_ended())
}

/// Records so many samples of `system`, and a message of each of two levels.
fn record(address: &str, system: &str, samples: u32) -> Recorder {
    record_and_end_within(LONG, address, system, samples)
}

fn record_and_end_within(end: Duration, address: &str, system: &str, samples: u32) -> Recorder {
    let hub = Hub::new(system, Default::default());
    let recorder = Recorder::start(&hub, Logging::to_place(address).end_within(end)).unwrap();
    let _inside = hub.enter();
    let signal = Signal::<u32>::register("numbers").unwrap();
    (0..samples).for_each(|n| signal.record(n));
    message(Level::Warn, "pump", format_args!("too hot"));
    message(Level::Info, "pump", format_args!("as ever"));
    recorder
}

#[test]
fn once_takes_one_recording_into_a_file() {
    let folder = folder("once");
    for way in [&[][..], &["--udp"]] {
        let once = [
            "--once",
            "--replace",
            "--messages",
            "warn",
            "-o",
            "run.luna",
        ];
        let arguments = [&once[..], way].concat();
        let listening = Listening::start(&folder, &arguments);
        let report = record(&listening.address, "arm", 100).finish();
        assert_eq!((report.signals[0].recorded, report.error), (100, None));
        let (lines, code) = listening.end();
        assert_eq!(code, Some(0), "{lines:?}");
        let has = |part: &str| lines.iter().any(|line| line.contains(part));
        assert!(
            has("has come: run.luna") && has("pump: too hot"),
            "{lines:?}"
        );
        assert!(!has("as ever"), "{lines:?}");
        assert!(
            has("has ended: 100 samples and 2 messages are in run.luna; 0 blocks are missing"),
            "{lines:?}"
        );
        assert_eq!(read(&folder.join("run.luna")), (100, 2, true));
    }
}

#[test]
fn what_comes_is_shown_in_the_scope_too() {
    let folder = folder("scope");
    let mut child = command(&["record", "--once", "-o", "run.luna", "--listen"])
        .args(["127.0.0.1:0", "--scope", "127.0.0.1:0"])
        .current_dir(&folder)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = BufReader::new(child.stderr.take().unwrap()).lines();
    let scope = said
        .find_map(|line| Some(line.unwrap().strip_prefix("scope: http://")?.to_owned()))
        .unwrap();
    let scope = scope.trim_end_matches('/');
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let first = lines.next().unwrap().unwrap();
    let address = first.strip_prefix("listening on ").unwrap();
    let (address, _) = address.split_once(';').unwrap();

    // It ends with the recording, which the viewer has seen by then.
    let recorder = record(address, "arm", 100);
    let stream = TcpStream::connect(scope).unwrap();
    let (mut viewer, _) = tungstenite::client(format!("ws://{scope}/live"), stream).unwrap();
    let name = b"numbers";
    let has_name = |bytes: &[u8]| bytes.windows(name.len()).any(|part| part == name);
    while !has_name(&viewer.read().unwrap().into_data()) {}
    assert_eq!(recorder.finish().signals[0].recorded, 100);
    assert!(child.wait().unwrap().success());
    assert_eq!(read(&folder.join("run.luna")), (100, 2, true));
}

#[test]
fn several_senders_are_shown_together() {
    let folder = folder("together");
    let mut child = command(&["record", "--listen", "127.0.0.1:0"])
        .args(["--scope", "127.0.0.1:0"])
        .current_dir(&folder)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = BufReader::new(child.stderr.take().unwrap()).lines();
    let scope = said
        .find_map(|line| Some(line.unwrap().strip_prefix("scope: http://")?.to_owned()))
        .unwrap();
    let scope = scope.trim_end_matches('/');
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let first = lines.next().unwrap().unwrap();
    let address = first.strip_prefix("listening on ").unwrap();
    let (address, _) = address.split_once(';').unwrap();
    let senders = ["arm", "leg"].map(|system| record(address, system, 10));
    let stream = TcpStream::connect(scope).unwrap();
    let (mut viewer, _) = tungstenite::client(format!("ws://{scope}/live"), stream).unwrap();
    let mut wanted = vec!["arm/numbers", "leg/numbers"];
    while !wanted.is_empty() {
        let bytes = viewer.read().unwrap().into_data();
        wanted.retain(|name| {
            !bytes
                .windows(name.len())
                .any(|part| part == name.as_bytes())
        });
    }
    for sender in senders {
        assert_eq!(sender.finish().signals[0].recorded, 10);
    }
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn several_senders_have_a_file_each_and_ctrl_c_leaves_them_whole() {
    let folder = folder("several");
    let mut listening = Listening::start(&folder, &[]);
    let address = listening.address.clone();
    let first = record(&address, "arm", 10);
    let second = record(&address, "leg", 20);
    assert_eq!(first.finish().signals[0].recorded, 10);
    listening.line("arm (127.0.0.1");
    // A peer with another protocol disturbs no sender.
    let mut stranger = TcpStream::connect(address.strip_prefix("tcp://").unwrap()).unwrap();
    stranger.write_all(b"GET / HTTP/1.1\r\n\r\n").unwrap();
    let _ = stranger.shutdown(Shutdown::Write);
    listening.line("is refused: the peer is not LUNA's");
    assert_eq!(second.finish().signals[0].recorded, 20);
    // No sender is left when it ends.
    let third = record_and_end_within(Duration::ZERO, &address, "eye", 30);
    // All of it has come when its last message is shown.
    listening.line("eye/");
    listening.line("as ever");
    kill(
        Pid::from_raw(listening.child.id().cast_signed()),
        Number::SIGINT,
    )
    .unwrap();
    let (lines, code) = listening.end();
    assert_eq!(code, Some(0));
    assert!(
        lines
            .iter()
            .any(|line| line.contains("eye") && line.contains("without an end")),
        "{lines:?}"
    );
    drop(third);
    let mut files: Vec<_> = fs::read_dir(&folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    files.sort();
    let read: Vec<_> = files.iter().map(|file| read(file)).collect();
    let names: Vec<_> = files
        .iter()
        .map(|file| file.file_name().unwrap().to_str().unwrap()[..4].to_owned())
        .collect();
    assert_eq!(names, ["arm-", "eye-", "leg-"]);
    assert_eq!(read, [(10, 2, true), (30, 2, false), (20, 2, true)]);
}

#[test]
fn a_limit_is_kept_and_the_file_is_good() {
    let folder = folder("limit");
    let mut listening = Listening::start(&folder, &["--limit", "1", "--once", "-o", "run.luna"]);
    let hub = Hub::new("arm", Default::default());
    let recording = Logging::to_place(&listening.address)
        .room_for_samples(1 << 20)
        .end_within(Duration::from_millis(1));
    let recorder = Recorder::start(&hub, recording).unwrap();
    let _inside = hub.enter();
    let signal = Signal::<[f64; 16]>::register("numbers").unwrap();
    (0..20_000u32).for_each(|n| signal.record([n.into(); 16]));
    listening.line("as many MiB as --limit allows");
    let report = recorder.finish();
    assert!(report.lost_samples() > 0);
    kill(
        Pid::from_raw(listening.child.id().cast_signed()),
        Number::SIGTERM,
    )
    .unwrap();
    assert_eq!(listening.end().1, Some(0));
    let file = folder.join("run.luna");
    assert!(fs::metadata(&file).unwrap().len() <= 1 << 20);
    assert!(read(&file).0 >= report.signals[0].recorded);
}

#[test]
fn an_address_that_cannot_be_had_is_named() {
    let output = luna(&["record", "--listen", "nowhere"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("--listen nowhere"));
}
