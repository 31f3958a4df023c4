//! How a network is opened: from the program, or from a file in zenoh's format.

use crate::NetError;
use crate::age::millis;
use serde_json::Value;
use std::fs;
use std::net::IpAddr;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// What zenoh's format has and this crate is not built with, and why. A key there would have no
/// effect.
const NOT_BUILT_IN: [(&str, &str); 5] = [
    (
        "transport/auth/pubkey",
        "authentication by bare keys is not built in: use TLS or QUIC with certificates",
    ),
    (
        "transport/unicast/compression",
        "compression is not built in: remove the key",
    ),
    (
        "transport/shared_memory",
        "shared memory is not built in: use luna-ipc on one computer",
    ),
    ("plugins", "plugins are not built in: remove the key"),
    (
        "plugins_loading",
        "plugins are not built in: remove the key",
    ),
];

/// Files that zenoh reads only when a connection is made.
const FILES: [&str; 6] = [
    "transport/link/tls/root_ca_certificate",
    "transport/link/tls/listen_private_key",
    "transport/link/tls/listen_certificate",
    "transport/link/tls/connect_private_key",
    "transport/link/tls/connect_certificate",
    "transport/auth/usrpwd/dictionary_file",
];

/// How a [`Network`](crate::Network) is opened.
///
/// Nothing listens beyond this computer, and nothing looks for others by multicast, unless the
/// configuration says so. Addresses are zenoh's: `tcp/127.0.0.1:7447`, `tls/press.local:7447`,
/// `quic/…`, `udp/…`.
///
/// ```
/// use luna_net::Config;
/// use std::time::Duration;
///
/// let config = Config::network()
///     .listen("tcp/192.168.7.2:7447")
///     .connect("tcp/192.168.7.3:7447")
///     .lost_after(Duration::from_millis(400));
/// # let _ = config;
/// ```
#[derive(Debug, Clone)]
pub struct Config {
    /// What is stated, in zenoh's format.
    stated: Value,
    file: Option<PathBuf>,
    is_loopback: bool,
    listens: Vec<String>,
    connects: Vec<String>,
    lost_after: Duration,
    connect_within: Option<Duration>,
}

impl Config {
    /// For programs on this computer: addresses beyond it are refused at the opening. It listens on
    /// a free port of 127.0.0.1 unless [`listen`](Self::listen) names one.
    pub fn loopback() -> Self {
        Self {
            stated: Value::Object(Default::default()),
            file: None,
            is_loopback: true,
            listens: Vec::new(),
            connects: Vec::new(),
            lost_after: Duration::from_secs(1),
            connect_within: None,
        }
    }

    /// For other computers too: it listens where [`listen`](Self::listen) says. Who reaches such an
    /// address can send and receive values: for TLS, QUIC, passwords and access control use
    /// [`from_file`](Self::from_file).
    pub fn network() -> Self {
        Self {
            is_loopback: false,
            ..Self::loopback()
        }
    }

    /// From a file in zenoh's format (JSON5, or JSON): its TLS, QUIC, authentication, access
    /// control, discovery and all else. What the file does not state is as for
    /// [`network`](Self::network). Reads the file: not for the real-time path.
    ///
    /// # Errors
    ///
    /// [`NetError::Unreadable`]; or [`NetError::Config`], which names the file and the key, for a
    /// file that is no JSON5, a key that zenoh does not know or that is not built in, a value that
    /// it does not take, and a certificate or password file that cannot be read.
    pub fn from_file(path: impl AsRef<Path>) -> Result<Self, NetError> {
        let file = path.as_ref().to_owned();
        let text = match fs::read_to_string(&file) {
            Ok(text) => text,
            Err(source) => return Err(NetError::Unreadable { file, source }),
        };
        let wrong = |key: &str, why: String| NetError::Config {
            place: format!("`{}`", file.display()),
            key: key.to_owned(),
            why,
        };
        let stated: Value = json5::from_str(&text)
            .map_err(|error| wrong("", format!("it is no JSON5: {error}")))?;
        if !stated.is_object() {
            return Err(wrong("", "it is no object: begin with `{`".to_owned()));
        }
        let config = Self {
            stated,
            file: Some(file.clone()),
            ..Self::network()
        };
        config.check()?;
        Ok(config)
    }

    /// Listens on an address too. Without one it listens on a free port of 127.0.0.1.
    #[must_use]
    pub fn listen(mut self, address: &str) -> Self {
        self.listens.push(address.to_owned());
        self
    }

    /// Connects to an address too, as soon as something listens there, and again whenever the
    /// connection ends.
    #[must_use]
    pub fn connect(mut self, address: &str) -> Self {
        self.connects.push(address.to_owned());
        self
    }

    /// After which silence a partner is lost; 1 s if not stated, at least 20 ms. Each side gives a
    /// sign of life four times in it. zenoh's own lease is the same, unless a file states it.
    #[must_use]
    pub fn lost_after(mut self, time: Duration) -> Self {
        self.lost_after = time.max(Duration::from_millis(20));
        self
    }

    /// The opening fails unless all addresses to connect to are connected within this time. If not
    /// stated the opening does not wait for them.
    #[must_use]
    pub fn connect_within(mut self, time: Duration) -> Self {
        self.connect_within = Some(time);
        self
    }

    pub(crate) fn time(&self) -> Duration {
        self.lost_after
    }

    /// Where it listens, as far as that is stated.
    pub(crate) fn listens(&self) -> Vec<String> {
        self.all("listen/endpoints", &self.listens)
    }

    pub(crate) fn connects(&self) -> Vec<String> {
        self.all("connect/endpoints", &self.connects)
    }

    fn all(&self, key: &str, own: &[String]) -> Vec<String> {
        let mut found = Vec::new();
        if let Some(stated) = self.at(key) {
            addresses(stated, &mut found);
        }
        found.extend_from_slice(own);
        found
    }

    fn at(&self, key: &str) -> Option<&Value> {
        let value = self.stated.pointer(&format!("/{key}"))?;
        (!value.is_null()).then_some(value)
    }

    fn wrong(&self, key: &str, why: impl Into<String>) -> NetError {
        NetError::Config {
            place: match &self.file {
                Some(file) => format!("`{}`", file.display()),
                None => "of this program".to_owned(),
            },
            key: key.to_owned(),
            why: why.into(),
        }
    }

    /// What zenoh is opened with.
    pub(crate) fn check(&self) -> Result<zenoh::Config, NetError> {
        for (key, why) in NOT_BUILT_IN {
            if self.at(key).is_some() {
                return Err(self.wrong(key, why));
            }
        }
        let (listens, connects) = (self.listens(), self.connects());
        let beyond = listens.iter().chain(&connects).find(|a| !is_loopback(a));
        if let (true, Some(address)) = (self.is_loopback, beyond) {
            let address = address.clone();
            return Err(NetError::BeyondLoopback { address });
        }
        for key in FILES {
            if let Some(path) = self.at(key).and_then(Value::as_str)
                && let Err(error) = fs::File::open(path)
            {
                let why = format!("cannot read `{path}`: {error}");
                return Err(self.wrong(key, why));
            }
        }
        let is_secure = |a: &&String| a.starts_with("tls/") || a.starts_with("quic/");
        if let Some(address) = listens.iter().find(is_secure) {
            for what in ["listen_certificate", "listen_private_key"] {
                let key = format!("transport/link/tls/{what}");
                if self.at(&key).is_none() && self.at(&format!("{key}_base64")).is_none() {
                    let why =
                        format!("`{address}` needs it: state it in a file for `Config::from_file`");
                    return Err(self.wrong(&key, why));
                }
            }
        }
        let mut zenoh = self.parse()?;
        let mut set = |key: &str, value: String| {
            let set = zenoh.insert_json5(key, &value);
            set.map_err(|error| self.wrong(key, error.to_string()))
        };
        let json = |list: &[String]| Value::from(list.to_vec()).to_string();
        let time = millis(self.lost_after);
        if listens.is_empty() {
            set("listen/endpoints", r#"["tcp/127.0.0.1:0"]"#.to_owned())?;
        } else if !self.listens.is_empty() {
            set("listen/endpoints", json(&listens))?;
        }
        if !self.connects.is_empty() {
            set("connect/endpoints", json(&connects))?;
        }
        for (key, value) in [
            ("scouting/multicast/enabled", "false".to_owned()),
            ("transport/link/tx/lease", time.to_string()),
            (
                "transport/link/tx/queue/congestion_control/block/wait_before_close",
                (time * 1000).to_string(),
            ),
            (
                "connect/retry",
                "{ period_init_ms: 50, period_max_ms: 1000, period_increase_factor: 2 }".to_owned(),
            ),
        ] {
            if self.at(key).is_none() {
                set(key, value)?;
            }
        }
        if let Some(limit) = self.connect_within {
            set("connect/timeout_ms", millis(limit).to_string())?;
            set("connect/exit_on_failure", "true".to_owned())?;
        }
        Ok(zenoh)
    }

    fn parse(&self) -> Result<zenoh::Config, NetError> {
        match zenoh::Config::from_json5(&self.stated.to_string()) {
            Ok(config) => Ok(config),
            Err(error) => {
                let (key, why) = wrong_key(&self.stated, "")
                    .unwrap_or_else(|| (String::new(), error.to_string()));
                Err(self.wrong(&key, format!("zenoh does not take it: {why}")))
            }
        }
    }
}

/// The innermost key that zenoh refuses, and why.
fn wrong_key(value: &Value, path: &str) -> Option<(String, String)> {
    for (name, value) in value.as_object()? {
        let key = match path.is_empty() {
            true => name.clone(),
            false => format!("{path}/{name}"),
        };
        if let Err(error) = zenoh::Config::default().insert_json5(&key, &value.to_string()) {
            let inner = wrong_key(value, &key);
            return Some(inner.unwrap_or_else(|| (key, error.to_string())));
        }
    }
    None
}

/// All addresses in a value of zenoh's: a text, a list, or an object by mode or with `locators`.
fn addresses(value: &Value, found: &mut Vec<String>) {
    match value {
        Value::String(address) if address.contains('/') => found.push(address.clone()),
        Value::Array(list) => list.iter().for_each(|value| addresses(value, found)),
        Value::Object(map) => map.values().for_each(|value| addresses(value, found)),
        _ => {}
    }
}

fn is_loopback(address: &str) -> bool {
    let Some((_, rest)) = address.split_once('/') else {
        return false;
    };
    let rest = rest.split(['#', '?']).next().unwrap_or_default();
    let host = rest.rsplit_once(':').map_or(rest, |(host, _)| host);
    let host = host.trim_start_matches('[').trim_end_matches(']');
    host == "localhost" || host.parse().is_ok_and(|ip: IpAddr| ip.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loopback_is_told_from_the_rest() {
        for near in [
            "tcp/127.0.0.1:7447",
            "udp/127.3.2.1:0#iface=lo",
            "quic/[::1]:7447",
            "tls/localhost:7447?prio=1-2",
        ] {
            assert!(is_loopback(near), "{near}");
        }
        for far in [
            "tcp/0.0.0.0:7447",
            "tcp/[::]:7447",
            "tcp/192.168.1.2:7447",
            "tls/localhost.example:1",
            "127.0.0.1:7447",
        ] {
            assert!(!is_loopback(far), "{far}");
        }
    }

    #[test]
    fn what_is_not_stated_stays_on_this_computer() {
        for config in [Config::loopback(), Config::network()] {
            let zenoh = config.check().unwrap();
            let listens = zenoh.get_json("listen/endpoints").unwrap();
            assert_eq!(listens, r#"["tcp/127.0.0.1:0"]"#);
            let multicast = zenoh.get_json("scouting/multicast/enabled").unwrap();
            assert_eq!(multicast, "false");
        }
    }

    #[test]
    fn all_forms_of_addresses_are_found() {
        let value = json5::from_str(
            "{ peer: ['tcp/a:1', {strategy: 'allOf', locators: ['tcp/b:2']}], router: 'tcp/c:3' }",
        );
        let mut found = Vec::new();
        addresses(&value.unwrap(), &mut found);
        found.sort();
        assert_eq!(found, ["tcp/a:1", "tcp/b:2", "tcp/c:3"]);
    }
}
