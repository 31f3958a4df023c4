//! Several programs in one page.

use super::{LAPTOP, browser, is_content, picture, settings};
use luna_logger::Sink;
use luna_logger::format::{
    ClockBase, Encoder, Event, Record, RunsOn, SignalInfo, Subject, Type, Values,
};
use luna_scope::{Scope, ScopeSink};
use serde_json::json;

const MS: u64 = 1_000_000;

/// A program that sends its recording.
struct Program {
    sink: ScopeSink,
    encoder: Encoder,
}

impl Program {
    /// With a signal, a process, a channel and a loop, all of number 1 or 0.
    fn start(scope: &Scope, system: &str) -> Self {
        let mut sink = scope.sink().unwrap().patient();
        sink.begin(&Encoder::head()).unwrap();
        let mut encoder = Encoder::new();
        encoder.put(&Record::Session {
            system,
            clock: ClockBase::Monotonic,
            written_by: "a test",
        });
        encoder.put(&Record::Thread {
            number: 1,
            name: "executor",
        });
        encoder.put(&Record::Signal(SignalInfo {
            number: 0,
            element_type: Type::F64,
            elements: 1,
            name: "speed",
            unit: "m/s",
            description: "",
        }));
        for (subject, name, runs_on) in [
            (Subject::Executor, "executor", None),
            (
                Subject::Process,
                "control",
                Some(RunsOn {
                    executor: 1,
                    level: 16,
                }),
            ),
            (Subject::Channel, "commands", None),
            (Subject::Loop, "control", None),
        ] {
            encoder.put(&Record::Name {
                subject,
                number: 1,
                parent: 0,
                name,
                runs_on,
            });
        }
        Self { sink, encoder }
    }

    fn sample(&mut self, time: u64, value: f64) -> &mut Self {
        self.encoder.put(&Record::Sample {
            signal: 0,
            time,
            values: Values::from_bytes(Type::F64, &value.to_le_bytes()),
        });
        self
    }

    fn event(&mut self, time: u64, code: u16, arguments: [u64; 2]) -> &mut Self {
        self.encoder.put(&Record::Event(Event {
            thread: 1,
            time,
            code,
            subject: 1,
            arguments,
        }));
        self
    }

    fn say(&mut self, time: u64, text: &str) -> &mut Self {
        self.encoder.put(&Record::Message {
            thread: 1,
            time,
            level: luna_logger::Level::Warn,
            process: 1,
            truncated: false,
            target: "",
            text,
        });
        self
    }

    fn send(&mut self) {
        self.sink.block(self.encoder.block()).unwrap();
        self.encoder.next();
    }

    fn end(mut self, time: u64) {
        self.encoder.put(&Record::End { time });
        self.send();
    }
}

const SPEEDS: &str = r#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"><text data-signal="right/speed" data-text=""/><text data-signal="speed" data-text=""/></svg>"#;

#[test]
fn several_programs_are_on_one_time_axis() {
    let Some(browser) = browser("programs") else {
        return;
    };
    let scope = Scope::open(settings().together().picture(SPEEDS)).unwrap();
    let mut left = Program::start(&scope, "left");
    let mut right = Program::start(&scope, "right");
    for n in 0..200 {
        let time = (1000 + 10 * n) * MS;
        left.sample(time, n as f64);
        left.event(time, 2, [0, 0]).event(time + MS, 3, [3, 1]);
        left.event(time, 10, [n, 1000]);
    }
    left.say(1500 * MS, "of the left").send();
    // The axis begins with the first time that is shown. Each program has a thread of its own that
    // passes it on, so the right one waits until the left one is shown.
    browser.open(&scope.url(), LAPTOP, "light");
    browser.wait("scope.clock.latest > 1.9");
    for n in 0..200 {
        let time = (1005 + 10 * n) * MS;
        right.sample(time, -(n as f64));
        right.event(time, 2, [0, 0]).event(time + MS, 3, [3, 1]);
        right.event(time, 10, [n, 2000]);
    }
    right.say(1505 * MS, "of the right").send();
    browser.wait("scope.model.events.end >= 1190");
    assert_eq!(
        browser.run("[...scope.model.signals.values()].map(({ name }) => name).sort()"),
        json!(["left/speed", "right/speed"])
    );
    let at = "[...scope.model.signals.values()].sort((a, b) => (a.name < b.name ? -1 : 1)).map(({ series }) => series.at(1.0021))";
    assert_eq!(browser.run(at), json!([100, -99]));
    assert_eq!(
        browser.run("scope.model.messages.map(({ process, text }) => `${scope.model.processes.get(process).name}: ${text}`).sort()"),
        json!(["left/control: of the left", "right/control: of the right"])
    );
    browser.wait("document.querySelector('#system').textContent === 'left, right'");

    browser.click("#tab-loops");
    browser.wait("[...document.querySelectorAll('#loops .card h2')].map((one) => one.textContent).join() === 'left/control,right/control'");
    browser.click("#tab-composition");
    browser.click("[data-composition=parts]");
    browser.wait("[...document.querySelectorAll('#tree .executor h2')].map((one) => one.textContent).join() === 'left/executor,right/executor'");
    // Each waits for the channel of its own program.
    browser.wait("[...document.querySelectorAll('#tree .box p')].map((one) => one.textContent).join() === 'waits for left/commands,waits for right/commands'");
    picture(&browser, "programs");

    // In a picture a signal's name is enough, if one program alone has it.
    browser.click("#tab-picture");
    browser.wait("document.querySelector('#picture .note').textContent === 'Not recorded: speed.'");
    browser.wait("document.querySelector('#picture text').textContent === '−199 m/s'");

    // The run ends with the last of them.
    left.end(4000 * MS);
    right.end(3800 * MS);
    browser.wait("scope.model.ended === 3");
    is_content(&browser);
}
