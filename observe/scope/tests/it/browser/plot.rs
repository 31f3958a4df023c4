//! The plot: time, trigger, cursors, export.

use super::{PICTURE, is_content, live, number, picture, still};
use serde_json::Value;

#[test]
fn plots_move_pause_pan_and_zoom() {
    let Some((browser, _feeder, _scope)) = live("plots") else {
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
    let Some((browser, _feeder, _scope)) = live("trigger") else {
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
    let Some((browser, _feeder, _scope)) = live("cursors") else {
        return;
    };
    browser.run("scope.views.signals.span = 0.5");
    browser.click("#cursors");
    browser.wait("document.querySelectorAll('#readings tbody tr').length === 7");
    browser.wait("document.querySelector('#readings td.n').textContent.endsWith(' s')");
    let at = browser.run("(() => { const s = scope.views.signals, box = s.over.getBoundingClientRect(); return [box.x + s.x(s.cursors.at[1]), box.y + box.height / 2]; })()");
    let at = (number(&at[0]), number(&at[1]));
    let before = number(&browser.run("scope.views.signals.cursors.at[1]"));
    browser.drag(at, (at.0 + 60.0, at.1));
    browser.wait(&format!("scope.views.signals.cursors.at[1] > {before}"));
    browser.wait("(() => { const s = scope.views.signals, [a, b] = s.cursors.at, { series } = s.rows.get('pan/angle').signal; const cells = s.readings.cells.get('pan/angle'); return Math.abs(parseFloat(cells[2].textContent.replace('−', '-')) - (series.at(b) - series.at(a))) < 1e-3 * Math.max(1, Math.abs(series.at(b) - series.at(a))); })()");
    is_content(&browser);
}

#[test]
fn what_is_shown_can_be_exported() {
    let Some((browser, _scope)) = still("export") else {
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
fn statistics_are_those_of_the_visible_samples() {
    let Some((browser, _scope)) = still("statistics") else {
        return;
    };
    browser.run("scope.views.signals.span = 0.7");
    browser.key("s");
    browser.click("#pause");
    browser.wait("document.querySelectorAll('#readings tbody tr').length === 7");
    // Beside the sums of blocks: one by one.
    let wanted = "(() => { const s = scope.views.signals, [from, to] = s.window(), { series } = s.rows.get('pan/angle').signal; let n = 0, sum = 0, squares = 0, least = Infinity, most = -Infinity; for (let i = series.begin; i < series.end; i++) { const t = series.time(i), v = series.value(i); if (t < from || t >= to) continue; n++; sum += v; squares += v * v; least = Math.min(least, v); most = Math.max(most, v); } return [n, sum / n, Math.sqrt(squares / n), least, most]; })()";
    let found = "(() => { const s = scope.views.signals; const { number, mean, rms, least, most } = s.rows.get('pan/angle').signal.series.statistics(0, ...s.window()); return [number, mean, rms, least, most]; })()";
    let (wanted, found) = (browser.run(wanted), browser.run(found));
    assert!((600.0..=701.0).contains(&number(&wanted[0])), "{wanted}");
    for n in 0..5 {
        let (wanted, found) = (number(&wanted[n]), number(&found[n]));
        assert!((wanted - found).abs() <= 1e-9 * wanted.abs(), "{n}");
    }
    let shown = "Math.max(...scope.views.signals.readings.cells.get('pan/angle').map((cell, n) => Math.abs(parseFloat(cell.textContent.replace('−', '-')) - wanted[n + 1]) / Math.max(1, Math.abs(wanted[n + 1]))))";
    browser.wait(&format!(
        "(() => {{ const wanted = {wanted}; return {shown} < 1e-3; }})()"
    ));
    // With the cursors, the same table has both.
    browser.key("c");
    browser.wait("[...document.querySelectorAll('#readings thead th')].map((one) => one.textContent).join() === 'A,B,B − A,mean,rms,min,max'");
    picture(&browser, "statistics");
    is_content(&browser);
}

#[test]
fn one_signal_is_drawn_over_another() {
    let Some((browser, _scope)) = still("xy") else {
        return;
    };
    browser.click("[data-layout=xy]");
    browser.run("(() => { for (const [id, key] of [['x', 'pan/speed'], ['y', 'pan/angle']]) { const select = document.querySelector(`#xy-${id}`); select.value = key; select.dispatchEvent(new Event('change')); } })()");
    browser.wait("scope.views.signals.xy.keys.join() === 'pan/speed,pan/angle'");
    browser.click("#pause");
    browser.frames(3);
    // Both were sampled at the same instants.
    let pairs = "(() => { const s = scope.views.signals, { xs, ys } = s.xy.points, x = s.rows.get('pan/speed').signal.series, y = s.rows.get('pan/angle').signal.series; const first = x.find(s.window()[0]); return xs.length > 900 && [1, 400, 800].every((n) => { const at = xs.indexOf(x.value(first + n)); return at >= 0 && ys[at] === y.value(first + n); }); })()";
    browser.wait(pairs);
    assert_ne!(browser.run(PICTURE), 0, "the curve is drawn");
    assert_eq!(
        browser.run("scope.views.signals.xy.lane.labels.length >= 2 && scope.views.signals.lanes[0].labels.length >= 2"),
        true
    );
    picture(&browser, "xy");

    // The wheel on the axis of X changes that alone.
    let range = |of: &str| format!("(({{ low, high }}) => high - low)({of}.scale)");
    let (x, y) = (
        range("scope.views.signals.xy.lane"),
        range("scope.views.signals.lanes[0]"),
    );
    let (before, beside) = (number(&browser.run(&x)), browser.run(&y));
    let at = browser.run("(() => { const box = document.querySelector('#plot').getBoundingClientRect(); return [box.x + box.width / 2, box.bottom - 14]; })()");
    browser.wheel((number(&at[0]), number(&at[1])), -120.0);
    browser.wait(&format!("{x} < {before} * 0.9"));
    assert_eq!(browser.run("scope.views.signals.chosenSpan"), Value::Null);
    assert!((number(&browser.run(&y)) - number(&beside)).abs() < 0.2 * number(&beside));
    browser.key("y");
    browser.wait(&format!("{x} > {before} * 0.9"));
    is_content(&browser);
}

#[test]
fn a_plot_fits_the_run_and_shows_nothing_before_it() {
    let Some((browser, _scope)) = still("fits") else {
        return;
    };
    let window = "scope.views.signals.window()";
    browser.frames(2);
    let shown = browser.run(&format!("[...{window}, scope.clock.now]"));
    assert_eq!(number(&shown[0]), 0.0, "{shown}");
    assert!(number(&shown[1]) > 1.5, "{shown}");
    // A longer span leaves room behind the run, and none before it.
    browser.run("scope.views.signals.span = 100");
    let shown = browser.run(window);
    assert_eq!(
        (number(&shown[0]), number(&shown[1])),
        (0.0, 100.0),
        "{shown}"
    );
    browser.run("scope.views.signals.pan(5000)");
    assert_eq!(number(&browser.run(window)[0]), 0.0);
    is_content(&browser);
}

#[test]
fn differences_have_as_many_digits_as_their_values() {
    let Some((browser, _scope)) = still("digits") else {
        return;
    };
    browser.click("#cursors");
    browser.wait("document.querySelectorAll('#readings tbody tr').length === 7");
    let digits = "[...document.querySelectorAll('#readings tbody tr')].slice(1).map((row) => new Set([...row.querySelectorAll('td')].slice(0, 3).map((cell) => cell.textContent.split(' ')[0].split('.')[1]?.length ?? 0)).size)";
    browser.wait(&format!("{digits}.every((sizes) => sizes === 1)"));
    is_content(&browser);
}
