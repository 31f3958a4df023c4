//! The page in a real browser, a headless Chromium. Without one on this machine the tests are
//! skipped with a message.
//!
//! All waiting happens in the page; speed does not matter.

mod address;
mod axes;
#[cfg(target_os = "linux")]
mod drawing;
mod ending;
mod history;
mod looks;
mod marks;
mod parameters;
mod pause;
mod picture;
mod plot;
mod programs;
mod seek;
mod views;

use crate::support;
use luna_logger::format::Writer;
use luna_scope::{Scope, Settings, Speed};
use serde_json::Value;
use std::sync::LazyLock;
use std::time::Duration;
use support::browser::{Browser, program};
use support::feeder::Feeder;
use support::machine::{Machine, PERIOD};

const LAPTOP: (u32, u32) = (1366, 768);

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
    let browser = browser(name)?;
    let scope = Scope::open(settings()).unwrap();
    let feeder = Feeder::start_at(&scope, Machine::new(), Duration::from_millis(1600));
    browser.open(&scope.url(), LAPTOP, "light");
    browser.wait("[...scope.model.signals.values()][0].series.end > 1500 && scope.clock.now > 1");
    Some((browser, feeder, scope))
}

/// A scope that has played the start of that machine's recording, and a browser that shows it: for
/// what does not need more to come.
fn still(name: &str) -> Option<(Browser, Scope)> {
    static RECORDING: LazyLock<Vec<u8>> = LazyLock::new(|| {
        let mut file = Writer::new(Vec::new()).unwrap();
        Machine::new().until(1600 * PERIOD, &mut |record| file.put(record).unwrap());
        file.finish().unwrap()
    });
    let browser = browser(name)?;
    let scope = Scope::open(settings()).unwrap();
    scope.replay(&RECORDING[..], Speed::AT_ONCE).unwrap();
    browser.open(&scope.url(), LAPTOP, "light");
    browser.wait("[...scope.model.signals.values()][0].series.end > 1500 && scope.clock.now > 1.5");
    Some((browser, scope))
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value}"))
}

/// Keeps a picture to look at, in the folder that `LUNA_PICTURES` names.
fn picture(browser: &Browser, name: &str) {
    if let Some(folder) = std::env::var_os("LUNA_PICTURES") {
        browser.screenshot(&std::path::Path::new(&folder).join(format!("{name}.png")));
    }
}

fn is_content(browser: &Browser) {
    assert_eq!(browser.complaints(), [""; 0]);
}

/// Without this, [`is_content`] could not fail.
#[test]
fn what_the_page_complains_about_is_heard() {
    let Some(browser) = browser("complaints") else {
        return;
    };
    browser.run(
        "console.warn('careful'); setTimeout(() => { throw new Error('thrown'); }); \
         new Promise((done) => setTimeout(done, 10))",
    );
    let complaints = browser.complaints();
    assert_eq!(complaints.len(), 2, "{complaints:?}");
    assert!(complaints[0].contains("careful"), "{complaints:?}");
    assert!(complaints[1].contains("thrown"), "{complaints:?}");
    is_content(&browser);
}
