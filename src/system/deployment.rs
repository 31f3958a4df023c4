//! Where a system's deployment comes from, if it is not the program alone.

use super::System;
use crate::error::{Result, SetupError};
use luna_config::arguments::take_options;
use std::path::Path;

impl System {
    /// Reads a system file: what it states of executors, threads, processes and loops goes over
    /// what the program states, by their names. So one program runs on a laptop and on the machine.
    /// `docs/system-file.md` has its keys. Call it before the first executor or thread; the file is
    /// read here, and never again. Not for the real-time path.
    ///
    /// Where the program names no file, the environment may: `LUNA_DEPLOYMENT=machine.toml`. What
    /// was changed, and in which line, stands in
    /// [`Report::deployment`](crate::Report::deployment). Processes that are spawned while the
    /// system runs get the values of a name that was there at the start.
    ///
    /// # Errors
    ///
    /// [`SetupError::DeploymentFile`]: it cannot be read. [`SetupError::Deployment`]: something is
    /// wrong in it, with the line. [`SetupError::DeploymentTooLate`]: an executor or a thread was
    /// made before, or a file was named. What shows only later is a [`SetupError::Deployment`] of
    /// [`build`](crate::system::ExecutorBuilder::build) (a core that the machine has not), of
    /// [`spawn`](crate::system::ProcessBuilder::spawn) (the priority of a process with a thread of
    /// its own) or of [`run`](Self::run) (a name that nothing has).
    ///
    #[cfg_attr(feature = "toml", doc = "```")]
    #[cfg_attr(not(feature = "toml"), doc = "```ignore")]
    /// use luna::prelude::*;
    ///
    /// let file = std::env::temp_dir().join(format!("luna-laptop-{}.toml", std::process::id()));
    /// std::fs::write(&file, "[executor.control]\ncore = \"any\"\npolicy = \"other\"\n")?;
    /// let mut system = System::new("arm");
    /// system.deployment_from(&file)?;
    /// let control = system.executor("control").core(3).policy(Policy::fifo(80)).build()?;
    /// control.process("x axis").spawn(async { Ok(()) })?;
    /// let report = system.run()?;
    /// assert_eq!(report.threads[0].core, None);
    /// let overrides = report.deployment.unwrap().overrides;
    /// assert_eq!((overrides[1].line, overrides[1].program.as_deref()), (3, Some("fifo:80")));
    /// # std::fs::remove_file(file)?;
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn deployment_from(&mut self, file: impl AsRef<Path>) -> Result<&mut Self> {
        let read = self.plan.read_deployment(file.as_ref());
        read.inspect_err(|_| self.plan.note_refusal())?;
        Ok(self)
    }

    /// Takes `--deployment FILE` out of a program's arguments, as
    /// [`deployment_from`](Self::deployment_from); gives the others, in their order. What follows
    /// `--` is left alone.
    ///
    /// # Errors
    ///
    /// As `deployment_from`, and [`SetupError::DeploymentFile`] if no file follows.
    ///
    /// ```
    /// use luna::prelude::*;
    ///
    /// let mut system = System::new("arm");
    /// let others = system.deployment_arguments(["--fast", "--"].map(String::from))?;
    /// assert_eq!(others, ["--fast", "--"]);
    /// let error = system.deployment_arguments(["--deployment".to_owned()]).unwrap_err();
    /// assert_eq!(error.to_string(), "--deployment: it needs the name of a file");
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn deployment_arguments(
        &mut self,
        arguments: impl IntoIterator<Item = String>,
    ) -> Result<Vec<String>> {
        take_options(arguments, &["--deployment"], |option, file| {
            if file.is_empty() {
                self.plan.note_refusal();
                return Err(SetupError::DeploymentFile {
                    path: option.to_owned(),
                    message: "it needs the name of a file".to_owned(),
                }
                .into());
            }
            self.deployment_from(file).map(|_| ())
        })
    }
}
