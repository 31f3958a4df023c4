//! The scope as a program has it.

use crate::feed::ScopeSink;
use crate::parameters::Parameter;
use crate::replay::{Range, ReplayError, Speed, play, play_file, play_from};
use crate::server::{self, Places};
use crate::settings::Settings;
use crate::store::Store;
use crate::together::Together;
use std::fmt;
use std::io::{self, Read, Seek};
use std::net::{SocketAddr, TcpListener};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// The limit of connections with a request that is being read.
const READING: usize = 32;
/// The limit of connections that an answer is sent to.
const ANSWERING: usize = 32;
/// The limit of the bytes of a picture: each viewer gets it at once.
const LONGEST_PICTURE: usize = 256 << 10;
/// The longest time in which a closed scope takes what is on its way, and then that in which a
/// viewer gets the rest.
pub(crate) const REST: Duration = Duration::from_secs(1);

/// What the threads of a scope share.
#[derive(Debug)]
pub(crate) struct Shared {
    pub(crate) settings: Settings,
    pub(crate) viewers: AtomicUsize,
    /// Places of connections of which the request is being read.
    pub(crate) reading: Arc<Places>,
    /// Connections that an answer is sent to.
    pub(crate) answering: Arc<Places>,
    /// Pieces of recordings that the store has not taken yet.
    waiting: AtomicUsize,
    /// The parameters as they were listed last.
    parameters: Mutex<Vec<Parameter>>,
    store: Mutex<Store>,
    pub(crate) together: Option<Together>,
    control: Mutex<Control>,
    changed: Condvar,
}

/// A piece of a recording that the store has not taken yet.
pub(crate) struct OnItsWay(Arc<Shared>);

impl Drop for OnItsWay {
    fn drop(&mut self) {
        if self.0.waiting.fetch_sub(1, Ordering::Relaxed) == 1 {
            self.0.has_changed();
        }
    }
}

/// What ends or moves a replay.
#[derive(Debug, Default)]
struct Control {
    is_closed: bool,
    /// What a viewer wants to see of the file that is played.
    sought: Option<Range>,
}

impl Shared {
    pub(crate) fn new(settings: Settings) -> Self {
        Self {
            store: Mutex::new(Store::new(settings.memory)),
            together: settings.is_together.then(Together::new),
            settings,
            viewers: AtomicUsize::new(0),
            reading: Arc::new(Places::new(READING)),
            answering: Arc::new(Places::new(ANSWERING)),
            waiting: AtomicUsize::new(0),
            parameters: Mutex::default(),
            control: Mutex::default(),
            changed: Condvar::new(),
        }
    }

    pub(crate) fn store(&self) -> MutexGuard<'_, Store> {
        self.store.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn control(&self) -> MutexGuard<'_, Control> {
        self.control.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn is_closed(&self) -> bool {
        self.control().is_closed
    }

    /// Waits. Returns whether the scope was closed meanwhile.
    pub(crate) fn closes_within(&self, time: Duration) -> bool {
        self.wait(time, |control| !control.is_closed).is_closed
    }

    /// Waits until a viewer seeks in the file that is played. Returns the range, which is then
    /// taken, or nothing after this time, or when the scope is closed.
    pub(crate) fn sought_within(&self, time: Duration) -> Option<Range> {
        let goes_on = |control: &mut Control| !control.is_closed && control.sought.is_none();
        self.wait(time, goes_on).sought.take()
    }

    pub(crate) fn seek(&self, range: Range) {
        self.control().sought = Some(range);
        self.changed.notify_all();
    }

    /// The program's parameters, if it shows any. What has changed since the last call is kept as
    /// a change at the present time of the recording.
    pub(crate) fn parameters(&self) -> Option<Vec<Parameter>> {
        let now = self.settings.parameters.as_ref()?.list();
        let mut known = self
            .parameters
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        for parameter in &now {
            let before = known.iter().find(|one| one.name == parameter.name);
            if let Some(before) = before.filter(|before| before.value != parameter.value) {
                let (name, before, value) = (&parameter.name, &before.value, &parameter.value);
                self.store().change(name, before, value);
            }
        }
        known.clone_from(&now);
        Some(now)
    }

    /// A piece of a recording is on its way to the store until the token is dropped.
    pub(crate) fn on_its_way(self: &Arc<Self>) -> OnItsWay {
        self.waiting.fetch_add(1, Ordering::Relaxed);
        OnItsWay(self.clone())
    }

    /// Tells those that wait for a change that there was one.
    pub(crate) fn has_changed(&self) {
        // So that none is between its look and its wait.
        drop(self.control());
        self.changed.notify_all();
    }

    /// Waits for changes while `goes_on`, at most for this time.
    fn wait(
        &self,
        time: Duration,
        goes_on: impl FnMut(&mut Control) -> bool,
    ) -> MutexGuard<'_, Control> {
        let waited = self
            .changed
            .wait_timeout_while(self.control(), time, goes_on);
        waited.unwrap_or_else(PoisonError::into_inner).0
    }

    fn wait_at_most(&self, time: Duration, mut goes_on: impl FnMut() -> bool) {
        drop(self.wait(time, |_| goes_on()));
    }

    /// Viewers get the rest of the recording, and then their connections end.
    fn close(&self) {
        self.wait_at_most(REST, || self.waiting.load(Ordering::Relaxed) > 0);
        if let Some(together) = &self.together {
            together.release_all(self);
        }
        self.store().cut();
        self.control().is_closed = true;
        self.changed.notify_all();
        self.wait_at_most(2 * REST, || self.viewers.load(Ordering::Relaxed) > 0);
    }
}

/// A page that shows a running system, and its server. Dropping it ends the server: before that
/// the viewers get the rest of what the sinks were given. With viewers that do not take it the drop
/// takes up to 3 s.
///
/// Create it on an ordinary thread before the system runs: its threads inherit that thread's policy
/// and cores.
pub struct Scope {
    shared: Arc<Shared>,
    address: SocketAddr,
    acceptor: Option<JoinHandle<()>>,
}

impl Scope {
    /// Begins to listen.
    ///
    /// # Errors
    ///
    /// The system's own: the address is taken, or not of this machine. [`InvalidInput`] if the
    /// picture is longer than 256 KiB.
    ///
    /// [`InvalidInput`]: io::ErrorKind::InvalidInput
    pub fn open(settings: Settings) -> io::Result<Scope> {
        if let Some(picture) = &settings.picture
            && picture.len() > LONGEST_PICTURE
        {
            let error = format!(
                "the picture has {} bytes; at most {LONGEST_PICTURE} can be shown",
                picture.len()
            );
            return Err(io::Error::new(io::ErrorKind::InvalidInput, error));
        }
        let listener = TcpListener::bind(settings.address)?;
        let address = listener.local_addr()?;
        let shared = Arc::new(Shared::new(settings));
        let acceptor = std::thread::Builder::new()
            .name("luna-scope".to_owned())
            .spawn({
                let shared = shared.clone();
                move || {
                    // The threads of its viewers inherit that.
                    luna_machine::signals::refuse_write_signals_here();
                    server::accept(&listener, &shared);
                }
            })?;
        Ok(Scope {
            shared,
            address,
            acceptor: Some(acceptor),
        })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The address to open in the browser, with the token if there is one. The token follows a `#`;
    /// a browser does not send that part over the network.
    pub fn url(&self) -> String {
        let host = match self.address.ip() {
            ip if ip.is_unspecified() => "localhost".to_owned(),
            std::net::IpAddr::V4(ip) => ip.to_string(),
            std::net::IpAddr::V6(ip) => format!("[{ip}]"),
        };
        let token = self.shared.settings.token.as_ref();
        let token = token.map_or_else(String::new, |token| format!("#token={}", token.text()));
        format!("http://{host}:{}/{token}", self.address.port())
    }

    /// A sink for a recording's blocks. Of several, the recording that begins last is shown, alone;
    /// the blocks of the others are taken and ignored. With [`Settings::together`] all are shown.
    ///
    /// ```
    /// use luna_logger::format::{Encoder, Record};
    /// use luna_logger::Sink;
    /// use luna_scope::{Scope, Settings};
    ///
    /// let scope = Scope::open(Settings::default().address(([127, 0, 0, 1], 0).into()))?;
    /// let mut sink = scope.sink()?;
    /// sink.begin(&Encoder::head())?;
    /// let mut encoder = Encoder::new();
    /// encoder.put(&Record::End { time: 7 });
    /// sink.block(encoder.block())?;
    /// # Ok::<(), std::io::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// The system cannot create a thread.
    pub fn sink(&self) -> io::Result<ScopeSink> {
        ScopeSink::new(&self.shared)
    }

    /// Plays a recording, and returns at its end. Viewers see its end until the scope is dropped.
    ///
    /// # Errors
    ///
    /// It is not a recording, or damaged; records before the damage are shown.
    pub fn replay(&self, recording: impl Read, speed: Speed) -> Result<(), ReplayError> {
        play(&self.shared, recording, speed)
    }

    /// Plays a recording that can be read again, and returns at its end. It is read once as a whole
    /// before, so that viewers see the whole run from the beginning, and can seek in it.
    ///
    /// # Errors
    ///
    /// As [`replay`](Self::replay).
    pub fn replay_file(
        &self,
        recording: &mut (impl Read + Seek),
        speed: Speed,
    ) -> Result<(), ReplayError> {
        play_file(&self.shared, recording, speed)
    }

    /// After [`replay_file`](Self::replay_file): plays on from where a viewer seeks next, to the
    /// end. Returns early after this time without a viewer that does.
    ///
    /// # Errors
    ///
    /// As [`replay`](Self::replay).
    pub fn replay_sought(
        &self,
        recording: &mut (impl Read + Seek),
        speed: Speed,
        within: Duration,
    ) -> Result<(), ReplayError> {
        match self.shared.sought_within(within) {
            Some(range) => play_from(&self.shared, recording, speed, range),
            None => Ok(()),
        }
    }

    /// Says how the run ended, in a few words: the page shows them behind "Run ended:", with the
    /// figures of the loops, when the recording has come to its end. Without them it shows the time
    /// of the end. A recording that begins later has none again. It may be called at any time, on
    /// any thread that may block.
    ///
    /// ```
    /// use luna_scope::{Scope, Settings};
    ///
    /// let scope = Scope::open(Settings::default().address(([127, 0, 0, 1], 0).into()))?;
    /// // The system runs here, with a sink of the scope.
    /// scope.ended("completed after 60.0 s");
    /// # Ok::<(), std::io::Error>(())
    /// ```
    pub fn ended(&self, how: impl Into<String>) {
        // The recording that has ended may not have begun for the store.
        let goes_on = || self.shared.waiting.load(Ordering::Relaxed) > 0;
        self.shared.wait_at_most(REST, goes_on);
        self.shared.store().report(how.into());
    }

    /// How many look at it.
    pub fn viewers(&self) -> usize {
        self.shared.viewers.load(Ordering::Relaxed)
    }
}

impl Drop for Scope {
    fn drop(&mut self) {
        self.shared.close();
        // A connection of our own makes the accepting thread return and see the end.
        let mut to = self.address;
        if to.ip().is_unspecified() {
            to.set_ip(match to {
                SocketAddr::V4(_) => std::net::Ipv4Addr::LOCALHOST.into(),
                SocketAddr::V6(_) => std::net::Ipv6Addr::LOCALHOST.into(),
            });
        }
        let reached = std::net::TcpStream::connect_timeout(&to, Duration::from_secs(1)).is_ok();
        if let Some(acceptor) = self.acceptor.take().filter(|_| reached) {
            let _ = acceptor.join();
        }
    }
}

impl fmt::Debug for Scope {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Scope")
            .field("address", &self.address)
            .field("viewers", &self.viewers())
            .finish_non_exhaustive()
    }
}
