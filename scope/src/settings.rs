//! Who may see what.

use crate::parameters::Parameters;
use crate::token::Token;
use std::fmt;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

/// The port if none is stated.
const PORT: u16 = 8620;

/// Where a scope listens, whom it lets in, and how much it keeps.
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
        }
    }
}

impl Settings {
    /// Listens there; on port 8620 of the loopback if not stated. Port 0 lets the system choose one.
    ///
    /// There is no encryption: on other addresses than the loopback all who can reach it see all, and a token can be overheard.
    pub fn address(mut self, address: SocketAddr) -> Self {
        self.address = address;
        self
    }

    /// Answers under this name too, without a port. Otherwise only under `localhost` and the address that a viewer has reached: a page of another origin cannot pretend to be
    /// this one by a name of its own that leads here.
    pub fn host(mut self, name: impl Into<String>) -> Self {
        self.hosts.push(name.into().to_ascii_lowercase());
        self
    }

    /// At most so many viewers at a time, 8 if not stated; others are refused.
    pub fn viewers(mut self, most: usize) -> Self {
        self.viewers = most;
        self
    }

    /// Keeps so many bytes of the last blocks for who comes late, 16 MiB if not stated, at least 1 MiB.
    pub fn memory(mut self, bytes: usize) -> Self {
        self.memory = bytes.max(1 << 20);
        self
    }

    /// Drops a viewer that takes nothing for so long, 10 s if not stated. Others are not held up by it meanwhile.
    pub fn patience(mut self, time: Duration) -> Self {
        self.patience = time;
        self
    }

    /// Shows these parameters. They can be set by who has the token of [`allow_setting`](Self::allow_setting).
    pub fn parameters(mut self, parameters: Arc<dyn Parameters>) -> Self {
        self.parameters = Some(parameters);
        self
    }

    /// Makes a token; who has it may set parameters. It is in [`Scope::url`](crate::Scope::url).
    ///
    /// # Errors
    ///
    /// The system has no random numbers.
    pub fn allow_setting(mut self) -> std::io::Result<Self> {
        self.token = Some(Token::random()?);
        Ok(self)
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
            .finish()
    }
}
