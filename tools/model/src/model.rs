//! A model that has been read.

use crate::cspm::{CspmError, cspm};
use crate::draw;
use crate::elaborate::elaborate;
use crate::explore::{DEFAULT_MAX_STATES, Exploration, Limits, explore};
use crate::file::{Document, read};
use crate::generate::{self, File};
use crate::network::Network;
use crate::schedule::{self, Costs, Schedule};
use crate::spin::promela::promela;
use crate::spin::run::SpinError;
use crate::spin::{self, SpinCheck};
use crate::text::{Problem, Source};
use crate::trace::{self, Communication, TraceOptions, Traced};

/// A model: its processes and channels with all arrays and compositions laid out.
#[derive(Debug)]
pub struct Model {
    pub(crate) network: Network,
    pub(crate) document: Document,
    file: Box<str>,
    text: Box<str>,
}

/// A small model with comments, to begin with.
pub const TEMPLATE: &str = include_str!("template.toml");

impl Model {
    /// Reads a model from the text of a file. `file` is its name in errors.
    ///
    /// # Errors
    ///
    /// What is wrong first, with its place in the file.
    pub fn parse(file: &str, text: &str) -> Result<Self, Problem> {
        let document = read(file, text)?;
        let source = Source { name: file, text };
        let network = elaborate(source, &document)?;
        Ok(Self {
            network,
            document,
            file: file.into(),
            text: text.into(),
        })
    }

    pub(crate) fn source(&self) -> Source<'_> {
        Source {
            name: &self.file,
            text: &self.text,
        }
    }

    /// The model's name: that of the file, or `system`.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.network.name
    }

    /// How many processes with a body there are.
    #[must_use]
    pub fn processes(&self) -> usize {
        self.network.processes.len()
    }

    /// How many channels there are.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.network.channels.len()
    }

    /// The names of its processes, with the parts that they are in.
    pub fn process_names(&self) -> impl ExactSizeIterator<Item = &str> {
        self.network.processes.iter().map(|one| one.name.as_str())
    }

    /// The names of its channels, with the parts that they are in.
    pub fn channel_names(&self) -> impl ExactSizeIterator<Item = &str> {
        self.network.channels.iter().map(|one| one.name.as_str())
    }

    /// The titles of the properties of `check.ltl`.
    pub fn ltl(&self) -> impl Iterator<Item = &str> {
        self.network.ltl.iter().map(|(title, _)| title.as_str())
    }

    /// The limit on states that the file states, or [`DEFAULT_MAX_STATES`].
    #[must_use]
    pub fn max_states(&self) -> usize {
        self.network.max_states.unwrap_or(DEFAULT_MAX_STATES)
    }

    /// Looks at all states, at most `max_states` of them: for deadlocks, livelocks, assertions, the
    /// properties of `check.always`, and branches that no run takes.
    ///
    /// It takes [half of the free memory](crate::default_memory()) at most:
    /// see [`explore_within`](Self::explore_within).
    #[must_use]
    pub fn explore(&self, max_states: usize) -> Exploration {
        self.explore_within(Limits::of_states(max_states), |_, _| ())
    }

    /// As [`explore`](Self::explore), within other limits. Calls `progress` now and then with the
    /// number of states that were looked at, and of those that are known.
    ///
    /// At the limit of states, those that are known are looked at, and no more; at that of memory it
    /// ends at once. What was found until then is found, with the shortest ways.
    ///
    /// Not real-time. Equal parts of states are kept once: a state takes some 100 bytes, and some 16
    /// for each pair of values that no state had before.
    ///
    /// ```
    /// use luna_model::{Limit, Limits, Model};
    ///
    /// let model = Model::parse("first.toml", luna_model::TEMPLATE)?;
    /// let limits = Limits::of_states(model.max_states()).bytes(1000);
    /// let explored = model.explore_within(limits, |_, _| ());
    /// assert_eq!(explored.limit, Some(Limit::Memory(1000)));
    /// assert!(!explored.is_complete);
    /// # Ok::<(), luna_model::Problem>(())
    /// ```
    #[must_use]
    pub fn explore_within(
        &self,
        limits: Limits,
        mut progress: impl FnMut(usize, usize),
    ) -> Exploration {
        explore(&self.network, limits, &mut progress)
    }

    /// Whether communications are a trace of the model: whether one of its runs has them, and no
    /// others, in an order that their threads and times leave open. All else in the model may happen
    /// in between. Those of one thread come in the order in which it recorded them. Values are not
    /// recorded: a send or receive matches with any.
    ///
    /// Not real-time. It takes some memory for each state that the model may be in on the way, and
    /// O(1) for a communication that comes again in the same states.
    ///
    /// ```
    /// use luna_model::{Communication, Model, Party, TraceOptions, TraceVerdict};
    ///
    /// let model = Model::parse("first.toml", luna_model::TEMPLATE)?;
    /// let [producer, consumer] = [0, 1].map(Party::Process);
    /// let on_values = |time, sender, receiver| Communication {
    ///     thread: 0,
    ///     time,
    ///     channel: 0,
    ///     sender,
    ///     receiver,
    /// };
    /// let sent = on_values(5, producer, Party::None);
    /// let received = on_values(9, Party::None, consumer);
    /// let options = TraceOptions::default();
    /// let traced = model.trace(&[sent, received], &options);
    /// assert_eq!(traced.verdict, TraceVerdict::Accepted);
    /// let traced = model.trace(&[sent, received, received], &options);
    /// let TraceVerdict::Rejected(rejected) = traced.verdict else { panic!() };
    /// assert_eq!((traced.accepted, rejected.event), (2, 2));
    /// assert_eq!(rejected.allowed, ["producer -> values"]);
    /// # Ok::<(), luna_model::Problem>(())
    /// ```
    ///
    /// # Panics
    ///
    /// The channel of a communication, or a process of
    /// [`ended`](crate::TraceOptions::ended), is none of the model.
    #[must_use]
    pub fn trace(&self, events: &[Communication], options: &TraceOptions) -> Traced {
        self.trace_with(events, options, |_| ())
    }

    /// As [`trace`](Self::trace). Calls `progress` now and then with the number of communications
    /// that are a trace so far.
    ///
    /// # Panics
    ///
    /// As [`trace`](Self::trace).
    #[must_use]
    pub fn trace_with(
        &self,
        events: &[Communication],
        options: &TraceOptions,
        mut progress: impl FnMut(usize),
    ) -> Traced {
        trace::trace(&self.network, events, options, &mut progress)
    }

    /// The model in Promela, the language of SPIN.
    #[must_use]
    pub fn to_promela(&self) -> String {
        promela(&self.network).text
    }

    /// The model in CSPm, the input language of FDR, with assertions for deadlocks, livelocks, broken
    /// assertions and the properties of `check.always`. Comments at the end name the properties that
    /// are left out: those of `check.ltl`, and of `check.always` those that name a process with
    /// `par` or too many values.
    ///
    /// # Errors
    ///
    /// An expression may have a value beyond 32 bits.
    pub fn to_cspm(&self) -> Result<String, CspmError> {
        cspm(&self.network)
    }

    /// Lets SPIN look for deadlocks and assertions, and for the properties of `check.ltl`, under
    /// weak fairness: a process that can go on all the time does so at some time.
    ///
    /// Runs `spin` and a C compiler in a folder of its own below that of temporary files. Not
    /// real-time: at most 5 minutes and 2 GB for each of these questions.
    ///
    /// # Errors
    ///
    /// SPIN or a C compiler is missing, or does not take the model.
    pub fn check_with_spin(&self) -> Result<SpinCheck, SpinError> {
        spin::check(&self.network)
    }

    /// Reads a file of costs, `file` in errors: a table for each process, `[servo]` or
    /// `["arm.servo[0]"]`, with `cost = "120 us"` and `longest_poll = "40 us"`.
    ///
    /// # Errors
    ///
    /// What is wrong first, with its place in the file; as a process that the model does not have.
    pub fn parse_costs(&self, file: &str, text: &str) -> Result<Costs, Problem> {
        schedule::read_costs(&self.network, file, text)
    }

    /// Bounds the responses of all parts with a period, by what the model states and by `costs`. Of
    /// a figure that both have, the larger one counts.
    ///
    /// Not real-time.
    #[must_use]
    pub fn schedule(&self, costs: &Costs) -> Schedule {
        schedule::schedule(&self.network, costs)
    }

    /// The composition and the communication as an SVG file. LUNA's scope animates it by the events
    /// of a run (`docs/scope-pictures.md`).
    #[must_use]
    pub fn to_svg(&self) -> String {
        draw::svg(&self.network)
    }

    /// The same for Graphviz.
    #[must_use]
    pub fn to_dot(&self) -> String {
        draw::dot(&self.network)
    }

    /// The same as a flowchart of Mermaid.
    #[must_use]
    pub fn to_mermaid(&self) -> String {
        draw::mermaid(&self.network)
    }

    /// The files of a Rust package that runs the model; its manifest depends on `luna`. Not
    /// real-time.
    ///
    /// # Errors
    ///
    /// What cannot be written in Rust: names that collide there, several processes on one thread.
    pub fn generate(&self, luna: &generate::Luna) -> Result<Vec<File>, Problem> {
        generate::generate(self, luna)
    }
}
