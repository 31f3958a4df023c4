//! What the command line takes and refuses.

use super::*;
use luna::Policy;

fn parse(line: &str) -> Result<Demos, clap::Error> {
    Demos::try_parse_from(line.split_whitespace())
}

fn demo(line: &str) -> Demo {
    parse(line).expect(line).jiwy
}

#[test]
fn clap_is_content() {
    <Demos as clap::CommandFactory>::command().debug_assert();
}

#[test]
fn no_machine_is_the_camera() {
    let demo_alone = demo("luna-demo");
    assert_eq!(
        (demo_alone.seconds, demo_alone.rate, demo_alone.cycles()),
        (10.0, 1000, 10_000)
    );
    let place = &demo_alone.place;
    assert_eq!(
        (place.core, place.policy, place.json),
        (None, Policy::fifo(80), false)
    );
    assert_eq!(
        (demo_alone.joystick.clone(), demo_alone.period()),
        (None, Duration::from_millis(1))
    );
    assert_eq!(demo("luna-demo --seconds 2").cycles(), 2000);
}

#[test]
fn demo_takes_its_options() {
    let demo =
        demo("luna-demo --seconds 0.5 --rate 250 --core 1 --policy rr:7 --joystick a.csv --json");
    assert_eq!(
        (demo.cycles(), demo.period()),
        (125, Duration::from_millis(4))
    );
    assert_eq!(
        (demo.place.core, demo.place.policy, demo.place.json),
        (Some(1), Policy::round_robin(7), true)
    );
    assert_eq!(demo.joystick, Some(PathBuf::from("a.csv")));
    assert!(demo.parameters.is_none() && demo.set.is_empty());
}

#[test]
fn demo_takes_parameters() {
    let demo = demo("luna-demo --parameters jiwy.toml --set pan/kp=2 --set tilt/kd=0.1");
    assert_eq!(demo.parameters, Some(PathBuf::from("jiwy.toml")));
    assert_eq!(demo.set, ["pan/kp=2", "tilt/kd=0.1"]);
}

#[test]
fn a_replay_says_all_that_the_recorded_run_was_told() {
    let recorded = demo("luna-demo --seconds 1 --virtual --record run.replay");
    assert_eq!(recorded.record, Some(PathBuf::from("run.replay")));
    let replayed = demo("luna-demo --replay run.replay --json");
    assert_eq!(replayed.replay, Some(PathBuf::from("run.replay")));
    assert!(replayed.place.json && replayed.record.is_none());
    for other in [
        "--seconds 1",
        "--rate 500",
        "--record b",
        "--calibrated",
        "--core 0",
        "--policy other",
        "--parameters jiwy.toml",
        "--set pan/kp=1",
        "--strict",
        "--table-4",
    ] {
        let line = format!("luna-demo --replay run.replay {other}");
        assert_eq!(parse(&line).expect_err(&line).exit_code(), 2, "{line}");
    }
}

#[test]
fn bad_values_are_named() {
    for (line, option) in [
        ("luna-demo --rate 0", "--rate"),
        ("luna-demo --rate 99", "--rate"),
        ("luna-demo --rate 4001", "--rate"),
        ("luna-demo --rate -1", "--rate"),
        ("luna-demo --rate 1e3", "--rate"),
        ("luna-demo --seconds 0", "--seconds"),
        ("luna-demo --seconds -1", "--seconds"),
        ("luna-demo --seconds nan", "--seconds"),
        ("luna-demo --seconds inf", "--seconds"),
        ("luna-demo --seconds ten", "--seconds"),
        ("luna-demo --core one", "--core"),
        ("luna-demo --core -1", "--core"),
        ("luna-demo --policy fifo:98", "--policy"),
        ("luna-demo --policy fifo:0", "--policy"),
        ("luna-demo --policy fifo", "--policy"),
        ("luna-demo --policy batch", "--policy"),
    ] {
        let error = parse(line).expect_err(line);
        assert_eq!(error.exit_code(), 2, "{line}");
        assert!(error.to_string().contains(option), "{line}: {error}");
    }
}
