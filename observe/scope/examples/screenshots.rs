//! Makes the pictures of the documentation:
//! `cargo run -p luna-scope --example screenshots -- docs/scope`.

#[path = "../tests/support/mod.rs"]
mod support;

use luna_scope::{Scope, Settings};
use std::path::PathBuf;
use support::browser::{Browser, program};
use support::feeder::Feeder;
use support::machine::Machine;

const LAPTOP: (u32, u32) = (1366, 820);
const TABLET: (u32, u32) = (820, 1180);

fn main() {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| ".".to_owned()));
    let program = program().expect("chromium is needed (Debian: chromium)");
    let settings = Settings::default().address(([127, 0, 0, 1], 0).into());
    let scope = Scope::open(settings).unwrap();
    let feeder = Feeder::start(&scope, Machine::new());
    let browser = Browser::start(&program, "screenshots");
    browser.open(&scope.url(), LAPTOP, "light");
    browser.wait("scope.clock.now > 10.5");
    browser.screenshot(&folder.join("light.png"));

    browser.look(TABLET, "dark");
    browser.run("scope.show('loops')");
    browser.frames(10);
    browser.screenshot(&folder.join("tablet.png"));

    browser.look(LAPTOP, "dark");
    browser.run("scope.show('composition')");
    browser.frames(90);
    browser.screenshot(&folder.join("dark.png"));

    browser.look(LAPTOP, "light");
    browser.run("scope.show('timeline'); scope.views.timeline.lastLate()");
    browser.frames(10);
    browser.screenshot(&folder.join("late.png"));
    assert_eq!(browser.complaints(), [""; 0]);
    drop(feeder);
    #[cfg(target_os = "linux")]
    cell(&browser, &folder.join("cell.png"));
}

/// The Production Cell, while its feeder is broken.
#[cfg(target_os = "linux")]
fn cell(browser: &Browser, to: &std::path::Path) {
    use luna_production_cell::{Breakage, Unit, picture::CELL};

    let settings = Settings::default().address(([127, 0, 0, 1], 0).into());
    let scope = Scope::open(settings.picture(CELL)).unwrap();
    let path = browser.folder.join("cell.luna");
    support::cell::record(&path, (Unit::Feeder, Breakage::Sensor));
    let mut recording = std::fs::File::open(&path).unwrap();
    let speed = luna_scope::Speed::AT_ONCE;
    scope.replay_file(&mut recording, speed).unwrap();
    browser.open(&scope.url(), (1366, 768), "light");
    browser.wait("scope.clock.latest >= 5");
    browser.run("scope.show('picture'); scope.clock.pause(2.3)");
    browser.frames(10);
    browser.screenshot(to);
}
