//! `luna demo --scope` and `luna scope`: what they serve.

use crate::run::{command, luna};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::sync::mpsc;
use std::time::Duration;
use tungstenite::{Message, WebSocket};

const ANYWHERE: &str = "127.0.0.1:0";

/// Starts it. Returns where its scope listens, with the token behind a slash and a hash if there is
/// one.
fn served(arguments: &[&str]) -> (Child, String) {
    let mut child = command(arguments)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let mut lines = BufReader::new(child.stderr.take().expect("a pipe")).lines();
    let address = lines.find_map(|line| {
        let line = line.expect("text");
        let address = line.strip_prefix("scope: http://")?;
        Some(address.strip_suffix('/').unwrap_or(address).to_owned())
    });
    // A reader for its later output.
    std::thread::spawn(move || lines.for_each(drop));
    (child, address.expect("it says where"))
}

/// Looks at the scope until `wanted` has come.
fn look_for(address: &str, wanted: &[u8]) {
    let mut viewer = TcpStream::connect(address).expect("it listens");
    write!(
        viewer,
        "GET /live HTTP/1.1\r\nHost: {address}\r\nOrigin: http://{address}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
    )
    .expect("it reads");
    let (mut all, mut some) = (Vec::new(), [0; 4096]);
    while !all.windows(wanted.len()).any(|part| part == wanted) {
        let got = viewer.read(&mut some).expect("it answers");
        assert!(got > 0, "{}", String::from_utf8_lossy(&all));
        all.extend_from_slice(&some[..got]);
    }
}

fn end(mut child: Child) {
    child.kill().expect("it runs");
    child.wait().expect("it ends");
}

#[test]
fn the_demo_shows_its_signals_while_it_runs() {
    let (child, address) = served(&[
        "demo",
        "--scope",
        ANYWHERE,
        "--seconds",
        "600",
        "--calibrated",
        "--policy",
        "other",
    ]);
    let mut browser = TcpStream::connect(&address).expect("it listens");
    write!(browser, "GET / HTTP/1.1\r\nHost: {address}\r\n\r\n").expect("it reads");
    let mut page = String::new();
    browser.read_to_string(&mut page).expect("it answers");
    assert!(page.contains("<title>LUNA scope</title>"), "{page}");
    look_for(&address, b"pan/voltage");
    end(child);
}

#[test]
#[cfg(target_os = "linux")]
fn the_production_cell_shows_its_picture_and_where_its_blocks_are() {
    for place in ["executor", "threads"] {
        let options = "demo production-cell --seconds 600 --policy other --deploy";
        let options = options.split(' ').chain([place, "--scope", ANYWHERE]);
        let (child, address) = served(&options.collect::<Vec<_>>());
        look_for(&address, br#"data-signal=\"robot/places[4]\""#);
        look_for(&address, b"robot/places");
        end(child);
    }
}

#[test]
fn several_recordings_are_shown_together() {
    let paths = ["left", "right"].map(|system| {
        use luna_logger::format::{ClockBase, Record, Subject, Writer};
        let mut file = Writer::new(Vec::new()).expect("a head");
        let (subject, number, parent) = (Subject::Process, 1, 0);
        let (clock, written_by) = (ClockBase::Monotonic, "a test");
        let name = "control";
        for record in [
            Record::Session {
                system,
                clock,
                written_by,
            },
            Record::Name {
                subject,
                number,
                parent,
                name,
                runs_on: None,
            },
            Record::End { time: 7 },
        ] {
            file.put(&record).expect("memory");
        }
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{system}.luna"));
        std::fs::write(&path, file.finish().expect("an end")).expect("a place");
        path
    });
    let [left, right] = paths.each_ref().map(|path| path.to_str().expect("text"));
    let (child, address) = served(&["scope", left, right, "--listen", ANYWHERE]);
    look_for(&address, b"left/control");
    look_for(&address, b"right/control");
    end(child);

    let ends = |files: &[&str]| {
        let options = ["--once", "--speed", "max", "--listen", ANYWHERE];
        let output = luna(&[&["scope"], files, &options].concat());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        (output.status.code(), said)
    };
    assert_eq!(ends(&[left, right]).0, Some(0));
    let (code, said) = ends(&[left, "-"]);
    assert!(code == Some(2) && said.contains("standard input"), "{said}");
    let damaged = Path::new(env!("CARGO_TARGET_TMPDIR")).join("damaged.luna");
    let mut bytes = std::fs::read(right).expect("it was written");
    bytes.pop();
    std::fs::write(&damaged, bytes).expect("a place");
    let (code, said) = ends(&[left, damaged.to_str().expect("text")]);
    assert!(code == Some(1) && said.contains("damaged.luna: "), "{said}");
    let (code, said) = ends(&[left, file!()]);
    assert!(code == Some(2), "{said}");
}

#[test]
fn a_picture_is_read_from_a_file() {
    let svg = Path::new(env!("CARGO_TARGET_TMPDIR")).join("axis.svg");
    let recording = Path::new(env!("CARGO_TARGET_TMPDIR")).join("picture.luna");
    std::fs::write(&svg, "<svg/>").expect("a place");
    let file = luna_logger::format::Writer::new(Vec::new()).expect("a head");
    std::fs::write(&recording, file.finish().expect("an end")).expect("a place");
    let [svg, recording] = [&svg, &recording].map(|path| path.to_str().expect("text"));
    let options = ["scope", recording, "--listen", ANYWHERE, "--picture"];
    let (child, address) = served(&[&options[..], &[svg]].concat());
    look_for(&address, br#""picture":"<svg/>""#);
    end(child);
    let missing = luna(&[&options[..], &["missing.svg"]].concat());
    let said = String::from_utf8_lossy(&missing.stderr);
    assert_eq!(missing.status.code(), Some(2), "{said}");
    assert!(said.contains("picture missing.svg: "), "{said}");
}

#[test]
fn a_model_is_drawn_as_the_picture() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let [recording, broken] = ["drawn.luna", "broken.toml"].map(|name| folder.join(name));
    let file = luna_logger::format::Writer::new(Vec::new()).expect("a head");
    std::fs::write(&recording, file.finish().expect("an end")).expect("a place");
    std::fs::write(&broken, "name = 1").expect("a place");
    let [recording, broken] = [&recording, &broken].map(|path| path.to_str().expect("text"));
    let model = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../examples/models/commstime.toml"
    );
    let options = ["scope", recording, "--listen", ANYWHERE, "--model"];
    let (child, address) = served(&[&options[..], &[model]].concat());
    look_for(&address, br#"data-process=\"successor\""#);
    look_for(&address, br#"data-channel=\"to_successor\""#);
    end(child);
    let record = ["record", "--listen", ANYWHERE, "--scope", ANYWHERE];
    let (child, address) = served(&[&record[..], &["--model", model]].concat());
    look_for(&address, br#"data-channel=\"out\""#);
    end(child);
    let said = |more: &[&str]| {
        let ended = luna(&[&options[..], more].concat());
        let said = String::from_utf8_lossy(&ended.stderr).into_owned();
        assert_eq!(ended.status.code(), Some(2), "{said}");
        said
    };
    assert!(said(&["missing.toml"]).contains("missing.toml"));
    assert!(said(&[broken]).contains("broken.toml:1:"));
    // One picture at a time.
    assert!(said(&[model, "--picture", "axis.svg"]).contains("cannot be used with"));
}

type Viewer = WebSocket<TcpStream>;

/// The next of the scope's words of this type.
fn hear(viewer: &mut Viewer, of: &str) -> Value {
    loop {
        if let Message::Text(text) = viewer.read().expect("it is there") {
            let word: Value = serde_json::from_str(&text).expect("its words are JSON");
            if word["type"] == of {
                return word;
            }
        }
    }
}

/// Sends it, and returns the answer.
fn say(viewer: &mut Viewer, word: &Value, answer: &str) -> Value {
    let text = Message::text(word.to_string());
    viewer.send(text).expect("it hears");
    hear(viewer, answer)
}

/// The value of a parameter, as soon as the scope lists it and it is what is wanted.
fn wait_for(viewer: &mut Viewer, name: &str, wanted: impl Fn(&Value) -> bool) {
    loop {
        let word = hear(viewer, "parameters");
        let list = word["list"].as_array().expect("a list").iter();
        let mut named = list.filter(|parameter| parameter["name"] == name);
        if named.any(|parameter| wanted(&parameter["value"])) {
            return;
        }
    }
}

#[test]
fn the_demos_gains_are_seen_by_all_and_set_with_the_token_alone() {
    let run = [
        "demo",
        "--seconds",
        "600",
        "--calibrated",
        "--policy",
        "other",
        "--scope",
        ANYWHERE,
    ];
    let view = |address: &str| {
        let stream = TcpStream::connect(address).expect("it listens");
        tungstenite::client(format!("ws://{address}/live"), stream)
            .expect("it answers")
            .0
    };
    let set = |value: Value| json!({"type": "set", "id": 1, "name": "pan/kp", "value": value});

    let (child, url) = served(&[&run[..], &["--scope-token"]].concat());
    let (address, token) = url.split_once("/#token=").expect("a token");
    let mut viewer = view(address);
    assert_eq!(hear(&mut viewer, "hello")["can_set"], true);
    wait_for(&mut viewer, "pan/kp", Value::is_f64);
    let refused = say(&mut viewer, &set(json!(3.5)), "set");
    assert!(refused["error"].to_string().contains("token"), "{refused}");
    let wrong = json!({"type": "token", "token": "0".repeat(32)});
    assert_eq!(say(&mut viewer, &wrong, "authorized")["ok"], false);
    let refused = say(&mut viewer, &set(json!(3.5)), "set");
    assert!(refused["error"].to_string().contains("token"), "{refused}");

    let right = json!({"type": "token", "token": token});
    assert_eq!(say(&mut viewer, &right, "authorized")["ok"], true);
    // They are listed before the system runs, and can be set from then on.
    loop {
        let answer = say(&mut viewer, &set(json!(3.5)), "set");
        match answer["error"].as_str() {
            None => break,
            Some(error) => assert!(error.contains("does not run"), "{error}"),
        }
    }
    wait_for(&mut viewer, "pan/kp", |value| *value == json!(3.5));
    let refused = say(&mut viewer, &set(json!("much")), "set");
    assert!(
        refused["error"].to_string().contains("it must be a number"),
        "{refused}"
    );
    end(child);

    let (child, address) = served(&run);
    let mut viewer = view(&address);
    assert_eq!(hear(&mut viewer, "hello")["can_set"], false);
    wait_for(&mut viewer, "pan/kp", Value::is_f64);
    assert_eq!(say(&mut viewer, &right, "authorized")["ok"], false);
    let refused = say(&mut viewer, &set(json!(3.5)), "set");
    assert!(refused["error"].to_string().contains("token"), "{refused}");
    end(child);
}

fn recording(name: &str) -> PathBuf {
    use luna_logger::format::{Record, SignalInfo, Type, Values, Writer};
    let mut writer = Writer::new(Vec::new()).expect("memory");
    let signal = SignalInfo {
        number: 0,
        element_type: Type::F64,
        elements: 1,
        name: "arm/angle",
        unit: "rad",
        description: "",
    };
    let bytes = 0.5f64.to_le_bytes();
    let values = Values::from_bytes(Type::F64, &bytes);
    writer.put(&Record::Signal(signal)).expect("memory");
    for time in 0..10 {
        let signal = 0;
        let sample = Record::Sample {
            signal,
            time,
            values,
        };
        writer.put(&sample).expect("memory");
    }
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::write(&path, writer.finish().expect("memory")).expect("a file");
    path
}

#[test]
fn a_recording_is_shown_until_the_program_is_ended() {
    let path = recording("shown.luna");
    let path = path.to_str().expect("a path");
    let (child, address) = served(&["scope", path, "--listen", ANYWHERE, "--speed", "max"]);
    look_for(&address, b"arm/angle");
    end(child);
}

#[test]
fn once_ends_with_the_recording_and_says_whether_it_was_whole() {
    let path = recording("once.luna");
    let once = |path: &str| {
        let output = luna(&["scope", path, "--listen", ANYWHERE, "--once"]);
        let said = String::from_utf8(output.stderr).expect("text");
        (output.status.code(), said)
    };
    let (code, said) = once(path.to_str().expect("a path"));
    assert_eq!(code, Some(0), "{said}");

    let bytes = std::fs::read(&path).expect("a file");
    std::fs::write(&path, &bytes[..bytes.len() - 1]).expect("a file");
    let (code, said) = once(path.to_str().expect("a path"));
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("in the middle of a block"), "{said}");

    let (code, said) = once("/no/such/recording.luna");
    assert_eq!(code, Some(2), "{said}");
}

/// How a program ends by itself, and its last line of output. A program that does not end within a
/// minute is killed.
fn end_of(arguments: &[&str]) -> (Option<i32>, String) {
    let mut child = command(arguments)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let errors = BufReader::new(child.stderr.take().expect("a pipe"));
    let (notify, notified) = mpsc::channel();
    std::thread::spawn(move || {
        let lines: Vec<_> = errors.lines().map_while(Result::ok).collect();
        notify.send(lines)
    });
    let lines = notified.recv_timeout(Duration::from_secs(60));
    let Ok(lines) = lines else {
        end(child);
        panic!("{arguments:?} does not end");
    };
    let code = child.wait().expect("it ends").code();
    (code, lines.last().cloned().unwrap_or_default())
}

#[test]
fn a_file_that_is_no_recording_ends_the_scope_with_the_exit_code_of_convert() {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR"));
    let empty = folder.join("empty.luna");
    std::fs::write(&empty, "").expect("a file");
    let file = |path: &Path| path.to_str().expect("a path").to_owned();
    for path in [file(&empty), env!("CARGO_BIN_EXE_luna").to_owned()] {
        let output = file(&folder.join("no-recording.csv"));
        let scope = end_of(&["scope", &path, "--listen", ANYWHERE]);
        let convert = end_of(&["convert", &path, "--to", "csv", "--output", &output]);
        assert_eq!(scope, convert);
        assert_eq!(scope.0, Some(2));
        assert!(scope.1.contains("no recording of LUNA"), "{scope:?}");
    }
}
