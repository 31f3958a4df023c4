//! What the command line takes and refuses.

use super::*;
use luna::Policy;

fn parse(line: &str) -> Result<Command, clap::Error> {
    let parsed = Arguments::try_parse_from(line.split_whitespace());
    parsed.map(|arguments| arguments.command)
}

#[test]
fn clap_is_content() {
    <Arguments as clap::CommandFactory>::command().debug_assert();
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
}
