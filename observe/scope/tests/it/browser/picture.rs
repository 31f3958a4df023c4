//! The picture of the machine.

use super::{LAPTOP, browser, is_content, picture, settings};
use crate::support::browser::Browser;
use luna_logger::format::{ClockBase, Record, SignalInfo, Type, Values, Writer};
use luna_scope::{Scope, Speed};
use serde_json::{Value, json};

/// An axis that moves from 0 to 1 m within 10 s, its state, and three places of which the last two
/// have no value.
fn recording() -> Vec<u8> {
    let mut file = Writer::new(Vec::new()).unwrap();
    file.put(&Record::Session {
        system: "axis",
        clock: ClockBase::Virtual,
        written_by: "a test",
    })
    .unwrap();
    let declared = [
        ("axis/position", "m", 1),
        ("axis/state", "", 1),
        ("axis/places", "", 3),
    ];
    for (number, (name, unit, elements)) in declared.into_iter().enumerate() {
        file.put(&Record::Signal(SignalInfo {
            number: number as u32,
            element_type: Type::F64,
            elements,
            name,
            unit,
            description: "",
        }))
        .unwrap();
    }
    for n in 0..=100_u32 {
        let part = f64::from(n) / 100.0;
        let state = f64::from(n / 50);
        let samples = [vec![part], vec![state], vec![part, f64::NAN, f64::NAN]];
        for (signal, values) in samples.iter().enumerate() {
            // The state is silent from 6 s on.
            if signal == 1 && n > 60 {
                continue;
            }
            let bytes: Vec<u8> = values
                .iter()
                .flat_map(|value| value.to_le_bytes())
                .collect();
            file.put(&Record::Sample {
                signal: signal as u32,
                time: u64::from(n) * 100_000_000,
                values: Values::from_bytes(Type::F64, &bytes),
            })
            .unwrap();
        }
    }
    file.finish().unwrap()
}

const AXIS: &str = r##"<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" width="200" height="100">
  <rect width="9" height="9" transform="translate(5 5)" data-signal="axis/position" data-x="0 0; 0.5 100; 1 120" data-y="0 0; 1 -10"/>
  <g data-signal="axis/position" data-repeat="0.25" data-turn="0 0; 0.25 90"/>
  <rect style="fill: #123456; filter: url(#none)" data-signal="axis/state" data-silent="1" data-fill="1 #00ff00; silent #000000"/>
  <text data-signal="axis/state" data-silent="1" data-text="0 off; 1 on; silent lost">?</text>
  <text data-signal="axis/position" data-digits="2" data-text="">?</text>
  <circle data-signal="axis/state" data-show="0 no; 1 yes"/>
  <circle data-signal="axis/places[1]" data-x="0 0; 1 1"/>
  <line data-signal="axis/places[0]" data-width="0 0; 1 50" data-opacity="0 0; 1 1"/>
</svg>"##;

/// Opens a recording with a picture, at its end.
fn open(browser: &Browser, scope: &Scope, recording: &[u8]) {
    scope.replay(recording, Speed::AT_ONCE).unwrap();
    browser.open(&scope.url(), LAPTOP, "light");
    browser.wait("!document.querySelector('#tab-picture').hidden");
    browser.click("#tab-picture");
    browser.wait("scope.model.ended !== null || scope.clock.latest >= 10");
}

fn show(browser: &Browser, seconds: f64) {
    browser.run(&format!("scope.clock.pause({seconds})"));
    browser.frames(2);
}

/// An attribute of each element of the picture but the outer one.
fn attributes(browser: &Browser, name: &str) -> Value {
    browser.run(&format!(
        "[...document.querySelectorAll('#picture svg svg, #picture svg :not(tspan)')].map((one) => one.getAttribute({name:?}))"
    ))
}

/// The page's policy holds for the text of the SVG too, which the browser's parser reports. It has
/// nothing to report of the picture that is made of it.
fn is_content_with_the_parser(browser: &Browser) {
    for complaint in browser.complaints() {
        let is_of_the_parser = ["Applying inline style", "Executing inline event handler"]
            .iter()
            .any(|start| complaint.contains(&format!("\"text\":\"{start} violates")));
        assert!(is_of_the_parser, "{complaint}");
    }
}

fn texts(browser: &Browser) -> Value {
    browser.run("[...document.querySelectorAll('#picture svg text')].map((one) => one.textContent)")
}

#[test]
fn elements_follow_their_signals() {
    let Some(browser) = browser("bound") else {
        return;
    };
    let scope = Scope::open(settings().picture(AXIS)).unwrap();
    open(&browser, &scope, &recording());

    show(&browser, 3.0);
    let transforms = attributes(&browser, "transform");
    assert_eq!(
        transforms[0],
        "translate(5 5) translate(60.00 -3.00) rotate(0.00)"
    );
    // 0.3 m is 0.05 m of the second turn.
    assert_eq!(transforms[1], "translate(0.00 0.00) rotate(18.00)");
    assert_eq!(attributes(&browser, "fill")[2], "#123456");
    assert_eq!(texts(&browser), json!(["off", "0.30 m"]));
    let none = Value::Null;
    let display = |browser: &Browser| attributes(browser, "display");
    assert_eq!(
        display(&browser),
        json!([none, none, none, none, none, "none", "none", none])
    );
    assert_eq!(attributes(&browser, "width")[7], "15.00");
    assert_eq!(attributes(&browser, "opacity")[7], "0.30");

    show(&browser, 5.5);
    assert_eq!(
        attributes(&browser, "transform")[0],
        "translate(5 5) translate(102.00 -5.50) rotate(0.00)"
    );
    assert_eq!(attributes(&browser, "fill")[2], "#00ff00");
    assert_eq!(texts(&browser), json!(["on", "0.55 m"]));
    assert_eq!(display(&browser)[5], none);

    // The state is not heard any more.
    show(&browser, 7.5);
    assert_eq!(attributes(&browser, "fill")[2], "#000000");
    assert_eq!(texts(&browser)[0], "lost");
    // A state that was seen is left again.
    show(&browser, 3.0);
    assert_eq!(attributes(&browser, "fill")[2], "#123456");
    let note = browser.run("document.querySelector('#picture .note').hidden");
    assert_eq!(note, true);
    is_content_with_the_parser(&browser);
}

const HOSTILE: &str = r##"<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" viewBox="0 0 10 10" onload="window.hit = 1">
  <script>window.hit = 2</script>
  <style>@import "http://127.0.0.1:9/style.css"; * { display: none }</style>
  <image href="http://127.0.0.1:9/a.png" width="9" height="9"/>
  <use xlink:href="http://127.0.0.1:9/b.svg#c"/>
  <a href="javascript:window.hit = 3"><text>link</text></a>
  <foreignObject><body xmlns="http://www.w3.org/1999/xhtml"><img src="x" onerror="window.hit = 4"/></body></foreignObject>
  <animate attributeName="href" values="javascript:window.hit = 5"/>
  <rect fill="url(http://127.0.0.1:9/d.svg#e)" stroke="u\72l(http://127.0.0.1:9/f)" class="emergency" id="pause" style="fill: url('http://127.0.0.1:9/g'); stroke-width: 2" onclick="window.hit = 6" width="5"/>
  <text data-signal="axis/none" data-text="">&lt;img src=x onerror=alert(1)&gt;</text>
  <text data-signal="axis/position" data-text="0 &lt;b&gt;bold&lt;/b&gt;">x</text>
  <rect data-signal="axis/position" data-fill="0 url(http://127.0.0.1:9/h)"/>
  <rect data-signal="axis/position" data-x="0 a"/>
</svg>"##;

#[test]
fn a_picture_runs_nothing_and_loads_nothing() {
    let Some(browser) = browser("hostile") else {
        return;
    };
    let scope = Scope::open(settings().picture(HOSTILE)).unwrap();
    open(&browser, &scope, &recording());
    show(&browser, 3.0);
    let names = "[...document.querySelectorAll('#picture svg, #picture svg *')].map((one) => one.localName).join()";
    assert_eq!(browser.run(names), "svg,rect,text,text,rect,rect");
    let found = "[...document.querySelectorAll('#picture svg, #picture svg *')].flatMap((one) => one.getAttributeNames().map((name) => `${name}=${one.getAttribute(name)}`)).sort().join(' ')";
    assert_eq!(
        browser.run(found),
        "role=img stroke-width=2 viewBox=0 0 10 10 width=5"
    );
    assert_eq!(texts(&browser), json!(["–", "<b>bold</b>"]));
    assert_eq!(browser.run("window.hit === undefined"), true);
    let loaded = "performance.getEntriesByType('resource').filter(({ name }) => !name.startsWith(location.origin)).length";
    assert_eq!(browser.run(loaded), 0);
    let note = browser.run("document.querySelector('#picture .note').textContent");
    let note = note.as_str().unwrap();
    for part in [
        "<script>",
        "<style>",
        "<image>",
        "<use>",
        "<a>",
        "<foreignObject>",
        "<animate>",
        "onload",
        "onclick",
        "fill=\"url(",
        "Not understood: data-fill=",
        "data-x=\"0 a\": 0 a",
        "Not recorded: axis/none.",
    ] {
        assert!(note.contains(part), "{part}: {note}");
    }
    is_content_with_the_parser(&browser);
}

#[test]
fn what_is_no_svg_is_said() {
    let Some(browser) = browser("broken") else {
        return;
    };
    let scope = Scope::open(settings().picture("<svg><rect></svg>")).unwrap();
    open(&browser, &scope, &recording());
    browser.wait("document.querySelector('#picture .note').textContent === 'The picture is no SVG that can be read.'");
    is_content_with_the_parser(&browser);
}

#[test]
#[cfg(target_os = "linux")]
fn the_production_cell_is_seen_with_its_blocks_and_faults() {
    use crate::support::cell;
    use luna_production_cell::{Breakage, Unit, picture::CELL};
    use std::fs::File;

    let Some(browser) = browser("cell") else {
        return;
    };
    let path = browser.folder.join("cell.luna");
    cell::record(&path, (Unit::Feeder, Breakage::Kill));
    let scope = Scope::open(settings().picture(CELL)).unwrap();
    let mut file = File::open(&path).unwrap();
    scope.replay_file(&mut file, Speed::AT_ONCE).unwrap();
    browser.open(&scope.url(), LAPTOP, "light");
    browser.wait("!document.querySelector('#tab-picture').hidden");
    browser.click("#tab-picture");
    browser.wait("scope.clock.latest >= 5");

    // Of each unit: its state, and its blocks.
    let units = "(() => { const found = {}; for (const panel of document.querySelectorAll('#picture svg > g[transform]')) { const [name, state, position, , ...blocks] = [...panel.querySelectorAll('text')]; found[name.textContent] = [state.textContent, blocks.filter(({ parentNode }) => parentNode.getAttribute('display') !== 'none').map((one) => one.textContent).join()]; } return found; })()";
    let blocks = |found: &Value| {
        let units = found.as_object().unwrap().values();
        let mut all: Vec<_> = units
            .flat_map(|unit| unit[1].as_str().unwrap().split(','))
            .filter(|one| !one.is_empty())
            .map(str::to_owned)
            .collect();
        all.sort();
        all.join(",")
    };
    show(&browser, 0.1);
    let found = browser.run(units);
    assert_eq!(found["feeder belt"], json!(["running", "1,2,3"]));
    assert_eq!(found["extraction belt"], json!(["running", "4,5"]));
    assert_eq!(found["robot"], json!(["running", ""]));
    picture(&browser, "cell");

    // They move round, and each is in one place.
    show(&browser, 1.9);
    let later = browser.run(units);
    assert_eq!(blocks(&later), "1,2,3,4,5");
    assert_ne!(later, found);

    // The feeder is dead: nothing is heard of it, the belt behind it halts, the door ahead opens.
    show(&browser, 3.4);
    let dead = browser.run(units);
    assert_eq!(dead["feeder"][0], "silent");
    assert_eq!(dead["feeder belt"][0], "halted");
    assert_eq!(dead["moulder door"][0], "safe");
    assert_eq!(dead["robot"][0], "running");
    picture(&browser, "dead-feeder");
    let note = browser.run("document.querySelector('#picture .note').hidden");
    assert_eq!(note, true);
    is_content(&browser);
}
