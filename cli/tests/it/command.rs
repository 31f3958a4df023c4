//! The command as its users meet it: what it prints, where, and its exit code.

use crate::is_long;
use crate::run::{command, file, luna, text};
use serde_json::Value;
use std::process::{Command, Stdio};

/// The one JSON object that a complete run prints.
fn json(arguments: &[&str]) -> Value {
    let output = luna(arguments);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("one JSON object and nothing else")
}

fn check_loop(report: &Value) {
    let slots = |key: &str| {
        report[key]
            .as_u64()
            .unwrap_or_else(|| panic!("{key} in {report}"))
    };
    assert_eq!(
        slots("slots_elapsed"),
        slots("slots_kept") + slots("slots_missed"),
        "{report}"
    );
    for histogram in ["wake_latency_ns", "cycle_time_ns", "run_time_ns"] {
        let quantiles =
            ["min", "p50", "p99", "p99_9", "max"].map(|key| report[histogram][key].as_u64());
        assert!(
            quantiles.iter().all(Option::is_some),
            "{histogram} in {report}"
        );
        assert!(quantiles.is_sorted(), "{histogram} in {report}");
    }
    assert!(
        report["cycle_time_ns"]["mean"].is_f64() && report["cycle_time_ns"]["stddev"].is_f64(),
        "{report}"
    );
}

#[test]
fn without_a_word_it_prints_its_help() {
    let output = luna(&[]);
    assert_eq!(output.status.code(), Some(2));
    let help = text(&output.stderr);
    assert!(help.contains("Usage: luna <COMMAND>"), "{help}");
    let asked = luna(&["help"]);
    assert_eq!(asked.status.code(), Some(0));
    let help = text(&asked.stdout);
    assert!(
        help.contains("demo: ") && help.contains("luna-demo"),
        "{help}"
    );
}

/// Another program of this name is on no path here.
#[test]
fn a_program_that_is_missing_is_named_with_how_to_get_it() {
    let nothing = tempfile::tempdir().expect("a folder of its own");
    let alone = nothing.path().join("luna");
    std::fs::copy(env!("CARGO_BIN_EXE_luna"), &alone).expect("a copy");
    let run = |words: &[&str]| {
        let mut luna = std::process::Command::new(&alone);
        let luna = luna.args(words).env_remove("LUNA_PROGRAMS");
        luna.env("PATH", nothing.path()).output().expect("it runs")
    };
    let output = run(&["demo", "--seconds", "1"]);
    assert_eq!(output.status.code(), Some(2));
    let errors = text(&output.stderr);
    for part in [
        "luna demo: ",
        "`luna-demo` is not there",
        "cargo install luna-demo",
    ] {
        assert!(errors.contains(part), "{errors}");
    }
    let help = run(&["--help"]);
    assert!(text(&help.stdout).contains("`luna-demo` is not there"));
}

#[test]
fn shells_complete_its_words() {
    let output = luna(&["completions", "bash"]);
    assert_eq!(output.status.code(), Some(0));
    let script = text(&output.stdout);
    assert!(script.contains("doctor") && script.contains("--per-cycle"));
}

#[test]
fn demo_prints_json() {
    let demo = json(&["demo", "--seconds", "0.5", "--calibrated", "--json"]);
    assert_eq!(demo["complete"], true);
    for count in ["allocations", "reallocations", "frees"] {
        assert_eq!(demo[count], 0, "{count} on the real-time path");
    }
    assert!(["fifo:80", "other"].contains(&demo["policy"].as_str().expect("a policy")));
    let loops = demo["loops"].as_array().expect("loops");
    let names: Vec<_> = loops
        .iter()
        .filter_map(|report| report["name"].as_str())
        .collect();
    assert_eq!(names, ["timer", "joystick", "pan bridge", "tilt bridge"]);
    loops.iter().for_each(check_loop);
    assert_eq!(loops[0]["period_ns"], 1_000_000);
    assert_eq!(loops[0]["slots_kept"], 500);
    let table = &demo["table_4"];
    assert_eq!(
        (table["rate_hz"].as_f64(), table["cycles"].as_u64()),
        (Some(1000.0), Some(500))
    );
    let mean = table["cycle_ms"]["mean"].as_f64().expect("a mean");
    // Milliseconds: no machine is later than this, but microseconds would be too strict.
    assert!((0.9..500.0).contains(&mean), "{table}");
    let switches = |of: &str| table["switches"][of].as_f64().expect("switches");
    // Each of the 44 that control has at least one turn a cycle.
    assert!(
        switches("control") >= 44.0 && switches("all") > switches("control"),
        "{table}"
    );
    let processing = &table["processing_us"];
    assert!(
        processing["mean"].as_f64() <= processing["max"].as_f64(),
        "{table}"
    );
    for (axis, name) in ["pan", "tilt"].iter().enumerate() {
        let axis = &demo["axes"][axis];
        assert_eq!(axis["name"], *name);
        assert!(
            axis["tracking_error_deg"]["rms"].is_f64() && axis["final_state"]["angle_deg"].is_f64(),
            "{axis}"
        );
        assert_eq!(axis["sanity"]["not_finite"], 0);
    }
}

/// What is not measured is not 0, and what was recorded and lost and the late cycles are in the
/// JSON.
#[test]
fn demo_that_ends_before_the_calibration_has_no_tracking_error() {
    let path = file("log");
    let demo = |more: &[&str]| {
        let mut command = command(&["demo", "--virtual", "--seconds", "0.5"]);
        let output = command.args(more).env("LUNA_LOG", &path).output();
        output.expect("the program starts").stdout
    };
    let table = demo(&[]);
    let table = text(&table);
    for axis in ["pan", "tilt"] {
        let line = format!("{axis:<14}    -    -");
        assert!(table.lines().any(|one| one == line), "{table}");
    }
    let demo: Value = serde_json::from_slice(&demo(&["--json"])).expect("one JSON object");
    for axis in [0, 1] {
        let error = &demo["axes"][axis]["tracking_error_deg"];
        assert!(error.is_null(), "{error}");
    }
    let logging = &demo["logging"];
    assert!(
        logging["samples"]["recorded"].as_u64() > Some(0),
        "{logging}"
    );
    for of in ["samples", "messages", "events"] {
        assert!(logging[of]["lost"].is_u64(), "{logging}");
    }
    for one in demo["loops"].as_array().expect("loops") {
        assert_eq!(one["late"], 0, "{one}");
        assert_eq!(one["late_cycles"], serde_json::json!([]));
        assert!(one["late_after_ns"].as_u64() > Some(0), "{one}");
    }
}

#[test]
fn demo_prints_text() {
    let output = luna(&[
        "demo",
        "--seconds",
        "0.2",
        "--rate",
        "500",
        "--policy",
        "other",
    ]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let out = text(&output.stdout);
    for part in [
        "500 Hz",
        "policy other",
        "pan bridge",
        "tracking error",
        "wake-up latency of timer",
        "#",
        "allocations",
    ] {
        assert!(out.contains(part), "{part} in:\n{out}");
    }
}

#[test]
fn two_runs_on_a_virtual_clock_print_the_same_bytes() {
    let seconds = if is_long() { "12" } else { "4" };
    let run = || luna(&["demo", "--virtual", "--seconds", seconds, "--json"]).stdout;
    let first = run();
    let demo: Value = serde_json::from_slice(&first).expect("one JSON object and nothing else");
    assert_eq!(demo["complete"], true);
    assert_eq!(demo["table_4"]["cycle_ms"]["max"], 1.0);
    assert_eq!(demo["table_4"]["processor_us"], Value::Null);
    assert!(first == run(), "two runs differ");
}

#[test]
fn demo_takes_a_recording() {
    let path = file("recording.csv");
    std::fs::write(&path, "time,pan,tilt\n0,0.5,-0.5\n1,0.5,-0.5\n").expect("a file is written");
    let demo = json(&[
        "demo",
        "--seconds",
        "1.5",
        "--calibrated",
        "--json",
        "--joystick",
        path.to_str().expect("a path"),
    ]);
    // Half of the ranges, 1.2 and 0.5 rad; whatever the machine's jitter, they are about there by
    // then.
    for (axis, expected) in [(0, 34.4), (1, -14.3)] {
        let angle = demo["axes"][axis]["final_state"]["angle_deg"]
            .as_f64()
            .expect("an angle");
        assert!((angle - expected).abs() < 5.0, "{angle}");
    }
}

/// Ctrl-C ends the demo in order: its report has that the run was cut short.
#[cfg(target_os = "linux")]
#[test]
fn interrupted_demo_still_reports() {
    let child = command(&["demo", "--seconds", "600", "--json"])
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("the program starts");
    // Its handler is there before its executors are.
    let tasks = format!("/proc/{}/task", child.id());
    let has_executor = || {
        let tasks = std::fs::read_dir(&tasks)
            .expect("the program runs")
            .flatten();
        tasks
            .map(|task| std::fs::read_to_string(task.path().join("comm")).unwrap_or_default())
            .any(|name| name == "mechanism\n")
    };
    while !has_executor() {
        std::thread::yield_now();
    }
    let killed = Command::new("kill")
        .args(["-INT", &child.id().to_string()])
        .status()
        .expect("kill runs");
    assert!(killed.success());
    let output = child.wait_with_output().expect("the program ends");
    assert_eq!(output.status.code(), Some(1));
    let demo: Value =
        serde_json::from_slice(&output.stdout).expect("one JSON object and nothing else");
    assert_eq!(demo["complete"], false);
}

#[test]
fn jitter_prints_json_and_writes_its_histogram() {
    let path = file("histogram.csv");
    let name = path.to_str().expect("a path");
    let jitter = json(&[
        "jitter",
        "--loops",
        "200",
        "--interval",
        "500",
        "--json",
        "--histogram",
        name,
    ]);
    assert_eq!(
        (&jitter["allocations"], &jitter["frees"]),
        (&0.into(), &0.into())
    );
    let report = &jitter["loops"][0];
    check_loop(report);
    assert_eq!(
        (report["name"].as_str(), report["slots_kept"].as_u64()),
        (Some("jitter"), Some(200))
    );
    assert_eq!(report["period_ns"], 500_000);

    let histogram = std::fs::read_to_string(&path).expect("the histogram");
    let mut lines = histogram.lines();
    assert_eq!(lines.next(), Some("latency_ns,count"));
    let counts = lines.map(|line| {
        line.split_once(',')
            .and_then(|(_, count)| count.parse::<u64>().ok())
            .expect("a count")
    });
    assert_eq!(counts.sum::<u64>(), 200);
}

#[test]
fn jitter_prints_text() {
    // More loops than a system has room for by default.
    let output = luna(&[
        "jitter", "--loops", "50", "--policy", "other", "--others", "20",
    ]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let out = text(&output.stdout);
    for part in [
        "50 wake-ups",
        "policy other",
        "wake-up latency of jitter",
        "other 19",
        "#",
    ] {
        assert!(out.contains(part), "{part} in:\n{out}");
    }
}

#[test]
fn bad_values_end_with_2_and_say_why() {
    let bad = file("bad.csv");
    std::fs::write(&bad, "time,pan,tilt\n0,0,0\n1,left,0\n").expect("a file is written");
    let bad = bad.to_str().expect("a path");
    let gains = file("gains.toml");
    std::fs::write(&gains, "pan.kp = 1\n[tilt]\nkp = \"many\"\n").expect("a file is written");
    let gains = gains.to_str().expect("a path");
    for (arguments, part) in [
        (&["demo", "--rate", "0"][..], "--rate"),
        (&["demo", "--seconds", "-1"], "--seconds"),
        (&["demo", "--policy", "fifo:98"], "--policy"),
        (&["demo", "--core", "70000"], "70000"),
        (
            &["demo", "--joystick", bad],
            "line 3: \"left\" in column `pan` is not a number",
        ),
        (
            &["demo", "--joystick", "/no/such/file.csv"],
            "/no/such/file.csv",
        ),
        (
            &["demo", "--joystick", "/dev/null"],
            "`/dev/null` is no input device",
        ),
        (
            &["demo", "--set", "pan/kq=1"],
            "--set: `pan/kq` = 1: there is no such parameter; did you mean `pan/kp`?",
        ),
        (
            &["demo", "--set", "tilt/kd=-1"],
            "--set: `tilt/kd` = -1: it must be 0.0 to 100.0 s/rad",
        ),
        (&["demo", "--set", "pan/kp"], "is not NAME=VALUE"),
        (
            &["demo", "--parameters", gains],
            "gains.toml:3: `tilt/kp` = many: it must be a number",
        ),
        (
            &["demo", "--parameters", "/no/such/gains.toml"],
            "/no/such/gains.toml: ",
        ),
        (&["jitter", "--interval", "0"], "--interval"),
        (
            &[
                "jitter",
                "--loops",
                "1",
                "--histogram",
                "/no/such/folder/h.csv",
            ],
            "/no/such/folder/h.csv",
        ),
        (&["jitter", "--core", "70000"], "70000"),
        (&["dance"], "dance"),
    ] {
        let output = luna(arguments);
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {error}");
        assert!(error.contains(part), "{arguments:?}: {error}");
        assert!(
            output.stdout.is_empty(),
            "{arguments:?}: {}",
            text(&output.stdout)
        );
    }
}

#[test]
fn demo_records_a_run_in_real_time_and_replays_it() {
    let path = file("demo.replay");
    let path = path.to_str().expect("a path of this test");
    let demo = json(&[
        "demo",
        "--seconds",
        "0.4",
        "--calibrated",
        "--policy",
        "other",
        "--set",
        "pan/kp=0.5",
        "--record",
        path,
        "--json",
    ]);
    let record = &demo["record"];
    assert_eq!(record["lost"], 0, "{record}");
    let events = record["events"].as_u64().expect("events");
    assert!(events > 400, "{record}");
    for _ in 0..if is_long() { 3 } else { 1 } {
        let replayed = json(&["demo", "--replay", path, "--json"]);
        assert_eq!(replayed["same"], true, "{replayed}");
        assert_eq!(replayed["whole"], true, "{replayed}");
        assert_eq!(replayed["processes"], 51, "{replayed}");
        assert_eq!(replayed["events"], events, "{replayed}");
        // What is written to each motor, and where each joint is, in each cycle.
        assert!(
            replayed["outputs"]
                .as_u64()
                .is_some_and(|count| count > 800),
            "{replayed}"
        );
    }
    let words = luna(&["demo", "--replay", path]);
    assert_eq!(words.status.code(), Some(0));
    assert!(text(&words.stdout).starts_with("the outputs are the same: 51 processes"));
}

#[test]
fn demo_replays_nothing_that_is_not_what_was_recorded() {
    let path = file("changed.replay");
    let name = path.to_str().expect("a path of this test");
    json(&[
        "demo",
        "--seconds",
        "0.05",
        "--calibrated",
        "--virtual",
        "--record",
        name,
        "--json",
    ]);
    let whole = std::fs::read(&path).expect("it was recorded");
    for at in [0, 9, whole.len() / 2, whole.len() - 1] {
        let mut changed = whole.clone();
        changed[at] ^= 1;
        std::fs::write(&path, &changed).expect("a file of this test");
        let refused = luna(&["demo", "--replay", name]);
        assert_eq!(refused.status.code(), Some(2), "byte {at}");
        assert!(text(&refused.stderr).contains("--replay"), "byte {at}");
    }
    std::fs::remove_file(&path).expect("a file of this test");
    assert_eq!(luna(&["demo", "--replay", name]).status.code(), Some(2));
}
