//! Messages of the `log` and `tracing` facades are recorded. One test alone, since a facade has one
//! subscriber in a program.

use crate::common;
use common::{Kept, Message};
use luna_logger::{Hub, Level, Logging, Recorder, install};

#[test]
fn both_facades_end_in_the_recording() {
    assert!(install(Level::Info));
    assert!(!install(Level::Info), "a facade has one end");
    let kept = Kept::default();
    let hub = Hub::new("facades", Default::default());
    let recorder = Recorder::start(&hub, Logging::to_sink(kept.sink())).unwrap();
    let on_thread = std::thread::Builder::new().name("worker".to_owned());
    let thread = on_thread
        .spawn(|| {
            log::info!(target: "arm", "homed after {} s", 3);
            log::debug!("below the enabled level");
            tracing::warn!(target: "leg", pressure = 7.5, unit = "bar", "too high: {}", "valve 3");
            tracing::trace!("neither is this");
            tracing::error_span!("of a span nothing is kept")
                .in_scope(|| tracing::info!("{}", "x".repeat(5000)));
        })
        .unwrap();
    thread.join().unwrap();
    let report = recorder.finish();
    assert_eq!((report.messages.recorded, report.messages.lost), (3, 0));
    assert_eq!(report.messages.truncated, 1);

    let read = kept.read();
    assert_eq!(read.threads, ["worker"]);
    let [first, second, third] = &read.messages[..] else {
        panic!("{:?}", read.messages)
    };
    let expected = |level, target: &str, text: &str| Message {
        level,
        target: target.to_owned(),
        text: text.to_owned(),
        truncated: false,
    };
    assert_eq!(*first, expected(Level::Info, "arm", "homed after 3 s"));
    let fields = "too high: valve 3 pressure=7.5 unit=\"bar\"";
    assert_eq!(*second, expected(Level::Warn, "leg", fields));
    assert!(third.truncated && third.text.ends_with("xxx…"), "{third:?}");
    assert_eq!(third.target, module_path!());
}
