//! A parameter, as its process has it.

use super::cells::Cells;
use super::error::DeclareError;
use super::form::Form;
use super::store::{Declared, Store};
use super::types::{Number, Tunable};
use super::value::Value;
use luna_core::current::ProcessId;
use std::marker::PhantomData;
use std::ops::RangeInclusive;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// A value that is set from outside, and read on the real-time path: see [`parameters`](super).
///
/// Declared with `ProcessBuilder::parameter`, and moved
/// into the process' body, as a channel's end is. Clones are the same parameter. Elsewhere than in
/// the process that it was declared for, a handle reads what that process has taken.
///
/// ```
/// use luna::parameters::Choice;
/// use luna::prelude::*;
///
/// #[derive(Clone, Copy, PartialEq)]
/// enum Mode { Position, Speed }
///
/// impl Choice for Mode {
///     const CHOICES: &'static [(&'static str, Mode)] = &[("position", Mode::Position), ("speed", Mode::Speed)];
/// }
///
/// let mut system = System::new("drive");
/// system.set_parameter("axis/mode", "speed").set_parameter("axis/gains", [1.0, 2.0, 3.0]);
/// let main = system.executor("main").build()?;
/// let axis = main.process("axis");
/// let mode = axis.parameter("axis/mode", Mode::Position).register()?;
/// let gains = axis.parameter("axis/gains", [2.0_f32, 0.0, 0.1]).range(0.0..=10.0).register()?;
/// axis.spawn(async move {
///     assert!(mode.get() == Mode::Speed);
///     assert_eq!(gains.get(), [1.0, 2.0, 3.0]);
///     Ok(())
/// })?;
/// system.run()?;
/// # Ok::<(), luna::Error>(())
/// ```
pub struct Parameter<T> {
    cells: Arc<Cells>,
    has: PhantomData<fn() -> T>,
}

impl<T: Tunable> Parameter<T> {
    /// The value, of the set that the process has taken last; before the start the default.
    ///
    /// Real-time path: yes. O(elements), no allocation: a load for each element. All elements are
    /// of one set. In another process, or on another thread, an array is read under a lock, which
    /// the process holds while it takes a new set. It never gives a value that the process has not
    /// taken.
    #[inline]
    pub fn get(&self) -> T {
        if T::IS_ARRAY {
            let make = |words: &[AtomicU64]| T::of_words(|i| words[i].load(Ordering::Relaxed));
            self.cells.several(make)
        } else {
            T::of_words(|_| self.cells.word())
        }
    }

    /// Takes the latest set, for all parameters of the process: for a process without a
    /// loop, since a loop's `next` does it.
    ///
    /// Real-time path: yes. No allocation: a load, and if there is a new set O(the process'
    /// parameters) under a lock, which a set holds as long. Elsewhere than in the process that the
    /// parameter was declared for it does nothing.
    #[inline]
    pub fn latch(&self) {
        self.cells.reader.latch();
    }
}

impl<T> Clone for Parameter<T> {
    fn clone(&self) -> Self {
        Self {
            cells: self.cells.clone(),
            has: PhantomData,
        }
    }
}

luna_platform::debug_fields!(impl[T] Parameter<T>, |parameter| name: parameter.cells.name());

/// A parameter to be: see
/// `ProcessBuilder::parameter`.
#[must_use = "a parameter is declared by `register`"]
#[derive(Clone)]
pub struct ParameterBuilder<'a, T> {
    store: &'a Store,
    /// Set when it is refused.
    refused: &'a AtomicBool,
    /// The process that it is declared for, by number and name.
    process: (ProcessId, &'a str),
    declared: Declared,
    has: PhantomData<fn() -> T>,
}

impl<'a, T: Tunable> ParameterBuilder<'a, T> {
    #[doc(hidden)]
    pub fn new(
        store: &'a Store,
        refused: &'a AtomicBool,
        process: (ProcessId, &'a str),
        name: &str,
        default: T,
    ) -> Self {
        let declared = Declared {
            name: name.into(),
            unit: String::new(),
            description: String::new(),
            form: Form {
                kind: T::kind(),
                elements: T::IS_ARRAY.then_some(T::WORDS),
                range: None,
            },
            default: (0..T::WORDS).map(|index| default.word(index)).collect(),
            is_shared: false,
        };
        Self {
            store,
            refused,
            process,
            declared,
            has: PhantomData,
        }
    }

    /// What it is measured in.
    pub fn unit(mut self, unit: &str) -> Self {
        self.declared.unit = unit.to_owned();
        self
    }

    /// What it is, in a few words.
    pub fn description(mut self, text: &str) -> Self {
        self.declared.description = text.to_owned();
        self
    }

    /// Between which values it, or each of its elements, may be.
    pub fn range(mut self, range: RangeInclusive<T::Element>) -> Self
    where
        T::Element: Number + Into<Value>,
    {
        let (least, most) = range.into_inner();
        self.declared.form.range = Some((least.into(), most.into()));
        self
    }

    /// Other processes may declare it too, alike. Each takes a set at its own cycle's begin.
    pub fn shared(mut self) -> Self {
        self.declared.is_shared = true;
        self
    }

    /// Declares it. The start then gives it its first value; while the system runs it has that at
    /// once. Its name is free again when all its handles are gone, for a parameter that is declared
    /// alike: it goes on with the old value. Its description, and whether it is
    /// [shared](Self::shared), are then as newly declared.
    ///
    /// Not for the real-time path: it allocates, and takes a lock. O(processes that have
    /// parameters).
    ///
    /// # Errors
    ///
    /// A [`DeclareError`]: a name that another has, or that cannot be written in a file; a text
    /// that is too long; a range or a default that makes no sense. A value of the file that is out
    /// of range is no error of this: the start fails with all of those.
    pub fn register(self) -> Result<Parameter<T>, DeclareError> {
        let refused = self.refused;
        self.declare()
            .inspect_err(|_| refused.store(true, Ordering::Relaxed))
    }

    fn declare(mut self) -> Result<Parameter<T>, DeclareError> {
        let Declared {
            name,
            form,
            default,
            ..
        } = &mut self.declared;
        if let Some((least, most)) = &form.range
            && !is_range(least, most)
        {
            return Err(DeclareError::Range {
                parameter: name.to_string(),
                range: format!("{least} to {most}"),
            });
        }
        let value = form.unpack(default);
        *default = form.pack(&value).map_err(|reason| DeclareError::Default {
            parameter: name.to_string(),
            value: value.to_string(),
            reason,
        })?;
        let (process, its_name) = self.process;
        let cells = self.store.declare(self.declared, process, its_name)?;
        Ok(Parameter {
            cells,
            has: PhantomData,
        })
    }
}

luna_platform::debug_fields!(
    impl[T] ParameterBuilder<'_, T>, |builder|
    name: builder.declared.name
);

fn is_range(least: &Value, most: &Value) -> bool {
    match (least, most) {
        (Value::Float(least), Value::Float(most)) => {
            least.is_finite() && most.is_finite() && least <= most
        }
        (Value::Integer(least), Value::Integer(most)) => least <= most,
        _ => false,
    }
}
