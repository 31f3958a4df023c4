//! The layout in the address.

use super::{LAPTOP, browser, is_content, settings, still};
use crate::support::feeder::Feeder;
use crate::support::machine::{Machine, PERIOD};
use luna_scope::{Scope, Speed};

#[test]
fn the_address_restores_the_layout() {
    let Some((browser, scope)) = still("address") else {
        return;
    };
    assert_eq!(
        browser.run("location.hash"),
        "",
        "a page as it is at first has a plain address"
    );
    browser.click("[data-layout=overlay]");
    browser.run("(() => { const boxes = document.querySelectorAll('#signal-list input[type=checkbox]'); for (const n of [0, 1, 2, 3, 4, 5, 7, 29]) boxes[n].click(); })()");
    browser.wait("[...scope.views.signals.chosen].join() === 'tilt/angle,imu/acceleration[0]'");
    browser.run("scope.views.signals.rows.get('tilt/angle').adjust(-2, 5)");
    browser.key("s");
    browser.run("scope.views.signals.span = 10; scope.views.signals.zoom(0.5)");
    browser.frames(3);
    browser.run("scope.views.signals.zoomY(0.5, scope.views.signals.lanes[0])");
    let held = browser.run("JSON.stringify([...scope.views.signals.held].map(([key, { low, high }]) => [key, low, high]))");
    browser.wait("location.hash.includes('axis=')");
    let address = browser.run("location.href");
    let address = address.as_str().unwrap();
    assert!(
        address.starts_with(&scope.url()) && address.contains("layout=overlay&span=5&"),
        "{address}"
    );

    browser.navigate("about:blank");
    browser.open(address, LAPTOP, "light");
    browser.wait("scope.views.signals.lanes?.length === 2");
    let restored = browser.run("(() => { const s = scope.views.signals, { gain, offset } = s.rows.get('tilt/angle'); return JSON.stringify([s.layout, s.span, [...s.chosen], gain, offset, s.readings.statistics]); })()");
    assert_eq!(
        restored,
        r#"["overlay",5,["tilt/angle","imu/acceleration[0]"],-2,5,true]"#
    );
    assert_eq!(
        browser.run("JSON.stringify([...scope.views.signals.held].map(([key, { low, high }]) => [key, low, high]))"),
        held
    );

    // The view and the signals of X-Y, too; an address that is entered in an open page counts.
    browser.run("location.hash = 'view=timeline&layout=xy&x=tilt/angle&y=pan/speed'");
    browser.wait("!document.querySelector('#timeline').hidden && scope.views.signals.layout === 'xy' && scope.views.signals.xy.keys.join() === 'tilt/angle,pan/speed'");
    // One that means nothing changes nothing.
    browser.run("location.hash = 'view=constructor&layout=no&span=-1&axis=no&adjust=no&until=no'");
    browser
        .wait("!document.querySelector('#signals').hidden && scope.views.signals.layout === 'xy'");
    // An address counts also if a frame comes between its entry and the event that reports it.
    browser.run("(() => { location.hash = 'layout=overlay'; scope.address.write(); })()");
    browser.wait("scope.views.signals.layout === 'overlay'");
    is_content(&browser);
}

#[test]
fn the_address_of_a_paused_plot_stands_where_it_stood() {
    let Some(browser) = browser("until") else {
        return;
    };
    let scope = Scope::open(settings()).unwrap();
    let mut file = luna_logger::format::Writer::new(Vec::new()).unwrap();
    Machine::new().until(1500 * PERIOD, &mut |record| file.put(record).unwrap());
    let file = file.finish().unwrap();
    scope.replay(&file[..], Speed::AT_ONCE).unwrap();
    let url = format!("{}#span=0.5&until=1.25", scope.url());
    browser.open(&url, LAPTOP, "light");
    browser.wait("!scope.clock.live && scope.views.signals.window().join() === '0.75,1.25'");
    browser.wait("scope.views.signals.rows.get('pan/setpoint').columns.least.every(isFinite)");
    is_content(&browser);
}

/// The page may not have that instant yet when its first data comes: the scope says what it has.
#[test]
fn the_address_waits_for_what_the_scope_has_and_for_nothing_else() {
    let Some(browser) = browser("known") else {
        return;
    };
    let scope = Scope::open(settings()).unwrap();
    let mut file = luna_logger::format::Writer::new(Vec::new()).unwrap();
    Machine::new().until(3000 * PERIOD, &mut |record| file.put(record).unwrap());
    let file = file.finish().unwrap();
    scope.replay(&file[..], Speed::AT_ONCE).unwrap();
    let url = format!("{}#span=0.5&until=2.75", scope.url());
    browser.open(&url, LAPTOP, "light");
    browser.wait("!scope.clock.live && scope.views.signals.window().join() === '2.25,2.75'");
    is_content(&browser);
    drop(scope);

    // A run that goes on is followed, also when it comes to that instant later.
    let scope = Scope::open(settings()).unwrap();
    let url = format!("{}#span=0.5&until=1", scope.url());
    browser.navigate("about:blank");
    browser.open(&url, LAPTOP, "light");
    browser.wait("scope.connection.state === 'open'");
    let _feeder = Feeder::start(&scope, Machine::new());
    browser.wait("scope.clock.latest > 1.3");
    browser.frames(3);
    assert_eq!(browser.run("scope.clock.live"), true);
    browser.wait("location.hash === '#span=0.5'");
}

#[test]
fn the_token_does_not_stay_in_the_address() {
    let Some(browser) = browser("token") else {
        return;
    };
    let scope = Scope::open(settings().allow_setting().unwrap()).unwrap();
    let token = scope.url();
    let token = token.split("#token=").nth(1).unwrap();
    browser.open(&scope.url(), LAPTOP, "light");
    assert_eq!(browser.run("location.hash"), "");
    assert_eq!(browser.run("scope.connection.token"), token);
    // It is known in this tab all the same.
    browser.reload();
    browser.wait(&format!(
        "window.scope?.connection.token === '{token}' && location.hash === ''"
    ));
    is_content(&browser);
}
