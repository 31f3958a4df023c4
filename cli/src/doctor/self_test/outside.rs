//! Links to files.

use super::Test;

#[cfg(unix)]
pub(super) const TESTS: &[Test] = &[Test {
    name: "external-channel",
    component: "external",
    shows: "lines go out to a pipe and come back from it, and the end of one is the end of the other",
    run: links::around,
}];

#[cfg(not(unix))]
pub(super) const TESTS: &[Test] = &[];

#[cfg(unix)]
mod links {
    use super::super::{Outcome, Trouble, ensure, same};
    use luna::System;
    use luna::external::{Frame, Framing, LinkError, input, output};

    const LINES: u32 = 100;

    pub(super) fn around() -> Outcome {
        let (near, far) = std::io::pipe().map_err(luna::Error::from)?;
        let (source, outgoing) = luna::channel::<[u8; 4]>();
        let (incoming, drain) = luna::channel::<Frame<4>>();
        let mut system = System::new("self-test");
        let links = system.executor("links").build()?;
        let framing = Framing::fixed(4);
        // First, so that its error comes first: the other's is then a consequence.
        links
            .process("input")
            .spawn(input(near, incoming, framing))?;
        links
            .process("output")
            .spawn(output(outgoing, far, framing))?;
        let ends = system.executor("ends").build()?;
        ends.process("source").spawn(async move {
            for number in 0..LINES {
                source.send(number.to_le_bytes()).await?;
            }
            Ok(())
        })?;
        ends.process("drain").spawn(async move {
            for number in 0..LINES {
                same("a record", &*drain.recv().await?, &number.to_le_bytes()[..])?;
            }
            ensure(
                drain.recv().await.is_err_and(|error| error.is_closed()),
                "the end comes through",
            )
        })?;
        match system.run() {
            Ok(_) => Ok(format!("{LINES} records through a pipe")),
            Err(luna::Error::Process { source, .. }) if cannot_wait(&source) => {
                Err(Trouble::CannotRun {
                    why: source.to_string(),
                    how: "use the complete backend".to_owned(),
                })
            }
            Err(error) => Err(error.into()),
        }
    }

    /// Whether the backend cannot wait for files.
    fn cannot_wait(error: &luna::Error) -> bool {
        matches!(error, luna::Error::External(LinkError::Wait(error)) if error.is_unsupported())
    }
}
