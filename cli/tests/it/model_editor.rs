//! The editor's page in a headless Chromium. Without one on this machine the tests are skipped with
//! a message.

#[path = "../../../observe/scope/tests/support/browser.rs"]
#[allow(dead_code, unreachable_pub, reason = "the scope's tests use the rest")]
mod browser;

use crate::run::command;
use browser::{Browser, program};
use std::fmt::Write;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};

const WINDOW: (u32, u32) = (1400, 900);

/// The program, ended with the test.
struct Program(Child);

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

struct Page {
    browser: Browser,
    file: PathBuf,
    _program: Program,
    _folder: tempfile::TempDir,
}

/// The page with a model; nothing where there is no Chromium.
fn open(name: &str, text: &str, more: &[&str]) -> Option<Page> {
    let found = program();
    if found.is_none() {
        assert!(
            std::env::var_os("LUNA_NEEDS_CHROMIUM").is_none(),
            "chromium is missing"
        );
        eprintln!("skipped: the model editor, {name}: chromium is missing (Debian: chromium)");
    }
    let browser = Browser::start(&found?, name);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("model.toml");
    fs::write(&file, text).unwrap();
    let mut child = command(&["model", "edit", "--listen", "127.0.0.1:0"])
        .arg(&file)
        .args(more)
        .stdout(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let mut url = String::new();
    let mut output = BufReader::new(child.stdout.take().unwrap());
    output.read_line(&mut url).unwrap();
    let page = Page {
        browser,
        file,
        _program: Program(child),
        _folder: folder,
    };
    page.browser.look(WINDOW, "light");
    page.browser.navigate(url.trim());
    page.wait("editor.state && editor.canvas.boxes.size > 0");
    page.browser.frames(2);
    Some(page)
}

impl Page {
    fn wait(&self, condition: &str) {
        self.browser.wait(condition);
    }

    fn text(&self) -> String {
        fs::read_to_string(&self.file).unwrap()
    }

    fn port(&self, part: &str, port: &str) -> (f64, f64) {
        self.browser
            .middle(&format!("[data-box='part {part}'][data-port='{port}']"))
    }

    /// Types a value into a field of the panel.
    fn fill(&self, key: &str, value: &str) {
        self.browser.run(&format!(
            "(() => {{ const field = document.querySelector('#panel [data-key={key:?}]'); field.value = {value:?}; field.dispatchEvent(new Event('change')); }})()"
        ));
    }

    fn choose(&self, id: &str) {
        self.browser.run(&format!("editor.choose({id:?})"));
    }

    /// Clicks, and waits until the program has answered.
    fn click(&self, selector: &str) {
        let version = self.browser.run("editor.state.version");
        self.browser.click(selector);
        self.wait(&format!("editor.state.version > {version}"));
    }

    fn picture(&self, name: &str) {
        if let Some(folder) = std::env::var_os("LUNA_PICTURES") {
            let path = Path::new(&folder).join(format!("{name}.png"));
            self.browser.screenshot(&path);
        }
    }
}

fn philosophers() -> String {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/models");
    fs::read_to_string(models.join("philosophers.toml")).unwrap()
}

#[test]
fn the_philosophers_are_edited_and_checked() {
    let first = philosophers();
    let Some(page) = open("edit", &first, &[]) else {
        return;
    };
    let browser = &page.browser;

    // A box is moved, and nothing else in the file is.
    let (x, y) = browser.middle("[data-id='part philosopher'] rect");
    browser.drag((x, y), (x + 60.0, y - 40.0));
    page.wait("editor.state.view.scopes[0].parts[0].is_placed && editor.state.is_saved");
    let at = browser.run("editor.state.view.scopes[0].parts[0].area");
    let line = format!("at = [{}, {}]\n", at[0], at[1]);
    let bound = "bind.right_back = \"right_back[i]\"\n";
    let mut meant = first.replacen(bound, &format!("{bound}{line}"), 1);
    assert_eq!(page.text(), meant.replace(".0", ""));
    meant = page.text();

    // A key moves it too.
    browser.run("document.querySelector('[data-id=\"part fork\"]').focus()");
    browser.key("ArrowDown");
    page.wait("editor.state.view.scopes[0].parts[1].is_placed && editor.state.is_saved");
    browser.run(
        "document.body.dispatchEvent(new KeyboardEvent('keydown', {key: 'z', ctrlKey: true, bubbles: true}))",
    );
    page.wait("!editor.state.view.scopes[0].parts[1].is_placed");
    assert_eq!(page.text(), meant);

    // The check finds the circle, and shows it in place.
    browser.click("#check");
    page.wait("document.querySelectorAll('.box.is-circle').length === 2");
    let found = browser.run("document.querySelector('#findings').textContent");
    let found = found.as_str().unwrap();
    assert!(found.contains("deadlock, after 10 steps"), "{found}");
    assert!(
        found.contains("philosopher[4] -> fork[4]: left[4]"),
        "{found}"
    );
    page.choose("part philosopher");
    browser.frames(2);
    page.picture("model-editor");

    // A priority.
    page.fill("priority", "7");
    page.wait("editor.state.is_saved && editor.state.view.scopes[0].parts[0].run.length === 1");
    assert!(page.text().contains("priority = 7\n"));

    // A bad body is refused beside the body, and the file stays.
    let before = page.text();
    page.fill("body", "loop {\n  think think\n}\n");
    page.wait("editor.state.refused !== null");
    let error = browser.run("document.querySelector('#panel .error').textContent");
    assert!(
        error.as_str().unwrap().starts_with("line 9, column 9: "),
        "{error}"
    );
    let wrong = "document.querySelector('[data-id=\"part philosopher\"]').matches('.is-wrong')";
    assert_eq!(browser.run(wrong), true);
    let typed = browser.run("document.querySelector('#panel textarea').value");
    assert_eq!(typed, "loop {\n  think think\n}\n");
    assert_eq!(page.text(), before);
    assert_eq!(browser.complaints(), [""; 0]);
}

#[test]
fn a_process_and_a_channel_are_drawn() {
    let Some(page) = open("draw", &philosophers(), &[]) else {
        return;
    };
    let browser = &page.browser;
    page.click("#add-process");
    page.wait("document.querySelector('#panel [data-key=\"new ports\"]')");
    for (name, side) in [("question", "send"), ("answer", "receive")] {
        let version = browser.run("editor.state.version");
        browser.run(&format!(
            "document.querySelector('#panel [data-key=\"new ports\"]').value = {name:?}"
        ));
        page.fill("new ports value", side);
        page.wait(&format!("editor.state.version > {version}"));
    }
    page.fill("body", "question!; answer?");
    page.wait("editor.state.view.processes[2].body === 'question!; answer?'");
    page.fill("process name", "Judge");
    page.wait("editor.state.view.processes[2].name === 'Judge'");
    let before = page.text();
    assert!(before.contains("[process.Judge]\n"), "{before}");

    // Its part is a draft until its ports are bound.
    browser.run("document.querySelector('#new-part').value = 'Judge'");
    page.click("#add-part");
    assert_eq!(browser.run("editor.state.is_saved"), false);
    assert_eq!(browser.run("editor.state.problem.thing.name"), "judge");
    assert_eq!(page.text(), before);
    page.wait("document.querySelector('[data-id=\"part judge\"]').matches('.is-wrong')");
    let (from, to) = (page.port("judge", "question"), page.port("judge", "answer"));
    browser.drag(from, to);
    page.wait("editor.state.is_saved");
    let text = page.text();
    let center = browser.run("editor.state.view.scopes[0].parts[2].area");
    let part = format!(
        "[system.part.judge]\nprocess = \"Judge\"\nat = [{}, {}]\nbind.question = \"question\"\nbind.answer = \"question\"\n",
        center[0], center[1]
    );
    assert!(text.contains(&part.replace(".0", "")), "{text}");
    assert!(
        text.contains("right_back = { array = 5 }\nquestion = {}\n"),
        "{text}"
    );
    for comment in philosophers().lines().filter(|line| line.starts_with('#')) {
        assert!(text.contains(comment), "{comment}: {text}");
    }

    // All is undone, to the byte.
    while browser.run("editor.state.undo") == true {
        page.click("#undo");
    }
    assert_eq!(page.text(), philosophers());

    // What another program writes is shown.
    fs::write(
        &page.file,
        philosophers().replace("\"philosophers\"", "\"thinkers\""),
    )
    .unwrap();
    page.wait("document.querySelector('#name').textContent === 'thinkers'");
    assert_eq!(browser.complaints(), [""; 0]);
}

#[test]
fn bounds_and_measured_times_stand_at_their_parts() {
    let model = "[process.Servo]\nbody = \"loop { move }\"\n[system.part.servo]\nprocess = \"Servo\"\n\
                 on = \"fast\"\nperiod = \"1 ms\"\npriority = 20\n[executor.fast]\ncore = 2\n\
                 policy = \"fifo:80\"\n";
    let folder = tempfile::tempdir().unwrap();
    let costs = folder.path().join("costs.toml");
    fs::write(&costs, "servo = { cost = \"120 us\" }\n").unwrap();
    let Some(page) = open("times", model, &["--costs", &costs.display().to_string()]) else {
        return;
    };
    page.browser.click("#times");
    page.wait("document.querySelector('#times-table')");
    let note = page
        .browser
        .run("document.querySelector('.note').textContent");
    let note = note.as_str().unwrap();
    assert!(
        note.starts_with("bound 120.0, measured -, slack 880.0 µs: holds"),
        "{note}"
    );
    assert_eq!(page.browser.complaints(), [""; 0]);
}

#[test]
fn a_process_made_of_parts_is_edited_inside() {
    let model = "[process.Relay]\nports = { a = \"receive\", b = \"send\" }\n\
                 body = \"loop { a?; b! }\"\n[process.Two]\n\
                 ports = { a = \"receive\", b = \"send\" }\nchannel.c = {}\n\
                 [process.Two.part]\nfirst = { process = \"Relay\", bind = { a = \"a\", b = \"c\" } }\n\
                 second = { process = \"Relay\", bind = { a = \"c\", b = \"b\" } }\n\
                 [system.channel]\nring = {}\n[system.part.two]\nprocess = \"Two\"\n\
                 bind = { a = \"ring\", b = \"ring\" }\n";
    let Some(page) = open("inside", model, &[]) else {
        return;
    };
    let browser = &page.browser;
    browser.run("editor.enter('Two')");
    page.wait("document.querySelectorAll('.box.terminal').length === 2");
    assert_eq!(browser.run("document.querySelectorAll('.wire').length"), 3);

    // An unbound port comes back by a drag to the process' own port.
    page.choose("part second");
    page.fill("bind.b", "");
    page.wait("editor.state.problem !== null && !editor.state.is_saved");
    browser.run("editor.canvas.whole()");
    browser.frames(2);
    let from = page.port("second", "b");
    let to = browser.middle("[data-box='port b'][data-port='b']");
    browser.drag(from, to);
    page.wait("editor.state.problem === null && editor.state.is_saved");
    assert_eq!(page.text(), model);

    // A channel's name changes where it is bound.
    page.choose("channel c");
    page.fill("name", "between");
    page.wait("editor.chosen === 'channel between' && editor.state.is_saved");
    let meant = model.replace("channel.c", "channel.between");
    assert_eq!(page.text(), meant.replace("\"c\"", "\"between\""));
    assert_eq!(browser.complaints(), [""; 0]);
}

/// A ring of so many processes.
fn ring(count: usize) -> String {
    let mut text = String::from(
        "[process.P]\nports = { a = \"receive\", b = \"send\" }\nbody = \"loop { a?; b! }\"\n\
         [system.channel]\n",
    );
    for n in 0..count {
        let _ = writeln!(text, "c{n} = {{}}");
    }
    for n in 0..count {
        let (next, x, y) = ((n + 1) % count, n % 20 * 90, n / 20 * 110);
        let _ = writeln!(
            text,
            "[system.part.p{n}]\nprocess = \"P\"\nbind = {{ a = \"c{n}\", b = \"c{next}\" }}\nat = [{x}, {y}]"
        );
    }
    text
}

#[test]
fn a_drag_among_200_processes_changes_what_moves_alone() {
    let Some(page) = open("200", &ring(200), &[]) else {
        return;
    };
    let browser = &page.browser;
    assert_eq!(browser.run("editor.canvas.boxes.size"), 200);
    let (x, y) = browser.middle("[data-id='part p105'] rect");
    browser.mouse("mousePressed", (x, y));
    browser.run(
        "window.changed = new Set(); window.most = 0; window.times = []; \
         window.watch = new MutationObserver((all) => { for (const one of all) changed.add(one.target.closest('[data-id]').dataset.id); most = Math.max(most, all.length); }); \
         watch.observe(document.querySelector('#world'), {subtree: true, attributes: true, childList: true}); \
         window.loop = (now) => { times.push(now); if (!window.done) requestAnimationFrame(loop); }; requestAnimationFrame(loop); 0",
    );
    for step in 1..=120 {
        let step = f64::from(step);
        browser.mouse("mouseMoved", (x + step, y + (step / 9.0).sin() * 60.0));
    }
    browser.run("done = true; watch.disconnect(); 0");
    let work = browser.run("[...changed].sort().join()");
    assert_eq!(work, "channel c105,channel c106,part p105");
    let most = browser.run("most").as_u64().unwrap();
    // The box; and for each of its two lines the path and both numbers of its label.
    assert!((1..=7).contains(&most), "{most} changes in a frame");
    let times = "(() => { const d = times.slice(1).map((t, n) => t - times[n]).sort((a, b) => a - b); return [d.length, d[d.length >> 1], d[Math.floor(d.length * 0.95)], d.at(-1)].map((n) => Math.round(n * 10) / 10).join(' '); })()";
    let frames = browser.run(times);
    println!("200 processes, a drag: frames, then median, 95 % and longest of their ms: {frames}");
    browser.mouse("mouseReleased", (x + 120.0, y));
    page.wait("editor.state.version > 1");
    assert_eq!(browser.complaints(), [""; 0]);
}
