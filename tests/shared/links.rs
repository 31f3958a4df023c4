//! Common to the tests of crates whose links carry channels to another program.

use luna::{Policy, System};
use std::thread::JoinHandle;

/// Runs a process and a link on an executor of their own, on the calling thread. Without the
/// privilege for a policy the threads are ordinary ones.
pub(crate) fn run(
    policy: Policy,
    link: impl luna::Process + Send + 'static,
    body: impl Future<Output = luna::Result<()>> + Send + 'static,
) -> luna::Result<()> {
    let mut system = System::new("test");
    let main = system.executor("main").policy(policy).build()?;
    main.process("link").priority(2).spawn(link)?;
    main.process("body").priority(1).spawn(body)?;
    system.run().map(drop)
}

/// As [`run`], on a thread of its own.
pub(crate) fn spawn(
    policy: Policy,
    link: impl luna::Process + Send + 'static,
    body: impl Future<Output = luna::Result<()>> + Send + 'static,
) -> JoinHandle<luna::Result<()>> {
    std::thread::spawn(move || run(policy, link, body))
}
