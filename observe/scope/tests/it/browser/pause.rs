//! What a paused page takes in, and which keys pause.

use super::{LAPTOP, browser, is_content, settings, still};
use crate::support::machine::{Machine, PERIOD};
use luna_scope::{Scope, Speed};

/// What the scope says of the run is not lost when a paused page connects again and then follows.
#[test]
fn a_paused_page_that_connects_again_has_the_status_when_it_follows() {
    let Some(browser) = browser("paused") else {
        return;
    };
    let mut file = luna_logger::format::Writer::new(Vec::new()).unwrap();
    let mut machine = Machine::new().emergency_at(1500);
    machine.until(2000 * PERIOD, &mut |record| file.put(record).unwrap());
    let file = file.finish().unwrap();
    let scope = Scope::open(settings()).unwrap();
    scope.replay(&file[..], Speed::AT_ONCE).unwrap();
    browser.open(&scope.url(), LAPTOP, "light");
    let banner = "document.querySelector('#emergency')";
    browser.wait(&format!("!{banner}.hidden && scope.clock.latest > 1.9"));
    browser.click("#pause");
    // It is heard at once, and kept.
    scope.ended("completed after 2 s");
    browser.wait("scope.model.status.report === 'completed after 2 s'");
    browser.run("(() => { window.lost = scope.connection.socket; lost.close(); })()");
    browser.wait("scope.connection.socket !== lost && scope.connection.state === 'open' && scope.connection.kept.some(({ type }) => type === 'begin')");
    // The status follows with the first blocks, and comes once.
    browser.run("new Promise((done) => setTimeout(done, 1500))");
    browser.click("#pause");
    browser.wait("scope.clock.live && scope.clock.latest > 1.9");
    browser.frames(3);
    assert_eq!(browser.run(&format!("{banner}.hidden")), false);
    let kept = browser.run("[scope.model.status.report, scope.model.counts.late_in_all]");
    assert_eq!(kept, serde_json::json!(["completed after 2 s", 2]));
    is_content(&browser);
}

/// Space pauses wherever the focus is, except where it is text.
#[test]
fn space_pauses_on_checkboxes_and_selects_too() {
    let Some((browser, _scope)) = still("space") else {
        return;
    };
    let checkbox = "#signal-list input[type=checkbox]";
    let checked = format!("document.querySelector('{checkbox}').checked");
    browser.run(&format!("document.querySelector('{checkbox}').focus()"));
    browser.key(" ");
    browser.wait("!scope.clock.live");
    assert_eq!(browser.run(&checked), true);
    browser.key("Enter");
    browser.wait(&format!("!{checked}"));
    assert_eq!(browser.run("scope.clock.live"), false);

    // Letters choose in a select.
    browser.run("document.querySelector('#speed').focus()");
    browser.key("c");
    assert_eq!(browser.run("scope.views.signals.cursors.on"), false);
    browser.key(" ");
    browser.wait("scope.clock.live");

    browser.run("document.querySelector('#signal-filter').focus()");
    browser.key(" ");
    browser.wait("document.querySelector('#signal-filter').value === ' '");
    assert_eq!(browser.run("scope.clock.live"), true);
    is_content(&browser);
}
