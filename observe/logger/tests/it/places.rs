//! What a recording's destination is called, and names that are refused.

use luna_logger::{
    FileSink, Hub, Logging, Recorder, Sink, StartError, TcpSink, Tee, UdpSink, WriterSink,
};
use std::path::PathBuf;

fn file(name: &str) -> PathBuf {
    let id = std::process::id();
    std::env::temp_dir().join(format!("luna-logger-places-{id}-{name}"))
}

#[test]
fn the_report_names_the_first_place_of_several() {
    let path = file("first.luna");
    let both = Tee::new(FileSink::create(&path).unwrap()).and(WriterSink::new(std::io::sink()));
    let hub = Hub::new("pump", Default::default());
    let report = Recorder::start(&hub, Logging::to_sink(both))
        .unwrap()
        .finish();
    std::fs::remove_file(&path).unwrap();
    assert_eq!(report.to, path.display().to_string());
    assert_eq!(TcpSink::new("lan:1").place(), "tcp://lan:1");
    assert_eq!(UdpSink::new("lan:1").place(), "udp://lan:1");
}

#[test]
fn the_name_of_a_replay_log_is_refused() {
    let path = file("run.replay");
    for logging in [Logging::to_file(&path), Logging::to_place(&path)] {
        let hub = Hub::new("pump", Default::default());
        let error = Recorder::start(&hub, logging).unwrap_err();
        let StartError::Sink { to, error } = error else {
            panic!("{error}");
        };
        assert_eq!(to, path.display().to_string());
        assert!(
            error.contains(".luna") && error.contains(".replay"),
            "{error}"
        );
    }
    assert!(!path.exists());
}
