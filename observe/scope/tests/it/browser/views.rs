//! Loops, timeline, composition and emergencies.

use super::{LAPTOP, browser, is_content, live, number, picture, settings};
use crate::support::machine::{Machine, PERIOD};
use luna_scope::{Scope, Speed};

#[test]
fn a_late_cycle_leads_to_the_timeline() {
    let Some((browser, _feeder, _scope)) = live("late") else {
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
    browser.wait("(() => { const { loops } = scope.views, { events } = scope.model; if (events.end === events.begin) return false; const known = events.time[(events.end - 1) & events.mask] - 0.01, rows = loops.shown.late.slice(-100).reverse(); const n = rows.findIndex(({ time }) => scope.model.seconds(time) < known); if (n < 0) return false; window.clicked = { seconds: scope.model.seconds(rows[n].time), lateness: rows[n].lateness / 1e9 }; document.querySelectorAll('#loops tbody tr button')[n].click(); return true; })()");
    browser.wait("!document.querySelector('#timeline').hidden && !scope.clock.live");
    // It hears of late cycles while it is paused, and stays where it is.
    browser
        .wait("scope.model.seconds(scope.model.counts.late.at(-1).time) > clicked.seconds + 0.01");
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
    let Some((browser, _feeder, _scope)) = live("composition") else {
        return;
    };
    browser.click("#tab-composition");
    browser.click("[data-composition=parts]");
    browser.wait("document.querySelectorAll('#tree .box').length === 20");
    let inside = browser.run("document.querySelectorAll('#tree .whole .box').length");
    assert_eq!(inside, 12, "sub-processes lie in their processes");
    for state in ["running", "waiting"] {
        browser.wait(&format!(
            "document.querySelector('#tree .box.{state}') !== null"
        ));
    }
    browser.wait("[...document.querySelectorAll('#tree .box p')].some((p) => p.textContent === 'waits for pan/angle (pan/scale)')");
    browser.wait("document.querySelectorAll('#channels tbody tr').length === 12");
    browser.wait("[...document.querySelectorAll('#channels tbody tr')].some((row) => row.cells[2].textContent.includes('pan/controller'))");
    browser.wait("parseInt(document.querySelector('#channels tbody tr').cells[1].textContent.replace(/\\D/g, '')) > 0");
    browser.click("#channels tbody tr");
    browser.wait("document.querySelectorAll('#tree .box.marked').length === 2");
    is_content(&browser);
}

#[test]
fn an_emergency_is_seen_on_every_view_and_text_stays_text() {
    let Some(browser) = browser("emergency") else {
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
fn a_late_cycle_scrolls_to_its_lane_and_space_pauses_on_buttons() {
    let Some((browser, _feeder, _scope)) = live("lane") else {
        return;
    };
    browser.look((1366, 420), "light");
    browser.run("scope.show('timeline')");
    browser.wait("scope.views.timeline.lanes.length > 20 && scope.views.timeline.box.scrollHeight > scope.views.timeline.box.clientHeight + 100");
    browser.run("scope.views.timeline.box.scrollTop = 10000");
    browser.frames(3);
    let seen = "(() => { const t = scope.views.timeline, late = scope.model.counts.late.at(-1); const top = t.of.get(scope.model.loops.get(late.loop).parent) * t.lane - t.box.scrollTop; return top >= 0 && top + t.lane <= t.box.clientHeight - 28; })()";
    assert_eq!(browser.run(seen), false);
    browser.click("#tab-loops");
    browser.wait("document.querySelector('#loops tbody button')");
    browser.click("#loops tbody button");
    browser.wait(&format!(
        "!document.querySelector('#timeline').hidden && {seen}"
    ));
    picture(&browser, "lane");

    // Once: neither the button is pressed, nor is the pause taken back.
    assert_eq!(browser.run("scope.clock.live"), false);
    browser.run("document.querySelector('#lanes-idle').focus()");
    browser.key(" ");
    browser.wait("scope.clock.live");
    assert_eq!(browser.run("scope.views.timeline.skips"), false);
    is_content(&browser);
}

/// The graph has a box for each process that communicates, a line for each channel, and shows which
/// end of it waits.
#[test]
fn the_graph_shows_which_process_waits_for_which() {
    let Some((browser, _feeder, _scope)) = live("graph") else {
        return;
    };
    browser.click("#tab-composition");
    browser.wait("document.querySelectorAll('#graph .line').length === 12 && document.querySelectorAll('#graph .box').length === 17");
    // Below what sends to it, and nothing on top of another.
    let places = "(() => { const of = (name) => [...document.querySelectorAll('#graph .box')].find((box) => box.querySelector('h3').textContent === name).getBoundingClientRect(); return ['read', 'scale', 'controller', 'safety', 'write'].map((part) => of(`pan/${part}`).y); })()";
    let places = browser.run(places);
    let places = places.as_array().unwrap();
    assert!(places.is_sorted_by(|one, other| number(one) < number(other)));
    let overlaps = browser.run("(() => { const all = [...document.querySelectorAll('#graph .box')].map((box) => box.getBoundingClientRect()); let n = 0; for (const a of all) for (const b of all) n += a !== b && a.x < b.right && b.x < a.right && a.y < b.bottom && b.y < a.bottom; return n; })()");
    assert_eq!(overlaps, 0);
    // The controller waits for the scaling, at the receiving end.
    let line = "[...document.querySelectorAll('#graph .line')].find((line) => line.querySelector('title').textContent === 'pan/angle')";
    browser.wait(&format!("{line}.dataset.waits === 'receiver'"));
    browser.wait("[...document.querySelectorAll('#graph .box p')].some((p) => p.textContent === 'waits for pan/angle (pan/scale)')");
    browser.run(&format!(
        "{line}.dispatchEvent(new MouseEvent('click', {{ bubbles: true }}))"
    ));
    browser.wait("[...document.querySelectorAll('#graph .box.marked h3')].map((one) => one.textContent).sort().join() === 'pan/controller,pan/scale'");
    browser.frames(3);
    picture(&browser, "graph");
    // Where there is no room for all of it, it scrolls.
    browser.look((400, 800), "light");
    browser.wait("document.querySelectorAll('#graph .line').length === 12 && (() => { const graph = document.querySelector('#graph'); return graph.clientWidth < 400 && graph.scrollWidth > graph.clientWidth; })()");
    browser.frames(3);
    picture(&browser, "graph-400");
    is_content(&browser);
}
