//! What the demo says first, what `--strict` makes of it, and what it says of privileges.

use crate::run::{command, luna, programs, text};
use serde_json::Value;
use std::process::{Command, Stdio};

#[test]
fn the_verdict_comes_first_and_table_4_on_request() {
    let demo = [
        "demo",
        "--virtual",
        "--calibrated",
        "--seconds",
        "0.2",
        "--strict",
    ];
    let output = luna(&demo);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let out = text(&output.stdout);
    let lines: Vec<_> = out.lines().take(4).collect();
    assert_eq!(
        lines[..3],
        [
            "timer: 200 of 200 slots kept, none missed; wake-up latency p99 0.0 µs, worst 0.0 µs",
            "no cycle began more than 100.0 µs late",
            "",
        ]
    );
    assert!(
        lines[3].starts_with("Jiwy, pan and tilt at 1000 Hz"),
        "{out}"
    );
    assert!(!out.contains("table 4"), "{out}");
    let with_table = luna(&[&demo[..], &["--table-4"]].concat());
    assert!(text(&with_table.stdout).contains("\ntable 4  "));
}

/// A run whose program was stopped for 50 ms while its control loop ran: the exit code, and how
/// many slots the loop missed.
#[cfg(target_os = "linux")]
fn stopped_for_a_while() -> (Option<i32>, u64) {
    let demo = [
        "demo",
        "--seconds",
        "3",
        "--calibrated",
        "--strict",
        "--json",
    ];
    let child = command(&demo)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("the program starts");
    let tasks = format!("/proc/{}/task", child.id());
    // A thread that has gone to sleep a hundred times is within its loop.
    let is_looping = || {
        let tasks = std::fs::read_dir(&tasks).into_iter().flatten().flatten();
        let mut status = tasks
            .map(|task| std::fs::read_to_string(task.path().join("status")).unwrap_or_default());
        status.any(|status| {
            let sleeps = status
                .lines()
                .find_map(|line| line.strip_prefix("voluntary_ctxt_switches:"));
            let sleeps = sleeps.and_then(|number| number.trim().parse::<u64>().ok());
            status.starts_with("Name:\tcontrol\n") && sleeps > Some(100)
        })
    };
    let has_ended = || !std::fs::exists(&tasks).is_ok_and(|exists| exists);
    while !is_looping() && !has_ended() {
        std::thread::yield_now();
    }
    let signal = |name: &str| {
        let id = child.id().to_string();
        Command::new("kill")
            .args([name, &id])
            .status()
            .expect("kill runs");
    };
    signal("-STOP");
    // The time that it stands still is what is tested.
    std::thread::sleep(std::time::Duration::from_millis(50));
    signal("-CONT");
    let output = child.wait_with_output().expect("the program ends");
    let demo: Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    assert_eq!(demo["complete"], true);
    assert_eq!(demo["loops"][0]["name"], "timer");
    let missed = demo["loops"][0]["slots_missed"].as_u64();
    (output.status.code(), missed.expect("a number of slots"))
}

#[cfg(target_os = "linux")]
#[test]
fn strict_ends_with_5_if_slots_were_missed() {
    // On a busy machine the run may be over before it can be stopped: then none may be missed.
    for _ in 0..10 {
        let (code, missed) = stopped_for_a_while();
        assert_eq!(
            code,
            Some(if missed > 0 { 5 } else { 0 }),
            "{missed} missed"
        );
        if missed > 0 {
            return;
        }
    }
    panic!("ten runs missed no slot");
}

#[test]
fn the_exit_codes_are_in_the_help() {
    let output = luna(&["demo", "--help"]);
    let help = text(&output.stdout);
    let part = "5 complete, but the control loop missed slots";
    assert!(help.contains(part), "{help}");
    for command in [
        "demo", "jitter", "doctor", "convert", "record", "scope", "new", "list", "echo", "send",
    ] {
        let output = luna(&[command, "--help"]);
        let help = text(&output.stdout);
        assert!(help.contains("Exit codes: "), "{command}: {help}");
    }
}

#[test]
fn a_wrong_option_gets_the_name_of_a_similar_one() {
    for (wrong, similar) in [
        ("--secconds", "'--seconds'"),
        ("--calibratd", "'--calibrated'"),
    ] {
        let output = luna(&["demo", wrong]);
        assert_eq!(output.status.code(), Some(2));
        let error = text(&output.stderr);
        assert!(
            error.contains("a similar argument exists") && error.contains(similar),
            "{error}"
        );
    }
}

/// Whatever this user may not do is reported once, in a line that names the command and the page.
#[cfg(target_os = "linux")]
#[test]
fn missing_privileges_are_said_once() {
    use std::os::unix::fs::PermissionsExt;
    use std::os::unix::process::CommandExt;
    // Where a plain user can read it.
    let folder = std::env::temp_dir().join(format!("luna-verdict-{}", std::process::id()));
    let copy = folder.join("luna");
    std::fs::create_dir_all(&folder).expect("a folder");
    std::fs::copy(env!("CARGO_BIN_EXE_luna"), &copy).expect("a copy");
    let demo = folder.join("luna-demo");
    std::fs::copy(programs().join("luna-demo"), &demo).expect("a copy");
    for path in [&folder, &copy, &demo] {
        let mode = std::fs::Permissions::from_mode(0o755);
        std::fs::set_permissions(path, mode).expect("its own files");
    }
    let run = |as_nobody: bool| {
        let mut command = Command::new(&copy);
        if as_nobody {
            command.uid(65534).gid(65534);
        }
        command.args(["demo", "--calibrated", "--seconds", "0.05"]);
        command.current_dir(&folder).output()
    };
    // A user that is not root cannot become another one, and need not.
    let output = run(true)
        .or_else(|_| run(false))
        .expect("the program starts");
    std::fs::remove_dir_all(&folder).expect("its own folder");
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let (out, errors) = (text(&output.stdout), text(&output.stderr));
    assert!(
        !out.contains("best effort") && !out.contains("CAP_"),
        "{out}"
    );
    let lines: Vec<_> = errors
        .lines()
        .filter(|line| line.contains("setcap"))
        .collect();
    // A user may have been given all that is asked for.
    if out.contains("policy other") {
        let [line] = lines[..] else {
            panic!("one line, not {lines:?}")
        };
        assert!(line.chars().count() <= 200, "{line}");
        assert!(line.contains("docs/realtime.md#permissions"), "{line}");
    }
}
