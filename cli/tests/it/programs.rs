//! `luna list`, `luna echo` and `luna send`. The test is the other program, or starts others.

use luna::prelude::*;
use luna::{Policy, Process};
use luna_ipc::{Blackboard, ZeroCopySend};
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, Output, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// What is not so after this time never will be.
const LIMIT: Duration = Duration::from_secs(60);

#[repr(C)]
#[derive(Debug, Clone, Copy, ZeroCopySend)]
#[type_name("cell::Block")]
struct Block {
    number: u64,
    height: f64,
}

fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_luna"));
    command.args(arguments);
    command
}

fn luna(arguments: &[&str]) -> Output {
    command(arguments).output().expect("the program starts")
}

fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).expect("output is text")
}

/// What it has printed, if it was content.
fn good(arguments: &[&str]) -> String {
    let output = luna(arguments);
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {error}");
    text(&output.stdout).to_owned()
}

/// Its exit code and what it says.
fn bad(arguments: &[&str]) -> (i32, String) {
    let output = luna(arguments);
    let code = output.status.code().expect("a code");
    (code, text(&output.stderr).to_owned())
}

fn list(arguments: &[&str]) -> Value {
    let printed = good(&[&["list", "--json"], arguments].concat());
    serde_json::from_str(&printed).expect("one JSON object")
}

/// A name that no other test has.
fn name(test: &str) -> String {
    format!("test/{}/{test}", std::process::id())
}

/// A link and a process that uses its channel, on a thread of this program.
fn run(
    link: impl Process + Send + 'static,
    body: impl Future<Output = luna::Result<()>> + Send + 'static,
) -> JoinHandle<luna::Result<()>> {
    std::thread::spawn(move || {
        let mut system = System::new("test");
        let main = system.executor("main").policy(Policy::Other).build()?;
        main.process("link").priority(2).spawn(link)?;
        main.process("body").priority(1).spawn(body)?;
        drop(main);
        system.run().map(drop)
    })
}

/// A child that is killed when it is dropped.
struct Killed(Child);

impl Drop for Killed {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn a_channel_is_listed_with_both_programs_and_its_rate() {
    let name = name("listed");
    let (sender, link) = luna_ipc::sender::<f64>(&name).unwrap();
    let alone = list(&[&name, "--interval", "0"]);
    let channel = &alone["channels"][0];
    assert_eq!(channel["name"], *name);
    assert_eq!(channel["type"]["name"], "f64");
    assert_eq!(channel["state"], "no_receiver");
    assert_eq!(channel["sender"]["pid"], std::process::id());
    assert_eq!(
        (&channel["receiver"], &channel["per_second"]),
        (&Value::Null, &Value::Null)
    );
    let table = good(&["list", &name]);
    assert!(table.contains("waits for a receiver"), "{table}");

    let sending = run(link, async move {
        let mut number = 0.0;
        while sender.send(number).await.is_ok() {
            number += 1.0;
            luna::after(Duration::from_millis(1)).await;
        }
        Ok(())
    });
    let mut echo = Killed(
        command(&["echo", &name])
            .stdout(Stdio::piped())
            .spawn()
            .expect("it starts"),
    );
    let mut lines = BufReader::new(echo.0.stdout.take().unwrap()).lines();
    assert_eq!(lines.next().unwrap().unwrap(), "0.0");
    assert_eq!(lines.next().unwrap().unwrap(), "1.0");
    // It reads on, so that the other goes on printing.
    let reading = std::thread::spawn(move || lines.map_while(Result::ok).count());
    let joined = list(&[&name, "--interval", "0.3"]);
    let channel = &joined["channels"][0];
    assert_eq!(channel["receiver"]["pid"], echo.0.id());
    assert_eq!(channel["receiver"]["program"], "luna");
    let per_second = channel["per_second"].as_f64().expect("a rate");
    assert!(per_second > 0.0 && per_second <= 1100.0, "{joined}");
    let sent = channel["sent"].as_u64().expect("a number");
    assert!(sent >= channel["taken"].as_u64().expect("a number") && sent >= 2);
    let pids: Vec<_> = joined["programs"]
        .as_array()
        .unwrap()
        .iter()
        .map(|one| &one["pid"])
        .collect();
    assert!(pids.contains(&&echo.0.id().into()), "{joined}");

    // Ctrl-C closes the channel in order.
    let id = nix::unistd::Pid::from_raw(echo.0.id() as i32);
    nix::sys::signal::kill(id, nix::sys::signal::Signal::SIGINT).unwrap();
    assert_eq!(echo.0.wait().unwrap().code(), Some(0));
    assert!(reading.join().unwrap() > 0);
    sending.join().unwrap().unwrap();
    assert_eq!(list(&[&name])["channels"], serde_json::json!([]));
}

#[test]
fn echo_ends_after_so_many_values_and_prints_json() {
    let name = name("echoed");
    let (sender, link) = luna_ipc::sender::<[i16; 2]>(&name).unwrap();
    let sending = run(link, async move {
        let mut number = 0;
        while sender.send([number, -number]).await.is_ok() {
            number += 1;
        }
        Ok(())
    });
    let printed = good(&["echo", &name, "--count", "2", "--json"]);
    let values: Vec<Value> = printed
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    assert_eq!(values[0], serde_json::json!({"number": 1, "value": [0, 0]}));
    assert_eq!(
        values[1],
        serde_json::json!({"number": 2, "value": [1, -1]})
    );
    assert_eq!(values.len(), 2);
    sending.join().unwrap().unwrap();
}

#[test]
fn values_that_cannot_be_printed_are_refused_or_bytes() {
    let name = name("struct");
    let opened = luna_ipc::sender::<Block>(&name).unwrap();
    let (code, error) = bad(&["echo", &name]);
    assert_eq!(code, 2, "{error}");
    assert!(
        error.contains("cell::Block") && error.contains("--raw"),
        "{error}"
    );
    let (code, error) = bad(&["send", &name, "1"]);
    assert_eq!(code, 2, "{error}");
    let (sender, link) = opened;
    let sending = run(link, async move {
        let height = 0.5;
        sender.send(Block { number: 3, height }).await?;
        Ok(())
    });
    let printed = good(&["echo", &name, "--raw"]);
    let bytes = [3_u64.to_ne_bytes(), 0.5_f64.to_ne_bytes()].concat();
    let digits: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(printed, digits + "\n");
    sending.join().unwrap().unwrap();

    let call = luna_ipc::client::<u8, u8>(&name).unwrap();
    let (code, error) = bad(&["echo", &name, "--raw"]);
    assert_eq!(code, 2, "{error}");
    assert!(error.contains("call"), "{error}");
    drop(call);
    for command in [&["echo", &name][..], &["send", &name, "1"]] {
        let (code, error) = bad(command);
        assert_eq!(code, 2, "{error}");
        assert!(error.contains("no program has it open"), "{error}");
    }
    let (code, error) = bad(&["echo", "two words"]);
    assert_eq!(code, 2, "{error}");
}

#[test]
fn send_is_the_sending_program() {
    let name = name("sent");
    let (receiver, link) = luna_ipc::receiver::<f32>(&name).unwrap();
    let receiving = run(link, async move {
        for value in [1.5, -2.0, f32::INFINITY] {
            assert_eq!(receiver.recv().await?, value);
        }
        assert!(receiver.recv().await.is_err_and(|error| error.is_closed()));
        Ok(())
    });
    let (code, error) = bad(&["send", &name, "1.5", "two"]);
    assert_eq!(code, 2, "{error}");
    assert!(error.contains("`two`"), "{error}");
    good(&["send", &name, "1.5", "-2", "inf"]);
    receiving.join().unwrap().unwrap();
}

#[test]
fn send_waits_for_a_program_that_opens_the_channel() {
    let name = name("awaited");
    let mut send = Killed(
        command(&["send", &name, "two words", "--wait", "60"])
            .spawn()
            .expect("it starts"),
    );
    let endpoint = luna_ipc::Endpoint::new(&name);
    let (receiver, link) = endpoint.serde_receiver::<String>(40).unwrap();
    let receiving = run(link, async move {
        assert_eq!(receiver.recv().await?, "two words");
        assert!(receiver.recv().await.is_err());
        Ok(())
    });
    assert_eq!(send.0.wait().unwrap().code(), Some(0));
    receiving.join().unwrap().unwrap();
}

#[test]
fn a_value_that_nobody_takes_in_time_is_withdrawn() {
    let name = name("withdrawn");
    let (receiver, link) = luna_ipc::receiver::<u8>(&name).unwrap();
    let (end, ends) = luna::channel::<()>();
    let end = end.external();
    let receiving = run(link, async move {
        // It is busy elsewhere, until the sender has given up.
        ends.recv().await?;
        assert!(receiver.recv().await.is_err_and(|error| error.is_closed()));
        Ok(())
    });
    let (code, error) = bad(&["send", &name, "7", "--timeout", "0.2"]);
    assert_eq!(code, 1, "{error}");
    assert!(
        error.contains("value 1 of 1 was not taken in 0.2 s"),
        "{error}"
    );
    end.blocking_send(()).unwrap();
    receiving.join().unwrap().unwrap();
}

#[test]
fn a_side_that_is_taken_is_refused_with_what_to_do() {
    let name = name("busy");
    let _receiving = luna_ipc::receiver::<u8>(&name).unwrap();
    let (code, error) = bad(&["echo", &name]);
    assert_eq!(code, 2, "{error}");
    let own = std::process::id().to_string();
    for part in [&*own, "receiver", "luna list"] {
        assert!(error.contains(part), "{part}: {error}");
    }
    let _sending = luna_ipc::sender::<u8>(&name).unwrap();
    let (code, error) = bad(&["send", &name, "1"]);
    assert_eq!(code, 2, "{error}");
    assert!(error.contains("sender"), "{error}");
}

#[test]
fn a_blackboard_is_echoed_and_set() {
    let name = name("board");
    let board = Blackboard::new(&name)
        .entry("speed", 0.5_f64)
        .entry("blocks", 3_u32);
    let mut writer = board.write().unwrap();
    let speed = writer.take::<f64>("speed").unwrap();
    assert_eq!(
        good(&["echo", &name, "--count", "2"]),
        "speed   0.5\nblocks  3\n"
    );
    let printed = good(&["echo", &name, "bl*", "--count", "1", "--json"]);
    let value: Value = serde_json::from_str(&printed).unwrap();
    assert_eq!(
        (&value["key"], &value["value"]),
        (&"blocks".into(), &3.into())
    );
    assert!(value["age_s"].as_f64().is_some_and(|age| age >= 0.0));
    let (code, error) = bad(&["echo", &name, "color"]);
    assert_eq!(code, 2, "{error}");
    assert!(error.contains("speed, blocks"), "{error}");

    let mut echo = Killed(
        command(&["echo", &name, "speed"])
            .stdout(Stdio::piped())
            .spawn()
            .expect("it starts"),
    );
    let mut lines = BufReader::new(echo.0.stdout.take().unwrap()).lines();
    assert_eq!(lines.next().unwrap().unwrap(), "speed  0.5");
    let mut speed = speed;
    speed.set(0.75);
    assert_eq!(lines.next().unwrap().unwrap(), "speed  0.75");

    let reader = Blackboard::new(&name).read().unwrap();
    let listed = list(&[&name]);
    let found = &listed["blackboards"][0];
    assert_eq!(found["writer"]["pid"], std::process::id());
    assert_eq!(found["readers"][0]["pid"], std::process::id());
    assert_eq!(found["keys"][0]["value"], 0.75);
    assert!(good(&["list", &name]).contains("0.75"));
    let (code, error) = bad(&["send", &name, "speed=1"]);
    assert_eq!(code, 2, "{error}");
    drop((writer, speed));
    good(&["send", &name, "speed=-1", "blocks=4"]);
    assert_eq!(lines.next().unwrap().unwrap(), "speed  -1.0");
    let blocks = reader.entry::<u32>("blocks").unwrap().get().unwrap();
    assert_eq!(blocks.value, 4);
    let (code, error) = bad(&["send", &name, "speed=1", "blocks=-1"]);
    assert_eq!(code, 2, "{error}");
    assert_eq!(
        reader.entry::<f64>("speed").unwrap().get().unwrap().value,
        -1.0
    );
    // All programs have closed it.
    drop(reader);
    assert_eq!(echo.0.wait().unwrap().code(), Some(0));
}

/// A folder that this test alone has.
fn folder(test: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("programs-{test}"));
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

const UNITS: [&str; 6] = [
    "feeder-belt",
    "feeder",
    "moulder-door",
    "extractor",
    "extraction-belt",
    "robot",
];

/// Six programs and their operator, which find each other by luna-ipc, are listed by their names
/// with their channels; recorded, they become one trace with flows between them.
#[test]
fn the_production_cell_is_listed_and_recorded_into_one_trace() {
    let folder = folder("cell");
    let mut record = Killed(
        command(&[
            "record",
            "--listen",
            "127.0.0.1:0",
            "--messages",
            "none",
            "-o",
        ])
        .arg(&folder)
        .stdout(Stdio::piped())
        .spawn()
        .expect("it starts"),
    );
    let mut said = BufReader::new(record.0.stdout.take().unwrap()).lines();
    let first = said.next().unwrap().unwrap();
    let address = first
        .split(['/', ';'])
        .nth(2)
        .expect("an address")
        .to_owned();
    let cell = command(&[
        "demo",
        "production-cell",
        "--deploy",
        "programs",
        "--seconds",
        "5",
    ])
    .args(["--policy", "other", "--json"])
    .env("LUNA_LOG", format!("tcp://{address}"))
    .env("LUNA_LOG_EVENTS", "65536")
    .stdout(Stdio::piped())
    .spawn();
    let mut cell = Killed(cell.expect("it starts"));
    let since = Instant::now();
    loop {
        let listed = list(&["--interval", "0.2"]);
        let is_own = |channel: &&Value| {
            let name = channel["name"].as_str().expect("a name");
            name.starts_with(&format!("cell/{}/", cell.0.id()))
        };
        let channels = listed["channels"].as_array().expect("channels");
        let own: Vec<&Value> = channels.iter().filter(is_own).collect();
        let mut systems: Vec<&str> = own
            .iter()
            .flat_map(|one| [&one["sender"], &one["receiver"]])
            .filter_map(|side| side["systems"][0].as_str())
            .collect();
        systems.sort_unstable();
        systems.dedup();
        let is_whole =
            UNITS.iter().all(|unit| systems.contains(unit)) && systems.contains(&"production cell");
        let flow = own
            .iter()
            .filter(|one| one["per_second"].as_f64() > Some(0.0))
            .count();
        if is_whole && flow >= 6 {
            break;
        }
        let left = cell.0.try_wait().unwrap();
        assert!(
            left.is_none() && since.elapsed() < LIMIT,
            "{left:?}: {listed:#}"
        );
    }
    let ended = cell.0.wait().unwrap();
    assert_eq!(ended.code(), Some(0));
    // The recorder has all of it.
    let gone = said
        .map_while(Result::ok)
        .filter(|line| line.contains("has ended"));
    assert_eq!(gone.take(7).count(), 7);

    let files: Vec<String> = std::fs::read_dir(&folder)
        .unwrap()
        .map(|entry| entry.unwrap().path().display().to_string())
        .collect();
    assert_eq!(files.len(), 7, "{files:?}");
    let trace = folder.join("cell.perfetto-trace");
    let files: Vec<&str> = files.iter().map(|file| &**file).collect();
    let to = ["--to", "perfetto", "-o", trace.to_str().unwrap()];
    // Of some 700 000 events, those between the programs.
    let chosen = ["--events", "link", "--signals", "none"];
    good(&[&["convert"], &files[..], &to, &chosen].concat());
    let trace = crate::trace::read(&trace);
    let mut systems: Vec<&str> = trace.processes.values().map(|name| &**name).collect();
    systems.sort_unstable();
    let mut all = UNITS.to_vec();
    all.push("production cell");
    all.sort_unstable();
    assert_eq!(systems, all);
    let between = trace.flows_between_processes();
    assert!(
        between.iter().all(|[from, to]| from.1 <= to.1),
        "taken before it was given"
    );
    // Each unit has neighbours on both sides, and the operator.
    for unit in UNITS {
        assert!(between.iter().any(|[from, _]| from.0 == unit), "{unit}");
        assert!(between.iter().any(|[_, to]| to.0 == unit), "{unit}");
    }
}

/// The last program to close a channel removes its files. One that is stopped and then killed does
/// not get to do so.
#[test]
fn what_killed_programs_have_left_is_counted_and_removed_on_request() {
    let name = name("left");
    let (receiver, link) = luna_ipc::receiver::<u64>(&name).unwrap();
    let send = ["send", &name, "1", "--timeout", "600"];
    let mut send = Killed(command(&send).spawn().expect("it starts"));
    let since = Instant::now();
    // Then its link runs, and it is not in the middle of opening the channel.
    while list(&[&name, "--interval", "0"])["channels"][0]["state"] != "under_way" {
        assert!(since.elapsed() < LIMIT);
    }
    let pid = nix::unistd::Pid::from_raw(send.0.id() as i32);
    nix::sys::signal::kill(pid, nix::sys::signal::Signal::SIGSTOP).unwrap();
    let is_stopped = || {
        let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
        status.contains("State:\tT")
    };
    while !is_stopped() {
        assert!(since.elapsed() < LIMIT);
    }
    drop((receiver, link));
    send.0.kill().unwrap();
    send.0.wait().unwrap();
    let counted = list(&[&name, "--interval", "0"]);
    assert_eq!(counted["left_behind"], 1);
    assert_eq!(counted["channels"], serde_json::json!([]));
    let cleaned = list(&[&name, "--interval", "0", "--clean-up"]);
    assert_eq!(cleaned["left_behind"], 0);
}

/// A program that is killed leaves its announcement, which the next look removes.
#[test]
fn a_system_is_listed_while_its_program_lives() {
    let demo = [
        "demo",
        "--seconds",
        "600",
        "--policy",
        "other",
        "--calibrated",
    ];
    let demo = command(&demo)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn();
    let mut demo = Killed(demo.expect("it starts"));
    let pid = demo.0.id();
    let is_listed = || {
        let listed = list(&["--interval", "0"]);
        let programs = listed["programs"].as_array().expect("programs");
        programs.iter().find(|one| one["pid"] == pid).cloned()
    };
    let since = Instant::now();
    let program = loop {
        if let Some(program) = is_listed() {
            break program;
        }
        assert!(since.elapsed() < LIMIT);
    };
    assert_eq!(program["program"], "luna");
    assert_eq!(program["systems"][0]["name"], "jiwy");
    let threads = program["systems"][0]["threads"]
        .as_array()
        .expect("threads");
    assert!(
        threads.iter().any(|one| one["policy"] == "other"),
        "{program}"
    );
    demo.0.kill().unwrap();
    demo.0.wait().unwrap();
    assert_eq!(is_listed(), None);
    let left = std::fs::read_dir("/dev/shm").unwrap().filter(|entry| {
        let name = entry.as_ref().unwrap().file_name();
        name.to_string_lossy()
            .starts_with(&format!("luna-system.{pid}."))
    });
    assert_eq!(left.count(), 0);
}
