//! What the command line takes and refuses.

use super::*;
use luna::Policy;
use std::time::Duration;

fn parse(line: &str) -> Result<Command, clap::Error> {
    Arguments::try_parse_from(line.split_whitespace()).map(Arguments::command)
}

fn demo(line: &str) -> Demo {
    match parse(line) {
        Ok(Command::Demo(demos)) => demos.jiwy,
        other => panic!("{other:?}"),
    }
}

#[test]
fn clap_is_content() {
    <Arguments as clap::CommandFactory>::command().debug_assert();
}

#[test]
fn no_command_is_the_demo() {
    for line in ["luna", "luna demo"] {
        let demo = demo(line);
        assert_eq!(
            (demo.seconds, demo.rate, demo.cycles()),
            (10.0, 1000, 10_000)
        );
        assert_eq!(
            (demo.place.core, demo.place.policy, demo.place.json),
            (None, Policy::fifo(80), false)
        );
        assert_eq!(
            (demo.joystick.clone(), demo.period()),
            (None, Duration::from_millis(1))
        );
    }
    assert_eq!(demo("luna --seconds 2").cycles(), 2000);
}

#[test]
fn demo_takes_its_options() {
    let demo =
        demo("luna demo --seconds 0.5 --rate 250 --core 1 --policy rr:7 --joystick a.csv --json");
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
    let demo = demo("luna --parameters jiwy.toml --set pan/kp=2 --set tilt/kd=0.1");
    assert_eq!(demo.parameters, Some(PathBuf::from("jiwy.toml")));
    assert_eq!(demo.set, ["pan/kp=2", "tilt/kd=0.1"]);
}

#[test]
fn a_replay_says_all_that_the_recorded_run_was_told() {
    let recorded = demo("luna demo --seconds 1 --virtual --record run.replay");
    assert_eq!(recorded.record, Some(PathBuf::from("run.replay")));
    let replayed = demo("luna demo --replay run.replay --json");
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
        let line = format!("luna demo --replay run.replay {other}");
        assert_eq!(parse(&line).expect_err(&line).exit_code(), 2, "{line}");
    }
}

#[test]
fn jitter_takes_its_options() {
    let Ok(Command::Jitter(jitter)) =
        parse("luna jitter --interval 500 --loops 20 --policy other --histogram h.csv")
    else {
        panic!("no jitter");
    };
    assert_eq!(
        (jitter.interval, jitter.loops, jitter.place.policy),
        (500, 20, Policy::Other)
    );
    assert_eq!(jitter.histogram, Some(PathBuf::from("h.csv")));
    assert_eq!((jitter.guard, jitter.others, jitter.burn), (0, 0, None));
    let Ok(Command::Jitter(jitter)) = parse("luna jitter --guard 60 --others 99 --burn 100") else {
        panic!("no jitter");
    };
    assert_eq!(
        (jitter.guard, jitter.others, jitter.burn),
        (60, 99, Some(100))
    );
}

#[test]
fn doctor_takes_its_options() {
    let Ok(Command::Doctor(doctor)) = parse("luna doctor") else {
        panic!("no doctor");
    };
    assert_eq!((doctor.core, doctor.root), (None, None));
    assert!(!(doctor.quick || doctor.no_measure || doctor.no_self_test));
    let Ok(Command::Doctor(doctor)) =
        parse("luna doctor --core 3 --no-measure --no-self-test --root a --json --explain")
    else {
        panic!("no doctor");
    };
    assert_eq!((doctor.core, doctor.root), (Some(3), Some("a".into())));
    assert!(doctor.no_measure && doctor.no_self_test && doctor.json && doctor.explain);
}

#[test]
fn record_takes_its_options() {
    let Ok(Command::Record(record)) = parse("luna record") else {
        panic!("no record");
    };
    assert_eq!(record.listen, "127.0.0.1:7411");
    assert_eq!(record.messages, Messages(Some(luna::log::Level::Info)));
    assert!(!record.udp && !record.once && record.output.is_none() && record.limit.is_none());
    let line = "luna record --listen 0.0.0.0:1 --udp -o a --messages none --once --limit 5";
    let Ok(Command::Record(record)) = parse(line) else {
        panic!("no record");
    };
    assert_eq!(
        (record.listen.as_str(), record.limit),
        ("0.0.0.0:1", Some(5))
    );
    assert_eq!(
        (record.messages, record.output),
        (Messages(None), Some("a".into()))
    );
    assert!(record.udp && record.once);
}

#[test]
fn bad_values_are_named() {
    for (line, option) in [
        ("luna demo --rate 0", "--rate"),
        ("luna demo --rate 99", "--rate"),
        ("luna demo --rate 4001", "--rate"),
        ("luna demo --rate -1", "--rate"),
        ("luna demo --rate 1e3", "--rate"),
        ("luna demo --seconds 0", "--seconds"),
        ("luna demo --seconds -1", "--seconds"),
        ("luna demo --seconds nan", "--seconds"),
        ("luna demo --seconds inf", "--seconds"),
        ("luna demo --seconds ten", "--seconds"),
        ("luna demo --core one", "--core"),
        ("luna demo --core -1", "--core"),
        ("luna demo --policy fifo:98", "--policy"),
        ("luna demo --policy fifo:0", "--policy"),
        ("luna demo --policy fifo", "--policy"),
        ("luna --policy batch", "--policy"),
        ("luna jitter --interval 0", "--interval"),
        ("luna jitter --interval -5", "--interval"),
        ("luna jitter --interval 99999999999999999999", "--interval"),
        ("luna jitter --loops 0", "--loops"),
        ("luna jitter --loops -3", "--loops"),
        ("luna doctor --core -1", "--core"),
        ("luna jitter --guard -1", "--guard"),
        ("luna jitter --others 251", "--others"),
        ("luna jitter --burn 0", "--burn"),
        ("luna record --messages loud", "--messages"),
        ("luna record --limit 0", "--limit"),
        ("luna jitter --burn 1001", "--burn"),
        (
            "luna jitter --policy deadline:200000/1000000/1000000",
            "--policy",
        ),
    ] {
        let error = parse(line).expect_err(line);
        assert_eq!(error.exit_code(), 2, "{line}");
        assert!(error.to_string().contains(option), "{line}: {error}");
    }
    assert!(parse("luna --seconds 1 jitter").is_err());
}
