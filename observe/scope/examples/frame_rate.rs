//! Measures how many frames a second the page draws on each view, in a headless Chromium:
//! `cargo run --release -p luna-scope --example frame_rate`, for a computed machine with 32 curves
//! of 1 kHz, 57 000 events a second and 24 parameters; or with the address of a scope that runs, as
//! that of `luna demo --scope`.
//!
//! The times between frames are those of `requestAnimationFrame`, for ten seconds after a warm-up
//! of five; the run time of each frame's script is reported too. A headless Chromium draws without
//! a graphics card, on the processor alone, at most 60 times a second.

#[path = "../tests/support/mod.rs"]
mod support;

use luna_scope::{Parameter, Parameters, Scope, Settings};
use serde_json::Value;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use support::browser::{Browser, program};
use support::feeder::Feeder;
use support::machine::Machine;

/// A name, the view, and what to do there first.
const MEASURED: [(&str, &str, &str); 9] = [
    ("signals, stacked", "signals", "signals.lay('stack')"),
    ("signals, overlaid", "signals", "signals.lay('overlay')"),
    ("signals, X-Y", "signals", "signals.lay('xy')"),
    ("loops", "loops", "loops"),
    ("composition, graph", "composition", "composition.lay(true)"),
    (
        "composition, parts",
        "composition",
        "composition.lay(false)",
    ),
    ("timeline", "timeline", "timeline"),
    ("messages", "messages", "messages"),
    ("parameters", "parameters", "parameters"),
];

/// Parameters of the computed machine; one of them changes with each look.
#[derive(Default)]
struct Gains(AtomicU32);

impl Parameters for Gains {
    fn list(&self) -> Vec<Parameter> {
        let looks = self.0.fetch_add(1, Ordering::Relaxed);
        let gain = |n| Parameter::new(format!("axis/gain {n}"), f64::from(n)).range(0.0, 50.0);
        let changing = Parameter::new("looks", looks);
        (1..24).map(gain).chain([changing]).collect()
    }

    fn set(&self, _: &str, _: &Value) -> Result<(), String> {
        Err("it is fixed".to_owned())
    }
}

fn main() {
    let program = program().expect("chromium is needed (Debian: chromium)");
    let browser = Browser::start(&program, "frame-rate");
    if let Some(url) = std::env::args().nth(1) {
        measure(&browser, &url);
        return;
    }
    let settings = Settings::default()
        .address(([127, 0, 0, 1], 0).into())
        .parameters(Arc::new(Gains::default()));
    let scope = Scope::open(settings).unwrap();
    let feeder = Feeder::start(&scope, Machine::new());
    measure(&browser, &scope.url());
    println!("blocks refused: {}", feeder.end());
}

fn measure(browser: &Browser, url: &str) {
    browser.open(url, (1366, 768), "light");
    browser.wait("scope.views.signals.rows.size > 0");
    browser.run("(() => { const { chosen, rows } = scope.views.signals; if (chosen.size < rows.size) document.querySelector('#signals-all').click(); })()");
    browser.wait("scope.views.signals.chosen.size === scope.views.signals.rows.size");
    for (name, view, first) in MEASURED {
        browser.run(&format!("scope.show('{view}'); scope.views.{first}; 0"));
        browser.run("new Promise((done) => setTimeout(done, 5000))");
        let measured = browser.run(&format!(
            "new Promise((done) => {{
                const times = [], work = [], view = scope.views.{view}, own = view.frame, frame = own.bind(view), before = scope.model.samples;
                view.frame = (now) => {{ const begun = performance.now(); frame(now); work.push(performance.now() - begun); }};
                const next = (now) => {{
                    times.push(now);
                    if (now - times[0] < 10000) return requestAnimationFrame(next);
                    view.frame = own;
                    const gaps = times.slice(1).map((time, n) => time - times[n]).sort((a, b) => a - b);
                    work.sort((a, b) => a - b);
                    const at = (list, share) => list[Math.min(list.length - 1, Math.floor(list.length * share))].toFixed(1);
                    const seconds = (times.at(-1) - times[0]) / 1000;
                    done(`${{((times.length - 1) / seconds).toFixed(1)}} frames/s, ms from one to the next: p50 ${{at(gaps, 0.5)}}, p99 ${{at(gaps, 0.99)}}, greatest ${{at(gaps, 1)}}; ms of script in each: p50 ${{at(work, 0.5)}}, p99 ${{at(work, 0.99)}}; ${{Math.round((scope.model.samples - before) / seconds)}} samples/s`);
                }};
                requestAnimationFrame(next);
            }})"
        ));
        println!("{name}: {}", measured.as_str().unwrap_or_default());
    }
}
