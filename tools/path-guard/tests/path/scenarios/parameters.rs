//! Parameters: read and taken, in loops and directly, while a process off the path replaces them.

use super::Places;
use luna::prelude::*;
use std::time::Duration;

/// How many sets there are.
const SETS: u64 = 20;

/// Reads until it has the last set.
struct Reads {
    name: &'static str,
    by_loop: bool,
    number: Parameter<u64>,
    list: Parameter<[u64; 4]>,
}

impl Process for Reads {
    async fn run(&mut self) -> luna::Result<()> {
        let Self { number, list, .. } = self;
        let mut tick = luna::periodic(self.name, Duration::from_micros(500))?;
        while number.get() < SETS {
            match self.by_loop {
                true => drop(tick.next().await),
                false => {
                    luna::after(Duration::from_micros(500)).await;
                    number.clone().latch();
                }
            }
            assert_eq!(list.get(), [number.get(); 4]);
        }
        Ok(())
    }
}

pub(crate) fn parameters_that_are_replaced(places: &mut Places) {
    for (name, by_loop) in [("loop", true), ("by hand", false)] {
        let process = places.next(name);
        let named = |part: &str| format!("{name}/{part}");
        let number = process.parameter(&named("number"), 0).register().unwrap();
        let list = process.parameter(&named("list"), [0; 4]).register().unwrap();
        process
            .spawn(Reads {
                name,
                by_loop,
                number,
                list,
            })
            .unwrap();
    }
    let parameters = places.system.parameters();
    let set = move |value: u64| {
        let of =
            |name| format!("{name}/number={value},{name}/list=[{value},{value},{value},{value}]");
        parameters.set_text(&format!("{},{}", of("loop"), of("by hand")))
    };
    places
        .next("sets")
        .spawn(async move {
            for value in 1..=SETS {
                luna::after(Duration::from_micros(700)).await;
                luna::realtime::off_path(|| set(value).unwrap());
            }
            // What it holds is freed with it.
            luna::realtime::off_path(|| drop(set));
            Ok(())
        })
        .unwrap();
}

pub(crate) fn parameters_that_are_recorded(places: &mut Places) {
    let name = format!(
        "luna-guard-parameters-{}-{:?}",
        std::process::id(),
        places.placement
    );
    places.system.record(std::env::temp_dir().join(name));
    parameters_that_are_replaced(places);
}
