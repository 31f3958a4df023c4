//! A model and a system of this program: whether it is wired as the model says, and a model file of
//! it.

mod differences;
mod read;
#[cfg(test)]
mod tests;

use crate::model::Model;
use crate::recorded::Recorded;
use luna::System;
use luna::inspect::{Composition, Observer};

pub use differences::{Difference, Wiring};

/// The model of a system, and its comparison with one: for a [`System`], an [`Observer`] of one
/// that runs, or a [`Composition`].
///
/// ```
/// use luna::prelude::*;
/// use luna_model::{Model, SystemModel};
///
/// # fn build(priority: u8) -> luna::Result<System> {
/// let mut system = System::new("pair");
/// let main = system.executor("main").build()?;
/// let (output, input) = luna::channel::<u32>();
/// let output = output.named("values");
/// main.process("producer").priority(priority).spawn(async move {
///     Ok(output.send(1).await?)
/// })?;
/// main.process("consumer").spawn(async move {
///     input.recv().await?;
///     Ok(())
/// })?;
/// # Ok(system)
/// # }
/// # let mut system = build(3)?;
/// let text = system.model();
/// let model = Model::parse("pair.toml", &text).map_err(luna::Error::other)?;
/// system.check_wiring(&model).map_err(luna::Error::other)?;
///
/// # let system = build(4)?;
/// let wiring = system.check_wiring(&model).unwrap_err();
/// assert_eq!(wiring.differences[0].to_string(), "process `producer`: priority 4, in the model 3");
/// # Ok::<(), luna::Error>(())
/// ```
pub trait SystemModel {
    /// Its parts, at this moment.
    fn parts(&self) -> Composition;

    /// A model file of it: its processes, priorities, executors, and the channels that were used up
    /// to now, with what used them last. A process takes its communications in any order there: that
    /// is for the reader to refine. Before the start no channel was used.
    ///
    /// Not real-time: it allocates.
    fn model(&self) -> String {
        let parts = self.parts();
        let source = format!("the system {}", parts.system);
        Recorded::of(&parts).to_model(&source)
    }

    /// Whether it is as the model says: its processes with their priorities; their executors and
    /// threads with cores and policies, those that were asked for before the start, later those that
    /// were obtained; its channels with buffers and users, as far as they were used up to now. So a
    /// check before the start compares what runs where, and one by an [`Observer`] of the running
    /// system the channels too.
    ///
    /// What the model leaves open may be as it will. A process `outside` of the model stands for what
    /// is not in the system. Names are compared as
    /// [`name_in_model`](crate::name_in_model) writes them.
    ///
    /// Not real-time: it allocates.
    ///
    /// # Errors
    ///
    /// All differences.
    fn check_wiring(&self, model: &Model) -> Result<(), Wiring> {
        let differences = differences::between(&model.network, &self.parts());
        match differences.is_empty() {
            true => Ok(()),
            false => Err(Wiring {
                model: model.name().to_owned(),
                differences,
            }),
        }
    }
}

impl SystemModel for Composition {
    fn parts(&self) -> Composition {
        self.clone()
    }
}

impl SystemModel for System {
    fn parts(&self) -> Composition {
        self.composition()
    }
}

impl SystemModel for Observer {
    fn parts(&self) -> Composition {
        self.composition()
    }
}
