//! The plot's axes.

use super::{LAPTOP, browser, is_content, live, number, picture, settings};
use luna_logger::format::{ClockBase, Record, SignalInfo, Type, Values, Writer};
use luna_scope::{Scope, Speed};
use serde_json::Value;

#[test]
fn axes_are_labelled_zoomed_and_fitted() {
    let Some((browser, _feeder, _scope)) = live("axes") else {
        return;
    };
    // However many lanes there are.
    let labelled = "scope.views.signals.lanes.every(({ labels, scale }) => new Set(labels).size >= 2 && labels.every((one) => Math.abs(one - (scale.low + scale.high) / 2) < 0.6 * (scale.high - scale.low)))";
    for lanes in [6, 32] {
        browser.wait(&format!(
            "scope.views.signals.lanes.length === {lanes} && {labelled}"
        ));
        browser.frames(3);
        picture(&browser, &format!("axes-{lanes}"));
        browser.click("#signals-all");
    }
    browser.wait("scope.views.signals.lanes.length === 0");

    // Overlaid curves of different units have axes of their own.
    browser.run("(() => { for (const box of [...document.querySelectorAll('#signal-list input[type=checkbox]')].slice(0, 6)) box.click(); })()");
    browser.click("[data-layout=overlay]");
    browser.wait("scope.views.signals.lanes.map(({ unit, curves }) => unit + curves.length).join() === 'deg3,deg/s1,V1,A1'");
    browser.wait(&format!("scope.views.signals.axes === 4 && {labelled}"));
    picture(&browser, "axes-overlaid");
    browser.click("#pause");
    browser.frames(3);

    // The wheel on an axis, and a drag of it, change that axis alone.
    let range = |n: u32| {
        format!("(({{ low, high }}) => [low, high])(scope.views.signals.lanes[{n}].scale)")
    };
    let before = [0, 1].map(|n| browser.run(&range(n)));
    let (_, y) = browser.middle("#plot");
    let left = number(&browser.run("document.querySelector('#plot').getBoundingClientRect().x"));
    let axis = (left + 3.5 * 62.0, y);
    browser.wheel(axis, -120.0);
    let size = |range: &Value| number(&range[1]) - number(&range[0]);
    browser.wait(&format!(
        "(([low, high]) => high - low)({}) < {} * 0.9",
        range(0),
        size(&before[0])
    ));
    let zoomed = browser.run(&range(0));
    let span = browser.run("scope.views.signals.chosenSpan");
    browser.drag(axis, (axis.0, axis.1 + 50.0));
    browser.wait(&format!("{}[0] > {}", range(0), number(&zoomed[0])));
    // The page fits this axis again in each frame; sums of another order differ in the last digits.
    let other = browser.run(&range(1));
    for end in [0, 1] {
        let moved = number(&other[end]) - number(&before[1][end]);
        assert!(moved.abs() < 1e-6, "{other} was {}", before[1]);
    }
    assert_eq!(browser.run("scope.views.signals.chosenSpan"), span);
    browser.key("y");
    browser.wait(&format!(
        "document.querySelector('#fit-y').disabled && Math.abs({}[0] - {}) < 1e-3",
        range(0),
        number(&before[0][0])
    ));

    // A signal has a scale and an offset of its own.
    let row = "document.querySelector('#signal-list li:nth-child(3)')";
    browser.run(&format!("{row}.querySelector('.more').click()"));
    browser.run(&format!("(() => {{ const [gain, offset] = {row}.querySelectorAll('.settings input'); gain.value = -10; offset.value = 1000; for (const one of [gain, offset]) one.dispatchEvent(new Event('change')); }})()"));
    let (low, high) = (number(&before[1][0]), number(&before[1][1]));
    let near = |n: usize, wanted: f64| format!("Math.abs({}[{n}] - {wanted}) < 1", range(1));
    browser.wait(&format!(
        "{} && {}",
        near(0, 1000.0 - 10.0 * high),
        near(1, 1000.0 - 10.0 * low)
    ));
    picture(&browser, "axes-scaled");
    is_content(&browser);
}

/// A signal may rest but for the rounding of its numbers, and an address may ask for any axis.
#[test]
fn an_axis_is_wider_than_the_rounding_of_its_numbers() {
    let Some(browser) = browser("rounding") else {
        return;
    };
    let mut file = Writer::new(Vec::new()).unwrap();
    let session = Record::Session {
        system: "machine",
        clock: ClockBase::Virtual,
        written_by: "a test",
    };
    file.put(&session).unwrap();
    let pairs = [[0.3, 0.1 + 0.2], [1.0, 1.0 + 2.0 * f64::EPSILON]];
    for (number, name) in [(0, "sum"), (1, "rest")] {
        let signal = SignalInfo {
            number,
            element_type: Type::F64,
            elements: 1,
            name,
            unit: "",
            description: "",
        };
        file.put(&Record::Signal(signal)).unwrap();
    }
    for n in 0..1000 {
        for (signal, pair) in (0..).zip(pairs) {
            let bytes = f64::to_le_bytes(pair[n % 2]);
            let sample = Record::Sample {
                signal,
                time: n as u64 * 1_000_000,
                values: Values::from_bytes(Type::F64, &bytes),
            };
            file.put(&sample).unwrap();
        }
    }
    let file = file.finish().unwrap();
    let scope = Scope::open(settings()).unwrap();
    scope.replay(&file[..], Speed::AT_ONCE).unwrap();
    let narrow = "span=1e-300&axis=rest from 1 to 1.0000000000000002";
    browser.open(&format!("{}#{narrow}", scope.url()), LAPTOP, "light");
    let labelled = "scope.views.signals.lanes.length > 0 && scope.views.signals.lanes.every(({ labels }) => new Set(labels).size >= 2 && labels.length < 100)";
    for layout in ["stack", "xy"] {
        browser.run(&format!("scope.views.signals.lay('{layout}')"));
        browser.frames(3);
        browser.wait(labelled);
    }
    assert_eq!(browser.run("scope.views.signals.span"), 20e-6);
    assert_eq!(browser.run("scope.views.signals.held.size"), 0);
    // However far an axis is zoomed, it has a range.
    browser.run("scope.views.signals.lay('stack')");
    browser.frames(3);
    browser.run("for (let n = 0; n < 200; n++) scope.views.signals.zoomY(0.5, scope.views.signals.lanes[0])");
    browser.frames(3);
    browser.wait(labelled);
    is_content(&browser);
}

#[test]
fn a_value_that_is_no_number_hides_no_extreme() {
    let Some(browser) = browser("extremes") else {
        return;
    };
    let scope = Scope::open(settings()).unwrap();
    browser.open(&scope.url(), LAPTOP, "light");
    let extremes = browser.run("import('/series.js').then(({ Series }) => { const series = new Series(1); for (let n = 0; n < 1000; n++) series.push(n, [n === 130 ? 100 : n === 131 ? -100 : n === 140 || n === 128 ? NaN : 0]); return series.columns(0, 0, 1000, 1, new Float64Array(1), new Float64Array(1)); })");
    assert_eq!(extremes, serde_json::json!([-100, 100]));
    is_content(&browser);
}
