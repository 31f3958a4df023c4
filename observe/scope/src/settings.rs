//! The settings of a scope.

use crate::parameters::Parameters;
use crate::site::{Shown, Site};
use crate::token::Token;
use std::fmt;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

/// The port if none is stated.
const PORT: u16 = 8620;

/// Where a scope listens, which host names it accepts, and how much it keeps.
///
/// ```
/// use luna_scope::Settings;
///
/// let settings = Settings::default();
/// assert_eq!(settings.listens_on().to_string(), "127.0.0.1:8620"); // this machine alone
/// let settings = settings.address(([0, 0, 0, 0], 8620).into()).host("robot.local").viewers(2);
/// assert_eq!(settings.listens_on().port(), 8620);
/// ```
#[derive(Clone)]
pub struct Settings {
    pub(crate) address: SocketAddr,
    pub(crate) hosts: Vec<String>,
    pub(crate) viewers: usize,
    pub(crate) memory: usize,
    pub(crate) patience: Duration,
    pub(crate) token: Option<Token>,
    pub(crate) parameters: Option<Arc<dyn Parameters>>,
    pub(crate) picture: Option<Arc<str>>,
    pub(crate) is_together: bool,
    pub(crate) site: Option<Shown>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            address: SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), PORT),
            hosts: Vec::new(),
            viewers: 8,
            memory: 16 << 20,
            patience: Duration::from_secs(10),
            token: None,
            parameters: None,
            picture: None,
            is_together: false,
            site: None,
        }
    }
}

impl Settings {
    /// The address to listen on; default port 8620 of the loopback. Port 0 lets the system choose
    /// one.
    ///
    /// There is no encryption: on an address other than the loopback everyone with access to it
    /// sees all data, and a token can be intercepted.
    pub fn address(mut self, address: SocketAddr) -> Self {
        self.address = address;
        self
    }

    /// Accepts this host name too, without a port. Otherwise only `localhost` and the address that
    /// a viewer has reached are accepted: a page of another origin cannot pose as this one by a
    /// name that resolves to this address.
    pub fn host(mut self, name: impl Into<String>) -> Self {
        self.hosts.push(name.into().to_ascii_lowercase());
        self
    }

    /// The limit of viewers at a time, default 8; others are refused.
    pub fn viewers(mut self, most: usize) -> Self {
        self.viewers = most;
        self
    }

    /// Keeps this many bytes of the last blocks for viewers that connect later, half of them for
    /// events; default 16 MiB, at least 1 MiB.
    pub fn memory(mut self, bytes: usize) -> Self {
        self.memory = bytes.max(1 << 20);
        self
    }

    /// Disconnects a viewer that takes nothing for this time; default 10 s. It does not delay other
    /// viewers meanwhile.
    pub fn patience(mut self, time: Duration) -> Self {
        self.patience = time;
        self
    }

    /// Shows these parameters. They can be set with the token of
    /// [`allow_setting`](Self::allow_setting).
    pub fn parameters(mut self, parameters: Arc<dyn Parameters>) -> Self {
        self.parameters = Some(parameters);
        self
    }

    /// Shows a picture of the machine: an SVG of at most 256 KiB, in which elements are bound to
    /// signals, processes and channels by attributes, as those of a model's drawing are.
    /// `docs/scope-pictures.md` lists them.
    ///
    /// The page takes the elements and attributes that it knows: nothing in the SVG runs, and
    /// nothing is loaded for it. What it leaves out, and what is wrong with a binding, is written
    /// below the picture.
    ///
    /// ```
    /// use luna_scope::{Scope, Settings};
    ///
    /// let settings = Settings::default().picture(
    ///     r##"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 20">
    ///       <rect width="10" height="20" data-signal="arm/position" data-x="0 0; 0.3 90"/>
    ///     </svg>"##,
    /// );
    /// let scope = Scope::open(settings.address(([127, 0, 0, 1], 0).into()))?;
    /// # Ok::<(), std::io::Error>(())
    /// ```
    pub fn picture(mut self, svg: impl Into<Arc<str>>) -> Self {
        self.picture = Some(svg.into());
        self
    }

    /// Shows all recordings that come at a time together, at most 64: on one time axis, with the name
    /// of the system before each name that does not begin with it. Without this, the recording that
    /// began last is shown alone.
    ///
    /// A program of the same name that comes back goes on where the one before has ended. When all
    /// have ended, the next one begins anew.
    pub fn together(mut self) -> Self {
        self.is_together = true;
        self
    }

    /// Makes a token, with which parameters can be set. It is part of
    /// [`Scope::url`](crate::Scope::url).
    ///
    /// # Errors
    ///
    /// The system has no random numbers.
    pub fn allow_setting(mut self) -> std::io::Result<Self> {
        self.token = Some(Token::random()?);
        Ok(self)
    }

    /// Serves this page in place of the scope's. Makes a token, with which the page may talk with
    /// the program: other users of the machine have none.
    ///
    /// # Errors
    ///
    /// The system has no random numbers.
    pub fn site(mut self, site: Arc<dyn Site>) -> std::io::Result<Self> {
        self.site = Some(Shown(site));
        self.allow_setting()
    }

    /// Where it will listen.
    pub fn listens_on(&self) -> SocketAddr {
        self.address
    }
}

impl fmt::Debug for Settings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Settings")
            .field("address", &self.address)
            .field("hosts", &self.hosts)
            .field("viewers", &self.viewers)
            .field("memory", &self.memory)
            .field("has_token", &self.token.is_some())
            .field("has_parameters", &self.parameters.is_some())
            .field("is_together", &self.is_together)
            .field("site", &self.site)
            .field("has_picture", &self.picture.is_some())
            .finish()
    }
}
