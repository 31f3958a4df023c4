//! What a recording's destination is called.

use luna_logger::{FileSink, Hub, Logging, Recorder, Sink, TcpSink, Tee, UdpSink, WriterSink};
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
