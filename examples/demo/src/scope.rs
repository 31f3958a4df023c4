//! The scope of `luna demo --scope`.

use crate::failure::{Failure, unusable};
use crate::jiwy::Show;
use luna_scope::{Scope, Settings};
use std::io::Write;
use std::net::SocketAddr;
use std::sync::Arc;

/// The scope of a run of a demo, which shows its parameters and its picture. A viewer with the
/// token, if there is one, may set them.
pub(crate) fn of_demo(
    address: SocketAddr,
    parameters: luna::parameters::Parameters,
    show: Show<'_>,
) -> Result<Scope, Failure> {
    let settings = Settings::default()
        .address(address)
        .parameters(Arc::new(parameters));
    let settings = show.picture.into_iter().fold(settings, Settings::picture);
    open(match show.scope_token {
        true => settings.allow_setting().map_err(unserved(address))?,
        false => settings,
    })
}

/// A scope cannot be served there.
pub(crate) fn unserved(address: SocketAddr) -> impl Fn(std::io::Error) -> Failure {
    move |error| unusable(format_args!("scope {address}"), error)
}

/// A scope. Its address is printed on standard error, since standard output is for results.
fn open(settings: Settings) -> Result<Scope, Failure> {
    let address = settings.listens_on();
    let scope = Scope::open(settings).map_err(unserved(address))?;
    let _ = writeln!(std::io::stderr(), "scope: {}", scope.url());
    Ok(scope)
}
