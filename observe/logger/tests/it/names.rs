//! Names are collected only while a recording with events runs. Alone in its program: all recorders
//! get all names.

use luna_events::{self as events, Kind};
use luna_logger::{Hub, Logging, Recorder, StartError, WriterSink};

/// Whether names are collected.
fn is_asked() -> bool {
    let mut is_asked = false;
    events::name(Kind::Channel, u32::MAX, 0, || {
        is_asked = true;
        String::new()
    });
    is_asked
}

#[test]
fn no_names_are_collected_after_the_recording() {
    let to_nowhere = || Logging::to_sink(WriterSink::new(std::io::sink()));
    let hub = Hub::new("pump", Default::default());
    assert!(!is_asked());
    let recorder = Recorder::start(&hub, to_nowhere().events()).unwrap();
    assert!(is_asked() && hub.records_events());
    let again = Recorder::start(&hub, to_nowhere().events());
    assert!(matches!(again, Err(StartError::Twice)));
    assert_eq!(recorder.finish().error, None);
    // The hub lives on, as it does while signals of it exist.
    assert!(!is_asked());
    hub.name(Kind::Channel, 1, 0, "late".to_owned());
    drop(hub);
    let without = Hub::new("pump", Default::default());
    let recorder = Recorder::start(&without, to_nowhere()).unwrap();
    assert!(!is_asked() && !without.records_events());
    drop(recorder);
}
