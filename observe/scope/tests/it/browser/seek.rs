//! Seeking in a file, where the page has some of it.

use super::{LAPTOP, browser, is_content, number, settings};
use crate::support::browser::Browser;
use luna_logger::format::{ClockBase, Record, SignalInfo, Type, Values, Writer};
use luna_scope::{Scope, Speed};
use std::io::Cursor;
use std::sync::Arc;
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

/// A scope that plays a file again and again, from where it is sought.
struct Player {
    scope: Arc<Scope>,
    stop: Sender<()>,
    thread: JoinHandle<()>,
}

impl Player {
    /// Plays when the page is there.
    fn start(browser: &Browser, file: Vec<u8>, speed: Speed) -> Player {
        let scope = Arc::new(Scope::open(settings()).unwrap());
        browser.open(&scope.url(), LAPTOP, "light");
        browser.wait("scope.connection.state === 'open'");
        let (stop, stops) = channel::<()>();
        let thread = std::thread::spawn({
            let scope = scope.clone();
            move || {
                let mut file = Cursor::new(file);
                scope.replay_file(&mut file, speed).unwrap();
                while stops.try_recv().is_err() {
                    let short = Duration::from_millis(20);
                    scope.replay_sought(&mut file, speed, short).unwrap();
                }
            }
        });
        Player {
            scope,
            stop,
            thread,
        }
    }

    fn end(self) {
        self.stop.send(()).unwrap();
        drop(self.scope);
        self.thread.join().unwrap();
    }
}

/// A signal of 1 kHz for so many seconds, and another that begins in the middle.
fn file(seconds: u64) -> Vec<u8> {
    let mut file = Writer::new(Vec::new()).unwrap();
    let session = Record::Session {
        system: "machine",
        clock: ClockBase::Virtual,
        written_by: "a test",
    };
    file.put(&session).unwrap();
    let count = seconds * 1000;
    for n in 0..=count {
        for (number, name, begins) in [(0, "first", 0), (1, "second", count / 2)] {
            if n < begins {
                continue;
            }
            if n == begins {
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
            let bytes = (n as f64 * 1e-3).to_le_bytes();
            let sample = Record::Sample {
                signal: number,
                time: 5_000_000_000 + n * 1_000_000,
                values: Values::from_bytes(Type::F64, &bytes),
            };
            file.put(&sample).unwrap();
        }
    }
    file.finish().unwrap()
}

/// Clicks the bar at this share of its width.
fn click(browser: &Browser, share: f64) {
    browser.frames(3);
    let at = browser.run("(() => { const box = document.querySelector('#whole').getBoundingClientRect(), { whole } = scope.views.signals; return [box.x + whole.left, whole.width, box.y + box.height / 2]; })()");
    let at = (number(&at[0]) + number(&at[1]) * share, number(&at[2]));
    browser.drag(at, at);
}

const SERIES: &str = "scope.model.signals.get(0).series";

/// A page that was there from the start has dropped the first samples itself: it says so, and gets
/// them again.
#[test]
fn what_the_page_has_dropped_is_said_and_fetched() {
    let Some(browser) = browser("dropped") else {
        return;
    };
    let player = Player::start(&browser, file(150), Speed::times(2000.0));
    browser.wait("scope.clock.latest > 149.99");
    assert_eq!(browser.run("scope.model.samplesFrom"), 0);
    let kept = number(&browser.run(&format!("{SERIES}.time({SERIES}.begin)")));
    assert!(kept > 16.0, "{kept}");
    let said = format!("of signals until {kept:.1} s an overview");
    browser.wait(&format!(
        "document.querySelector('#losses').textContent === '{said}'"
    ));
    // It plays on: the first of what is fetched is dropped again soon.
    browser.run("(() => { const { model } = scope, { sample } = model; model.sample = (...one) => { if (one[0] === 0 && model.samplesFrom > 0) window.first ??= one[1]; sample.apply(model, one); }; })()");
    click(&browser, 10.0 / 150.0);
    browser.wait("Math.abs(scope.model.samplesFrom - 5) < 1 && window.first < 6");
    // All of the run is more than the page holds: it stays an overview.
    browser.wait(&format!(
        "scope.clock.latest > 149.99 && {SERIES}.begin > 0"
    ));
    browser.run("scope.connection.seek = (...range) => { throw new Error(`it seeks ${range}`); }");
    browser.key("f");
    click(&browser, 0.5);
    browser.frames(3);
    assert_eq!(browser.run("scope.clock.live"), false);
    is_content(&browser);
    player.end();
}

/// The plot may reach over both ends of the file.
#[test]
fn what_is_in_memory_is_not_fetched() {
    let Some(browser) = browser("there") else {
        return;
    };
    let player = Player::start(&browser, file(20), Speed::times(100.0));
    browser.wait("scope.clock.latest > 19.99");
    browser.run("scope.connection.seek = (...range) => { throw new Error(`it seeks ${range}`); }");
    for share in [0.05, 0.97] {
        click(&browser, share);
        browser.wait("!scope.clock.live");
    }
    browser.key("f");
    for share in [0.5, 0.1] {
        click(&browser, share);
    }
    browser.frames(3);
    assert_eq!(browser.run("scope.clock.live"), false);
    is_content(&browser);
    player.end();
}

/// A file that is played at once stands at what is sought.
#[test]
fn a_file_that_is_played_at_once_stands_where_it_is_sought() {
    let Some(browser) = browser("at-once") else {
        return;
    };
    let player = Player::start(&browser, file(150), Speed::AT_ONCE);
    browser.wait("scope.clock.latest > 149.99");
    for place in [10.0, 100.0] {
        click(&browser, place / 150.0);
        browser.wait(&format!(
            "Math.abs(scope.model.samplesFrom - {place} + 5) < 1 && scope.clock.latest > {place} + 4"
        ));
        browser.run("new Promise((done) => setTimeout(done, 500))");
        let now = number(&browser.run("scope.clock.now"));
        assert!((now - place - 5.0).abs() < 1.0, "{now}");
        // All that the plot shows is there.
        let window = browser.run("scope.views.signals.window()");
        let (from, to) = (number(&window[0]), number(&window[1]));
        browser
            .run("scope.views.signals.whole.seek = () => { throw new Error('it seeks again'); }");
        browser.run(&format!(
            "scope.views.signals.showAt({from} / 2 + {to} / 2)"
        ));
        browser.run("scope.views.signals.whole.fetch()");
        browser
            .run("scope.views.signals.whole.seek = (...range) => scope.connection.seek(...range)");
    }
    is_content(&browser);
    player.end();
}

/// The overview comes before the signal is declared.
#[test]
fn a_signal_that_is_declared_later_has_its_overview() {
    let Some(browser) = browser("later") else {
        return;
    };
    let player = Player::start(&browser, file(20), Speed::times(10.0));
    browser.wait("scope.model.signals.size === 2");
    let overview = browser.run("(() => { const { overview } = scope.model.signals.get(1).series; let n = 0; for (const one of overview.least[0]) n += one === one; return [overview.isWhole, n * overview.span]; })()");
    assert_eq!(overview[0], true, "{overview}");
    assert!((number(&overview[1]) - 10.0).abs() < 0.2, "{overview}");
    is_content(&browser);
    player.end();
}
