//! The humanoid head and TUlip as users run them. Their faults in virtual time are tests of their
//! crates.

use crate::run::luna;
use serde_json::Value;

/// What a run on a virtual clock prints, and its exit code.
fn run(arguments: &str) -> (Value, Option<i32>) {
    run_really(&format!("{arguments} --virtual"))
}

/// What a run prints, and its exit code.
fn run_really(arguments: &str) -> (Value, Option<i32>) {
    let words: Vec<&str> = arguments.split_whitespace().collect();
    let output = luna(&[&["demo"], &words[..], &["--json"]].concat());
    let said = String::from_utf8_lossy(&output.stderr);
    let run = serde_json::from_slice(&output.stdout);
    let run = run.unwrap_or_else(|error| panic!("{arguments}: {error}: {said}"));
    (run, output.status.code())
}

#[test]
fn the_head_follows_and_allocates_nothing() {
    for deployment in ["executor", "threads"] {
        let (run, code) = run(&format!("head --seconds 3 --deploy {deployment}"));
        assert_eq!(code, Some(0), "{run}");
        assert_eq!(
            (&run["deployment"], &run["allocations"]),
            (&deployment.into(), &0.into())
        );
        let worst = run["gaze_worst"].as_f64();
        assert!(worst.is_some_and(|worst| worst < 2.0), "{run}");
        assert_eq!(run["loops"][0]["name"], "joints");
        assert_eq!(run["loops"][0]["slots_missed"], 0);
    }
}

#[test]
fn tulip_walks_exchanges_its_controllers_and_allocates_nothing() {
    for deployment in ["executor", "threads"] {
        let arguments = format!("tulip --seconds 5 --exchange 0.5 --deploy {deployment}");
        let (run, code) = run(&arguments);
        assert_eq!(code, Some(0), "{run}");
        assert_eq!(
            (&run["deployment"], &run["allocations"]),
            (&deployment.into(), &0.into())
        );
        assert!(run["exchanges"].as_u64() >= Some(3), "{run}");
        // Only a run on the real clock can lose a slot: here the field is there, and 0.
        assert_eq!((&run["lost"], &run["fallen_at"]), (&0.into(), &Value::Null));
    }
}

/// On the real clock of a busy machine there is no verdict to rely on. But what comes from the other
/// program is there: the gaze is nowhere near that of a head that sees nothing, and the robot walks.
#[test]
fn vision_and_the_operator_may_be_programs_of_their_own() {
    let run = |arguments: &str| run_really(&format!("{arguments} --policy other")).0;
    std::thread::scope(|scope| {
        let tulip = scope.spawn(|| run("tulip --seconds 8 --deploy programs"));
        let blind = run("head --seconds 2 --vision 127.0.0.1:9");
        let head = run("head --seconds 2 --deploy programs");
        let [blind, sees] = [&blind, &head].map(|run| run["gaze_rms"].as_f64());
        let [blind, sees] = [blind, sees].map(|rms| rms.expect("long enough"));
        assert!(sees < blind / 2.0, "{sees}, blind {blind}");
        assert_eq!(head["deployment"], "programs");
        let alone = run("tulip --seconds 4 --operator 127.0.0.1:9");
        assert_eq!(alone["steps"], 0, "{alone}");
        let tulip = tulip.join().expect("an assertion of the thread, above");
        assert!(tulip["steps"].as_u64() >= Some(1), "{tulip}");
        assert!(tulip["exchanges_asked"].as_u64() >= Some(1), "{tulip}");
    });
}

#[test]
fn another_program_has_no_virtual_clock() {
    for machine in ["head", "tulip"] {
        let output = luna(&["demo", machine, "--deploy", "programs", "--virtual"]);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains("--deploy executor"), "{said}");
    }
}

/// A run that is too short shows nothing, and says so by its exit code.
#[test]
fn a_run_that_shows_nothing_is_no_success() {
    let (head, code) = run("head --seconds 1");
    assert_eq!((&head["gaze_rms"], code), (&Value::Null, Some(1)), "{head}");
    let (tulip, code) = run("tulip --seconds 1");
    assert_eq!((&tulip["steps"], code), (&0.into(), Some(1)), "{tulip}");
}
