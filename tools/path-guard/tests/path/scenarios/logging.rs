//! Signals and messages.

use super::{Places, ROUNDS};
use luna::prelude::*;
use luna::log::{Level, Logging, WriterSink};
use std::time::Duration;

/// Records its rounds.
struct Recorded {
    name: String,
    number: Option<Signal<u64>>,
    place: Option<Signal<[f32; 3]>>,
}

impl Process for Recorded {
    fn pre_run(&mut self) -> luna::Result<()> {
        self.number = Some(Signal::register(&format!("{}/number", self.name))?);
        self.place = Some(Signal::with_unit(&format!("{}/place", self.name), "m").register()?);
        Ok(())
    }

    async fn run(&mut self) -> luna::Result<()> {
        for n in 0..ROUNDS {
            if let (Some(number), Some(place)) = (&self.number, &self.place) {
                number.record(n);
                place.clone().record([n as f32; 3]);
            }
            luna::log::message(
                Level::Info,
                "test",
                format_args!("round {n} of {}", self.name),
            );
            luna::yield_now().await;
        }
        Ok(())
    }
}

fn record(places: &mut Places) {
    for name in ["one", "two", "three"] {
        let process = Recorded {
            name: name.to_owned(),
            number: None,
            place: None,
        };
        places.next(name).spawn(process).unwrap();
    }
}

fn nowhere() -> Logging {
    Logging::to_sink(WriterSink::new(std::io::sink()))
}

pub(crate) fn signals_and_messages(places: &mut Places) {
    places.system.log(nowhere().every(Duration::from_millis(1)));
    record(places);
}

/// Most is dropped and counted.
pub(crate) fn signals_without_room(places: &mut Places) {
    let recording = nowhere().every(Duration::from_secs(1));
    places
        .system
        .log(recording.room_for_samples(30).room_for_messages(600));
    record(places);
}

pub(crate) fn signals_without_a_recording(places: &mut Places) {
    record(places);
}
