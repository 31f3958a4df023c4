//! A headless Chromium, driven by the crate `chromiumoxide`.
//!
//! The tests of a program share one process, as long as any of them uses it: its start takes longer
//! than most of them. Each has a window with a context of its own, which shares no storage with
//! others.

use chromiumoxide::cdp::browser_protocol::browser::{BrowserContextId, SetDownloadBehaviorParams};
use chromiumoxide::cdp::browser_protocol::emulation;
use chromiumoxide::cdp::browser_protocol::input;
use chromiumoxide::cdp::browser_protocol::log::{EventEntryAdded, LogEntryLevel};
use chromiumoxide::cdp::browser_protocol::network;
use chromiumoxide::cdp::browser_protocol::page::{NavigateParams, ReloadParams};
use chromiumoxide::cdp::browser_protocol::target::{
    CreateBrowserContextParams, CreateTargetParams,
};
use chromiumoxide::cdp::js_protocol::runtime::{
    ConsoleApiCalledType, EvaluateParams, EventConsoleApiCalled, EventExceptionThrown,
};
use chromiumoxide::listeners::EventStream;
use chromiumoxide::page::{Page, ScreenshotParams};
use chromiumoxide::{BrowserConfig, Command};
use futures_util::{FutureExt, StreamExt};
use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::{Duration, Instant};
use tokio::runtime::{Builder, Runtime};

/// Only a browser that hangs takes this long.
const PATIENCE: Duration = Duration::from_secs(600);
/// The longest wait for a condition in the page.
const LONGEST_WAIT: Duration = Duration::from_secs(240);
/// What [`Browser::complaints`] writes to the page's console: all complaints that came before it
/// have been read when it is read.
const MARK: &str = "the complaints end here";

/// A window of the shared Chromium.
pub struct Browser {
    page: Page,
    context: BrowserContextId,
    heard: RefCell<Heard>,
    /// For files; it goes with the window.
    pub folder: PathBuf,
    chromium: Arc<Chromium>,
}

/// The process. It ends with the last of its windows.
struct Chromium {
    /// Runs the connection to it, in a thread of its own.
    runtime: Runtime,
    process: chromiumoxide::Browser,
    folder: PathBuf,
}

/// What the page complains by.
struct Heard {
    thrown: EventStream<EventExceptionThrown>,
    console: EventStream<EventConsoleApiCalled>,
    log: EventStream<EventEntryAdded>,
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
        let config = BrowserConfig::builder()
            .chrome_executable(program)
            .new_headless_mode()
            .no_sandbox()
            .arg("disable-gpu")
            .user_data_dir(folder.join("profile"))
            // What it leaves behind when it is killed goes with the folder.
            .env("TMPDIR", folder.display().to_string())
            .viewport(None)
            .launch_timeout(PATIENCE)
            .request_timeout(PATIENCE)
            .build()
            .unwrap();
        let runtime = Builder::new_multi_thread()
            .worker_threads(1)
            .enable_all()
            .build()
            .unwrap();
        let process = runtime.block_on(async {
            let (process, mut connection) = chromiumoxide::Browser::launch(config).await.unwrap();
            tokio::spawn(async move { while connection.next().await.is_some() {} });
            process
        });
        Chromium {
            runtime,
            process,
            folder,
        }
    }
}

impl Drop for Chromium {
    fn drop(&mut self) {
        let _ = self.runtime.block_on(self.process.kill());
        // Its helpers end a moment after it, and write until then.
        for _ in 0..100 {
            if std::fs::remove_dir_all(&self.folder).is_ok() {
                break;
            }
            std::thread::sleep(Duration::from_millis(10));
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
        let (context, page, heard) = chromium.runtime.block_on(async {
            let process = &chromium.process;
            let context = CreateBrowserContextParams::default();
            let context = process.create_browser_context(context).await.unwrap();
            let mut window = CreateTargetParams::new("about:blank");
            window.browser_context_id = Some(context.clone());
            window.new_window = Some(true);
            let page = process.new_page(window).await.unwrap();
            let heard = Heard {
                thrown: page.event_listener().await.unwrap(),
                console: page.event_listener().await.unwrap(),
                log: page.event_listener().await.unwrap(),
            };
            page.enable_runtime().await.unwrap();
            page.enable_log().await.unwrap();
            (context, page, RefCell::new(heard))
        });
        let browser = Browser {
            page,
            context,
            heard,
            folder: new_folder(name),
            chromium,
        };
        // Otherwise each message of a WebSocket is reported with all that it holds.
        browser.call::<network::DisableParams>(json!({}));
        // It has the keys, whichever window has the focus.
        browser.call::<emulation::SetFocusEmulationEnabledParams>(json!({"enabled": true}));
        browser
    }

    /// Calls a method of the protocol. Only the parameters that differ from its defaults are given.
    fn call<C: Command + DeserializeOwned>(&self, params: Value) -> C::Response {
        let command: C = serde_json::from_value(params).unwrap();
        let method = command.identifier();
        let answer = self.chromium.runtime.block_on(self.page.execute(command));
        answer
            .unwrap_or_else(|error| panic!("{method}: {error}"))
            .result
    }

    /// What the page has complained about since it was asked last.
    pub fn complaints(&self) -> Vec<String> {
        self.run(&format!("console.error({MARK:?})"));
        let heard = &mut *self.heard.borrow_mut();
        let mut complaints = Vec::new();
        loop {
            let called = self
                .chromium
                .runtime
                .block_on(heard.console.next())
                .unwrap();
            let text: Vec<_> = called.args.iter().map(|arg| arg.value.clone()).collect();
            if text == [Some(Value::from(MARK))] {
                break;
            }
            if matches!(
                called.r#type,
                ConsoleApiCalledType::Error | ConsoleApiCalledType::Warning
            ) {
                complaints.push(format!("{text:?}"));
            }
        }
        // The connection has handed on all that came before the mark.
        while let Some(Some(thrown)) = heard.thrown.next().now_or_never() {
            complaints.push(format!("{:?}", thrown.exception_details));
        }
        while let Some(Some(added)) = heard.log.next().now_or_never() {
            if added.entry.level == LogEntryLevel::Error {
                complaints.push(format!("{:?}", added.entry));
            }
        }
        complaints
    }

    /// Opens an address, in a window of this size in pixels.
    pub fn open(&self, url: &str, size: (u32, u32), theme: &str) {
        self.look(size, theme);
        self.navigate(url);
        self.wait("window.scope && document.readyState === 'complete'");
    }

    /// Begins to load an address.
    pub fn navigate(&self, url: &str) {
        self.call::<NavigateParams>(json!({"url": url}));
    }

    pub fn reload(&self) {
        self.call::<ReloadParams>(json!({}));
    }

    /// Changes the window, and what the system prefers.
    pub fn look(&self, (width, height): (u32, u32), theme: &str) {
        self.call::<emulation::SetDeviceMetricsOverrideParams>(
            json!({"width": width, "height": height, "deviceScaleFactor": 1.0, "mobile": false}),
        );
        self.call::<emulation::SetEmulatedMediaParams>(
            json!({"features": [{"name": "prefers-color-scheme", "value": theme}]}),
        );
    }

    /// A script's result; a promise is awaited.
    pub fn run(&self, script: &str) -> Value {
        let answer = self.call::<EvaluateParams>(
            json!({"expression": script, "awaitPromise": true, "returnByValue": true}),
        );
        assert!(
            answer.exception_details.is_none(),
            "{script}: {:?}",
            answer.exception_details
        );
        answer.result.value.unwrap_or_default()
    }

    /// Waits until a condition holds in the page.
    pub fn wait(&self, condition: &str) {
        let begun = Instant::now();
        // In parts: the client gives up a request after 30 s, whatever its settings say.
        let mut held = Value::Null;
        while held != true && begun.elapsed() < LONGEST_WAIT {
            held = self.run(&format!(
                "new Promise((done) => {{ const begun = Date.now(); const look = () => {{ let is = false, why = ''; try {{ is = ({condition}); }} catch (error) {{ why = String(error); }} if (is) done(true); else if (Date.now() - begun > 5000) done(why || 'false'); else setTimeout(look, Math.min(30, (Date.now() - begun) / 8)); }}; look(); }})"
            ));
        }
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
            self.call::<input::DispatchKeyEventParams>(
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
        self.call::<input::DispatchMouseEventParams>(
            json!({"type": kind, "x": x, "y": y, "button": "left", "buttons": 1, "clickCount": 1}),
        );
    }

    pub fn wheel(&self, (x, y): (f64, f64), by: f64) {
        self.call::<input::DispatchMouseEventParams>(
            json!({"type": "mouseWheel", "x": x, "y": y, "deltaX": 0.0, "deltaY": by}),
        );
    }

    pub fn screenshot(&self, to: &Path) {
        let shot = self.page.screenshot(ScreenshotParams::default());
        let picture = self.chromium.runtime.block_on(shot).unwrap();
        std::fs::write(to, picture).unwrap();
    }

    pub fn downloads_to(&self, folder: &Path) {
        std::fs::create_dir_all(folder).unwrap();
        self.call::<SetDownloadBehaviorParams>(
            json!({"behavior": "allow", "downloadPath": folder, "browserContextId": self.context}),
        );
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let process = &self.chromium.process;
        let closed = process.dispose_browser_context(self.context.clone());
        let _ = self.chromium.runtime.block_on(closed);
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}
