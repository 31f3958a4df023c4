//! The simulated mechanics of a unit: an axis with its motor, the blocks, and what collides.
//!
//! Blocks pass from unit to unit where the mechanics bring them, whatever the software believes. A
//! collision is
//!
//! - a block that comes to a unit with no room for it: to an arm that holds one, or that is not
//!   where it takes blocks; to a belt with another block at its entry;
//! - a block that a belt pushes further than [`OVERHANG`] against a unit that does not take it;
//! - a block that an arm has let go and then moves away from.

use crate::messages::{Contents, Drive, Fault, Handed, Sensors};
use crate::parameters::{
    BLOCK, BLOCKS, BROKEN_READING, DT, ENTRY, EXIT, Kind, MOTOR_TIME, OVERHANG, PLACES, Parameters,
    REACH, RESERVE, Unit, first_block,
};

/// A block, and where on a belt it lies.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Place {
    block: u32,
    at: f64,
}

/// The mechanics of one unit.
#[derive(Debug, Clone)]
pub struct Mechanics {
    parameters: &'static Parameters,
    position: f64,
    speed: f64,
    /// The one that leaves first is the first.
    blocks: [Option<Place>; PLACES],
    taken: u32,
    given: u32,
    collisions: u32,
    /// The block that stands at the neighbour.
    offered: Option<Handed>,
    /// The offered block has collided already.
    has_hit: bool,
    fault: Fault,
}

impl Mechanics {
    /// As at the first start.
    pub fn new(unit: Unit) -> Self {
        let parameters = unit.parameters();
        let mut blocks = [None; PLACES];
        for (n, (place, at)) in blocks.iter_mut().zip(parameters.blocks).enumerate() {
            let block = first_block(unit) + n as u32;
            *place = Some(Place { block, at: *at });
        }
        Self {
            parameters,
            position: parameters.take,
            speed: 0.0,
            blocks,
            taken: 0,
            given: 0,
            collisions: 0,
            offered: None,
            has_hit: false,
            fault: Fault::None,
        }
    }

    /// Breaks or heals it.
    pub fn set_fault(&mut self, fault: Fault) {
        self.fault = fault;
    }

    /// Whether it does nothing any more.
    pub fn is_dead(&self) -> bool {
        self.fault == Fault::Dead
    }

    /// One cycle. Returns the block that has come to the neighbour in it.
    pub fn step(&mut self, drive: Drive) -> Option<Handed> {
        let full = RESERVE * self.parameters.speed;
        self.speed += (drive.duty * full - self.speed) * DT / MOTOR_TIME;
        if self.fault == Fault::Stuck {
            self.speed = 0.0;
        }
        let way = self.speed * DT;
        self.position += way;
        let give = self.parameters.give;
        let first = match self.parameters.kind {
            Kind::Belt => {
                for place in self.blocks.iter_mut().flatten() {
                    place.at += way;
                }
                if self.blocks[0].is_some_and(|place| place.at > give + OVERHANG) {
                    self.hit();
                }
                self.blocks[0].filter(|place| place.at >= give)
            }
            Kind::Arm => {
                let distance = (self.position - give).abs();
                if self.offered.is_some() && distance > 2.0 * REACH {
                    self.hit();
                }
                self.blocks[0].filter(|_| drive.release && distance <= REACH)
            }
        };
        if self.offered.is_some() {
            return None;
        }
        self.offered = first.map(|place| Handed {
            number: self.given + 1,
            block: place.block,
        });
        self.offered
    }

    fn hit(&mut self) {
        if !self.has_hit {
            self.collisions += 1;
            self.has_hit = true;
        }
    }

    /// The neighbour has taken the offered block.
    pub fn gave(&mut self) {
        if self.offered.take().is_some() {
            self.given += 1;
            self.has_hit = false;
            self.blocks.rotate_left(1);
            self.blocks[PLACES - 1] = None;
        }
    }

    /// A block comes. One that came before is not taken twice.
    pub fn take(&mut self, handed: Handed) {
        if handed.number <= self.taken {
            return;
        }
        let count = self.blocks.iter().flatten().count();
        let has_room = match self.parameters.kind {
            Kind::Belt => self.blocks.iter().flatten().all(|place| place.at >= BLOCK),
            Kind::Arm => count == 0 && (self.position - self.parameters.take).abs() <= REACH,
        };
        if !has_room || handed.number != self.taken + 1 {
            self.collisions += 1;
        }
        self.taken = handed.number;
        if let Some(place) = self.blocks.get_mut(count) {
            let (block, at) = (handed.block, 0.0);
            *place = Some(Place { block, at });
        }
    }

    /// What the sensors read.
    pub fn sensors(&self) -> Sensors {
        let is_any = |at: fn(f64, f64) -> bool| {
            let mut places = self.blocks.iter().flatten();
            match self.parameters.kind {
                Kind::Belt => places.any(|place| at(place.at, self.parameters.give)),
                Kind::Arm => places.next().is_some(),
            }
        };
        Sensors {
            position: match self.fault {
                Fault::Sensor => BROKEN_READING,
                _ => self.position,
            },
            entry: is_any(|at, _| at < ENTRY),
            exit: is_any(|at, end| at > end - EXIT),
            taken: self.taken,
            given: self.given,
            count: self.blocks.iter().flatten().count() as u32,
        }
    }

    /// Where on the unit each block lies, in m: block 1, block 2 and so on; not a number if it is
    /// not here. On an arm it is where the axis is.
    pub fn places(&self) -> [f32; BLOCKS] {
        let mut places = [f32::NAN; BLOCKS];
        for Place { block, at } in self.blocks.iter().flatten() {
            let at = match self.parameters.kind {
                Kind::Belt => *at,
                Kind::Arm => self.position,
            };
            if let Some(place) = places.get_mut((*block as usize).wrapping_sub(1)) {
                *place = at as f32;
            }
        }
        places
    }

    /// What it holds.
    pub fn contents(&self) -> Contents {
        Contents {
            blocks: self
                .blocks
                .map(|place| place.map_or(0, |place| place.block)),
            under_way: self.offered.is_some(),
            taken: self.taken,
            given: self.given,
            collisions: self.collisions,
        }
    }

    /// The state that stays when the unit's program is killed, as matter does: see
    /// [`restore`](Self::restore).
    pub(crate) fn save(&self) -> [u8; SAVED] {
        let mut numbers = [0.0; SAVED / 8];
        let head = [self.position, self.taken.into(), self.given.into()];
        numbers[..3].copy_from_slice(&head);
        numbers[3] = self.collisions.into();
        for (n, place) in self.blocks.iter().flatten().enumerate() {
            numbers[4 + 2 * n] = place.block.into();
            numbers[5 + 2 * n] = place.at;
        }
        let mut bytes = [0; SAVED];
        for (bytes, number) in bytes.chunks_exact_mut(8).zip(numbers) {
            bytes.copy_from_slice(&number.to_le_bytes());
        }
        bytes
    }

    /// Of a unit that is started again, with its motor at rest.
    pub(crate) fn restore(unit: Unit, bytes: &[u8; SAVED]) -> Self {
        let mut numbers = [0.0; SAVED / 8];
        for (number, bytes) in numbers.iter_mut().zip(bytes.chunks_exact(8)) {
            *number = f64::from_le_bytes(bytes.try_into().unwrap_or_default());
        }
        let mut mechanics = Self::new(unit);
        mechanics.position = numbers[0];
        mechanics.taken = numbers[1] as u32;
        mechanics.given = numbers[2] as u32;
        mechanics.collisions = numbers[3] as u32;
        for (n, place) in mechanics.blocks.iter_mut().enumerate() {
            let (block, at) = (numbers[4 + 2 * n] as u32, numbers[5 + 2 * n]);
            *place = (block != 0).then_some(Place { block, at });
        }
        mechanics
    }
}

/// The bytes of a saved state.
pub(crate) const SAVED: usize = 8 * (4 + 2 * PLACES);

#[cfg(test)]
mod tests {
    use super::*;

    fn run(mechanics: &mut Mechanics, duty: f64, cycles: usize) -> Option<Handed> {
        let release = false;
        let steps = (0..cycles).map(|_| mechanics.step(Drive { duty, release }));
        steps.fold(None, Option::or)
    }

    #[test]
    fn a_block_that_passes_the_end_is_handed_over_once() {
        let mut belt = Mechanics::new(Unit::FeederBelt);
        let handed = run(&mut belt, 0.8, 300).unwrap();
        assert_eq!(
            handed,
            Handed {
                number: 1,
                block: 1
            }
        );
        belt.gave();
        assert_eq!(belt.contents().blocks[..3], [2, 3, 0]);
        assert_eq!((belt.contents().given, belt.contents().collisions), (1, 0));
    }

    #[test]
    fn a_block_that_nobody_takes_collides() {
        let mut belt = Mechanics::new(Unit::FeederBelt);
        run(&mut belt, 0.8, 1000);
        assert_eq!(belt.contents().collisions, 1);
    }

    #[test]
    fn a_block_that_comes_to_an_arm_elsewhere_collides() {
        let mut feeder = Mechanics::new(Unit::Feeder);
        run(&mut feeder, 0.8, 100);
        feeder.take(Handed {
            number: 1,
            block: 7,
        });
        assert_eq!(feeder.contents().collisions, 1);
    }

    #[test]
    fn the_same_hand_over_counts_once() {
        let mut feeder = Mechanics::new(Unit::Feeder);
        for _ in 0..2 {
            feeder.take(Handed {
                number: 1,
                block: 7,
            });
        }
        let contents = feeder.contents();
        assert_eq!((contents.taken, contents.collisions), (1, 0));
        assert_eq!(contents.blocks[..2], [7, 0]);
    }

    #[test]
    fn a_block_lies_on_a_belt_or_where_the_arm_is() {
        let mut belt = Mechanics::new(Unit::ExtractionBelt);
        run(&mut belt, 0.8, 100);
        let [.., fourth, fifth] = belt.places();
        assert!(
            (fourth - fifth - 0.1).abs() < 1e-6 && fourth > 0.3,
            "{fourth} {fifth}"
        );
        assert!(belt.places()[..3].iter().all(|place| place.is_nan()));

        let mut robot = Mechanics::new(Unit::Robot);
        robot.take(Handed {
            number: 1,
            block: 2,
        });
        run(&mut robot, 0.5, 100);
        let place = robot.places()[1];
        assert!(place > 0.0 && f64::from(place) - robot.sensors().position < 1e-6);
        robot.set_fault(Fault::Sensor);
        assert_eq!(robot.places()[1], place);
    }

    #[test]
    fn a_killed_unit_stands_where_it_stood() {
        let mut belt = Mechanics::new(Unit::ExtractionBelt);
        run(&mut belt, 0.8, 500);
        belt.gave();
        let again = Mechanics::restore(Unit::ExtractionBelt, &belt.save());
        assert_eq!(again.contents(), belt.contents());
        assert_eq!(again.sensors(), belt.sensors());
    }

    #[test]
    fn a_stuck_axis_stands_and_a_broken_sensor_lies() {
        let mut robot = Mechanics::new(Unit::Robot);
        robot.set_fault(Fault::Stuck);
        run(&mut robot, 1.0, 100);
        assert_eq!(robot.sensors().position, 0.0);
        robot.set_fault(Fault::Sensor);
        assert_eq!(robot.sensors().position, BROKEN_READING);
    }
}
