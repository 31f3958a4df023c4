//! Marks on the time axis.

use super::{LAPTOP, browser, is_content, number, picture, settings};
use crate::support::feeder::Feeder;
use crate::support::machine::{Machine, PERIOD};
use luna_scope::{Parameter, Parameters, Scope, Speed};
use serde_json::Value;
use std::sync::{Arc, Mutex};

#[test]
fn emergencies_warnings_and_late_cycles_are_marked() {
    let Some(browser) = browser("marks") else {
        return;
    };
    let mut file = luna_logger::format::Writer::new(Vec::new()).unwrap();
    let mut machine = Machine::new().emergency_at(1500);
    machine.until(4000 * PERIOD, &mut |record| file.put(record).unwrap());
    let file = file.finish().unwrap();
    let scope = Scope::open(settings()).unwrap();
    scope.replay(&file[..], Speed::AT_ONCE).unwrap();
    browser.open(&scope.url(), LAPTOP, "light");
    // Two late cycles of two loops, each with its warning; the emergency with its error.
    browser.wait("scope.model.marks.all.map(({ kind }) => kind).join() === 'late,late,warning,error,emergency,late,late,warning'");
    let times = browser.run("scope.model.marks.all.map(({ time }) => time)");
    assert!((number(&times[4]) - 1.50096).abs() < 1e-6, "{times}");

    // Where they are drawn, the axis has their colour.
    browser.key("f");
    browser.frames(3);
    let drawn = "(() => { const s = scope.views.signals, c = s.over.getContext('2d'); return s.model.marks.all.map(({ time }) => { const [r, g, b, a] = c.getImageData(Math.round(s.x(time)), s.over.clientHeight - 34, 1, 1).data; return a > 200 && r > g && r > b; }); })()";
    let drawn = browser.run(drawn);
    let drawn = drawn.as_array().unwrap();
    assert!(drawn.iter().all(|is| *is == true), "{drawn:?}");

    // By keys from one to the next; the text is shown and read out.
    let tip = "document.querySelector('#plot .tip')";
    browser.run("scope.views.signals.span = 0.02");
    browser.run("scope.views.signals.showAt(1.49)");
    browser.frames(3);
    browser.key("n");
    browser.wait(&format!(
        "{tip}.textContent.includes('the emergency stop was pressed')"
    ));
    browser.key("n");
    browser.wait(&format!(
        "!{tip}.hidden && {tip}.textContent.includes('emergency, raised by joystick')"
    ));
    browser.frames(3);
    picture(&browser, "marks");
    browser.key("p");
    browser.key("p");
    browser.wait(&format!(
        "{tip}.textContent.includes('a cycle began late: `calibration` ran instead')"
    ));

    // A click on a late cycle leads to the timeline.
    browser.run("scope.views.signals.showAt(scope.model.marks.all[0].time)");
    browser.frames(3);
    let at = browser.run("(() => { const s = scope.views.signals, box = s.over.getBoundingClientRect(); return [box.x + s.x(scope.model.marks.all[0].time), box.bottom - 34]; })()");
    let at = (number(&at[0]), number(&at[1]));
    browser.drag(at, at);
    browser.wait(
        "!document.querySelector('#timeline').hidden && Math.abs(scope.clock.now - 0.7) < 0.01",
    );
    is_content(&browser);
}

struct Gain(Mutex<f64>);

impl Parameters for Gain {
    fn list(&self) -> Vec<Parameter> {
        vec![Parameter::new("pan/gain", *self.0.lock().unwrap())]
    }

    fn set(&self, _: &str, value: &Value) -> Result<(), String> {
        *self.0.lock().unwrap() = value.as_f64().ok_or("it is a number")?;
        Ok(())
    }
}

#[test]
fn changed_parameters_are_marked_for_those_too_who_come_later() {
    let Some(browser) = browser("changes") else {
        return;
    };
    let gain = Arc::new(Gain(Mutex::new(8.0)));
    let settings = settings().parameters(gain.clone()).allow_setting().unwrap();
    let scope = Scope::open(settings).unwrap();
    let _feeder = Feeder::start(&scope, Machine::new());
    browser.open(&scope.url(), LAPTOP, "light");
    browser.wait("scope.clock.latest > 0.5 && document.querySelector('.parameter input')?.disabled === false");
    browser.run("scope.connection.set('pan/gain', 12.5)");
    let changes = "scope.model.marks.all.filter(({ kind }) => kind === 'parameter')";
    browser.wait(&format!(
        "{changes}.map(({{ text }}) => text).join() === 'pan/gain: 8 → 12.5'"
    ));
    let at = number(&browser.run(&format!("{changes}[0].time")));
    assert!(at > 0.4, "{at}");
    // The program's own changes are seen as well.
    *gain.0.lock().unwrap() = 3.0;
    browser.wait(&format!(
        "{changes}.map(({{ text }}) => text).join() === 'pan/gain: 8 → 12.5,pan/gain: 12.5 → 3'"
    ));
    browser.navigate("about:blank");
    browser.open(&scope.url(), LAPTOP, "light");
    browser.wait(&format!(
        "{changes}.length === 2 && Math.abs({changes}[0].time - {at}) < 1e-6"
    ));
    is_content(&browser);
}
