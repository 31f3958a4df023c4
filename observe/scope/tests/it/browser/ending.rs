//! How a run ends, and how a connection does.

use super::{LAPTOP, browser, picture, settings};
use crate::support::machine::{Machine, PERIOD};
use luna_logger::Sink;
use luna_logger::format::{Encoder, Record};
use luna_scope::{Scope, ScopeSink};
use std::io;
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Mutex};

/// A recorder that gives a machine's cycles.
struct Recorder {
    sink: ScopeSink,
    encoder: Encoder,
    machine: Machine,
}

impl Recorder {
    fn begin(scope: &Scope) -> Recorder {
        let mut sink = scope.sink().unwrap().patient();
        sink.begin(&Encoder::head()).unwrap();
        Recorder {
            sink,
            encoder: Encoder::new(),
            machine: Machine::new(),
        }
    }

    fn give(&mut self, cycles: u64) {
        let to = (self.machine.cycles() + cycles) * PERIOD;
        let Recorder { sink, encoder, .. } = self;
        self.machine.until(to, &mut |record| {
            encoder.put(record);
            if encoder.is_full() {
                sink.block(encoder.block()).unwrap();
                encoder.next();
            }
        });
        self.block();
    }

    fn block(&mut self) {
        self.sink.block(self.encoder.block()).unwrap();
        self.encoder.next();
    }

    fn end(mut self) {
        let time = 86_400_000_000_000 + self.machine.cycles() * PERIOD;
        self.encoder.put(&Record::End { time });
        self.block();
    }
}

const SAID: &str = "document.querySelector('#ended b').textContent";

/// The program ends right after its system: the page has all of it, and says how it ended.
#[test]
fn the_end_of_a_run_shows_its_report() {
    let Some(browser) = browser("end") else {
        return;
    };
    let scope = Scope::open(settings()).unwrap();
    let mut recorder = Recorder::begin(&scope);
    recorder.give(500);
    browser.open(&scope.url(), LAPTOP, "light");
    browser.wait("scope.clock.latest > 0.4");
    assert_eq!(browser.run("document.querySelector('#ended').hidden"), true);
    recorder.give(1000);
    recorder.end();
    scope.ended("completed after 1.5 s");
    drop(scope);
    browser.wait(&format!(
        "!document.querySelector('#ended').hidden && {SAID} === 'Run ended: completed after 1.5 s'"
    ));
    assert_eq!(browser.run("scope.model.ended"), 1.5);
    let figures =
        browser.run("[...document.querySelectorAll('#ended li')].map((one) => one.textContent)");
    assert_eq!(figures[0], "4\u{2009}575 cycles of 4 loops, 2 late");
    let latest = figures[1].as_str().unwrap();
    assert!(
        latest.starts_with("worst: tilt, at most ") && latest.contains("p99"),
        "{latest}"
    );
    // That the scope has gone is no failure then.
    browser.wait("scope.connection.state === 'away'");
    browser.frames(3);
    browser.wait("document.querySelector('#state').textContent === 'Ended'");
    assert_eq!(browser.run(SAID), "Run ended: completed after 1.5 s");
    picture(&browser, "end");
    browser.click("#ended button");
    browser.wait("document.querySelector('#ended').hidden");
}

/// The end is among what waits while the page is paused: that it has come is not known until then.
#[test]
fn a_paused_page_learns_of_the_end_when_it_follows() {
    let Some(browser) = browser("paused-end") else {
        return;
    };
    let scope = Scope::open(settings()).unwrap();
    let mut recorder = Recorder::begin(&scope);
    recorder.give(500);
    browser.open(&scope.url(), LAPTOP, "light");
    browser.wait("scope.clock.latest > 0.4");
    browser.click("#pause");
    recorder.give(1000);
    recorder.end();
    scope.ended("completed after 1.5 s");
    drop(scope);
    browser.wait("scope.connection.state === 'away' && !document.querySelector('#ended').hidden");
    browser.frames(3);
    assert_eq!(browser.run(SAID), "The scope was closed.");
    browser.wait("document.querySelector('#ended li').textContent.startsWith('Follow shows')");
    browser.click("#pause");
    browser.wait(&format!("{SAID} === 'Run ended: completed after 1.5 s'"));
}

/// Passes connections on, and breaks them.
struct Between {
    address: SocketAddr,
    streams: Arc<Mutex<Vec<TcpStream>>>,
}

impl Between {
    fn start(to: SocketAddr) -> Between {
        let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
        let address = listener.local_addr().unwrap();
        let streams = Arc::new(Mutex::new(Vec::new()));
        let known = streams.clone();
        std::thread::spawn(move || {
            for client in listener.incoming() {
                let (client, server) = (client.unwrap(), TcpStream::connect(to));
                let Ok(server) = server else { return };
                for (from, to) in [(&client, &server), (&server, &client)] {
                    let (mut from, mut to) = (from.try_clone().unwrap(), to.try_clone().unwrap());
                    std::thread::spawn(move || {
                        let _ = io::copy(&mut from, &mut to);
                        let _ = to.shutdown(Shutdown::Write);
                    });
                }
                known.lock().unwrap().extend([client, server]);
            }
        });
        Between { address, streams }
    }

    fn break_all(&self) {
        for stream in self.streams.lock().unwrap().drain(..) {
            let _ = stream.shutdown(Shutdown::Both);
        }
    }
}

#[test]
fn a_connection_that_breaks_is_no_end() {
    let Some(browser) = browser("broken") else {
        return;
    };
    let scope = Scope::open(settings()).unwrap();
    let mut recorder = Recorder::begin(&scope);
    recorder.give(500);
    let between = Between::start(scope.address());
    browser.open(&format!("http://{}/", between.address), LAPTOP, "light");
    browser.wait("scope.clock.latest > 0.4");
    // What is said until the connection is there again stays to be read.
    browser.run("(() => { window.said = []; const text = document.querySelector('#ended b'); new MutationObserver(() => said.push(text.textContent)).observe(text, { childList: true, characterData: true, subtree: true }); })()");
    between.break_all();
    browser.wait("said[0] === 'The connection broke: what happens now is not known.'");
    browser.wait(
        "scope.connection.state === 'open' && document.querySelector('#ended').hidden && scope.clock.latest > 0.4",
    );

    // A scope that is closed before its run has ended says something else.
    drop(scope);
    browser.wait("said.at(-1) === 'The scope was closed before the run ended.' && !document.querySelector('#ended').hidden");
    browser.frames(3);
    picture(&browser, "closed");
}
