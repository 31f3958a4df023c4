//! The process that simulates a unit's mechanics, and where their state stays when their program is
//! killed.

use crate::mechanics::{Mechanics, SAVED};
use crate::messages::{Contents, Drive, Fault, Handed, Sensors};
use crate::parameters::{BLOCKS, PERIOD, Unit};
use luna::prelude::*;
use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::FileExt;
use std::path::Path;

/// Cycles between two samples of where the blocks are.
const CYCLES_OF_PLACES: u32 = 10;
/// Cycles between two saved states.
const CYCLES_OF_SAVE: u32 = 10;

/// The simulated machine.
pub(crate) struct Simulation {
    pub(crate) mechanics: Mechanics,
    pub(crate) world: World,
    pub(crate) drive: Drive,
    pub(crate) inputs: (
        Receiver<Handed>,
        Receiver<Drive>,
        Receiver<Fault>,
        Receiver<()>,
    ),
    pub(crate) outputs: (Sender<Sensors>, Sender<Contents>, Sender<Handed>),
    pub(crate) signals: (Signal<f32>, Signal<f32>, Signal<[f32; BLOCKS]>),
}

impl Simulation {
    pub(crate) async fn run(mut self) -> luna::Result<()> {
        let (take, drives, faults, gone) = &self.inputs;
        let (read, show, offer) = &self.outputs;
        let mechanics = &mut self.mechanics;
        let mut ticks = luna::ticks(PERIOD)?;
        let mut cycle = 0;
        let mut has_behind = true;
        loop {
            let is_alive = !mechanics.is_dead();
            pri_alt! {
                fault = faults.recv() => {
                    let Ok(fault) = fault else { return Ok(()) };
                    mechanics.set_fault(fault);
                },
                handed = take.recv_extended(), if has_behind && is_alive => match handed {
                    Ok(handed) => {
                        mechanics.take(*handed);
                        // Before the other unit learns that it was taken.
                        self.world.save(mechanics)?;
                    },
                    Err(_) => has_behind = false,
                },
                taken = gone.recv(), if is_alive => {
                    if taken.is_err() {
                        return Ok(());
                    }
                    mechanics.gave();
                    self.world.save(mechanics)?;
                },
                _ = ticks.tick() => {
                    if !is_alive {
                        continue;
                    }
                    if let Ok(drive) = drives.try_recv() {
                        self.drive = drive;
                    }
                    if let Some(handed) = mechanics.step(self.drive) {
                        let _ = offer.send(handed).await;
                    }
                    if cycle % CYCLES_OF_SAVE == 0 {
                        self.world.save(mechanics)?;
                    }
                    let sensors = mechanics.sensors();
                    self.signals.0.record(sensors.position as f32);
                    self.signals.1.record(sensors.count as f32);
                    if cycle % CYCLES_OF_PLACES == 0 {
                        self.signals.2.record(mechanics.places());
                    }
                    let _ = show.send(mechanics.contents()).await;
                    if read.send(sensors).await.is_err() {
                        return Ok(());
                    }
                    cycle += 1;
                },
            }
        }
    }
}

/// Where the mechanics' state stays while their program is not there.
pub(crate) struct World(Option<File>);

impl World {
    /// The file of a unit below `folder`, and the mechanics as they stand.
    pub(crate) fn open(folder: Option<&Path>, unit: Unit) -> io::Result<(Self, Mechanics)> {
        let Some(folder) = folder else {
            return Ok((Self(None), Mechanics::new(unit)));
        };
        let mut options = OpenOptions::new();
        let options = options.read(true).write(true).create(true).truncate(false);
        let file = options.open(folder.join(unit.name()))?;
        let mut saved = [0; SAVED];
        let mechanics = match file.read_exact_at(&mut saved, 0) {
            Ok(()) => Mechanics::restore(unit, &saved),
            Err(_) => Mechanics::new(unit),
        };
        Ok((Self(Some(file)), mechanics))
    }

    /// One write of a few hundred bytes: it is whole or not at all when the program is killed.
    fn save(&self, mechanics: &Mechanics) -> io::Result<()> {
        match &self.0 {
            Some(file) => file.write_all_at(&mechanics.save(), 0),
            None => Ok(()),
        }
    }
}
