//! `luna list`, and recordings of what it lists.

use crate::programs::{Killed, LIMIT, good, list, name, run};
use crate::run::command;
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::Stdio;
use std::time::{Duration, Instant};

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
    assert_eq!(program["program"], "luna-demo");
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
