//! What was before the page came, and where a file is looked at.

use super::{LAPTOP, browser, is_content, number, picture, settings};
use crate::support::machine::{Machine, PERIOD};
use luna_scope::{Scope, Speed};
use std::sync::Arc;
use std::time::Duration;

/// A page that comes when the first part of a recording is no longer kept counts from the
/// recording's start all the same, and says what it does not have.
#[test]
fn a_page_that_comes_late_counts_from_the_start_and_says_what_is_gone() {
    let Some(browser) = browser("start") else {
        return;
    };
    let scope = Scope::open(settings().memory(1 << 20)).unwrap();
    let mut file = luna_logger::format::Writer::new(Vec::new()).unwrap();
    let mut machine = Machine::new().emergency_at(1500);
    machine.until(8000 * PERIOD, &mut |record| file.put(record).unwrap());
    let file = file.finish().unwrap();
    scope.replay(&file[..], Speed::AT_ONCE).unwrap();
    browser.open(&scope.url(), LAPTOP, "light");
    browser.wait("scope.clock.latest > 7.9 && scope.clock.latest < 8.1");
    // More is kept of the signals than of the many more events; the rest is an overview.
    let kept = browser.run("[scope.model.samplesFrom, scope.model.eventsFrom]");
    let (samples, events) = (number(&kept[0]), number(&kept[1]));
    assert!(4.0 < samples && samples < events && events < 8.0, "{kept}");
    let first = "[...scope.model.signals.values()][0].series.time(0)";
    assert!(
        (number(&browser.run(first)) - samples).abs() < 0.1,
        "{kept}"
    );
    let said = format!(
        "of signals until {samples:.1} s an overview · of messages until {samples:.1} s the last warnings and errors · of events until {events:.1} s nothing is kept"
    );
    browser.wait(&format!(
        "document.querySelector('#losses').textContent === '{said}'"
    ));

    // The last emergency is marked, and warnings and errors, though there is no more of them.
    browser.wait("scope.model.marks.all.filter(({ kind }) => kind === 'error' || kind === 'emergency').map(({ kind, time }) => kind + time.toFixed(3)).join() === 'error1.501,emergency1.501'");
    browser.wait(
        "scope.model.messages.map(({ time }) => time.toFixed(1)).join() === '0.7,1.5,3.7,6.7'",
    );
    // Late cycles are marked from the start on.
    browser.wait("scope.model.marks.all.filter(({ kind }) => kind === 'late').map(({ time }) => Math.round(time * 10) / 10).join() === '0.7,0.7,3.7,3.7,6.7,6.7'");

    // All of the run can be seen, as coarse as it is, and looked at where one likes.
    browser.key("f");
    browser.wait("Math.abs(scope.views.signals.span - 8) < 0.1");
    let drawn = "(() => { const { columns } = scope.views.signals.rows.get('pan/setpoint'); let n = 0; for (const one of columns.least) n += isFinite(one); return n / columns.least.length; })()";
    browser.wait(&format!("{drawn} > 0.95"));
    let extremes = "(() => { const { columns } = scope.views.signals.rows.get('pan/setpoint'); return [Math.min(...columns.least), Math.max(...columns.most)]; })()";
    let before = browser.run(extremes);
    assert!(
        number(&before[0]) < -20.0 && number(&before[1]) > 20.0,
        "{before}"
    );
    browser.run("scope.views.signals.span = 1");
    let bar = browser.middle("#whole");
    browser.drag(bar, (bar.0 - 300.0, bar.1));
    browser.wait("!scope.clock.live && scope.views.signals.end < 3.2 && document.querySelector('#whole').ariaValueNow < 2.8");
    browser.frames(3);
    picture(&browser, "whole");

    // What the scope has is there again after the connection was lost.
    browser.key("Home");
    browser.key("f");
    browser.run("(() => { window.lost = scope.connection.socket; lost.close(); })()");
    browser.wait("scope.connection.socket !== lost && scope.connection.state === 'open' && scope.clock.latest > 7.9");
    browser.wait(&format!("{drawn} > 0.95"));
    assert_eq!(browser.run(extremes), before);
    is_content(&browser);
}

/// A file is seen as a whole while it is played, and played on from where one seeks.
#[test]
fn a_file_is_sought_in() {
    let Some(browser) = browser("seek") else {
        return;
    };
    let scope = Arc::new(Scope::open(settings().memory(1 << 20)).unwrap());
    let mut file = luna_logger::format::Writer::new(Vec::new()).unwrap();
    Machine::new().until(8000 * PERIOD, &mut |record| file.put(record).unwrap());
    let file = file.finish().unwrap();
    browser.open(&scope.url(), LAPTOP, "light");
    browser.wait("scope.connection.state === 'open'");
    let (stop, stops) = std::sync::mpsc::channel::<()>();
    let player = std::thread::spawn({
        let scope = scope.clone();
        move || {
            let mut file = std::io::Cursor::new(file);
            // Slow, so that the page seeks long before its end.
            let speed = Speed::times(0.05);
            scope.replay_file(&mut file, speed).unwrap();
            while stops.try_recv().is_err() {
                let short = Duration::from_millis(20);
                scope.replay_sought(&mut file, speed, short).unwrap();
            }
        }
    });
    browser.wait("scope.model.until > 7.9 && scope.clock.latest > 0.02");
    browser.run("scope.views.signals.zoom(0.1)");
    // In the middle of the bar, and then near its end, of which all is shown at once.
    for (at, place) in [("0.5", 0.0), ("0.95", 0.45)] {
        let (x, y) = browser.middle("#whole");
        let wide = number(&browser.run("scope.views.signals.plotWidth"));
        let to = (x + 24.0 + wide * place, y);
        browser.drag((to.0 - 30.0, y), to);
        browser.wait(&format!(
            "scope.clock.live && Math.abs(scope.model.samplesFrom - ({at} * 8 - 0.5)) < 0.4"
        ));
        let first = "[...scope.model.signals.values()][0].series";
        browser.wait(&format!(
            "{first}.end > 500 && Math.abs({first}.time(0) - scope.model.samplesFrom) < 0.1"
        ));
        browser.wait("scope.model.processes.size >= 20 && scope.model.events.end > 1000");
        let whole = "(() => { const { overview } = [...scope.model.signals.values()][0].series; let n = 0; for (const one of overview.least[0]) n += one === one; return n * overview.span; })()";
        assert!((number(&browser.run(whole)) - 8.0).abs() < 0.1);
    }
    browser.wait("scope.clock.latest > 7.9");
    browser.key("f");
    browser.frames(3);
    picture(&browser, "seek");
    is_content(&browser);
    stop.send(()).unwrap();
    player.join().unwrap();
}
