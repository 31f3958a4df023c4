//! What a file states about executors and threads.

use super::stated::Thread;
use super::{Deployment, DeploymentError, find, written};
use luna_platform::thread::{Attributes, HIGHEST_USER_PRIORITY};

impl Deployment {
    /// The attributes of an executor or a thread as the file has them.
    ///
    /// # Errors
    ///
    /// What cannot be.
    pub fn thread(
        &self,
        mut attributes: Attributes,
        is_shared: bool,
    ) -> Result<Attributes, DeploymentError> {
        let name = attributes.name().to_owned();
        self.enter_thread(&name);
        let Some(stated) = find(&self.stated.threads, &name) else {
            return Ok(attributes);
        };
        let of = format!("executor `{name}`");
        let core = |core: Option<usize>| core.map_or("any".to_owned(), |core| core.to_string());
        if let Some(at) = &stated.core {
            let program = core(attributes.asked_core());
            self.note(at, &of, "core", program, core(at.value));
            attributes = match at.value {
                Some(core) => attributes.core(core),
                None => attributes.any_core(),
            };
        }
        if let Some(at) = &stated.policy {
            let program = attributes.asked_policy().to_string();
            self.note(at, &of, "policy", program, at.value.to_string());
            attributes = attributes.policy(at.value);
        }
        self.check_deadline(stated, &attributes, is_shared)?;
        if let Some(at) = &stated.spin_before_sleep {
            let program = written(attributes.asked_spin());
            self.note(at, &of, "spin_before_sleep", program, written(at.value));
            attributes = attributes.spin_before_sleep(at.value);
        }
        if let Some(at) = &stated.stack_size {
            let program = attributes.asked_stack().to_string();
            self.note(at, &of, "stack_size", program, at.value.to_string());
            attributes = attributes.stack_size(at.value);
        }
        Ok(attributes)
    }

    /// What else is wrong with a policy of the file is found as the file is read.
    fn check_deadline(
        &self,
        stated: &Thread,
        attributes: &Attributes,
        is_shared: bool,
    ) -> Result<(), DeploymentError> {
        if !attributes.asked_policy().is_deadline() {
            return Ok(());
        }
        let is_pinned = attributes.asked_core().is_some();
        let Some(at) = &stated.policy else {
            return match &stated.core {
                Some(at) if is_pinned && !is_shared => {
                    let message = "a thread of SCHED_DEADLINE cannot be pinned to a core";
                    let advice = "write `\"any\"`, or another `policy` beside it";
                    Err(self.problem(at, message, advice))
                }
                // If there is an error it is the program's.
                _ => Ok(()),
            };
        };
        if is_shared {
            let most = HIGHEST_USER_PRIORITY;
            let message =
                "an executor cannot have this policy, whose budget would stop all its processes";
            let advice = format!("write `fifo:1` to `fifo:{most}`");
            return Err(self.problem(at, message, advice));
        }
        if is_pinned {
            let message = "a thread that is pinned to a core cannot have this policy";
            return Err(self.problem(at, message, "write `core = \"any\"` beside it"));
        }
        Ok(())
    }

    /// The machine lacks the core of a thread: whether the file asked for it.
    pub fn lacks_core(&self, thread: &str, available: &[usize]) -> Option<DeploymentError> {
        let at = find(&self.stated.threads, thread)?.core.as_ref()?;
        let advice = format!("write one of {available:?}, or `\"any\"`");
        Some(self.problem(at, "this machine has no such core", advice))
    }

    /// The program has an executor or a thread of this name.
    pub fn enter_thread(&self, name: &str) {
        let threads = &mut self.done().threads;
        if !threads.iter().any(|known| known == name) {
            threads.push(name.to_owned());
        }
    }
}
