//! A headless Chromium, driven by the DevTools protocol: one WebSocket a window.
//!
//! The tests of a program share one process, as long as any of them uses it: its start takes longer
//! than most of them. Each has a window with a context of its own, which shares no storage with
//! others. A client of this size stands here because a crate with the whole protocol took a tenth
//! of the time that all tests take to build.

use data_encoding::BASE64;
use serde_json::{Value, json};
use std::cell::RefCell;
use std::io::{BufRead, BufReader, sink};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::Duration;
use tungstenite::{Message, WebSocket};

/// Only a browser that hangs takes this long.
const PATIENCE: Duration = Duration::from_secs(600);
/// The longest wait for a condition in the page.
const LONGEST_WAIT: Duration = Duration::from_secs(240);
/// What [`Browser::complaints`] writes to the page's console: all complaints that came before it
/// have been read when it is read.
const MARK: &str = "the complaints end here";

/// A window of the shared Chromium.
pub struct Browser {
    connection: RefCell<Connection>,
    context: String,
    /// For files; it goes with the window.
    pub folder: PathBuf,
    _chromium: Arc<Chromium>,
}

/// The process. It ends with the last of its windows.
struct Chromium {
    process: Child,
    /// `ws://HOST:PORT/PATH`.
    address: String,
    folder: PathBuf,
}

/// Calls of the protocol, and the events that came between their answers.
struct Connection {
    socket: WebSocket<TcpStream>,
    calls: u64,
    /// Of the window; before there is one, calls are the browser's.
    session: Option<String>,
    events: Vec<Value>,
}

/// The browser of this machine, or `CHROMIUM`.
pub fn program() -> Option<PathBuf> {
    let named = std::env::var_os("CHROMIUM").map(PathBuf::from);
    let paths = std::env::var_os("PATH").unwrap_or_default();
    let found = std::env::split_paths(&paths).flat_map(|folder| {
        [
            "chromium",
            "chromium-browser",
            "google-chrome",
            "google-chrome-stable",
        ]
        .map(|name| folder.join(name))
    });
    named.into_iter().chain(found).find(|path| path.is_file())
}

impl Chromium {
    /// The one that runs, or a new one.
    fn shared(program: &Path) -> Arc<Chromium> {
        static RUNNING: Mutex<Weak<Chromium>> = Mutex::new(Weak::new());
        let mut running = RUNNING.lock().unwrap_or_else(PoisonError::into_inner);
        running.upgrade().unwrap_or_else(|| {
            let chromium = Arc::new(Chromium::start(program));
            *running = Arc::downgrade(&chromium);
            chromium
        })
    }

    fn start(program: &Path) -> Chromium {
        let folder = new_folder("chromium");
        let mut process = Command::new(program)
            .args(["--headless=new", "--no-sandbox", "--disable-gpu"])
            .args(["--no-first-run", "--disable-extensions", "--disable-sync"])
            .args(["--disable-background-networking", "--disable-breakpad"])
            .args(["--disable-component-update", "--disable-default-apps"])
            .args(["--disable-dev-shm-usage", "--force-color-profile=srgb"])
            // Each window is served as if it were the one in front.
            .args(["--disable-background-timer-throttling"])
            .args(["--disable-backgrounding-occluded-windows"])
            .args(["--disable-renderer-backgrounding"])
            .arg("--remote-debugging-port=0")
            .arg(format!(
                "--user-data-dir={}",
                folder.join("profile").display()
            ))
            // What it leaves behind when it is killed goes with the folder.
            .env("TMPDIR", &folder)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut said = BufReader::new(process.stderr.take().unwrap());
        let mut all = String::new();
        let address = loop {
            let begun = all.len();
            let length = said.read_line(&mut all).unwrap();
            assert!(length > 0, "Chromium ended: {all}");
            if let Some(address) = all[begun..].strip_prefix("DevTools listening on ") {
                break address.trim().to_string();
            }
        };
        // Otherwise it would wait for a reader once the pipe is full.
        std::thread::spawn(move || std::io::copy(&mut said, &mut sink()));
        Chromium {
            process,
            address,
            folder,
        }
    }

    fn connect(&self) -> Connection {
        let host = self.address.strip_prefix("ws://").unwrap();
        let stream = TcpStream::connect(host.split('/').next().unwrap()).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream.set_nodelay(true).unwrap();
        let (socket, _) = tungstenite::client(&self.address, stream).unwrap();
        Connection {
            socket,
            calls: 0,
            session: None,
            events: Vec::new(),
        }
    }
}

impl Drop for Chromium {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
        // Its helpers end a moment after it, and write until then.
        for _ in 0..100 {
            if std::fs::remove_dir_all(&self.folder).is_ok() {
                break;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

impl Connection {
    /// Only the parameters that differ from the protocol's defaults are given.
    fn call(&mut self, method: &str, params: Value) -> Result<Value, String> {
        self.calls += 1;
        let mut call = json!({"id": self.calls, "method": method, "params": params});
        if let Some(session) = &self.session {
            call["sessionId"] = json!(session);
        }
        let sent = self.socket.send(Message::from(call.to_string()));
        sent.map_err(|error| error.to_string())?;
        loop {
            let mut message = self.next_message()?;
            if message["id"] != self.calls {
                self.events.push(message);
                continue;
            }
            if message["error"].is_object() {
                return Err(message["error"].to_string());
            }
            return Ok(message["result"].take());
        }
    }

    fn next_message(&mut self) -> Result<Value, String> {
        loop {
            match self.socket.read().map_err(|error| error.to_string())? {
                Message::Text(text) => return Ok(serde_json::from_str(&text).unwrap()),
                Message::Close(reason) => return Err(format!("closed: {reason:?}")),
                _ => {}
            }
        }
    }
}

/// A folder for temporary files, which no other call has given.
fn new_folder(name: &str) -> PathBuf {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let (process, count) = (std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
    let folder = std::env::temp_dir().join(format!("luna-scope-{process}-{count}-{name}"));
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

impl Browser {
    /// Opens a window with an empty page.
    pub fn start(program: &Path, name: &str) -> Browser {
        let chromium = Chromium::shared(program);
        let mut connection = chromium.connect();
        let text = |answer: Value, name: &str| answer[name].as_str().unwrap().to_string();
        let context = connection.call("Target.createBrowserContext", json!({}));
        let context = text(context.unwrap(), "browserContextId");
        let target = connection.call(
            "Target.createTarget",
            json!({"url": "about:blank", "browserContextId": context, "newWindow": true}),
        );
        let target = text(target.unwrap(), "targetId");
        let session = connection.call(
            "Target.attachToTarget",
            json!({"targetId": target, "flatten": true}),
        );
        connection.session = Some(text(session.unwrap(), "sessionId"));
        let browser = Browser {
            connection: RefCell::new(connection),
            context,
            folder: new_folder(name),
            _chromium: chromium,
        };
        for domain in ["Page", "Runtime", "Log"] {
            browser.call(&format!("{domain}.enable"), json!({}));
        }
        // It has the keys, whichever window has the focus.
        browser.call(
            "Emulation.setFocusEmulationEnabled",
            json!({"enabled": true}),
        );
        browser
    }

    fn call(&self, method: &str, params: Value) -> Value {
        let answer = self.connection.borrow_mut().call(method, params);
        answer.unwrap_or_else(|error| panic!("{method}: {error}"))
    }

    /// What the page has complained about since it was asked last.
    pub fn complaints(&self) -> Vec<String> {
        self.run(&format!("console.error({MARK:?})"));
        let connection = &mut *self.connection.borrow_mut();
        let is_mark = |event: &Value| {
            event["method"] == "Runtime.consoleAPICalled"
                && event["params"]["args"][0]["value"] == MARK
        };
        while !connection.events.iter().any(is_mark) {
            let event = connection.next_message().unwrap();
            connection.events.push(event);
        }
        let is_complaint = |event: &Value| match event["method"].as_str() {
            Some("Runtime.exceptionThrown") => true,
            Some("Runtime.consoleAPICalled") => {
                let kind = &event["params"]["type"];
                (kind == "error" || kind == "warning") && !is_mark(event)
            }
            Some("Log.entryAdded") => event["params"]["entry"]["level"] == "error",
            _ => false,
        };
        let events = std::mem::take(&mut connection.events);
        let complaints = events.into_iter().filter(is_complaint);
        complaints
            .map(|event| event["params"].to_string())
            .collect()
    }

    /// Opens an address, in a window of this size in pixels.
    pub fn open(&self, url: &str, size: (u32, u32), theme: &str) {
        self.look(size, theme);
        self.navigate(url);
        self.wait("window.scope && document.readyState === 'complete'");
    }

    /// Begins to load an address.
    pub fn navigate(&self, url: &str) {
        let answer = self.call("Page.navigate", json!({"url": url}));
        assert!(answer["errorText"].is_null(), "{url}: {answer}");
    }

    pub fn reload(&self) {
        self.call("Page.reload", json!({}));
    }

    /// Changes the window, and what the system prefers.
    pub fn look(&self, (width, height): (u32, u32), theme: &str) {
        self.call(
            "Emulation.setDeviceMetricsOverride",
            json!({"width": width, "height": height, "deviceScaleFactor": 1.0, "mobile": false}),
        );
        self.call(
            "Emulation.setEmulatedMedia",
            json!({"features": [{"name": "prefers-color-scheme", "value": theme}]}),
        );
    }

    /// A script's result; a promise is awaited.
    pub fn run(&self, script: &str) -> Value {
        let answer = self.call(
            "Runtime.evaluate",
            json!({"expression": script, "awaitPromise": true, "returnByValue": true}),
        );
        let thrown = &answer["exceptionDetails"];
        assert!(thrown.is_null(), "{script}: {thrown}");
        answer["result"]["value"].clone()
    }

    /// Waits until a condition holds in the page.
    pub fn wait(&self, condition: &str) {
        let longest = LONGEST_WAIT.as_millis();
        let held = self.run(&format!(
            "new Promise((done) => {{ const begun = Date.now(); const look = () => {{ let is = false, why = ''; try {{ is = ({condition}); }} catch (error) {{ why = String(error); }} if (is) done(true); else if (Date.now() - begun > {longest}) done(why || 'false'); else setTimeout(look, Math.min(30, (Date.now() - begun) / 8)); }}; look(); }})"
        ));
        if held != true {
            panic!(
                "it never came that {condition}: {held}; {:?}",
                self.complaints()
            );
        }
    }

    /// Waits until this many frames were drawn.
    pub fn frames(&self, count: u32) {
        self.run(&format!(
            "new Promise((done) => {{ let n = {count}; const next = () => n-- > 0 ? requestAnimationFrame(next) : done(true); next(); }})"
        ));
    }

    pub fn click(&self, selector: &str) {
        self.run(&format!("document.querySelector({selector:?}).click()"));
    }

    pub fn key(&self, key: &str) {
        for kind in ["keyDown", "keyUp"] {
            let text = if kind == "keyDown" && key.len() == 1 {
                key
            } else {
                ""
            };
            self.call(
                "Input.dispatchKeyEvent",
                json!({"type": kind, "key": key, "text": text}),
            );
        }
    }

    /// The middle of an element, in pixels of the page.
    pub fn middle(&self, selector: &str) -> (f64, f64) {
        let at = self.run(&format!(
            "(() => {{ const box = document.querySelector({selector:?}).getBoundingClientRect(); return [box.x + box.width / 2, box.y + box.height / 2]; }})()"
        ));
        (at[0].as_f64().unwrap(), at[1].as_f64().unwrap())
    }

    pub fn drag(&self, from: (f64, f64), to: (f64, f64)) {
        self.mouse("mousePressed", from);
        for part in 1..=8 {
            let share = f64::from(part) / 8.0;
            self.mouse(
                "mouseMoved",
                (
                    from.0 + (to.0 - from.0) * share,
                    from.1 + (to.1 - from.1) * share,
                ),
            );
        }
        self.mouse("mouseReleased", to);
    }

    pub fn mouse(&self, kind: &str, (x, y): (f64, f64)) {
        self.call(
            "Input.dispatchMouseEvent",
            json!({"type": kind, "x": x, "y": y, "button": "left", "buttons": 1, "clickCount": 1}),
        );
    }

    pub fn wheel(&self, (x, y): (f64, f64), by: f64) {
        self.call(
            "Input.dispatchMouseEvent",
            json!({"type": "mouseWheel", "x": x, "y": y, "deltaX": 0.0, "deltaY": by}),
        );
    }

    pub fn screenshot(&self, to: &Path) {
        let picture = self.call("Page.captureScreenshot", json!({}));
        let picture = picture["data"].as_str().unwrap();
        std::fs::write(to, BASE64.decode(picture.as_bytes()).unwrap()).unwrap();
    }

    pub fn downloads_to(&self, folder: &Path) {
        std::fs::create_dir_all(folder).unwrap();
        self.call(
            "Browser.setDownloadBehavior",
            json!({"behavior": "allow", "downloadPath": folder, "browserContextId": self.context}),
        );
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let mut connection = self.connection.borrow_mut();
        connection.session = None;
        let context = json!({"browserContextId": self.context});
        let _ = connection.call("Target.disposeBrowserContext", context);
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}
