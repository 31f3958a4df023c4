//! Messages on the path by threads without rings are lost and counted. In a process of its own,
//! since threads without a hub count for the recording that began last.

use crate::common;
use common::Kept;
use luna_core::current;
use luna_logger::{Hub, Level, Logging, Recorder, message};
use std::sync::Arc;

/// Writes this many messages on a thread of its own, which is on the path.
fn on_the_path(hub: Option<&Arc<Hub>>, messages: u32) {
    let hub = hub.cloned();
    let thread = std::thread::spawn(move || {
        let _inside = hub.as_ref().map(Hub::enter);
        current::set_on_path(true);
        for n in 0..messages {
            message(Level::Info, "test", format_args!("{n}"));
        }
        current::set_on_path(false);
    });
    thread.join().unwrap();
}

#[test]
fn messages_on_the_path_without_rings_are_counted() {
    own_process!();
    let hubs = ["first", "second"].map(|name| Hub::new(name, Default::default()));
    let kept = [Kept::default(), Kept::default()];
    // Nothing is recorded yet, so they count for no recording.
    on_the_path(None, 100);
    let start = |n: usize| Recorder::start(&hubs[n], Logging::to_sink(kept[n].sink())).unwrap();
    let first = start(0);
    on_the_path(Some(&hubs[0]), 5);
    on_the_path(None, 7);
    let second = start(1);
    on_the_path(Some(&hubs[0]), 2);
    on_the_path(Some(&hubs[1]), 3);
    on_the_path(None, 11);
    for (recorder, kept, lost) in [(first, &kept[0], 14), (second, &kept[1], 14)] {
        let report = recorder.finish();
        assert_eq!((report.messages.recorded, report.messages.lost), (0, lost));
        let counted = kept.read().lost_messages;
        assert_eq!(counted.values().sum::<u64>(), lost);
    }
}
