//! The scope that the environment asks for: `LUNA_SCOPE`.

use crate::error::{Error, Result};
use crate::notice::notice;
use crate::system::Opening;
use luna_config::parameters::Parameters;
use luna_logger::Logging;
use luna_scope::{Scope, ScopeSink, Settings};
use std::fmt::Display;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;

/// The variable of the environment: 1 for the port of all scopes on the loopback, or a free one, or
/// an address.
const VARIABLE: &str = "LUNA_SCOPE";

/// The scope of a run, if the environment asks for one.
pub(crate) struct Shown(Option<Scope>);

impl Shown {
    /// Opens it, and gives what records to it. `recording` is what else is recorded; `new` makes
    /// one for the scope alone.
    pub(super) fn open(
        recording: Option<Logging>,
        parameters: Parameters,
        opening: &Opening,
        new: impl FnOnce(ScopeSink) -> Logging,
    ) -> Result<(Option<Logging>, Shown)> {
        let asked = std::env::var(VARIABLE).unwrap_or_default();
        if asked.is_empty() || asked == "0" {
            return Ok((recording, Shown(None)));
        }
        let refused = {
            let asked = asked.clone();
            move |why: &dyn Display| Error::other(format!("{VARIABLE}={asked}: {why}"))
        };
        let addresses = addresses(&asked).ok_or_else(|| refused(&HOW))?;
        let opened = opening.wait_for(format!("serve the scope {asked}"), move || {
            serve(&addresses, parameters)
        })?;
        let (scope, sink) = opened.map_err(|error| refused(&error))?;
        notice!("luna: scope: {}", scope.url());
        let recording = match recording {
            Some(recording) => recording.beside(sink),
            None => new(sink),
        };
        Ok((Some(recording), Shown(Some(scope))))
    }

    /// Viewers read how the run has ended. It closes the scope.
    pub(crate) fn ended(self, how: &dyn Display) {
        if let Some(scope) = self.0 {
            scope.ended(how.to_string());
        }
    }
}

const HOW: &str = "it must be 1, or an address to listen on, as 127.0.0.1:8620";

/// Those to try, in this order.
fn addresses(asked: &str) -> Option<Vec<SocketAddr>> {
    if asked == "1" {
        let usual = Settings::default().listens_on();
        return Some(vec![usual, SocketAddr::new(usual.ip(), 0)]);
    }
    Some(vec![asked.parse().ok()?])
}

fn serve(addresses: &[SocketAddr], parameters: Parameters) -> io::Result<(Scope, ScopeSink)> {
    let settings = Settings::default().parameters(Arc::new(parameters));
    let settings = settings.allow_setting()?;
    let mut scope = Err(io::ErrorKind::AddrInUse.into());
    for address in addresses {
        scope = Scope::open(settings.clone().address(*address));
        // Else another program has it, as a system that runs beside this one.
        if !matches!(&scope, Err(error) if error.kind() == io::ErrorKind::AddrInUse) {
            break;
        }
    }
    let scope = scope?;
    let sink = scope.sink()?;
    Ok((scope, sink))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_asked_for() {
        let ports = |asked| addresses(asked).map(|all| all.iter().map(SocketAddr::port).collect());
        assert_eq!(ports("1"), Some(vec![8620, 0]));
        assert_eq!(ports("0.0.0.0:9000"), Some(vec![9000]));
        assert_eq!(ports("yes"), None::<Vec<u16>>);
    }
}
