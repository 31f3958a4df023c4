//! The Production Cell in its deployments, as users run it. The drills in virtual time are tests of
//! its crate.

use crate::run::{json, luna};
use serde_json::Value;
use std::process::Output;

fn production_cell(arguments: &str) -> Output {
    let words: Vec<&str> = arguments.split_whitespace().collect();
    luna(&[&["demo", "production-cell"], &words[..]].concat())
}

/// What a run prints that has lost no block.
fn good(arguments: &str) -> Value {
    let output = production_cell(&format!("{arguments} --json"));
    let said = String::from_utf8_lossy(&output.stderr);
    let run = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{arguments}: {run}\n{said}");
    let run = json(&output);
    for count in ["lost", "doubled", "collisions"] {
        assert_eq!(run[count], 0, "{run}");
    }
    run
}

fn stops(run: &Value) -> Vec<(&str, bool)> {
    let units = run["units"].as_array().expect("units");
    let stops = units.iter().map(|unit| {
        let name = unit["name"].as_str().expect("a name");
        (name, unit["stops"].as_u64().expect("a number") > 0)
    });
    stops.collect()
}

#[test]
fn it_prints_json_on_a_virtual_clock() {
    let run = good("--deploy executor --seconds 6 --virtual");
    assert_eq!(run["deployment"], "executor");
    assert!(run["blocks"].as_u64() >= Some(4), "{run}");
    assert_eq!(run["units"].as_array().map(Vec::len), Some(6));
}

#[test]
fn six_threads_carry_blocks_round() {
    assert_eq!(
        good("--deploy threads --seconds 4")["deployment"],
        "threads"
    );
}

#[test]
fn programs_that_are_killed_lose_no_block() {
    kill_each_unit("programs", 12);
}

#[cfg(feature = "hosts")]
#[test]
fn hosts_that_are_killed_lose_no_block() {
    use std::os::unix::fs::MetadataExt;
    if cfg!(debug_assertions) {
        println!(
            "skipped: six hosts of an unoptimized build hear each other too late: use --release"
        );
        return;
    }
    let is_root = std::fs::metadata("/proc/self").is_ok_and(|about| about.uid() == 0);
    let has_namespaces = is_root
        && std::process::Command::new("ip")
            .args(["netns", "list"])
            .output()
            .is_ok_and(|output| output.status.success());
    if !has_namespaces {
        println!("skipped: six hosts need root and `ip` (iproute2) with network namespaces");
        return;
    }
    kill_each_unit("hosts", 24);
}

/// Each unit's program is killed by SIGKILL and started again.
fn kill_each_unit(deployment: &str, seconds: u32) {
    let units = [
        "feeder",
        "robot",
        "extractor",
        "feeder-belt",
        "moulder-door",
        "extraction-belt",
    ];
    let kills = units.map(|unit| format!("--fault kill-{unit}")).join(" ");
    let run = good(&format!(
        "--deploy {deployment} --seconds {seconds} {kills}"
    ));
    let marks = run["marks"].as_array().expect("marks");
    let kills = marks.iter().filter(|mark| mark["what"] == "fault").count();
    assert_eq!(kills, 6, "{run}");
    // The unit behind each one halted: all of them did.
    assert!(stops(&run).iter().all(|(_, stops)| *stops), "{run}");
}

#[test]
fn a_fault_is_drawn_and_stops_those_that_depend_on_the_unit() {
    let path = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("cell.svg");
    let _ = std::fs::remove_file(&path); // of a run before
    let picture = path.display();
    let run = good(&format!(
        "--virtual --seconds 6 --fault stuck-feeder --picture {picture}"
    ));
    let stopped: Vec<_> = stops(&run)
        .into_iter()
        .filter(|(_, stops)| *stops)
        .collect();
    assert_eq!(stopped, [("feeder-belt", true), ("moulder-door", true)]);
    let svg = std::fs::read_to_string(&path).expect("a picture");
    assert!(
        svg.starts_with("<svg ") && svg.contains("the feeder is stuck"),
        "{svg}"
    );
}

#[test]
fn what_cannot_be_is_refused_with_a_remedy() {
    for (arguments, says) in [
        #[cfg(not(feature = "hosts"))]
        ("--deploy hosts", "--features hosts"),
        (
            "--deploy programs --virtual",
            "--deploy executor or threads",
        ),
        ("--fault stuck-toaster", "moulder-door"),
        ("--fault melted-feeder", "stuck-UNIT"),
    ] {
        let output = production_cell(arguments);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments}: {said}");
        assert!(said.contains(says), "{arguments}: {said}");
    }
}
