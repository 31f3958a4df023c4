//! The deployments: the same units, on other places and with other links.

#[cfg(feature = "hosts")]
mod hosts;

#[cfg(feature = "hosts")]
pub use hosts::{Subnet, on_six_hosts, run_unit_on_host};

use crate::links::{Links, Local, Programs};
use crate::operator::{Log, Operator, Plan};
use crate::outcome::Outcome;
use crate::parameters::Unit;
use crate::unit::{self, Options, Panel};
use luna::prelude::*;
use luna::system::Executor;
use std::fmt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use tempfile::TempDir;

/// Each unit has a controller's loop, and the operator one.
const LOOPS: usize = 8;

/// Where the units are within one program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// All on one executor.
    Executor,
    /// Each on a thread of its own.
    Threads,
}

/// How a cell is run.
#[derive(Debug, Clone)]
pub struct Settings {
    /// What the operator does.
    pub plan: Plan,
    /// The scheduling policy of the units' threads. Where it is refused, they are ordinary ones.
    pub policy: Policy,
    /// Whether the failures of neighbours are heeded: only a test says no.
    pub heeds_neighbours: bool,
}

/// Adds a cell to `system`: six units in this program, and the operator on a thread. Returns what
/// the operator knows when the system has run. On a virtual clock, too.
///
/// # Errors
///
/// Those of building the system.
///
/// ```
/// use luna::prelude::*;
/// use luna_production_cell::{Plan, Settings, deploy};
/// use std::time::Duration;
///
/// let mut system = System::new("production cell");
/// system.virtual_clock();
/// let plan = Plan { time: Duration::from_secs(5), exchange: None, drills: vec![] };
/// let settings = Settings { plan, policy: Policy::Other, heeds_neighbours: true };
/// let cell = deploy::in_one_program(&mut system, deploy::Place::Executor, settings)?;
/// system.run()?;
/// let outcome = cell.outcome();
/// assert!(outcome.blocks >= 3 && outcome.is_good());
/// # Ok::<(), luna::Error>(())
/// ```
pub fn in_one_program(system: &mut System, place: Place, settings: Settings) -> luna::Result<Cell> {
    system.max_loops(LOOPS);
    let mut links = Local::default();
    let build =
        |system: &mut System, name: &str| system.executor(name).policy(settings.policy).build();
    let shared: Option<Executor> = match place {
        Place::Executor => Some(build(system, "cell")?),
        Place::Threads => None,
    };
    for unit in Unit::ALL {
        let own = match &shared {
            Some(_) => None,
            None => Some(build(system, unit.name())?),
        };
        let options = Options {
            heeds_neighbours: settings.heeds_neighbours,
            world: None,
        };
        if let Some(executor) = own.as_ref().or(shared.as_ref()) {
            unit::build(unit, executor, &mut links, options)?;
        }
    }
    let panels = Unit::ALL.map(|unit| Panel::new(unit, &mut links));
    let panels = panels.into_iter().collect::<luna::Result<_>>()?;
    let cell = Cell::default();
    let operator = Operator {
        plan: settings.plan,
        panels,
        programs: None,
        log: Arc::clone(&cell.log),
    };
    let executor = system.executor("operator").policy(Policy::Other).build()?;
    executor.process("operator").spawn(operator.run())?;
    Ok(cell)
}

/// How the program of a unit is started: itself again, with these arguments, to which the unit's
/// name, the cell's name and the folder of its world are added. It is to call [`run_unit`] with
/// them.
#[derive(Debug, Clone)]
pub struct Program {
    /// The file.
    pub file: PathBuf,
    /// The first arguments.
    pub arguments: Vec<String>,
}

/// Adds the operator of a cell to `system`, and starts the programs of its six units. They end with
/// the operator. Those that do not are killed when the result is dropped.
///
/// # Errors
///
/// A program cannot be started, or those of building the system.
pub fn in_six_programs(
    system: &mut System,
    program: Program,
    settings: Settings,
) -> luna::Result<Cell> {
    let name = format!("cell/{}", std::process::id());
    let of_cell = name.clone();
    let children = Children::start_all(move |unit| {
        let mut command = Command::new(&program.file);
        command
            .args(&program.arguments)
            .args([unit.name(), &of_cell]);
        command
    })?;
    let executor = system.executor("operator").policy(Policy::Other).build()?;
    let mut links = Programs::new(&executor, &name);
    operated(&executor, &mut links, children, settings)
}

/// Spawns the operator of units that are programs.
fn operated(
    executor: &Executor,
    links: &mut impl Links,
    children: Children,
    settings: Settings,
) -> luna::Result<Cell> {
    let children = Arc::new(Mutex::new(children));
    let panels = Unit::ALL.map(|unit| Panel::new(unit, links));
    let panels = panels.into_iter().collect::<luna::Result<_>>()?;
    let cell = Cell {
        log: Arc::default(),
        _programs: Some(Arc::clone(&children)),
    };
    let operator = Operator {
        plan: settings.plan,
        panels,
        programs: Some(Box::new(children)),
        log: Arc::clone(&cell.log),
    };
    executor.process("operator").spawn(operator.run())?;
    Ok(cell)
}

/// Runs one unit as a program of its own, until its operator ends it, or is gone.
///
/// # Errors
///
/// Those of building and running the system.
pub fn run_unit(unit: Unit, cell: &str, world: &Path, policy: Policy) -> luna::Result<()> {
    let (system, executor) = system_of(unit, policy)?;
    let mut links = Programs::new(&executor, cell);
    unit::build(unit, &executor, &mut links, of_a_program(world))?;
    drop(executor);
    system.run().map(drop)
}

fn system_of(unit: Unit, policy: Policy) -> luna::Result<(System, Executor)> {
    let mut system = System::new(unit.name());
    system.announce().max_loops(LOOPS);
    let executor = system.executor(unit.name()).policy(policy).build()?;
    Ok((system, executor))
}

fn of_a_program(world: &Path) -> Options<'_> {
    Options {
        heeds_neighbours: true,
        world: Some(world),
    }
}

/// The programs of the units.
struct Children {
    /// How a unit's program is started; the folder of its world is added.
    command: Box<dyn Fn(Unit) -> Command + Send>,
    /// Removed with this.
    world: TempDir,
    running: [Option<Child>; 6],
}

impl Children {
    fn start_all(command: impl Fn(Unit) -> Command + Send + 'static) -> luna::Result<Self> {
        // A new one, that no other user can enter: a name alone may be taken.
        let world = tempfile::Builder::new().prefix("luna-cell-").tempdir()?;
        let mut children = Self {
            command: Box::new(command),
            world,
            running: [const { None }; 6],
        };
        for unit in Unit::ALL {
            children.start(unit)?;
        }
        Ok(children)
    }

    fn start(&mut self, unit: Unit) -> luna::Result<()> {
        let mut command = (self.command)(unit);
        command.arg(self.world.path());
        let quiet = command.stdin(Stdio::null()).stdout(Stdio::null());
        self.running[unit as usize] = Some(quiet.spawn()?);
        Ok(())
    }
}

impl fmt::Debug for Children {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Children")
            .field("world", &self.world)
            .field("running", &self.running)
            .finish_non_exhaustive()
    }
}

impl crate::operator::Programs for Arc<Mutex<Children>> {
    fn kill(&mut self, unit: Unit) -> luna::Result<()> {
        let mut children = self.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(mut child) = children.running[unit as usize].take() {
            child.kill()?;
            child.wait()?;
        }
        Ok(())
    }

    fn restart(&mut self, unit: Unit) -> luna::Result<()> {
        let mut children = self.lock().unwrap_or_else(PoisonError::into_inner);
        children.start(unit)
    }
}

impl Drop for Children {
    fn drop(&mut self) {
        // The operator has asked them to end, or its links do, since it is gone.
        let limit = std::time::Instant::now() + std::time::Duration::from_secs(2);
        for child in self.running.iter_mut().flatten() {
            while matches!(child.try_wait(), Ok(None)) && std::time::Instant::now() < limit {
                std::thread::sleep(std::time::Duration::from_millis(5));
            }
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// A cell that runs, or has run. Keep it until its system has run: the programs of its units are
/// waited for when it is dropped.
#[derive(Debug, Default)]
pub struct Cell {
    log: Arc<Mutex<Log>>,
    _programs: Option<Arc<Mutex<Children>>>,
}

impl Cell {
    /// What became of it; complete when its system has run.
    pub fn outcome(&self) -> Outcome {
        let log = self.log.lock().unwrap_or_else(PoisonError::into_inner);
        Outcome::of(log.clone())
    }
}
