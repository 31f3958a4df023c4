//! The drawing of a model, animated by the events of a run.

use super::{LAPTOP, browser, is_content, picture, settings};
use crate::support::browser::Browser;

use luna::log::Logging;
use luna::prelude::*;
use luna_model::Model;
use luna_scope::{Scope, Speed};
use serde_json::{Value, json};
use std::fs::File;
use std::path::Path;
use std::time::Duration;

const MODEL: &str = r#"
name = "store"

[process.Source]
ports = { to = "send" }
body = "loop { after_a_millisecond; to! }"

[process.Carrier]
ports = { from = "receive", to = "send" }
body = "loop { from?; to! }"

[process.Sink]
ports = { from = "receive" }
body = "loop { from?; rest }"

[process.Watch]
ports = { from = "receive" }
body = "loop { from? }"

[system.channel]
store = { buffer = "fifo 2" }
way = { array = 1 }
never = {}

[system.part]
source = { process = "Source", bind = { to = "store" } }
carrier = { process = "Carrier", bind = { from = "store", to = "way[0]" } }
src_sink_rs_3 = { process = "Sink", bind = { from = "way[0]" } }
outside = { process = "Source", bind = { to = "never" } }
watch = { process = "Watch", bind = { from = "never" } }
"#;

/// Sends a value each millisecond for 10 ms into a buffer of 2, from which it is carried to a
/// process that takes one each 4 ms, on a virtual clock. Another process waits for what never comes.
fn record(to: &Path) {
    let (into, out_of) = luna::buffered::<u32>(luna::Buffer::fifo(2));
    let (carried, taken) = luna::channel::<u32>();
    let (nothing, never) = luna::channel::<u32>();
    let (into, carried) = (into.named("store"), carried.named("way[0]"));
    let nothing = nothing.named("never");
    let mut system = System::new("store");
    system.virtual_clock();
    system.log(Logging::to_file(to).replacing().room_for_events(1 << 14));
    let executor = system.executor("main").build().unwrap();
    let source = async move {
        for number in 0..10 {
            luna::after(Duration::from_millis(1)).await;
            into.send(number).await?;
        }
        drop(nothing);
        Ok(())
    };
    executor.process("source").spawn(source).unwrap();
    let carrier = async move {
        while let Ok(number) = out_of.recv().await {
            carried.send(number).await?;
        }
        Ok(())
    };
    executor.process("carrier").spawn(carrier).unwrap();
    let sink = async move {
        while taken.recv().await.is_ok() {
            luna::after(Duration::from_millis(4)).await;
        }
        Ok(())
    };
    executor.process("src/sink.rs:3").spawn(sink).unwrap();
    let watch = async move { never.recv().await.map_or(Ok(()), |_| Ok(())) };
    executor.process("watch").spawn(watch).unwrap();
    system.run().unwrap();
}

/// What the page shows: of each process the class of its box and its words, of each channel the
/// class of its arrow and its figures.
fn seen(browser: &Browser) -> Value {
    browser.run(
        "(() => { const found = {}; for (const { element, names, kind, is, isText } of scope.views.picture.drawing.followers) { \
         const one = (found[names[0]] ??= [null, null]); \
         one[isText ? 1 : 0] = isText ? element.textContent : element.getAttribute('class') === `${kind} ${is}` ? is : null; } \
         return found; })()",
    )
}

fn show(browser: &Browser, seconds: f64) {
    browser.run(&format!("scope.clock.pause({seconds})"));
    browser.frames(2);
}

#[test]
fn a_drawing_follows_the_events_of_a_recording() {
    let Some(browser) = browser("drawing") else {
        return;
    };
    let path = browser.folder.join("store.luna");
    record(&path);
    let model = Model::parse("store.toml", MODEL).unwrap_or_else(|problem| panic!("{problem}"));
    let scope = Scope::open(settings().picture(model.to_svg())).unwrap();
    scope
        .replay_file(&mut File::open(&path).unwrap(), Speed::AT_ONCE)
        .unwrap();
    browser.open(&scope.url(), LAPTOP, "light");
    browser.wait("!document.querySelector('#tab-picture').hidden");
    browser.click("#tab-picture");
    browser.wait("scope.model.ended !== null");

    // It follows the run to its end: so many communications a second are no single ones.
    browser.wait("document.querySelectorAll('#picture .channel.often').length === 2");

    // The first value is with the sink until 5 ms, the second with the carrier.
    show(&browser, 2.5e-3);
    let early = json!({
        "source": ["waiting", "waits"],
        "store": ["lit", "2 · 2/s · holds 0"],
        "carrier": ["waiting", "waits for way[0]"],
        "way[0]": ["sender", "1 · 1/s"],
        "src_sink_rs_3": ["waiting", "waits"],
        "never": ["still", "0 · 0/s"],
        "watch": ["waiting", "waits for never"],
        "outside": ["unknown", "Source"],
    });
    assert_eq!(seen(&browser), early);
    picture(&browser, "drawing");

    // The third and the fourth are in the buffer then. At 5 ms the sink takes the second, the carrier
    // the third, and the fifth goes in; the sixth finds no room.
    show(&browser, 6.5e-3);
    let mut late = early.clone();
    late["source"] = json!(["waiting", "waits for store"]);
    late["store"] = json!(["lit", "6 · 6/s · holds 2"]);
    late["way[0]"] = json!(["lit", "2 · 2/s"]);
    assert_eq!(seen(&browser), late);

    // From event to event.
    let millis = |browser: &Browser| browser.run("Math.round(scope.clock.now * 1e4) / 10");
    show(&browser, 2.5e-3);
    browser.key("ArrowRight");
    assert_eq!(millis(&browser), 3);
    browser.key("ArrowLeft");
    browser.frames(2);
    assert_eq!(millis(&browser), 2);
    assert_eq!(seen(&browser), early);

    // At the end: two values went past the buffer, eight went in and came out.
    show(&browser, 1.0);
    for (name, is) in [
        ("source", ["done", "done"]),
        ("store", ["still", "18 · 18/s · holds 0"]),
        ("way[0]", ["lit", "10 · 10/s"]),
        ("watch", ["done", "done"]),
        ("outside", ["unknown", "Source"]),
    ] {
        assert_eq!(seen(&browser)[name], json!(is), "{name}");
    }
    let note = browser.run("document.querySelector('#picture .note').textContent");
    assert_eq!(note, "Not seen in the recording: process outside.");

    // Its text can be read in a small window, too.
    browser.look((500, 300), "light");
    browser.frames(2);
    let scales = browser.run(
        "(() => { const svg = document.querySelector('#picture svg'), box = svg.getBoundingClientRect(), { width, height } = svg.viewBox.baseVal; return [box.width / width, box.height / height]; })()",
    );
    for axis in [0, 1] {
        assert!(scales[axis].as_f64().unwrap() >= 0.74, "{scales}");
    }
    is_content(&browser);
}
