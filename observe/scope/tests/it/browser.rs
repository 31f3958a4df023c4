//! The page in a real browser, a headless Chromium. Without one on this machine the tests are
//! skipped with a message.
//!
//! All waiting happens in the page; speed does not matter.

use crate::support;
use luna_scope::{Parameter, Parameters, Scope, Settings, Speed};
use serde_json::Value;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use support::browser::{Browser, program};
use support::feeder::Feeder;
use support::machine::{Machine, PERIOD};

const LAPTOP: (u32, u32) = (1366, 768);
const TABLET: (u32, u32) = (820, 1180);
const SIZES: [(u32, u32); 3] = [LAPTOP, TABLET, (1180, 820)];

/// A number that changes with the picture of the curves.
const PICTURE: &str = "(() => { const c = scope.views.signals.traces; const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; let h = 0; for (let i = 0; i < d.length; i += 4) if (d[i + 3]) h = (h * 31 + i) | 0; return h; })()";

fn browser(name: &str) -> Option<Browser> {
    let found = program();
    if found.is_none() {
        assert!(
            std::env::var_os("LUNA_NEEDS_CHROMIUM").is_none(),
            "chromium is missing"
        );
        eprintln!("skipped: the page in a browser, {name}: chromium is missing (Debian: chromium)");
    }
    Some(Browser::start(&found?, name))
}

/// A browser that gets no time on a busy machine is no stalled one.
fn settings() -> Settings {
    Settings::default()
        .address(([127, 0, 0, 1], 0).into())
        .patience(Duration::from_secs(3600))
}

/// A scope with a simulated machine in real time, and a browser that shows it.
fn live(name: &str) -> Option<(Browser, Feeder, Scope)> {
    let mut browser = browser(name)?;
    let scope = Scope::open(settings()).unwrap();
    let feeder = Feeder::start(&scope, Machine::new());
    browser.open(&scope.url(), LAPTOP, "light");
    browser.wait("[...scope.model.signals.values()][0].series.end > 1500 && scope.clock.now > 1");
    Some((browser, feeder, scope))
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value}"))
}

fn is_content(browser: &Browser) {
    assert_eq!(browser.complaints, [""; 0]);
}

#[test]
fn plots_move_pause_pan_and_zoom() {
    let Some((mut browser, _feeder, _scope)) = live("plots") else {
        return;
    };
    let before = browser.run(PICTURE);
    assert_ne!(before, 0, "curves are drawn");
    browser.wait(&format!("{PICTURE} !== {before}"));

    browser.click("#pause");
    // A scale comes to rest slowly; here it is at rest at once.
    browser.frames(3);
    browser.run("(() => { for (const { scale, low, high } of scope.views.signals.lanes) if (high > low) Object.assign(scale, { low, high }); })()");
    browser.frames(3);
    let still = browser.run(PICTURE);
    let now = browser.run("scope.clock.now");
    let known = browser.run("scope.model.samples");
    browser.frames(30);
    assert_eq!(browser.run(PICTURE), still);
    assert_eq!(browser.run("scope.clock.now"), now);
    assert_eq!(
        browser.run("scope.model.samples"),
        known,
        "memory stays as it is"
    );

    let plot = browser.middle("#plot");
    let span = number(&browser.run("scope.views.signals.span"));
    browser.wheel(plot, -120.0);
    browser.wait(&format!("scope.views.signals.span < {span}"));
    let span = number(&browser.run("scope.views.signals.span"));
    let end = number(&browser.run("scope.views.signals.end"));
    browser.drag(plot, (plot.0 + 200.0, plot.1));
    // The last part of the way may come later than the first.
    browser.wait(&format!("Math.abs(({end} - scope.views.signals.end) / ({span} * 200 / scope.views.signals.plotWidth) - 1) < 0.1"));

    browser.run("scope.views.signals.over.focus()");
    browser.key("+");
    browser.wait(&format!("scope.views.signals.span < {span}"));
    browser.key("Home");
    browser.wait(&format!(
        "scope.clock.live && scope.model.samples > {known}"
    ));
    browser.wait(&format!("{PICTURE} !== {still}"));
    is_content(&browser);
}

#[test]
fn a_trigger_holds_the_plot_where_the_level_is_crossed() {
    let Some((mut browser, _feeder, _scope)) = live("trigger") else {
        return;
    };
    browser.run("scope.views.signals.span = 0.5");
    browser.click("#trigger");
    browser.run("(() => { const s = document.querySelector('#trigger-signal'); s.value = 'pan/setpoint'; s.dispatchEvent(new Event('change')); const l = document.querySelector('#trigger-level'); l.value = 3; l.dispatchEvent(new Event('change')); })()");
    browser.wait("scope.views.signals.trigger.at !== null");
    let sides = browser.run("(() => { const { signals } = scope.views, { series } = signals.rows.get('pan/setpoint').signal; const index = series.find(signals.trigger.at); return [series.value(index - 1), series.value(index)]; })()");
    assert!(
        number(&sides[0]) < 3.0 && number(&sides[1]) >= 3.0,
        "{sides}"
    );
    let share = browser.run("(() => { const s = scope.views.signals; const [from, to] = s.window(); return (s.trigger.at - from) / (to - from); })()");
    assert!((number(&share) - 0.25).abs() < 1e-6, "{share}");

    // Once, and falling: then the plot is held.
    browser.run("(() => { const e = document.querySelector('#trigger-edge'); e.value = '-1'; e.dispatchEvent(new Event('change')); const m = document.querySelector('#trigger-mode'); m.value = 'single'; m.dispatchEvent(new Event('change')); })()");
    browser.wait("!scope.clock.live");
    let sides = browser.run("(() => { const { signals } = scope.views, { series } = signals.rows.get('pan/setpoint').signal; const index = series.find(signals.trigger.at); return [series.value(index - 1), series.value(index)]; })()");
    assert!(
        number(&sides[0]) > 3.0 && number(&sides[1]) <= 3.0,
        "{sides}"
    );
    is_content(&browser);
}

#[test]
fn cursors_show_values_and_differences() {
    let Some((mut browser, _feeder, _scope)) = live("cursors") else {
        return;
    };
    browser.run("scope.views.signals.span = 0.5");
    browser.click("#cursors");
    browser.wait("document.querySelectorAll('#cursor-table tbody tr').length === 7");
    browser.wait("document.querySelector('#cursor-table td.n').textContent.endsWith(' s')");
    let at = browser.run("(() => { const s = scope.views.signals, box = s.over.getBoundingClientRect(); return [box.x + s.x(s.cursors.at[1]), box.y + box.height / 2]; })()");
    let at = (number(&at[0]), number(&at[1]));
    let before = number(&browser.run("scope.views.signals.cursors.at[1]"));
    browser.drag(at, (at.0 + 60.0, at.1));
    browser.wait(&format!("scope.views.signals.cursors.at[1] > {before}"));
    browser.wait("(() => { const s = scope.views.signals, [a, b] = s.cursors.at, { series } = s.rows.get('pan/angle').signal; const cells = s.cursors.cells.get('pan/angle'); return Math.abs(parseFloat(cells[2].textContent.replace('−', '-')) - (series.at(b) - series.at(a))) < 1e-3 * Math.max(1, Math.abs(series.at(b) - series.at(a))); })()");
    is_content(&browser);
}

#[test]
fn what_is_shown_can_be_exported() {
    let Some((mut browser, _feeder, _scope)) = live("export") else {
        return;
    };
    let folder = browser.folder.join("downloads");
    browser.downloads_to(&folder);
    browser.click("#pause");
    // Back from the end, where some curves may be a sample ahead of others.
    browser.run("scope.views.signals.zoom(0.1); scope.views.signals.pan(40)");
    browser.frames(3);
    browser.click("#export-csv");
    browser.click("#export-png");
    let whole = |name: &str| loop {
        let file = std::fs::read(folder.join(name)).unwrap_or_default();
        if !file.is_empty() {
            return file;
        }
        std::thread::sleep(std::time::Duration::from_millis(10));
    };
    let text = String::from_utf8(whole("scope.csv")).unwrap();
    let mut lines = text.lines();
    let head = lines.next().unwrap();
    assert!(
        head.starts_with("time (s),pan/setpoint (deg),pan/angle (deg)"),
        "{head}"
    );
    let rows: Vec<Vec<f64>> = lines
        .map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect())
        .collect();
    assert!(rows.len() > 100 && rows.iter().all(|row| row.len() == 7));
    assert!(rows.is_sorted_by(|one, other| one[0] < other[0]));
    let script = format!(
        "scope.views.signals.rows.get('pan/angle').signal.series.at({})",
        rows[7][0] + 1e-7
    );
    assert_eq!(number(&browser.run(&script)), rows[7][2]);
    let picture = whole("scope.png");
    assert!(picture.starts_with(b"\x89PNG") && picture.len() > 4000);
    is_content(&browser);
}

#[test]
fn a_late_cycle_leads_to_the_timeline() {
    let Some((mut browser, _feeder, _scope)) = live("late") else {
        return;
    };
    browser.click("#tab-loops");
    browser.wait("document.querySelectorAll('#loops .card').length === 4 && document.querySelectorAll('#loops tbody tr').length >= 2");
    let row = browser.run(
        "[...document.querySelector('#loops tbody tr').cells].map((cell) => cell.textContent)",
    );
    let cause = row[3].as_str().unwrap();
    assert!(
        cause.starts_with("another process of its executor (") && cause.ends_with(" %)"),
        "{cause}"
    );
    let p50 = browser.run("document.querySelector('#loops .figures dd').textContent");
    assert!(p50.as_str().unwrap().ends_with(" µs"), "{p50}");
    // The counts may be ahead of the events: they have cycles after the last one that the page has
    // events of.
    browser.wait("(() => { const { loops } = scope.views, { events } = scope.model; if (events.end === events.begin) return false; const known = events.time[(events.end - 1) & events.mask] - 0.01, rows = loops.shown.late.slice(-100).reverse(); const n = rows.findIndex(({ time }) => loops.seconds(time) < known); if (n < 0) return false; window.clicked = { seconds: loops.seconds(rows[n].time), lateness: rows[n].lateness / 1e9 }; document.querySelectorAll('#loops tbody tr button')[n].click(); return true; })()");
    browser.wait("!document.querySelector('#timeline').hidden && !scope.clock.live");
    // It hears of late cycles while it is paused, and stays where it is.
    browser.wait(
        "scope.views.loops.seconds(scope.model.counts.late.at(-1).time) > clicked.seconds + 0.01",
    );
    let away = browser.run("Math.abs(scope.clock.now - clicked.seconds)");
    assert!(number(&away) < 1e-9, "{away}");
    // The events show which process ran for most of the lateness.
    let ran = browser
        .run("scope.views.timeline.ranFor(clicked.seconds - clicked.lateness, clicked.seconds, 1)");
    assert_eq!(ran, "calibration");
    browser.frames(3);
    let coloured = browser.run("(() => { const c = document.querySelector('#lanes canvas'); const d = c.getContext('2d').getImageData(200, 30, c.width - 200, c.height - 30).data; let n = 0; for (let i = 0; i < d.length; i += 4) if (d[i + 3] && d[i + 1] > d[i] + 60) n++; return n; })()");
    assert!(number(&coloured) > 500.0, "bars are drawn: {coloured}");
    // Idle time is left out: the rest keeps its order, and the inverse conversion agrees.
    browser.click("#lanes-idle");
    browser.wait("scope.views.timeline.knots !== null");
    let bent = browser.run("(() => { const t = scope.views.timeline, at = [...Array(50).keys()].map((n) => t.to - t.span * (1 - n / 50)); return [at.every((time, n) => n === 0 || t.x(time) > t.x(at[n - 1])), Math.max(...at.map((time) => Math.abs(t.time(t.x(time)) - time))) / t.span]; })()");
    assert_eq!(bent[0], true);
    assert!(number(&bent[1]) < 1e-6, "{bent}");
    browser.click("#lanes-idle");
    browser.wait("scope.views.timeline.knots === null");
    let span = number(&browser.run("scope.views.timeline.span"));
    let lanes = browser.middle("#lanes canvas");
    browser.wheel(lanes, -120.0);
    browser.wait(&format!("scope.views.timeline.span < {span}"));
    // Slowly on from there: the instant moves.
    let now = browser.run("scope.clock.now");
    browser.run("(() => { const s = document.querySelector('#speed'); s.value = '0.001'; s.dispatchEvent(new Event('change')); })()");
    browser.wait(&format!("scope.clock.now > {now}"));
    is_content(&browser);
}

#[test]
fn processes_change_their_states() {
    let Some((mut browser, _feeder, _scope)) = live("composition") else {
        return;
    };
    browser.click("#tab-composition");
    browser.wait("document.querySelectorAll('#tree .box').length === 20");
    let inside = browser.run("document.querySelectorAll('#tree .whole .box').length");
    assert_eq!(inside, 12, "sub-processes lie in their processes");
    for state in ["running", "waiting"] {
        browser.wait(&format!(
            "document.querySelector('#tree .box.{state}') !== null"
        ));
    }
    browser.wait("[...document.querySelectorAll('#tree .box p')].some((p) => p.textContent === 'waits for pan/angle')");
    browser.wait("document.querySelectorAll('#channels tbody tr').length === 12");
    browser.wait("[...document.querySelectorAll('#channels tbody tr')].some((row) => row.cells[2].textContent.includes('pan/controller'))");
    browser.wait("parseInt(document.querySelector('#channels tbody tr').cells[1].textContent.replace(/\\D/g, '')) > 0");
    browser.click("#channels tbody tr");
    browser.wait("document.querySelectorAll('#tree .box.marked').length === 2");
    is_content(&browser);
}

#[test]
fn an_emergency_is_seen_on_every_view_and_text_stays_text() {
    let Some(mut browser) = browser("emergency") else {
        return;
    };
    let mut file = luna_logger::format::Writer::new(Vec::new()).unwrap();
    let mut machine = Machine::new().emergency_at(1500);
    machine.until(2000 * PERIOD, &mut |record| file.put(record).unwrap());
    file.put(&luna_logger::format::Record::Message {
        thread: 1,
        time: 86_402_000_000_000,
        level: luna_logger::Level::Error,
        process: 0,
        truncated: false,
        target: "<img src=x>",
        text: "<img src=x onerror=alert(1)>",
    })
    .unwrap();
    let file = file.finish().unwrap();
    let scope = Scope::open(settings()).unwrap();
    scope.replay(&file[..], Speed::AT_ONCE).unwrap();
    browser.open(&scope.url(), LAPTOP, "light");
    browser.wait("!document.querySelector('#emergency').hidden && document.querySelector('#emergency').textContent.startsWith('Emergency, raised by joystick')");
    browser.click("#tab-messages");
    browser.wait("document.querySelectorAll('#messages tbody tr').length === 4");
    assert_eq!(
        browser.run("document.querySelectorAll('#messages img').length"),
        0
    );
    assert_eq!(
        browser.run("document.querySelector('#messages td.text').textContent"),
        "<img src=x onerror=alert(1)>"
    );
    is_content(&browser);
}

#[test]
fn it_fits_in_light_and_dark_on_laptop_and_tablet() {
    let Some((mut browser, _feeder, _scope)) = live("sizes") else {
        return;
    };
    for theme in ["light", "dark"] {
        for size in SIZES {
            browser.look(size, theme);
            browser.wait(&format!(
                "document.documentElement.dataset.theme === '{theme}' && innerWidth === {}",
                size.0
            ));
            for view in ["signals", "loops", "composition", "timeline", "messages"] {
                browser.run(&format!("scope.show('{view}')"));
                browser.frames(3);
                let overflow = browser.run(&format!("(() => {{ const v = document.querySelector('#{view}'); return [document.documentElement.scrollWidth - innerWidth, v.scrollWidth - v.clientWidth, document.querySelector('header').scrollWidth - innerWidth, document.documentElement.scrollHeight - innerHeight]; }})()"));
                for part in overflow.as_array().unwrap() {
                    assert!(number(part) <= 0.0, "{view} {size:?}: {overflow}");
                }
            }
        }
        let contrast = browser.run("(() => { const lum = (c) => { const [r, g, b] = c.match(/\\d+/g).map((x) => { x /= 255; return x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4; }); return 0.2126 * r + 0.7152 * g + 0.0722 * b; }; const text = lum(getComputedStyle(document.querySelector('footer')).color), ground = lum(getComputedStyle(document.querySelector('footer')).backgroundColor); return (Math.max(text, ground) + 0.05) / (Math.min(text, ground) + 0.05); })()");
        assert!(number(&contrast) >= 4.5, "{theme}: {contrast}");
    }
    // The switch goes the other way, and is remembered.
    browser.click("#theme");
    browser.wait("document.documentElement.dataset.theme === 'light'");
    is_content(&browser);
}

struct Gain(Mutex<f64>);

impl Parameters for Gain {
    fn list(&self) -> Vec<Parameter> {
        let gain = *self.0.lock().unwrap();
        vec![
            Parameter::new("pan/gain", gain)
                .unit("V/rad")
                .range(0.0, 50.0),
        ]
    }

    fn set(&self, _: &str, value: &Value) -> Result<(), String> {
        *self.0.lock().unwrap() = value.as_f64().ok_or("it is a number")?;
        Ok(())
    }
}

#[test]
fn parameters_can_be_set_with_the_token_and_only_looked_at_without() {
    let Some(mut browser) = browser("parameters") else {
        return;
    };
    let gain = Arc::new(Gain(Mutex::new(8.0)));
    let settings = settings().parameters(gain.clone()).allow_setting().unwrap();
    let scope = Scope::open(settings).unwrap();
    let url = scope.url();
    browser.open(url.split('#').next().unwrap(), LAPTOP, "light");
    browser.wait("!document.querySelector('#tab-parameters').hidden");
    browser.click("#tab-parameters");
    browser.wait("document.querySelector('.parameter input')?.value === '8'");
    assert_eq!(
        browser.run("document.querySelector('.parameter input').disabled"),
        true
    );

    browser.call("Page.navigate", serde_json::json!({"url": "about:blank"}));
    browser.open(&url, LAPTOP, "light");
    browser.wait("document.querySelector('.parameter input')?.disabled === false");
    browser.run("(() => { const i = document.querySelector('.parameter input'); i.value = 12.5; i.form.requestSubmit(); })()");
    browser.wait("scope.connection.sets.size === 0");
    browser.wait("document.querySelector('.parameter .error').textContent === ''");
    let set = *gain.0.lock().unwrap();
    assert_eq!(set, 12.5);
    is_content(&browser);
}
